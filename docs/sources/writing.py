"""What the pages of the sources share: tables in Markdown, numbers with as many digits as they are worth, pictures."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path(__file__).resolve().parent
DPI = 80
"""of the pictures that are kept beside the pages: legible at the width of a page, about 60 kB each."""


def example(name: str) -> ModuleType:
    """A script of `examples/` as a module, so that a page shows what the example computes."""
    spec = importlib.util.spec_from_file_location(name, FOLDER.parents[1] / "examples" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def number(value: float | None, digits: int = 3) -> str:
    """A figure for a table; what diverged is named so.

    >>> number(0.012345), number(None), number(1234567.0)
    ('0.0123', 'diverged', '1.23e+06')
    """
    return "diverged" if value is None else f"{value:.{digits}g}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table.

    >>> print(table(["a", "b"], [["1", "2"]]))
    | a | b |
    |---|---|
    | 1 | 2 |
    """
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(row) + " |" if k != 1 else "|" + "|".join(row) + "|" for k, row in enumerate(lines)
    )


def picture(figure: Figure, name: str, caption: str) -> str:
    """Keep a picture beside the page; returns what shows it there."""
    (FOLDER / "pictures").mkdir(exist_ok=True)
    figure.savefig(FOLDER / "pictures" / f"{name}.png", dpi=DPI)
    return f"```{{figure}} pictures/{name}.png\n:alt: {caption.split('.')[0]}.\n\n{caption}\n```"


def write(name: str, parts: Iterable[str]) -> None:
    """Write a page."""
    path = FOLDER / f"{name}.md"
    path.write_text("\n\n".join(parts) + "\n", encoding="utf8")
    print(path.name, "written", file=sys.stderr)
