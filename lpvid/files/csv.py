"""Delimited text: comma, semicolon, tab or white space; a header row of ``name [unit]``, or a row of units below it."""

from __future__ import annotations

import codecs
import csv
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path

import numpy as np

from lpvid import units
from lpvid.condition.tables import Column, ColumnTable, is_time_name
from lpvid.errors import InputError
from lpvid.files._stamps import TIME_OF_DAY, Midnight, Stamps, instant, stamps
from lpvid.files._table import (
    MISSING,
    fault_text,
    headed,
    is_number,
    parse_cells,
    the_thousands,
    thousands_in,
    ungrouped,
)

EXTENSIONS = (".csv", ".tsv", ".txt")
_BLOCK = 50_000
_CHUNK = 1 << 20
_PREAMBLE = 100
"""Lines that are looked at for the first row of numbers, where the first line of the file is no header."""
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")
_WORDS = re.compile(r"[^\s\[\]()]+(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?")
_TWO_SEPARATORS = tuple(re.compile(p) for p in (r"\.\d{3}[.,]\d", r",\d{3}[.,]\d"))
"""In the text of every number that shows which separator is of thousands, and of few others; two patterns, since one
that begins with a character and not a class is searched three times as fast."""
_TWO_POINTS = (re.compile(r"\.\d{3}\.\d"),)
"""The same where a comma separates cells and none is quoted."""
_ERROR_VALUE = re.compile(r"#(?:DIV/0!|N/A|VALUE!|REF!|NAME\?|NUM!|NULL!)")
_LONGEST_NUMBER = 200
"""Characters of a chunk that are looked at again with the next: a number may stand on the border."""
_MEND_HEADER = "add a header row such as 'time [s],velocity [m/s],force [N]'"


@dataclass(frozen=True)
class _Layout:
    """How the text is laid out; `data_line` is the number of the first data line, from 1.

    `stamps` states how columns of dates or times of day count, and is None for the others; `thousands` is the point or
    comma that separates thousands in a column, empty where none of its cells shows one.
    """

    encoding: str
    delimiter: str | None
    names: tuple[str, ...]
    header_line: int
    data_line: int
    stamps: tuple[Stamps | None, ...] = ()
    thousands: tuple[str, ...] = ()

    @property
    def decimal_comma(self) -> bool:
        return self.delimiter in (";", "\t")

    def split(self, line: str) -> list[str]:
        """Cells of one line; quotes protect a delimiter."""
        if self.delimiter is None:
            return line.split()
        return next(csv.reader([line], delimiter=self.delimiter, skipinitialspace=True), [])

    def raw_cells(self, line: str) -> list[str]:
        """Cells of a data line as written."""
        quoted = self.delimiter is None or '"' in line
        return self.split(line) if quoted else line.split(self.delimiter)

    def data_cells(self, line: str) -> list[str]:
        """Cells of a data line, a decimal comma as a point."""
        return self.with_points(self.raw_cells(line))

    def with_points(self, cells: Sequence[str]) -> list[str]:
        """Cells with a decimal comma as a point, without thousands separators."""
        return [ungrouped(c).replace(",", ".") if "," in c else c for c in cells] if self.decimal_comma else list(cells)

    def parsed(self, place: int, cells: Sequence[str]) -> tuple[np.ndarray, list[int]]:
        """Numbers of one column, seconds since its first stamp where it holds dates or times; places of other text."""
        dated = self.stamps[place] if self.stamps else None
        thousands = self.thousands[place] if self.thousands else ""
        return (parse_cells(cells, self.decimal_comma, thousands) if dated is None else
                dated.seconds(self.with_points(cells)))

    def midnights(self) -> dict[int, Midnight]:
        """What carries the columns of times of day over midnight, by the place of the column."""
        return {i: Midnight() for i, s in enumerate(self.stamps) if s is not None and s.kind == TIME_OF_DAY}


def read_table(path: Path) -> ColumnTable:
    """Read delimited text.

    The delimiter is the one of tab, semicolon, comma and white space on which the header and the first data line
    agree. Behind a semicolon or a tab a comma is a decimal comma. Lines that start with ``#`` are comments, but for one
    above numbers that holds their header. Lines above
    the header are left out where the header is the line, with as many cells, above the first row that holds numbers
    or stamps alone; a row of units may stand between. Dates (``2026-11-26T10:12:13.5``, with an offset from UTC or
    without, ``26.11.2026 10:12:13,5``) and times of day (``10:12:13.5``, over midnight too) are seconds since the
    first; which of them a column holds is what most of its first rows hold, and others are a fault. Empty cells,
    ``NaN`` and ``NA`` are missing samples; other text is a fault of its column.

    Parameters
    ----------
    path : Path
        UTF-8 (with or without byte order mark), UTF-16 with byte order mark, or Latin-1.

    Returns
    -------
    ColumnTable

    Raises
    ------
    InputError
        Not text, empty, without header or data, or a row with another number of cells than the header.
    """
    where = str(path)
    layout = _layout(path, where)
    values = _read_numbers(path, layout)
    if values is not None:
        columns = [_column(header, values[:, i], None) for i, header in enumerate(layout.names)]
    else:
        columns = _read_cells(path, with_thousands(path, layout, where), where)
    return ColumnTable(_without_trailing(columns))


def _column(header: str, values: np.ndarray, fault: str | None) -> Column:
    name, unit = headed(header)
    return Column(name, values, unit, fault)


def _without_trailing(columns: list[Column]) -> list[Column]:
    """Drop the empty column that a delimiter at the end of every line leaves."""
    last = columns[-1]
    trailing = len(columns) > 1 and not last.name and not last.fault and bool(np.isnan(last.values).all())
    return columns[:-1] if trailing else columns


# -- layout ---------------------------------------------------------------------------------------------------------
def _layout(path: Path, where: str) -> _Layout:
    encoding = _encoding(path, where)
    with path.open(encoding=encoding, newline=None) as stream:
        numbered, last = _above_content(stream)
        lines = [*numbered, *islice(_content(stream, last + 1), _PREAMBLE - len(numbered))]
    if not lines:
        raise InputError(f"{where}: the file is empty", mend=_MEND_HEADER)
    candidates = [_Layout(encoding, d, (), 0, 0) for d in ("\t", ";", ",", None)]
    found = _headed_at_once(lines, candidates, where)
    if not _heads(found, lines):
        found = _above_numbers(lines, candidates) or found
    if not found.data_line:
        raise InputError(f"{where}: there is a header but no data", got=", ".join(found.names),
                         mend="export the data again; in a folder, name the files: FOLDER/*.csv")
    try:
        rows = [found.data_cells(line) for number, line in lines if number >= found.data_line]
    except csv.Error:
        return found  # the line is named where the file is read
    whole = [row for row in rows if len(row) == len(found.names)]
    return replace(found, stamps=tuple(map(stamps, zip(*whole, strict=True))) or (None,) * len(found.names))


def _above_content(stream: Iterator[str]) -> tuple[list[tuple[int, str]], int]:
    """The first line that is no comment, with the comment above it where that is its header; and how many were read.

    ``# time [s],force [N]`` is what `numpy.savetxt` writes above numbers, ``% time`` what MATLAB users do.
    """
    comment, number, above = (0, ""), 0, list[tuple[int, str]]()
    for number, line in enumerate(stream, 1):
        text = line.strip()
        if _is_comment(text):
            comment = number, text.lstrip("# \t")
        elif text.startswith("%"):
            above = [(number, text.lstrip("% \t"))]
        elif text:
            first = number, line.rstrip("\n")
            if above:
                return [*above, first], number
            numbers = all(map(is_number, re.split(r"[\s,;]+", text.strip(",;"))))
            return [comment, first] if numbers and _as_many_cells(comment[1], text) else [first], number
    return above, number


def _as_many_cells(header: str, row: str) -> bool:
    """Whether a comment has a name for every number below it, one that states a unit or the time among them."""
    splits = [(header.split(d), row.split(d)) for d in ("\t", ";", ",")] + [(_WORDS.findall(header), row.split())]
    names = next((names for names, cells in splits if len(names) == len(cells) > 1), [])
    return any(is_time_name(name) or unit is not None for name, unit in map(headed, names))


def _heads(layout: _Layout, lines: Sequence[tuple[int, str]]) -> bool:
    """Whether the first line can be the header of all that follow: a name for every cell, and samples below it."""
    try:
        rows = [layout.data_cells(line) for _, line in lines[1:]]
    except csv.Error:
        return True  # the line is named where the file is read
    if not rows or not all(layout.names) or any(len(row) != len(layout.names) for row in rows):
        return False
    stated = any(is_time_name(name) or unit is not None for name, unit in map(headed, layout.names))
    return any(map(_is_sample, rows[0])) and (stated or _is_row(rows[0])) and _goes_on(rows[0], rows[1:])


def _goes_on(row: list[str], below: Iterable[list[str]]) -> bool:
    """Whether the next row that holds samples alone has numbers and stamps in the same places, or stands right below.

    A preamble may hold a row of stamps of its own: ``Start,End`` and ``10:12:13,10:13:00`` above the header.
    """
    for k, other in enumerate(below):
        if len(other) == len(row) and _is_row(other):
            return k == 0 or not any(_differ(*pair) for pair in zip(row, other, strict=True))
    return True


def _differ(cell: str, other: str) -> bool:
    """Whether one cell is a number and the other a stamp."""
    return any(is_number(one) and instant(two) is not None for one, two in ((cell, other), (other, cell)))


def _is_row(cells: Sequence[str]) -> bool:
    """Whether cells hold numbers or missing samples alone, and one number at least."""
    cells = [cell.strip() for cell in cells]
    missing = [cell.casefold() in MISSING for cell in cells]
    return not all(missing) and all(m or _is_sample(cell) for m, cell in zip(missing, cells, strict=True))


def _is_sample(cell: str) -> bool:
    """Whether a cell holds a number, a stamp or a word for a missing one; a row of units may have empty cells too."""
    return is_number(cell) or (bool(cell.strip()) and cell.strip().casefold() in MISSING) or instant(cell) is not None


def _headed_at_once(lines: Sequence[tuple[int, str]], candidates: list[_Layout], where: str) -> _Layout:
    """The layout of a file whose first line is the header; its `data_line` is 0 where there is no other line."""
    (header_line, header), *data = lines[:2]
    try:
        delimiter, names = _delimiter(candidates, header, data[0][1] if data else header)
    except csv.Error as error:
        raise _broken_line(where, data[0][0] if data else header_line, error) from None
    if all(is_number(name) for name in names):
        raise InputError(f"{where}: line {header_line} holds numbers only", why="the columns have no names",
                         mend=_MEND_HEADER)
    return _Layout(candidates[0].encoding, delimiter, tuple(names), header_line, data[0][0] if data else 0)


def _above_numbers(lines: Sequence[tuple[int, str]], candidates: list[_Layout]) -> _Layout | None:
    """The layout by the first row that holds numbers alone: above it the header, between them a row of units or none.

    None where the line above such a row is no header of as many cells, each with a name.
    """
    for layout in candidates[:3]:
        for k in range(1, len(lines)):
            try:
                row = layout.data_cells(lines[k][1])
                above = [[c.strip() for c in layout.split(line)] for _, line in lines[max(k - 2, 0):k]]
            except csv.Error:
                break
            if len(row) < 2 or not _is_row(row) or not _goes_on(row, _readable(layout, lines[k + 1:])):
                continue
            names, line = _with_units(above, len(row)), lines[k - 1][0]
            if names is None:
                break
            return replace(layout, names=tuple(names), header_line=line, data_line=lines[k][0])
    return None


def _readable(layout: _Layout, lines: Sequence[tuple[int, str]]) -> Iterator[list[str]]:
    """Cells of each line as far as they can be read; the line that ends them is named where the file is read."""
    try:
        for _, line in lines:
            yield layout.data_cells(line)
    except csv.Error:
        return


def _with_units(above: list[list[str]], n: int) -> list[str] | None:
    """Headers ``name [unit]`` from the one or two lines above the numbers; None where there are no `n` names.

    The last line holds units only where every filled cell is one. `t` is the tonne and `T` the tesla, but also the name
    of time: they are units only below a line that names the time.
    """
    last = above[-1]
    names = above[0] if len(above) == 2 else []
    stated = [unit.strip("[]()\"' ") for unit in last]
    filled = list(filter(None, stated))
    timed = any(map(is_time_name, names)) or not any(map(is_time_name, filled))
    unit_row = len(last) == n and bool(filled) and timed and all(map(units.is_known, filled))
    if unit_row and len(names) == n and all(names) and not any(headed(name)[1] for name in names):
        return [f"{name} [{unit}]" if unit else name for name, unit in zip(names, stated, strict=True)]
    return last if len(last) == n and all(last) and not any(map(_is_sample, last)) else None


def _delimiter(candidates: list[_Layout], header: str, row: str) -> tuple[str | None, list[str]]:
    """Delimiter on which header and first row agree, or the first that splits the header at all."""
    options = []
    for layout in candidates:
        names = _WORDS.findall(header) if layout.delimiter is None else layout.split(header)
        cells = layout.split(row)
        options.append((layout.delimiter, names, len(names) == len(cells)))
    agreed = [o for o in options if len(o[1]) > 1 and o[2]]
    splits = [o for o in options[:3] if len(o[1]) > 1]
    if agreed:
        return agreed[0][:2]
    if splits:
        return splits[0][:2]
    return ",", [header.strip()]


def _encoding(path: Path, where: str) -> str:
    """UTF-8 if every byte fits, UTF-16 by its mark, Latin-1 otherwise; refuse what is no text."""
    with path.open("rb") as stream:
        head = stream.read(4)
        if head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
            return _checked_utf16(path, where)
        decoder, encoding = codecs.getincrementaldecoder("utf-8")(), "utf-8-sig"
        chunk = head + stream.read(_CHUNK)
        while chunk:
            found = _CONTROL.search(chunk)
            if found:
                raise _no_text(where, f"byte 0x{found[0].hex()}")
            try:
                if encoding == "utf-8-sig":
                    decoder.decode(chunk)
            except UnicodeDecodeError:
                encoding = "latin-1"
            chunk = stream.read(_CHUNK)
    if encoding == "utf-8-sig":
        try:
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return "latin-1"
    return encoding


def _checked_utf16(path: Path, where: str) -> str:
    try:
        with path.open(encoding="utf-16") as stream:
            while text := stream.read(_CHUNK):
                if _CONTROL.search(text.encode("utf-8", "replace")):
                    raise _no_text(where, "control characters")
    except UnicodeError:
        raise _no_text(where, "a broken UTF-16 sequence") from None
    return "utf-16"


def _no_text(where: str, got: str) -> InputError:
    return InputError(f"{where}: the file is not text", got=got,
                      mend="export comma-separated text, or use the extension of the file's real format")


def _is_comment(text: str) -> bool:
    """Whether a line is a comment: not one that begins with an error value of a spreadsheet, as ``#DIV/0!``."""
    return text.startswith("#") and _ERROR_VALUE.match(text) is None


def _content(stream: Iterable[str], first_line: int = 1) -> Iterator[tuple[int, str]]:
    """Lines that are neither blank nor comments, with their numbers."""
    for number, line in enumerate(stream, first_line):
        text = line.strip()
        if text and not _is_comment(text):
            yield number, line.rstrip("\n")


# -- numbers --------------------------------------------------------------------------------------------------------
def _read_numbers(path: Path, layout: _Layout) -> np.ndarray | None:
    """The fast way, for files that hold nothing but numbers; None sends the file the careful way."""
    with path.open(encoding=layout.encoding, newline=None) as stream:
        lines: Iterable[str] = islice(stream, layout.data_line - 1, None)
        if layout.decimal_comma:
            lines = (line.replace(",", ".") for line in lines)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                values = np.loadtxt(lines, delimiter=layout.delimiter, comments=None, ndmin=2)
        except (ValueError, UserWarning):
            return None
    return values if values.shape[1] == len(layout.names) else None


def with_thousands(path: Path, layout: _Layout, where: str) -> _Layout:
    """The layout with the thousands separators that the cells of each column show, anywhere in the file.

    One cell decides for the whole column, however far it stands from the others: ``1.024`` is 1024 in the first part
    of a file too where the last holds ``1.345,25``.

    Parameters
    ----------
    path : Path
    layout : _Layout
        Of the file.
    where : str
        The file, for messages.

    Returns
    -------
    _Layout
    """
    stat = path.stat()
    found = _thousands(path, layout, where, (stat.st_mtime_ns, stat.st_size))
    return replace(layout, thousands=found) if any(found) else layout


@lru_cache(maxsize=64)
def _thousands(path: Path, layout: _Layout, where: str, version: tuple[int, int]) -> tuple[str, ...]:
    """Separator of each column, empty for none; no cell is looked at in a file without a number of two separators."""
    with path.open(encoding=layout.encoding, newline=None) as stream:
        end = ""
        while text := stream.read(_CHUNK):
            commas = layout.delimiter != "," or '"' in text
            if any(p.search(end + text) for p in (_TWO_SEPARATORS if commas else _TWO_POINTS)):
                break
            end = text[-_LONGEST_NUMBER:]
        else:
            return ("",) * len(layout.names)
    shown: list[set[str]] = [set() for _ in layout.names]
    with path.open(encoding=layout.encoding, newline=None) as stream:
        rows = _rows(islice(stream, layout.data_line - 1, None), layout, where)
        while block := list(islice(rows, _BLOCK)):
            for own, cells in zip(shown, zip(*(row for _, row in block), strict=True), strict=True):
                own |= thousands_in(cells)
    return tuple(map(the_thousands, shown))


def _read_cells(path: Path, layout: _Layout, where: str) -> list[Column]:
    """The careful way: cell by cell, with the line of everything that is amiss."""
    parts: list[list[np.ndarray]] = [[] for _ in layout.names]
    first: list[tuple[str, int, int] | None] = [None] * len(layout.names)  # text, row and line of the first fault
    n_faults = [0] * len(layout.names)
    n_rows, midnights = 0, layout.midnights()
    with path.open(encoding=layout.encoding, newline=None) as stream:
        rows = _rows(islice(stream, layout.data_line - 1, None), layout, where)
        while block := list(islice(rows, _BLOCK)):
            for i, cells in enumerate(zip(*(row for _, row in block), strict=True)):
                values, at_fault = layout.parsed(i, cells)
                parts[i].append(midnights[i].on(values) if i in midnights else values)
                n_faults[i] += len(at_fault)
                if at_fault and first[i] is None:
                    k = at_fault[0]
                    first[i] = (cells[k], n_rows + k + 1, block[k][0])
            n_rows += len(block)
    faults = [fault_text(f[0], f[1], n, f[2]) if f else None for f, n in zip(first, n_faults, strict=True)]
    return [_column(_dated(layout, i), np.concatenate(parts[i]), faults[i]) for i in range(len(parts))]


def _dated(layout: _Layout, place: int) -> str:
    """Header of a column, in seconds where it holds dates or times of day and states no unit."""
    header = layout.names[place]
    return f"{headed(header)[0]} [s]" if layout.stamps and layout.stamps[place] is not None else header


def _rows(stream: Iterable[str], layout: _Layout, where: str) -> Iterator[tuple[int, list[str]]]:
    wanted, below = len(layout.names), False
    for number, line in _content(stream, layout.data_line):
        try:
            cells = layout.raw_cells(line)
        except csv.Error as error:
            raise _broken_line(where, number, error) from None
        if len(cells) != wanted:
            raise InputError(f"{where}: line {number} has {len(cells)} cell{'s' * (len(cells) != 1)}", got=_shown(line),
                             why=f"the header names {wanted} columns",
                             mend="repair that line, or remove what stands " +
                             ("below the data" if below or number > _PREAMBLE else "above the header"))
        below = below or _is_row(layout.with_points(cells))
        yield number, cells


def _broken_line(where: str, number: int, error: Exception) -> InputError:
    return InputError(f"{where}: line {number} cannot be read", got=str(error), mend="check its quotes")


def _shown(text: str) -> str:
    return f"'{text[:40]}…'" if len(text) > 40 else f"'{text}'"
