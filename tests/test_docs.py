"""Cheap checks of the documentation's sources, without Sphinx: navigation, links, options, lists and code blocks."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
GENERATED = ("generated/", "_build/", "_prepared/")
PAGES = sorted(p for p in DOCS.rglob("*.md") if not p.relative_to(DOCS).as_posix().startswith(GENERATED))
MOST_WORDS = 60
"""In a list item: the rule of issue 30, so that lists stay lists."""


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


def test_every_page_is_reached_from_the_index() -> None:
    reached, waiting = set(), ["index"]
    while waiting:
        page = waiting.pop()
        if page in reached or page.startswith(GENERATED):
            continue
        assert (DOCS / f"{page}.md").exists(), f"a toctree lists {page}, which is not there"
        reached.add(page)
        waiting += toctree(DOCS / f"{page}.md")
    missing = {name(p).removesuffix(".md") for p in PAGES} - reached
    assert not missing, f"in no toctree: {sorted(missing)}"


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda p: p.relative_to(ROOT).as_posix())
def test_internal_links_resolve(page: Path) -> None:
    text = page.read_text(encoding="utf8")
    anchors = {
        re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    }
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(text)):
        path, _, anchor = target.partition("#")
        if re.match(r"[a-z]+:", target):
            continue
        if not path:
            assert anchor in anchors, f"no heading for #{anchor}"
            continue
        inside = (page.parent / path).resolve()
        if inside.is_relative_to(DOCS) and inside.relative_to(DOCS).as_posix().startswith(GENERATED):
            continue  # made by the build, which checks them itself
        assert inside.exists(), f"{target} leads nowhere"


def items(text: str) -> Iterator[str]:
    """Whole list items, with their continued lines."""
    item: list[str] = []
    for line in [*prose(text).splitlines(), ""]:
        begins = re.match(r"\s*(?:[-*+]|\d+\.)\s+(.*)", line)
        continued = bool(item) and line.startswith(" ") and line.strip()
        if not continued and item:
            yield " ".join(item)
            item = []
        if begins:
            if item:
                yield " ".join(item)
            item = [begins.group(1)]
        elif continued:
            item.append(line.strip())


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_list_items_are_short(page: Path) -> None:
    for item in items(page.read_text(encoding="utf8")):
        count = len(item.split())
        assert count <= MOST_WORDS, f"{count} words in one list item: {item[:70]}… (make it paragraphs)"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_doctests_are_fenced(page: Path) -> None:
    """Unfenced they render as nested quotes; unfenced code is not code."""
    text = page.read_text(encoding="utf8")
    assert ">>>" not in prose(text), "a doctest outside a ```pycon block"
    for info, content in blocks(text):
        if ">>>" in content and not info.startswith("{"):
            assert info == "pycon", f"a doctest in a block of {info or 'nothing'}"
            assert content.endswith("\n\n"), "an empty line before the closing fence ends the expected output"


def commands() -> dict[str, set[str]]:
    """Every command with its options."""
    from lpvid.cli.app import app as lpvid_app
    from quartercar.cli.app import app as quartercar_app

    found = {}
    for program, app in (("lpvid", lpvid_app), ("quartercar", quartercar_app)):
        for command, made in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
            found[f"{program} {command}"] = {o for p in made.params for o in (*p.opts, *p.secondary_opts)} | {"--help"}
    return found


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda p: p.relative_to(ROOT).as_posix())
def test_commands_and_options_exist(page: Path) -> None:
    known = commands()
    for info, content in blocks(page.read_text(encoding="utf8")):
        if info != "sh":
            continue
        for line in re.sub(r"\\\n\s*", " ", content).splitlines():
            for part in re.split(r"&&|;|\|", line.split(" #")[0]):
                words = part.split()
                while words and not words[0].endswith(("lpvid", "quartercar")):
                    words = words[1:]
                if len(words) < 2 or words[1].startswith("-"):
                    continue
                command = f"{Path(words[0]).name} {words[1]}"
                assert command in known, f"no command {command}"
                unknown = [w for w in words[2:] if w.startswith("--") and w.split("=")[0] not in known[command]]
                assert not unknown, f"{command} has no option {unknown[0]}"
