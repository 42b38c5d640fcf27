"""Docstrings here are plain text with formulas; marks that reStructuredText would read as its own are escaped."""

from __future__ import annotations

import re

CODE = re.compile(r"``.+?``|`[^`]+`|:[a-z]+:`[^`]+`")
MARK = re.compile(r"(?<!\\)([|*])|(?<=\w)_(?=\W|$)")


def escape_line(line: str) -> str:
    """Escape bars, stars and trailing underscores outside code.

    >>> escape_line("|Δp| <= rate·Ts, `a*b`, x_ is")
    '\\\\|Δp\\\\| <= rate·Ts, `a*b`, x\\\\_ is'
    """
    parts, last = [], 0
    for found in CODE.finditer(line):
        parts += [_escaped(line[last : found.start()]), found.group()]
        last = found.end()
    return "".join([*parts, _escaped(line[last:])])


def _escaped(text: str) -> str:
    return MARK.sub(lambda m: "\\" + (m.group(1) or "_"), text)


def escape_marks(app, what, name, obj, options, lines: list[str]) -> None:
    """Handler of `autodoc-process-docstring`, before numpydoc's own: doctests and fields stay as they are."""
    lines[:] = [line if line.lstrip().startswith((">>>", "...", ":", "..")) else escape_line(line) for line in lines]
