"""The gallery: the scripts of `examples/` as sphinx-gallery wants them, run at build."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

SECONDS = ("coprime", "critical_current", "design_lpv_suspension", "export_controller", "first_model", "gas_damper",
           "network_topology", "own_effect", "state_space_forms", "synthesize_lpv")
"""Examples of up to ten seconds of processor time each, 55 s together; with `LPVID_DOCS=quick` only these run."""

MEASURED = {"gyroscope": "gyroscope/estimation.csv", "fixed_voltage": "mr_damper_fixed_voltage/estimation.csv"}
"""Examples on measured records, and where these lie in the folder that `LPVID_DATA` names; not part of the project."""

HEADER = """Gallery
=======

Every script of ``examples/``, each answering one question, run when this site is built. What it prints and draws stands
below its source. Unless a legend reads *measured*, the data come from the virtual rig.
"""
NOTE = """
.. note::

   Not run at this build: {why}
"""


def data_folder() -> Path | None:
    """Folder of the measured records, where it is there."""
    named = os.environ.get("LPVID_DATA")
    return Path(named) if named and Path(named).is_dir() else None


def runs(name: str, amount: str) -> bool:
    """Whether an example runs at this build."""
    if amount == "none" or (name in MEASURED and data_folder() is None):
        return False
    return amount == "full" or name in SECONDS


def with_title(text: str, note: str) -> str:
    """The script with its first sentence as a title and, where it does not run, the reason below.

    Raises
    ------
    ValueError
        A script that does not begin with a docstring.
    """
    found = re.match(r'"""(.+?)"""\n', text, flags=re.DOTALL)
    if found is None:
        raise ValueError("an example begins with a docstring: the question that it answers")
    first, *rest = found.group(1).strip().split("\n")
    question, mark, tail = first.partition("? ")
    title = question + mark.strip()
    body = "\n".join([tail, *rest]).strip()
    return f'r"""\n{title}\n{"=" * len(title)}\n\n{body}\n{note}"""\n' + text[found.end() :]


def prepare_examples(docs: Path, amount: str) -> None:
    """Write the scripts, titled, to `_prepared/examples`."""
    target = docs / "_prepared" / "examples"
    target.mkdir(parents=True, exist_ok=True)
    (target / "GALLERY_HEADER.rst").write_text(HEADER, encoding="utf8")
    for path in sorted((docs.parent / "examples").glob("*.py")):
        why = (
            "it needs measured records, which are not part of the project."
            if path.stem in MEASURED
            else "it takes minutes; the full build runs it."
        )
        note = "" if runs(path.stem, amount) else NOTE.format(why=why)
        text = with_title(path.read_text(encoding="utf8"), note)
        made = target / path.name
        if not made.exists() or made.read_text(encoding="utf8") != text:
            made.write_text(text, encoding="utf8")


class Arguments:
    """Command-line arguments of an example: the measured file where it needs one."""

    def __call__(self, conf: Any, variables: Any) -> list[str]:
        """Called by sphinx-gallery before every script."""
        name, folder = Path(variables["src_file"]).stem, data_folder()
        return [str(folder / MEASURED[name])] if name in MEASURED and folder is not None else []

    def __repr__(self) -> str:
        return "Arguments()"


def settings(docs: Path, amount: str) -> dict[str, Any]:
    """`sphinx_gallery_conf`."""
    names = [p.stem for p in sorted((docs.parent / "examples").glob("*.py")) if runs(p.stem, amount)]
    chosen = "|".join(["plot_", *names])
    return {
        "examples_dirs": [str(docs / "tutorial"), str(docs / "_prepared" / "examples")],
        "gallery_dirs": ["generated/tutorial", "generated/gallery"],
        "filename_pattern": rf"[\\/](?:{chosen})\w*\.py$" if amount != "none" else r"nothing runs^",
        "reset_argv": Arguments(),
        "abort_on_example_error": True,
        "download_all_examples": False,
        "remove_config_comments": True,
        "show_memory": False,
        "min_reported_time": 10,
        "matplotlib_animations": False,
        "plot_gallery": True,
        "capture_repr": (),
        "image_srcset": [],
        "within_subsection_order": "FileNameSortKey",
        "copyfile_regex": "",
        "write_computation_times": False,
    }
