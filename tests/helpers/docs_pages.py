"""Pages of the documentation and their blocks."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
GENERATED = ("generated/", "_build/", "_prepared/")
PAGES = sorted(p for p in DOCS.rglob("*.md") if not p.relative_to(DOCS).as_posix().startswith(GENERATED))


def name(page: Path) -> str:
    return page.relative_to(DOCS).as_posix()


def blocks(text: str) -> Iterator[tuple[str, str]]:
    """(info string, content) of every fenced block."""
    for found in re.finditer(r"^(`{3,}|:{3,})(.*?)\n(.*?)^\1[ ]*$", text, flags=re.DOTALL | re.MULTILINE):
        yield found.group(2).strip(), found.group(3)


def prose(text: str) -> str:
    """The page without its fenced blocks."""
    return re.sub(r"^(`{3,}|:{3,})(.*?)\n(.*?)^\1[ ]*$", "", text, flags=re.DOTALL | re.MULTILINE)


def toctree(page: Path) -> Iterator[str]:
    """Pages that a page lists, as paths below docs/ without a suffix."""
    for info, content in blocks(page.read_text(encoding="utf8")):
        if info == "{toctree}":
            for line in content.splitlines():
                if line.strip() and not line.startswith(":"):
                    target = re.sub(r".*<(.*)>", r"\1", line.strip())
                    yield (page.parent / target).relative_to(DOCS).as_posix() if "/.." not in target else target
