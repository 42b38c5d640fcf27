"""From a page to HTML: one file, styles, figures and scripts inside, nothing fetched from anywhere."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lpvid._forks import in_forks
from lpvid.report.glossary import TERMS, split_terms, term_of
from lpvid.report.origin import Origin, shown_names
from lpvid.report.page import OUT, NextStep, Page, PageFigure
from lpvid.report.traces import Traces, pack

if TYPE_CHECKING:
    from markupsafe import Markup

HEAVIEST = 1_450_000
"""Bytes that a page may weigh (issue: 1.5 MB), with some left for what is put around it."""
UNITS = {"m/s^2": "m/s²", "N*s/m": "N·s/m"}
"""Units that printed texts spell in ASCII, as a page shows them."""
LEAST = 150_000
"""Bytes that the time traces of a page have in any case."""


def render(page: Page) -> str:
    """HTML of a page: styles and figures inside, no reference to anything outside.

    The samples of its time traces get what the rest of the page leaves of `HEAVIEST`.

    Parameters
    ----------
    page : Page

    Returns
    -------
    str

    Examples
    --------
    >>> html = render(Page("Audit", "Nothing found.", "good"))
    >>> "<h1>Audit</h1>" in html, "http" in html
    (True, False)
    """
    from jinja2 import Environment, StrictUndefined

    words = _Glossed()
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    environment.filters.update(explain=words.explain, cell=words.cell, command=_command)
    template = environment.from_string(_file("page.html"))
    figures = [item for section in page.sections for item in section.items if isinstance(item, Traces)]
    scripts = _scripts() if figures else ()
    given: dict[str, Any] = {
        "page": page, "pictures": _pictures(page), "version": _version(), "style": _style(bool(figures)),
        "ids": _ids(page),
        "steps": [_step(s, page.origin) for s in page.steps], "terms": words.used,
        "sources": [] if page.origin is None else shown_names(page.origin.sources)}
    html = template.render(**given, scripts=(), packed=[""] * len(figures)) + "\n"
    if not figures:
        return html
    room = HEAVIEST - len(html.encode("utf-8")) - sum(len(s.encode("utf-8")) for s in scripts)
    words.used.clear()
    words.focusable.clear()
    return template.render(**given, scripts=_safe(scripts), packed=_safe(pack(figures, max(room, LEAST)))) + "\n"


class _Glossed:
    """Marks terms of the glossary, and keeps which ones a page uses."""

    def __init__(self) -> None:
        self.used: dict[str, str] = {}
        self.focusable: set[str] = set()

    def explain(self, text: str) -> Markup:
        """A text with its terms explained on hover; a term's first place on the page can be reached by keyboard.

        What stands between backquotes is code.
        """
        from markupsafe import Markup

        parts = re.split(r"`([^`]+)`", str(text))
        return Markup("").join(
            Markup("<code>{}</code>").format(part) if k % 2 else
            Markup("").join(self._marked(words, term) if term else _prose(words) for words, term in split_terms(part))
            for k, part in enumerate(parts))

    def cell(self, text: str) -> Markup:
        """A cell, explained where it is one term and nothing else."""
        from markupsafe import escape

        term = term_of(str(text))
        return self._marked(text, term) if term else escape(_typeset(str(text)))

    def _marked(self, words: str, term: str) -> Markup:
        from markupsafe import Markup

        self.used[term] = TERMS[term]
        first = term not in self.focusable
        self.focusable.add(term)
        return Markup('<abbr title="{}"{}>{}</abbr>').format(TERMS[term], Markup(' tabindex="0"') if first else "",
                                                             words)


def _typeset(text: str) -> str:
    """Units as they are set in print: texts are shared with the terminal, where they are ASCII."""
    for plain, printed in UNITS.items():
        text = text.replace(plain, printed)
    return text


def _prose(text: str) -> Markup:
    """A text with its units in print and its options unbroken."""
    from markupsafe import Markup, escape

    parts = re.split(r"((?<![\w-])--[a-z][a-z-]*)", _typeset(text))
    return Markup("").join(Markup('<span class="option">{}</span>').format(part) if k % 2 else escape(part)
                           for k, part in enumerate(parts))


def _pictures(page: Page) -> dict[PageFigure, Markup]:
    """Addresses of a page's drawings, their data inside; on as many processors as there are, where forks are safe.

    Laying out and writing a figure takes half a second; two figures on two processors take no longer. matplotlib's
    settings are global, so that threads cannot share them.
    """
    figures = [item for section in page.sections for item in section.items if isinstance(item, PageFigure)]
    if not figures:
        return {}
    from lpvid.plot import svg

    return dict(zip(figures, in_forks(lambda f: _address(svg(f.drawing)), figures, threads=False), strict=True))


def _address(drawing: bytes) -> Markup:
    """The address of an SVG as text, which is a fifth shorter than in base64.

    The name spaces of an SVG are no addresses: they are written so that a search for addresses does not find them.
    """
    from markupsafe import Markup

    quoted = re.sub(r'[%#"<>&\n]', lambda m: f"%{ord(m.group()):02X}", drawing.decode("utf-8"))
    return Markup("data:image/svg+xml;charset=utf-8," + quoted.replace("http", "%68ttp").replace("url(", "url%28"))


def _command(line: str) -> Markup:
    """A command line whose words are never broken, so that no option loses its dashes."""
    from markupsafe import Markup

    return Markup(" ").join(Markup("<span>{}</span>").format(word) for word in line.split(" "))


def _step(step: NextStep, origin: Origin | None) -> NextStep:
    """The step with the folder of the results in place of `OUT`, and the files that were read under their own paths.

    A name that several files share is the first one's: a command's argument stands before what its options name.
    """
    if origin is None:
        return step
    shown = [name for name, _ in shown_names(origin.sources)]
    paths = {name: s.name for name, s in zip(shown, origin.sources, strict=True) if shown.count(name) == 1}
    for s in origin.sources:
        paths.setdefault(Path(s.name).name, s.name)
    folder = origin.folder.rstrip("/") or OUT

    def resolved(name: str) -> str:
        first, slash, rest = name.partition("/")
        return paths.get(name) or (folder if first == OUT else first) + slash + rest

    words = (",".join(resolved(name) for name in word.split(",")) for word in step.command.split(" "))
    return NextStep(step.text, " ".join(words))


def _ids(page: Page) -> list[str]:
    """An address for every section."""
    found: list[str] = []
    for section in page.sections:
        word = re.sub(r"[^a-z0-9]+", "-", section.title.lower()).strip("-") or "section"
        name, count = word, 1
        while name in found:
            count += 1
            name = f"{word}-{count}"
        found.append(name)
    return found


def _style(traces: bool) -> Markup:
    from markupsafe import Markup

    return Markup(_file("page.css") + (_file("vendor", "uPlot.min.css") if traces else ""))


def _scripts() -> tuple[str, ...]:
    """uPlot under its licence, which every copy carries, and our own script that uses it."""
    code = _file("vendor", "uPlot.iife.min.js")
    return f"/*! uPlot\n{_file('vendor', 'LICENSE')}*/\n{code.partition('*/')[2].lstrip()}", _file("traces.js")


def _safe(texts: Iterable[str]) -> list[Markup]:
    """Texts that stand in the page as they are: our own scripts, and JSON without "<"."""
    from markupsafe import Markup

    return [Markup(t) for t in texts]


def _file(*parts: str) -> str:
    from importlib.resources import files

    return files("lpvid.report").joinpath(*parts).read_text(encoding="utf-8")


def _version() -> str:
    from lpvid import __version__

    return __version__
