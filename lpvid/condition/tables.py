"""Tables: named columns with units, from files, dicts or data frames, and how they become a Record."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from shlex import quote
from typing import Any

import numpy as np

from lpvid import _checks, units
from lpvid.condition.recalling import TIME_ROLE, channel_of, recalled_clock, recalled_units
from lpvid.condition.repeated_stamps import one_row_per_stamp
from lpvid.errors import InputError
from lpvid.record import Channel, Record
from lpvid.remark import ReadAs
from lpvid.timebase import calendar_seconds

_MEND_TIME = ("add a column 'time [s]', name the time column: --role {1}, or state the rate: --sample-rate {2}, in "
              "Python read(..., roles={{'time': '{0}'}}) or sample_rate={2}")
NO_TIME_UNIT = "gives no unit: taken as s"
"""How the note of a record ends whose clock has no stated unit."""


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a file: its name, samples in the file's own unit, the unit's text, and a fault if it has one.

    Attributes
    ----------
    name : str
        As in the file.
    values : (n,) array
    unit : str or None
        None where the file gives none.
    fault : str or None
        Why the column is no use, in words.
    """

    name: str
    values: np.ndarray
    unit: str | None = None
    fault: str | None = None


@dataclass(frozen=True, eq=False)
class ColumnTable:
    """Columns of equal length; `sample_time` [s] when the file states it apart from any column.

    Attributes
    ----------
    columns : sequence of Column
        The time column, if any, is one of them.
    sample_time : float or None
    notes : sequence of str
        What was left out on reading.
    scalars : mapping of str to float
        Single numbers beside the columns, of which one may be the rate under a name of the user's.
    origins : mapping of str to (datetime64, str)
        By column of calendar stamps, the instant from which its seconds count, and the kind of the stamps: "date",
        "date with zone" or "time of day".
    """

    columns: Sequence[Column]
    sample_time: float | None = None
    notes: Sequence[str] = field(default_factory=tuple)
    scalars: Mapping[str, float] = field(default_factory=dict)
    origins: Mapping[str, tuple[np.datetime64, str]] = field(default_factory=dict)


def to_record(table: ColumnTable, where: str, *, name: str, sample_rate: float | None,
              roles: Mapping[str, str] | None, readings: Sequence[Mapping[str, str]] = ()) -> Record:
    """Turn a file's columns into a Record in SI.

    Parameters
    ----------
    table : ColumnTable
    where : str
        The file, for messages.
    name : str
        The record's name.
    sample_rate : float or None
        Rate [Hz] of a file that has neither a time column nor a stated period.
    roles : mapping or None
        Role name to channel name, with a unit where the file states none or one that is refused: ``{"displacement":
        "x [mm]"}``; the role ``time`` names the time column.
    readings : sequence of mapping of str to str
        `Record.reading` of the training data of models: their clock and units count where `roles` and the file leave
        them open.

    Returns
    -------
    Record

    Raises
    ------
    InputError
        Names missing or used twice, unequal lengths, no samples, no usable time base.
    """
    _check_columns(table.columns, where)
    columns, signal_roles, restated = _with_stated_units(table.columns, roles or {}, where)
    columns, reading, recalled = _with_recalled_units(columns, roles or {}, readings, where)
    asked = signal_roles.pop(TIME_ROLE, None)
    named = asked or recalled_clock(readings, [c.name for c in columns], where)
    clock = _time_column(columns, named, where)
    if named is not None:
        reading = {TIME_ROLE: named, **reading}
    signals = [c for c in columns if c is not clock]
    if not signals:
        raise InputError(f"{where}: there is no channel beside '{table.columns[0].name}'",
                         mend="export at least one channel")
    channels: dict[str, Channel] = {}
    notes = [*table.notes, *restated, *recalled]
    for column in signals:
        values, unit, known = units.to_si(column.values, column.unit)
        channels[column.name] = Channel(_checks.owned(values), unit, column.unit, known, column.fault)
        if column.fault:
            notes.append(f"channel '{column.name}': {column.fault}")
    time, period = None, table.sample_time
    if clock is not None:
        time, period = _seconds(clock, where), None
        if clock.unit is None:
            notes.append(f"the time column '{clock.name}' {NO_TIME_UNIT}")
        if sample_rate is not None:
            notes.append(f"time column '{clock.name}' sets the clock; the stated {sample_rate:g} Hz are not used")
    elif period is None:
        if sample_rate is None:
            lacking, like = _lacking_clock(readings), _like_time(signals)
            raise InputError(f"{where}: no time column", got=", ".join(c.name for c in signals),
                             why=f"the clock of the model's training data, {lacking}, is not there" if lacking else "",
                             mend=_MEND_TIME.format(like, quote(f"time={like}"), _like_rate(table.scalars)))
        period = 1.0 / sample_rate
    own = None if named is None or asked else _time_column(columns, None, where)
    if own is not None and own is not clock:
        notes.append(ReadAs(f"column '{named}', not '{own.name}', is the clock, as in the model's training data"))
    if named is None and _lacking_clock(readings):
        notes.append(ReadAs((f"column '{clock.name}' is the clock" if clock is not None else
                             f"the clock is that of {1 / period:.6g} Hz" if period else "") +
                            f": {_lacking_clock(readings)}, that of the model's training data, is not there"))
    try:
        record = Record(channels, sample_time=period, time=time, roles=signal_roles, name=name, notes=tuple(notes),
                        reading=reading)
    except InputError as error:
        raise InputError(f"{where}: {error.what}", got=error.got, why=error.why, mend=error.mend) from None
    return one_row_per_stamp(record)


def clock_of(table: ColumnTable, where: str, roles: Mapping[str, str],
             readings: Sequence[Mapping[str, str]] = ()) -> Column | None:
    """The time column of a file's columns as `to_record` finds it.

    Parameters
    ----------
    table : ColumnTable
    where : str
        The file, for messages.
    roles : mapping of str to str
    readings : sequence of mapping of str to str
        As for `to_record`.

    Returns
    -------
    Column or None
        As the file has it; None where it has no clock.
    """
    names = [c.name for c in table.columns]
    asked = channel_of(roles[TIME_ROLE], names)[0] if TIME_ROLE in roles else None
    return _time_column(table.columns, asked or recalled_clock(readings, names, where), where)


def _lacking_clock(readings: Sequence[Mapping[str, str]]) -> str:
    """Columns that were the clock of models' training data, in quotes; empty for none."""
    return " or ".join(f"'{c}'" for c in dict.fromkeys(channel_of(r[TIME_ROLE], ())[0] for r in readings
                                                       if TIME_ROLE in r))


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
    """True for the names under which a time column goes.

    Parameters
    ----------
    name : str
        In upper or lower case.

    Returns
    -------
    bool
    """
    return name.casefold() in ("time", "t")


def _with_stated_units(columns: Sequence[Column], roles: Mapping[str, str], where: str
                       ) -> tuple[list[Column], dict[str, str], list[str]]:
    """Columns with the units that roles state for them, the roles without those, and which units they replace.

    A unit of the file is replaced where it could not be used: it is unknown, or of another quantity than the names of
    column and role call for (pounds of a force, which are a mass).
    """
    found, plain, stated_by, notes = {c.name: c for c in columns}, {}, dict[str, str](), list[str]()
    for role, text in roles.items():
        plain[role], unit = channel_of(text, found)
        column = found.get(plain[role])
        if column is None or unit is None:
            continue
        if column.unit is not None and column.unit != unit:
            if column.name in stated_by:
                raise InputError(f"{where}: two roles state different units of column '{column.name}'",
                                 got=f"[{column.unit}] in --role {stated_by[column.name]}, [{unit}] in --role {role}",
                                 mend="state one of them: the column has one unit, whatever role it serves")
            if _usable(column, role):
                raise InputError(f"{where}: the header of column '{column.name}' states its own unit",
                                 got=f"'{column.name} [{column.unit}]' in the file, [{unit}] in --role {role}",
                                 mend=f"leave the unit out, --role {role}={column.name}, or correct the header")
            notes.append(f"column '{column.name} [{column.unit}]' is read in {unit}, as --role {role} states")
        stated_by.setdefault(column.name, role)
        found[column.name] = replace(column, unit=unit)
    return list(found.values()), plain, notes


def _with_recalled_units(columns: Sequence[Column], roles: Mapping[str, str], readings: Sequence[Mapping[str, str]],
                         where: str) -> tuple[list[Column], dict[str, str], list[str]]:
    """Columns with the units that a role stated for a model's training data, where neither file nor role states one.

    Returns
    -------
    list of Column
    dict of str to str
        Role to ``column [unit]`` wherever no header states that unit: a `Record.reading` without its clock.
    list of str
        What was recalled.
    """
    names = {c.name for c in columns}
    stated = {column: (role, unit) for role, (column, unit) in
              ((r, channel_of(text, names)) for r, text in roles.items()) if unit is not None}
    before = {channel_of(text, names)[0]: role for r in readings for role, text in r.items()}
    unset = [c.name for c in columns if c.name not in stated and c.name in before
             and (c.unit is None or not _usable(c, before[c.name]))]
    recalled = recalled_units(readings, unset, where)
    found = [replace(c, unit=recalled[c.name][1]) if c.name in recalled else c for c in columns]
    reading = {role: f"{column} [{unit}]" for column, (role, unit) in {**stated, **recalled}.items()}
    return found, reading, [ReadAs(f"column '{column}' is read in {unit}, as that of the model's training data")
                            for column, (_, unit) in recalled.items()]


def _usable(column: Column, role: str) -> bool:
    """Whether the unit that a file states for a column is known and of the quantity that its name and role call for."""
    _, unit, known = units.to_si([0.0], column.unit)
    return known and not units.contradicts(column.name, unit, column.unit) and not units.contradicts(role, unit)


_TIME_NAME = re.compile(r"(?:time|zeit|t)(?:[_ -](?P<unit>[mun]?s|sec|min|h))?(?:[_ ].*)?", re.IGNORECASE)


def _like_time(columns: Sequence[Column]) -> str:
    """A column in a unit of time, else one whose name states time, with the unit of the name; else a placeholder."""
    for column in columns:
        if column.unit and units.to_si([0.0], column.unit).unit == "s":
            return column.name
    found = [(c, m) for c in columns if c.unit is None and (m := _TIME_NAME.fullmatch(c.name.rpartition(".")[2]))]
    if not found:
        return "COLUMN"
    column, match = found[0]
    return f"{column.name} [{match['unit']}]" if match["unit"] else column.name


_RATE_NAME = re.compile(r"f_?s(?:amp(?:le|ling)?)?(?:_?hz)?|samp(?:le|ling)_?(?:rate|freq(?:uency)?)|abtastrate",
                        re.IGNORECASE)
_PERIOD_NAME = re.compile(r"t_?s(?:amp(?:le)?)?|d_?t|delta_?t|samp(?:le|ling)_?(?:time|period|interval)|abtastzeit",
                          re.IGNORECASE)


def _like_rate(scalars: Mapping[str, float]) -> str:
    """The rate [Hz] that a single number of the file seems to state; else a placeholder."""
    positive = {name: value for name, value in scalars.items() if np.isfinite(value) and value > 0}
    rates = [value for name, value in positive.items() if _RATE_NAME.fullmatch(name)]
    rates += [1 / value for name, value in positive.items() if _PERIOD_NAME.fullmatch(name)]
    return f"{rates[0]:.9g}" if rates else "HZ"


def _time_column(columns: Sequence[Column], named: str | None, where: str) -> Column | None:
    if named is not None:
        name = _checks.known_name(named, [c.name for c in columns], "column", f"--role {TIME_ROLE}=COLUMN", where)
        return next(c for c in columns if c.name == name)
    for wanted in ("time", "t"):
        for column in columns:
            if column.name.casefold() == wanted:
                return column
    return None


def _seconds(column: Column, where: str) -> np.ndarray:
    if column.fault:
        raise InputError(f"{where}: time column '{column.name}' holds {column.fault}",
                         mend="write all rows alike: as numbers, with the unit in the header: 'time [s]', or in csv as "
                         "2026-11-26T10:12:13.5, 26.11.2026 10:12:13.5 or 10:12:13.5")
    values, unit, known = units.to_si(column.values, column.unit)
    if column.unit is not None and not (known and unit == "s"):
        raise InputError(f"{where}: time column '{column.name}' has the unit '{column.unit}'",
                         why="which is not one of time", mend="write e.g. 'time [s]' or 'time [ms]'")
    return values


def as_records(data: Any, name: str = "data", units: Mapping[str, str] | None = None) -> list[Record]:
    """Records from whatever holds columns: records, dicts of arrays, data frames, datasets, or lists of these.

    A column is named ``name [unit]`` as in a file's header, and one is called ``time`` or ``t``; a list is several
    records. Data frames are those of pandas or polars; of numpy, structured arrays have columns; of xarray, a Dataset
    of one dimension, whose attribute ``units`` counts where a name states no unit. The index of a pandas frame is its
    clock where no column is, and it is called so or holds times. Dates become seconds from the first one. Entries that
    a masked array masks are missing: NaN.

    Parameters
    ----------
    data : Record, mapping, data frame, structured array, xarray Dataset, or sequence of these
        With `units` also a plain (n, n_columns) array.
    name : str
        What to call records that have no name of their own; several are numbered.
    units : mapping of str to str, optional
        Of columns whose name states none, where the data are no Records; of a plain array, its columns in order.

    Returns
    -------
    list of Record

    Raises
    ------
    InputError
        Something that holds no named columns (an array without `units`, a path), columns without a time, of unequal
        lengths or not real numbers; a unit of no column, or of a Record, which has its own.

    Examples
    --------
    >>> import numpy as np
    >>> as_records({"time [ms]": [0.0, 2.0, 4.0], "force [kN]": [0.0, 1.0, 0.5]})[0]["force"]
    array([   0., 1000.,  500.])
    """
    if isinstance(data, Record):
        return [one_row_per_stamp(_with_own_units(data, units))]
    if isinstance(data, np.ndarray) and data.ndim == 2 and units is not None:
        data = _named_columns(data, units)
    if hasattr(data, "collect_schema") and not hasattr(data, "to_numpy"):
        raise InputError("a lazy frame holds no data yet", got=type(data).__name__, mend="give frame.collect()")
    if hasattr(data, "to_dataset") and not hasattr(data, "data_vars"):
        data = _dataset(data)
    if _columns_of(data) is not None:
        return [_from_columns(data, name, units or {})]
    if isinstance(data, Iterable) and not isinstance(data, (str, bytes, np.ndarray)):
        listed = list(data)
        if any(isinstance(one, (int, float, np.number)) for one in listed):
            raise _no_record(data)
        several = len(listed) > 1
        return [r for k, one in enumerate(listed) for r in
                as_records(one, f"{name} {k + 1}" if several else name, units)]
    raise _no_record(data)


def _with_own_units(record: Record, units: Mapping[str, str] | None) -> Record:
    if units is not None:
        raise InputError("units= belongs to columns whose names state none", got=f"record '{record.name}', which has "
                         "its own", mend="leave units= out, or give them to lpv.Record(..., units={...})")
    return record


def _dataset(data: Any) -> Any:
    """An xarray DataArray of one named channel as a Dataset."""
    if getattr(data, "name", None) is None or len(data.dims) != 1:
        raise InputError("a DataArray is one channel with a name and one dimension",
                         got=f"name {data.name!r}, dimensions {', '.join(map(str, data.dims)) or 'none'}",
                         mend="give a Dataset: array.to_dataset(dim=...) or array.to_dataset(name=...)")
    return data.to_dataset()


def _named_columns(data: np.ndarray, units: Mapping[str, str]) -> dict[str, np.ndarray]:
    """The columns of an array by the names in `units`."""
    if data.shape[1] != len(units):
        raise InputError("units= names every column of an array in order", got=f"{len(units)} names, {data.shape[1]} "
                         "columns", mend='units={"time": "s", "velocity": "m/s", "force": "N"}')
    return dict(zip(units, data.T, strict=True))


def _columns_of(data: Any) -> list[str] | None:
    """Names by which columns can be had; None for what has none.

    Mappings, structured arrays, data frames (of pandas or polars), and datasets of xarray: their variables, and their
    coordinates that are indices.
    """
    if isinstance(data, np.ndarray):
        return None if data.dtype.names is None else list(data.dtype.names)
    if hasattr(data, "data_vars") and hasattr(data, "indexes"):
        return [*map(str, data.indexes), *map(str, data.data_vars)]
    if isinstance(data, Mapping):
        return list(data)
    return list(data.columns) if hasattr(data, "columns") and hasattr(data, "__getitem__") else None


def _no_record(data: Any) -> InputError:
    mend = "lpv.read(path) reads a file" if isinstance(data, (str, bytes)) or hasattr(data, "__fspath__") else (
        "wrap it in lpv.Record({\"velocity\": v, \"force\": f}, sample_time=..., units={...}), or give a dict or data "
        "frame with named columns, or an array with units={\"time\": \"s\", ...} naming its columns")
    return InputError("data are records, or columns by name", got=type(data).__name__, mend=mend)


def _from_columns(data: Any, name: str, stated: Mapping[str, str]) -> Record:
    headers = _columns_of(data)
    if headers is None:
        raise _no_record(data)
    twice = next((h for h, n in Counter(map(str, headers)).items() if n > 1), None)
    if twice is not None:
        raise InputError(f"{name}: two columns are named '{twice}'", mend="give every column a name of its own")
    titles = [units.parse_header(str(header)) for header in headers]
    sources = [(str(header), data[header]) for header in headers]
    if not any(is_time_name(title) for title, _ in titles) and (clock := _index_clock(data)) is not None:
        titles, sources = [units.parse_header(clock[0]), *titles], [clock, *sources]
    for title in stated:
        _checks.known_name(title, [known for known, _ in titles], "column in units=")
    columns = []
    for (header, source), (title, unit) in zip(sources, titles, strict=True):
        unit = unit if unit is not None else stated.get(title)
        unit = unit if unit is not None else getattr(source, "attrs", {}).get("units")
        try:
            source = _checks.real_numbers(source)
            seconds = calendar_seconds(source)
            values = np.asarray(source, dtype=float) if seconds is None else seconds
        except (TypeError, ValueError) as error:
            raise InputError(f"{name}: column '{header}' must hold numbers", why=" ".join(str(error).split())[:80],
                             mend="leave it out, or convert it") from None
        if values.ndim != 1:
            raise InputError(f"{name}: column '{header}' must have one dimension", got=f"shape {values.shape}")
        columns.append(Column(title, values, unit if seconds is None else "s"))
    return to_record(ColumnTable(columns), name, name=name, sample_rate=None, roles=None)


def _index_clock(data: Any) -> tuple[str, Any] | None:
    """Name and values of a pandas index that is a clock: called ``time`` or ``t``, or of dates or durations."""
    index = getattr(data, "index", None)
    if index is None or not hasattr(data, "iloc"):
        return None
    label = str(getattr(index, "name", None) or "")
    if label and is_time_name(units.parse_header(label)[0]):
        return label, index
    return None if calendar_seconds(index) is None else ("time [s]", index)
