"""What the readers share: text cells as numbers, claims of headers, errors that name files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from lpvid import units
from lpvid.errors import InputError

MISSING = frozenset({"", "nan", "+nan", "-nan", "na", "n/a"})
"""Cells, case folded, that stand for a missing sample."""
_GROUPED = re.compile(r"([+-]?\d{1,3})((?:([.,'\u2019\u00a0\u202f])\d{3})(?:\3\d{3})*)(?:([.,])(\d+))?")
"""Digits in groups of three, of one separator, and decimals behind another."""
SIZE_LIMIT = 4 * 2**30
"""Bytes of samples above which a file is refused."""
DEFLATE_RATIO = 1100
"""Deflate cannot pack tighter than 1032:1; a file that claims more than this times its size is lying."""


def check_claim(claimed: int, where: str, *, held: int | None = None, what: str = "") -> None:
    """Refuse a header that claims more bytes of samples than are sane, or than `held` packed bytes can hold."""
    subject = f"{where}: {what or 'the header'} claims {claimed / 1e6:.6g} MB of samples"
    if held is not None and claimed > DEFLATE_RATIO * held + 65536:
        raise InputError(subject, got=f"{held} bytes", why="the file is corrupt", mend="export the data again")
    if claimed > SIZE_LIMIT:
        raise InputError(subject, why=f"more than the limit of {SIZE_LIMIT / 1e6:.6g} MB",
                         mend="split the file, or export it at a lower rate")


def parse_cells(cells: Sequence[str], decimal_comma: bool = False, thousands: str = "") -> tuple[np.ndarray, list[int]]:
    """Numbers from text cells: NaN where a cell is missing, and where it holds text, whose places are listed.

    Parameters
    ----------
    cells : sequence of str
    decimal_comma : bool
        Whether a comma separates decimals, where it separates no thousands.
    thousands : str
        Point or comma, where it separates thousands in the column that these cells are of (`thousands_in`).

    Returns
    -------
    values : (n,) array
    at_fault : list of int
        Places of the cells that hold text.

    Examples
    --------
    >>> parse_cells(["1.5", "", "abc"])
    (array([1.5, nan, nan]), [2])
    >>> parse_cells(["1.024", "12,5"], decimal_comma=True, thousands=".")[0]
    array([1024. ,   12.5])
    """
    joined = "".join(cells)
    if not thousands and joined.isascii() and "_" not in joined:
        try:
            plain = [c.replace(",", ".") for c in cells] if decimal_comma else cells
            return np.array(list(map(float, plain))), []
        except ValueError:
            pass
    numbers = [_number(cell, decimal_comma) for cell in _grouped_alike(cells, thousands)]
    at_fault = [i for i, number in enumerate(numbers) if number is None]
    return np.array([np.nan if number is None else number for number in numbers], dtype=float), at_fault


def fault_text(cell: str, row: int, n_faults: int, line: int | None = None) -> str:
    """State which text stands in which row (from 1), and in how many rows besides."""
    place = f"row {row}" + (f" (line {line} of the file)" if line is not None else "")
    return f"text '{cell.strip()[:36]}' in {place}" + (f" and in {n_faults - 1} more row(s)" if n_faults > 1 else "")


def ungrouped(cell: str) -> str:
    """A number without its thousands separators and with a decimal point; any other cell as it is.

    Only where it can be read in one way: ``1.024,5`` and ``1,024.5`` hold two separators, ``1.024.735`` cannot be a
    decimal, and neither an apostrophe nor a hard space separates decimals. ``1.024`` stays as it is; in a column whose
    other cells show what the point is (`thousands_in`), `parse_cells` reads it as those.

    Parameters
    ----------
    cell : str

    Returns
    -------
    str

    Examples
    --------
    >>> [ungrouped(c) for c in ("-1.024,5", "1,024.5", "1.024.735", "1'024", "1.024", "12,5", "26.11.2026")]
    ['-1024.5', '1024.5', '1024735', '1024', '1.024', '12,5', '26.11.2026']
    """
    found = _GROUPED.fullmatch(cell.strip())
    if found is None or _is_open(found):
        return cell
    head, groups, separator, point, decimals = found.groups()
    if point == separator:
        return cell
    return head + groups.replace(separator, "") + (f".{decimals}" if decimals else "")


def _is_open(found: re.Match[str]) -> bool:
    """Whether the separator may be that of decimals: ``1.024``."""
    _, groups, separator, point, _ = found.groups()
    return separator in ".," and point is None and groups.count(separator) == 1


def thousands_in(cells: Iterable[str]) -> set[str]:
    """Point or comma that cells of a column can only have between thousands; both where they contradict each other.

    Parameters
    ----------
    cells : iterable of str

    Returns
    -------
    set of str

    Examples
    --------
    >>> thousands_in(["1.024", "1.345,25"]), thousands_in(["1.024", "12,5"])
    ({'.'}, set())
    """
    found = (_GROUPED.fullmatch(cell.strip()) for cell in cells)
    return {m[3] for m in found if m and m[3] in ".," and not _is_open(m) and m[4] != m[3]}


def the_thousands(shown: set[str]) -> str:
    """The separator of a column whose cells show these; empty where none or several do."""
    return next(iter(shown)) if len(shown) == 1 else ""


def _grouped_alike(cells: Sequence[str], thousands: str) -> Sequence[str]:
    """Cells of a column, those that are open (``1.024``) without the separator that is of thousands there."""
    if not thousands:
        return cells
    found = [_GROUPED.fullmatch(cell.strip()) for cell in cells]
    return [m[1] + m[2].replace(m[3], "") if m and _is_open(m) and m[3] == thousands else cell
            for m, cell in zip(found, cells, strict=True)]


def _number(cell: str, decimal_comma: bool = False) -> float | None:
    text = ungrouped(cell).strip()
    if decimal_comma:
        text = text.replace(",", ".")
    if text.casefold() in MISSING:
        return np.nan
    if not text.isascii() or "_" in text:  # float() takes 1_000 and digits of any script
        return None
    try:
        return float(text)
    except ValueError:
        return None


def is_number(cell: str) -> bool:
    """True when a cell holds a number (a missing sample is none)."""
    return _number(cell) is not None and cell.strip().casefold() not in MISSING


def corrupt(where: str, format_name: str, error: Exception) -> InputError:
    """The error for a file that its own library cannot read."""
    stated = " ".join(str(error).split())[:120] or type(error).__name__
    return InputError(f"{where}: cannot be read as {format_name}", got=stated,
                      why="the file is damaged or of another format", mend="export the data again")


@contextmanager
def intact(where: str, format_name: str) -> Iterator[None]:
    """Whatever a library raises on a damaged file becomes an error of the input: struct's, numpy's, Python's own."""
    try:
        yield
    except (InputError, PermissionError, FileNotFoundError, MemoryError):
        raise
    except Exception as error:
        raise corrupt(where, format_name, error) from None


def without_library(where: str, library: str) -> InputError:
    """The error for a format whose optional library is not installed."""
    return InputError(f"{where}: reading this format needs {library}, which is not installed",
                      mend="pip install 'lpvid[files]'")


def stated_period(metadata: Mapping[str, object], where: str) -> float | None:
    """Sampling period [s] from `sample_time` [s] or `sample_rate` [Hz] in a file's metadata; None without either."""
    for key, unit in (("sample_time", "s"), ("sample_rate", "Hz")):
        if key in metadata:
            number, _ = units.quantity_to_si(metadata[key], unit=unit)
            if not number > 0:
                raise InputError(f"{where}: {key} must be positive", got=metadata[key], mend="state the true one")
            return number if key == "sample_time" else 1.0 / number
    return None


def headed(header: str) -> tuple[str, str | None]:
    """Name and unit of a column header; the name may be empty."""
    return units.parse_header(header)
