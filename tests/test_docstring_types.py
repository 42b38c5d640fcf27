"""Types that docstrings name: a capitalised one in Parameters, Attributes, Returns or Yields is a class that exists.

A name counts where the module binds it (an import, `TYPE_CHECKING` or not, a class, an assignment), where a stub
exports it, where the packages define one class of it and it is of two words at least (`CarRun`; one of a single word
may be another module's `Run`), or where it is a builtin, of `typing` or of a foreign package that is written before
it (`matplotlib.axes.Axes`). What follows on the lines below a type is prose and is not looked at.
"""

from __future__ import annotations

import ast
import builtins
import re
import typing
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("lpvid", "quartercar")
SECTIONS = ("Parameters", "Attributes", "Other Parameters", "Returns", "Yields")
NAMED = ("Parameters", "Attributes", "Other Parameters")
NAME = re.compile(r"(?<![\w.])((?:\w+\.)*)([A-Z][A-Za-z0-9]*[a-z][A-Za-z0-9]*)")
"""A name in capitals (a constant, a dimension of an array) is no type."""
BESIDE = frozenset(dir(builtins)) | frozenset(dir(typing)) | {"Axes", "Dataset"}
"""with those of matplotlib and xarray that need no package before them."""
OPTIONAL = ("asammdf", "control", "distributed", "nptdms", "pandas", "polars", "xarray")
"""packages that need not be installed."""
FOREIGN = ("NonlinearIOSystem", "Axes", "Figure")
"""classes of other packages that prose names without their package."""
"""Known ones, to be mended with the next change of their module."""


def section_types(docstring: str) -> Iterator[str]:
    """The text of each type in the sections that state types: behind ``name :``, of Returns a line of its own too."""
    lines = docstring.splitlines()
    section, indent = "", 0
    for k, line in enumerate(lines):
        under = lines[k + 1].strip() if k + 1 < len(lines) else ""
        if len(under) >= 3 and not under.strip("-") and line.strip():
            section, indent = line.strip(), len(line) - len(line.lstrip())
            continue
        if section not in SECTIONS or not line.strip() or not line.strip().strip("-"):
            continue
        if len(line) - len(line.lstrip()) != indent:
            continue  # prose below a type
        name, colon, kind = line.strip().partition(" : ")
        if colon:
            yield kind
        elif section not in NAMED:
            yield name


def names_in(kind: str) -> set[tuple[str, str]]:
    """Capitalised names of one type with the path before them, without what stands in quotes or braces."""
    bare = re.sub(r"\{[^}]*\}|\"[^\"]*\"|'[^']*'|``[^`]*``", "", kind)
    return set(NAME.findall(bare))


@cache
def is_foreign(head: str) -> bool:
    """Whether a package of this name is installed or optional, and not one of these."""
    return head not in PACKAGES and (head in OPTIONAL or find_spec(head) is not None)


def bound_names(nodes: Iterable[ast.AST]) -> set[str]:
    """Names that a module binds at any depth: imports, classes, type variables, aliases."""
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            found |= {name.partition(".")[0] for a in node.names for name in (a.name, a.asname or a.name)}
        elif isinstance(node, ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign):
            found |= {t.id for t in node.targets if isinstance(t, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found.add(node.target.id)
    return found


def documented(nodes: Iterable[ast.AST]) -> Iterator[tuple[str, str]]:
    """Name and docstring of every class and function."""
    for node in nodes:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            text = ast.get_docstring(node)
            if text:
                yield node.name, text


def exported(folder: Path) -> set[str]:
    """Names of a package's stubs."""
    return {name for stub in folder.rglob("*.pyi") for name in bound_names(statements(stub))}


def statements(file: Path | str) -> list[ast.AST]:
    """Every statement of a module at any depth; expressions hold no docstring and bind nothing that is a type."""
    waiting: list[ast.AST] = [ast.parse(file if isinstance(file, str) else file.read_text(encoding="utf8"))]
    found: list[ast.AST] = []
    while waiting:
        node = waiting.pop()
        found.append(node)
        for part in ("body", "orelse", "handlers", "finalbody"):
            waiting += getattr(node, part, [])
    return found


def unknown_types(modules: dict[str, list[ast.AST]], public: set[str]) -> list[str]:
    """``module: name: type`` of every type that is none."""
    classes = Counter(n.name for nodes in modules.values() for n in nodes if isinstance(n, ast.ClassDef))
    found = []
    for module, nodes in modules.items():
        bound = bound_names(nodes)

        def known(path: str, name: str, bound: set[str] = bound) -> bool:
            head = path.partition(".")[0]
            if path and (head in bound or head in PACKAGES):
                return name in classes or is_foreign(head)
            if path:
                return is_foreign(head)
            telling = classes[name] == 1 and len(re.findall("[A-Z][a-z0-9]+|[A-Z]+(?![a-z])", name)) > 1
            return name in bound or name in public or name in BESIDE or telling

        for name, text in documented(nodes):
            for kind in section_types(text):
                found += [f"{module}: {name}: {p}{t}" for p, t in sorted(names_in(kind)) if not known(p, t)]
    return found


@pytest.fixture(scope="module")
def texts() -> dict[str, str]:
    paths = [p for name in PACKAGES for p in sorted((ROOT / name).rglob("*.py"))]
    return {p.relative_to(ROOT).as_posix(): p.read_text(encoding="utf8") for p in paths}


@pytest.fixture(scope="module")
def modules(texts: dict[str, str]) -> dict[str, list[ast.AST]]:
    return {name: statements(text) for name, text in texts.items()}


@pytest.fixture(scope="module")
def public() -> set[str]:
    return {name for folder in PACKAGES for name in exported(ROOT / folder)}


@pytest.mark.seconds
def test_every_type_that_a_docstring_names_exists(modules: dict[str, list[ast.AST]], public: set[str]) -> None:
    found = set(unknown_types(modules, public))
    assert len(modules) > 100 and not found, "\n".join(sorted(found))


REFERENCE = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)")


def unknown_references(texts: dict[str, str], modules: dict[str, list[ast.AST]], public: set[str]) -> list[str]:
    """``module: reference`` of what stands in single backquotes, names a class or module, and is none.

    A part in capital and small letters must be a class, a name that the module binds or an attribute; the module that
    a path of small letters begins with must exist.
    """
    names = {n.name for nodes in modules.values() for n in nodes if isinstance(n, (ast.ClassDef, ast.FunctionDef))}
    bound = {name for nodes in modules.values() for name in bound_names(nodes)}
    inside = names | bound
    known = inside | public
    places = inside.union(part for module in modules for part in module.removesuffix(".py").split("/"))
    found = []
    for module, text in texts.items():
        for reference in REFERENCE.findall(text):
            first, *rest = reference.split(".")
            capital = next((part for part in (first, *rest) if re.match("[A-Z][A-Za-z0-9]*[a-z]", part)), None)
            if is_foreign(first) or capital in FOREIGN:
                continue
            lost = capital is not None and capital not in known
            if lost or (capital is not None and rest and first.islower() and first not in places):
                found.append(f"{module}: {reference}")
    return found


@pytest.mark.seconds
def test_every_class_that_backquotes_name_exists(texts: dict[str, str], modules: dict[str, list[ast.AST]],
                                                 public: set[str]) -> None:
    found = unknown_references(texts, modules, public)
    assert not found, "\n".join(found)


SOURCE = '''
from elsewhere import Tool

class Known:
    """It has one.

    Attributes
    ----------
    a, b : Known or None
    c : (N, M) array of Gone, optional
        Prose may speak of Anything.
    d : {"Left", "Right"}
    """

def act(x):
    """Do it.

    Parameters
    ----------
    x : Tool or module.Lost or numpy.random.Generator or elsewhere.Known
    z : TwoWords or Exported or Single

    Returns
    -------
    Missing
        The result.
    y : sequence of (str, Known)
        More.

    Raises
    ------
    OtherError
        Never looked at.
    """
'''


def test_what_is_unknown_and_what_is_not() -> None:
    modules = {"m": statements(SOURCE), "other": statements("class TwoWords: ...\nclass Single: ...")}
    assert set(unknown_types(modules, {"Exported"})) == {
        "m: Known: Gone", "m: act: elsewhere.Known", "m: act: module.Lost", "m: act: Single", "m: act: Missing"}


def test_which_references_are_lost() -> None:
    modules = {"own/place.py": statements("class Known:\n    size: int\nLIMIT = 1")}
    text = "`Known.size` `place.Known` `Gone` `nowhere.Known` `lost` `LIMIT` `numpy.Gone` ``Not.Looked`` `Known`"
    assert unknown_references({"m": text}, modules, set()) == ["m: Gone", "m: nowhere.Known"]
