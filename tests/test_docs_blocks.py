"""Python blocks of the documentation that are no doctests: each runs as it stands, beside the files that it reads."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.docs_pages import DOCS, PAGES, ROOT, blocks

Names = dict[str, Any]


def rig_files(folder: Path) -> Names:
    """Two runs of the virtual rig as run1.csv and run2.csv."""
    from quartercar.rig import EXPERIMENTS, Rig
    from quartercar.rig.storing import write_csv

    for k in (1, 2):
        write_csv(Rig().run(replace(EXPERIMENTS["test-1"], duration=10.0), seed=k), folder / f"run{k}.csv")
    return {}




def long_file(folder: Path) -> Names:
    """A Parquet file to be read in parts."""
    pytest.importorskip("pyarrow", reason="the extra 'scale' is not installed")
    from lpvid.export.tables import write_table
    from quartercar.rig import EXPERIMENTS, Rig

    run = Rig().run(replace(EXPERIMENTS["test-1"], duration=10.0), seed=1)
    columns = {n: (run[n], run.unit(n)) for n in ("displacement", "velocity", "current", "force")}
    write_table({"time": (run.times, "s"), **columns}, folder / "hours.parquet")
    return {}


def a_controller(folder: Path) -> Names:
    """An LPV controller of two states, scheduled as the page has it."""
    import lpvid as lpv
    import quartercar as qc

    box = lpv.Scheduling(("saturation_ratio",), (0.1,), (1.0,))
    model = lpv.LPVStateSpace(0.1 * np.ones((2, 2, 2)), np.ones((2, 2, 2)), np.ones((2, 1, 2)), np.zeros((2, 1, 2)),
                              lpv.Polynomial("saturation_ratio", 1), 0.002, box,
                              inputs=("suspension_velocity", "body_velocity"), outputs=("u",))
    return {"qc": qc, "controller": model, "gain": np.zeros(2)}


def own_effect(folder: Path) -> Names:
    """What the example around the class imports and defines."""
    spec = importlib.util.spec_from_file_location("own_effect", ROOT / "examples" / "own_effect.py")
    assert spec is not None and spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return vars(found).copy()


SCENES: dict[str, Callable[[Path], Names]] = {
    "README.md": rig_files, "docs/characterise.md": rig_files, "docs/scaling.md": long_file,
    "docs/ride.md": a_controller,
    "docs/diagnosis.md": own_effect}
"""What stands in the folder, and in the namespace, of a page's block."""


def python_blocks() -> list[tuple[str, str]]:
    """(page, code) of every block that is marked as Python."""
    return [(page.relative_to(ROOT).as_posix(), content) for page in [ROOT / "README.md", *PAGES]
            for info, content in blocks(page.read_text(encoding="utf8")) if info in ("python", "py")]


def test_every_block_of_python_has_a_scene() -> None:
    assert {page for page, _ in python_blocks()} == set(SCENES)
    assert DOCS.is_dir()


def marked() -> list[Any]:
    """The blocks; the README's certifies a model and takes a quarter of a minute."""
    return [pytest.param(page, code, id=page, marks=pytest.mark.slow if page == "README.md" else ())
            for page, code in python_blocks()]


@pytest.mark.thinned(4, "seconds")
@pytest.mark.parametrize("page, code", marked())
def test_a_block_of_python_runs(page: str, code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = {"__name__": "page", **SCENES[page](tmp_path)}
    monkeypatch.chdir(tmp_path)
    exec(compile(code, page, "exec"), names)  # text of this repository
