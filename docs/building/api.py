"""The API reference: one page for every public name, listed by subject.

The names come from the packages themselves (`lpvid/__init__.pyi`, `__all__` of `lpvid.plot`, of `quartercar` and of its
modules), so that a name without a page is not possible.
"""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path

import lpvid
import quartercar

SUBJECTS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "data": ("Data and its audit", ("record", "files", "auditing", "errors")),
    "models": ("Models, scheduling and simulation", ("model", "scheduling", "realization", "simulation")),
    "identification": ("Identification and validation", ("identification", "validation")),
    "analysis": ("Stability, gain and passivity", ("analysis", "lmi")),
    "synthesis": ("Plants and synthesis", ("synthesis",)),
    "diagnosis": ("Diagnosis", ("diagnosis", "effects", "baselines")),
    "export": ("Files and exports", ("export",)),
}
"""Page of the reference, its title, and the subpackages of `lpvid` whose public names stand on it."""

MODULES: Mapping[str, str] = {
    "lpvid.plot": "Figures of lpvid",
    "lpvid.condition": "Conditioning of records",
    "lpvid.excitation": "Excitation signals",
    "lpvid.effects": "Effects of one's own",
    "lpvid.baselines": "Baselines of one's own",
    "quartercar.dampers": "Damper models",
    "quartercar.rig": "The virtual rig",
    "quartercar.roads": "Roads",
    "quartercar.parameters": "Parameters of cars",
    "quartercar.criteria": "Criteria of a ride",
    "quartercar.controllers": "Control laws",
    "quartercar.lpv_models": "Plants of the quarter car",
    "quartercar.effects": "Effects that a diagnosis can name",
    "quartercar.plot": "Figures of quartercar",
}
"""Public modules whose names have pages of their own, with the title of the list."""


def public_names(module: str) -> list[str]:
    """Names that a module offers: its `__all__`, or what it defines without a leading underscore."""
    found = importlib.import_module(module)
    names = getattr(found, "__all__", None)
    if names is None:
        names = [
            n
            for n, value in vars(found).items()
            if not n.startswith("_") and is_documented(value) and getattr(value, "__module__", None) == module
        ]
    return sorted((n for n in names if not n.startswith("_")), key=str.lower)


def is_documented(value: object) -> bool:
    """Whether a page of autodoc can be made of it: a class or a function."""
    return inspect.isclass(value) or inspect.isroutine(value)


def exports() -> dict[str, list[str]]:
    """Public names of `lpvid` by the module that defines them, as `lpvid/__init__.pyi` lists them."""
    stub = ast.parse(Path(lpvid.__file__).with_suffix(".pyi").read_text())
    home: dict[str, list[str]] = {}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom) and node.module:  # not `from . import plot`, a module with its own page
            home.setdefault(f"lpvid.{node.module}", []).extend(alias.name for alias in node.names)
    return home


def lpvid_lists() -> dict[str, list[str]]:
    """Full names of `lpvid` by page; every name of `lpvid/__init__.pyi` is on exactly one."""
    lists: dict[str, list[str]] = {page: [] for page in SUBJECTS}
    home = {part: page for page, (_, parts) in SUBJECTS.items() for part in parts}
    for module, names in exports().items():
        part = module.split(".")[1]
        if part not in home:
            raise KeyError(f"lpvid.{part} has public names but no page of the reference: add it to SUBJECTS")
        lists[home[part]] += [f"lpvid.{name}" for name in names]
    return {page: sorted(names, key=str.lower) for page, names in lists.items()}


def module_lists() -> dict[str, list[str]]:
    """Full names of the public modules by module, and those of `quartercar` itself."""
    ours = {id(getattr(lpvid, name)) for names in exports().values() for name in names}  # on a page of lpvid
    lists = {}
    for module in MODULES:
        found = importlib.import_module(module)
        lists[module] = [f"{module}.{n}" for n in public_names(module) if id(getattr(found, n)) not in ours]
    own = [name for name in quartercar.__all__ if not inspect.ismodule(getattr(quartercar, name))]
    return {"quartercar": [f"quartercar.{name}" for name in own], **lists}


def split_kinds(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Classes and functions, which have pages; and plain values (tuples, mappings), which are listed."""
    documented, values = [], []
    for name in names:
        module, _, last = name.rpartition(".")
        (documented if is_documented(getattr(importlib.import_module(module), last)) else values).append(name)
    return documented, values


def _page(title: str, module: str, names: Sequence[str], intro: str) -> str:
    documented, values = split_kinds(names)
    lines = [title, "=" * len(title), "", intro, "", f".. currentmodule:: {module}", ""]
    if documented:
        lines += [".. autosummary::", "   :toctree: names", "   :template: name.rst", ""]
        lines += [f"   {name.removeprefix(module + '.')}" for name in documented]
    for name in values:
        value = getattr(importlib.import_module(module), name.rpartition(".")[2])
        lines += [
            "",
            f".. py:data:: {name}",
            f"   :type: {type(value).__name__}",
            "",
            "   " + (_summary(value) or "A constant of the module."),
        ]
    return "\n".join(lines) + "\n"


def _summary(value: object) -> str:
    """What a constant holds: its keys or names where it is a collection."""
    if isinstance(value, Mapping):
        return "Keys: " + ", ".join(f"``{key}``" for key in value) + "."
    if isinstance(value, (tuple, list)):
        return (
            "Members: " + ", ".join(f"``{getattr(v, 'name', None) or getattr(v, '__name__', v)}``" for v in value) + "."
        )
    return ""


def write_api(folder: Path) -> None:
    """Write one list of names per subject or module, and their index; autosummary makes the pages of the names."""
    folder.mkdir(parents=True, exist_ok=True)
    pages: dict[str, str] = {}
    for page, names in lpvid_lists().items():
        pages[f"lpvid-{page}"] = _page(SUBJECTS[page][0], "lpvid", names, "Public names of ``import lpvid as lpv``.")
    for module, names in module_lists().items():
        title = MODULES.get(module, "The car and the ride")
        first = (importlib.import_module(module).__doc__ or "").strip().splitlines()[0]
        pages[module.replace(".", "-")] = _page(title, module, names, f"``{module}``: {first}")
    index = [
        "API reference",
        "=============",
        "",
        "Every public name, from its docstring. Arrays are (n_samples, n_channels), values are SI.",
        "",
        ".. toctree::",
        "   :maxdepth: 1",
        "",
    ]
    pages["index"] = "\n".join([*index, *(f"   {page}" for page in pages)]) + "\n"
    for name, text in pages.items():
        _write_changed(folder / f"{name}.rst", text)
    present = {name for names in (*lpvid_lists().values(), *module_lists().values()) for name in names}
    for path in (folder / "names").glob("*.rst"):  # of names that are gone
        if path.stem not in present:
            path.unlink()


def _write_changed(path: Path, text: str) -> None:
    """Leave the file alone where it holds this text already, so that Sphinx does not read it again."""
    if not path.exists() or path.read_text(encoding="utf8") != text:
        path.write_text(text, encoding="utf8")
