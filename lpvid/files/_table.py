"""What every reader hands over: named columns as the file has them; and how they become a Record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid import units
from lpvid.errors import InputError
from lpvid.record import Channel, Record

MISSING = frozenset({"", "nan", "+nan", "-nan", "na", "n/a"})
"""Cells, case folded, that stand for a missing sample."""
SIZE_LIMIT = 4 * 2**30
"""Bytes of samples above which a file is refused."""
DEFLATE_RATIO = 1100
"""Deflate cannot pack tighter than 1032:1; a file that claims more than this times its size is lying."""
_MEND_TIME = "add a column 'time [s]', or state the rate: --sample-rate HZ, in Python read(..., sample_rate=HZ)"


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a file: its name, samples in the file's own unit, the unit's text, and a fault if it has one."""

    name: str
    values: np.ndarray
    unit: str | None = None
    fault: str | None = None


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of equal length; `sample_time` [s] when the file states it apart from any column."""

    columns: Sequence[Column]
    sample_time: float | None = None
    notes: Sequence[str] = field(default_factory=tuple)


def check_claim(claimed: int, where: str, *, held: int | None = None, what: str = "") -> None:
    """Refuse a header that claims more bytes of samples than are sane, or than `held` packed bytes can hold."""
    subject = f"{where}: {what or 'the header'} claims {claimed / 1e6:.6g} MB of samples"
    if held is not None and claimed > DEFLATE_RATIO * held + 65536:
        raise InputError(subject, got=f"{held} bytes", why="the file is corrupt", mend="export the data again")
    if claimed > SIZE_LIMIT:
        raise InputError(subject, why=f"more than the limit of {SIZE_LIMIT / 1e6:.6g} MB",
                         mend="split the file, or export it at a lower rate")


def parse_cells(cells: Sequence[str]) -> tuple[np.ndarray, list[int]]:
    """Numbers from text cells: NaN where a cell is missing, and where it holds text, whose places are listed.

    Parameters
    ----------
    cells : sequence of str

    Returns
    -------
    values : (n,) array
    at_fault : list of int
        Places of the cells that hold text.

    Examples
    --------
    >>> parse_cells(["1.5", "", "abc"])
    (array([1.5, nan, nan]), [2])
    """
    joined = "".join(cells)
    if joined.isascii() and "_" not in joined:
        try:
            return np.array(list(map(float, cells))), []
        except ValueError:
            pass
    numbers = [_number(cell) for cell in cells]
    at_fault = [i for i, number in enumerate(numbers) if number is None]
    return np.array([np.nan if number is None else number for number in numbers], dtype=float), at_fault


def fault_text(cell: str, row: int, n_faults: int, line: int | None = None) -> str:
    """Say which text stands in which row (from 1), and in how many rows besides."""
    place = f"row {row}" + (f" (line {line} of the file)" if line is not None else "")
    return f"text '{cell.strip()[:20]}' in {place}" + (f" and in {n_faults - 1} more row(s)" if n_faults > 1 else "")


def _number(cell: str) -> float | None:
    text = cell.strip()
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
    said = " ".join(str(error).split())[:120] or type(error).__name__
    return InputError(f"{where}: cannot be read as {format_name}", got=said,
                      why="the file is damaged or of another format", mend="export the data again")


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


def to_record(table: Table, where: str, *, name: str, sample_rate: float | None,
              roles: Mapping[str, str] | None) -> Record:
    """Turn a file's columns into a Record in SI.

    Parameters
    ----------
    table : Table
    where : str
        The file, for messages.
    name : str
        The record's name.
    sample_rate : float or None
        Rate [Hz] of a file that has neither a time column nor a stated period.
    roles : mapping or None
        Role name to channel name.

    Returns
    -------
    Record

    Raises
    ------
    InputError
        Names missing or used twice, unequal lengths, no samples, no usable time base.
    """
    _check_columns(table.columns, where)
    clock = _time_column(table.columns)
    signals = [c for c in table.columns if c is not clock]
    if not signals:
        raise InputError(f"{where}: there is no channel beside '{table.columns[0].name}'",
                         mend="export at least one channel")
    channels: dict[str, Channel] = {}
    notes = list(table.notes)
    for column in signals:
        values, unit, known = units.to_si(column.values, column.unit)
        channels[column.name] = Channel(values, unit, column.unit, known, column.fault)
        if column.fault:
            notes.append(f"channel '{column.name}': {column.fault}")
    time, period = None, table.sample_time
    if clock is not None:
        time, period = _seconds(clock, where), None
        if sample_rate is not None:
            notes.append(f"time column '{clock.name}' sets the clock; the stated {sample_rate:g} Hz are not used")
    elif period is None:
        if sample_rate is None:
            raise InputError(f"{where}: no time column", got=", ".join(c.name for c in signals), mend=_MEND_TIME)
        period = 1.0 / sample_rate
    try:
        return Record(channels, sample_time=period, time=time, roles=dict(roles or {}), name=name, notes=tuple(notes))
    except InputError as error:
        raise InputError(f"{where}: {error.what}", got=error.got, why=error.why, mend=error.mend) from None


def _check_columns(columns: Sequence[Column], where: str) -> None:
    if not columns:
        raise InputError(f"{where}: there are no columns", mend="export at least a time column and one channel")
    seen: dict[str, int] = {}
    for i, column in enumerate(columns, 1):
        if not column.name:
            raise InputError(f"{where}: column {i} has no name", mend="write a header 'name [unit]' for every column")
        if column.name in seen:
            raise InputError(f"{where}: two columns are named '{column.name}'",
                             got=f"columns {seen[column.name]} and {i}", mend="give every column a name of its own")
        seen[column.name] = i
    lengths = {c.name: c.values.size for c in columns}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{where}: channels differ in length", got=_listed(lengths.items()),
                         mend="export them on one time base")
    if not columns[0].values.size:
        raise InputError(f"{where}: there are no samples", mend="export the data again")


def _listed(pairs: Iterable[tuple[str, int]]) -> str:
    shown = [f"{name} {size}" for name, size in pairs]
    return ", ".join(shown[:6]) + (f" and {len(shown) - 6} more" if len(shown) > 6 else "")


def is_time_name(name: str) -> bool:
    """True for the names under which a time column goes."""
    return name.casefold() in ("time", "t")


def _time_column(columns: Sequence[Column]) -> Column | None:
    for wanted in ("time", "t"):
        for column in columns:
            if column.name.casefold() == wanted:
                return column
    return None


def _seconds(column: Column, where: str) -> np.ndarray:
    if column.fault:
        raise InputError(f"{where}: time column '{column.name}' holds {column.fault}",
                         mend="write time as numbers, with its unit in the header: 'time [s]'")
    values, unit, known = units.to_si(column.values, column.unit)
    if column.unit is not None and not (known and unit == "s"):
        raise InputError(f"{where}: time column '{column.name}' has the unit '{column.unit}'",
                         why="which is not one of time", mend="write e.g. 'time [s]' or 'time [ms]'")
    return values
