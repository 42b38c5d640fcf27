"""Files larger than memory: CSV, Parquet and MDF 4 read as a sequence of records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lpvid import _checks
from lpvid.condition.recalling import TIME_ROLE, channel_of, readings_of
from lpvid.condition.repeated_stamps import refuse_contradictions
from lpvid.condition.tables import Column, ColumnTable, clock_of, to_record
from lpvid.errors import InputError
from lpvid.files import find, natural, record_names
from lpvid.files._parts import READERS, reader
from lpvid.files._stamps import DATE, DATE_WITH_ZONE, DAY, TIME_OF_DAY
from lpvid.record import Record
from lpvid.units import convert

T = TypeVar("T")
_END = object()
ROWS = 131_072
"""Samples of a part: 1 MB a channel. Parts of 64 thousand to 500 thousand are read at about the same rate."""


@dataclass(frozen=True)
class Chunks:
    """Files as consecutive records; every loop over them reads the files anew, `rows` samples at a time.

    Parameters
    ----------
    sets : tuple of (str, tuple of Path)
        Records by name, each in one file or in several that continue each other.
    rows : int
        Samples in memory at once.
    roles : mapping of str to str
    sample_rate : float or None
        Rate [Hz] of files without a time column.
    channels : tuple of str or None
        Names or roles that are read; None for all.
    readings : tuple of mapping of str to str
        `Record.reading` of the training data of models, as `read` takes it from ``like``.
    """

    sets: tuple[tuple[str, tuple[Path, ...]], ...]
    rows: int
    roles: Mapping[str, str] = field(default_factory=dict)
    sample_rate: float | None = None
    channels: tuple[str, ...] | None = None
    readings: tuple[Mapping[str, str], ...] = ()

    def __iter__(self) -> Iterator[Record]:
        return (record for _, record in self.located())

    def only(self, channels: Sequence[str]) -> Chunks:
        """The same files, of which only these names or roles are read.

        Parameters
        ----------
        channels : sequence of str
            Names or roles.

        Returns
        -------
        Chunks
        """
        return replace(self, channels=tuple(channels))

    @property
    def version(self) -> str:
        """Names, sizes and dates of the files: another text where one of them has changed."""
        stats = [(str(p), p.stat().st_size, p.stat().st_mtime_ns) for _, parts in self.sets for p in parts]
        return repr((stats, dict(self.roles), self.sample_rate, *map(dict, self.readings)))

    def located(self, place: tuple[int, int, int] = (0, 0, 0)) -> Iterator[tuple[tuple[int, int, int], Record]]:
        """Records from a place on, each with the place behind it: set, file of the set, row of the file.

        Parameters
        ----------
        place : (int, int, int)
            As given with an earlier record; left out, the beginning.

        Yields
        ------
        (int, int, int), Record
        """
        begin, begin_part, begin_row = place
        for number, (name, parts) in enumerate(self.sets[begin:], begin):
            at_first = number == begin
            yield from self._set(number, name, parts, begin_part if at_first else 0, begin_row if at_first else 0)

    def _set(self, number: int, name: str, parts: Sequence[Path], first: int,
             row: int) -> Iterator[tuple[tuple[int, int, int], Record]]:
        """Records of one set; clocks that a file only states run on, and time must run forward."""
        last: Record | None = None
        rows_before = row + sum(_length(p) for p in parts[:first])

        def clock(table: ColumnTable, k: int) -> Column | None:
            return clock_of(table, str(parts[k]), self.roles, self.readings)

        one_clock = _SetClock(clock, parts)
        for k, table in self._beginnings(parts[: first + (row > 0)] if len(parts) > 1 else ()):
            one_clock.on(k, table)
        placed = ((k, after, one_clock.on(k, table)) for k, after, table in self._tables(parts, first, row))
        for k, after, table in _no_lone_row(_whole_stamps(placed, clock, parts), parts):
            path, size = parts[k], table.columns[0].values.size
            record = self._record(table, str(path), name)
            if record.time is None:
                assert record.sample_time is not None
                record = replace(record, time=None, start=rows_before * record.sample_time)
            elif last is not None:
                record = _behind(last, record, str(path), after - size)
            if self.channels is not None:  # here the row of the file is known
                refuse_contradictions(record, [c for c in self.channels if record.has(c)], max(after - size, 0))
            rows_before += size
            last = record
            yield (number, k, after), record

    def _tables(self, parts: Sequence[Path], first: int, row: int) -> Iterator[_Placed]:
        """File of the set, row behind the table, and the table."""
        for k, path in enumerate(parts[first:], first):
            read = reader(path)
            assert read is not None
            at = row if k == first else 0
            for table in read(path, self.rows, at, self._columns()):
                at += table.columns[0].values.size
                yield k, at, table

    def _beginnings(self, parts: Sequence[Path]) -> Iterator[tuple[int, ColumnTable]]:
        """The first rows of files before a restart, from which the clock of the set counts."""
        for k, path in enumerate(parts):
            read = reader(path)
            assert read is not None
            yield from ((k, table) for table in islice(read(path, 2, 0, self._columns()), 1))

    def _columns(self) -> list[str] | None:
        """Names in the file of what is read."""
        if self.channels is None:
            return None
        named = [c for c in (*self.channels, TIME_ROLE) if c != TIME_ROLE or c in self.roles]
        asked = [self.roles.get(c, c) for c in named]
        asked += [r[TIME_ROLE] for r in self.readings if TIME_ROLE in r]
        return asked + [channel_of(c, ())[0] for c in asked]

    def _record(self, table: ColumnTable, where: str, name: str) -> Record:
        """One part as a record; a role of a channel that is not read is left out."""
        read = {c.name.casefold() for c in table.columns}
        roles = {r: c for r, c in self.roles.items()
                 if self.channels is None or channel_of(c, read)[0].casefold() in read or c.casefold() in read}
        return to_record(table, where, name=name, sample_rate=self.sample_rate, roles=roles, readings=self.readings)


def read_chunks(paths: str | Path | Iterable[str | Path], rows: int = ROWS, *, roles: Mapping[str, str] | None = None,
                sample_rate: float | None = None, like: Any = None) -> Chunks:
    """Read CSV, Parquet and MDF 4 files as records of at most about `rows` samples that continue each other.

    The rules are those of `read`: units from the header, SI inside, missing samples NaN, text a fault of its channel.

    Parameters
    ----------
    paths : str, Path or several of them
        Files, patterns and folders, each file a record of its own. A folder named ``*.parquet`` is one data set, whose
        files continue each other in natural order.
    rows : int
        Samples in memory at once (the last record of a file may have one more, and any those rows that repeat its last
        time stamp).
    roles : mapping of str to str, optional
        Role name to channel name.
    sample_rate : float, optional
        Rate [Hz] of files without a time column.
    like : model or sequence of models, optional
        As for `read`.

    Returns
    -------
    Chunks
        An iterable of Record, to be run through as often as one likes.

    Raises
    ------
    InputError
        No such file, a format that cannot be read in parts; while looping, whatever `read` would refuse.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "run.csv"
    >>> _ = path.write_text("time [ms],velocity [mm/s]\\n" + "\\n".join(f"{2 * k},{k}" for k in range(7)))
    >>> [(r.n_samples, round(r.start, 3), r["velocity"].tolist()[:2]) for r in read_chunks(path, rows=3)]
    [(3, 0.0, [0.0, 0.001]), (4, 0.006, [0.003, 0.004])]
    """
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    sets: list[tuple[str, tuple[Path, ...]]] = []
    for item in given:
        folder = Path(item)
        if folder.is_dir() and folder.suffix.lower() in (".parquet", ".pq"):
            inside = [p for p in folder.rglob("*") if p.is_file() and reader(p) is not None]
            if not inside:
                raise InputError(f"{folder}: the data set holds no file", mend="export the data again")
            sets.append((folder.stem, tuple(sorted(inside, key=natural))))
            continue
        found = find(item)
        sets += [(name, (path,)) for name, path in zip(record_names(found), found, strict=True)]
    known = [e for extensions, _ in READERS for e in extensions]
    for path in (p for _, parts in sets for p in parts):
        if reader(path) is None:
            raise InputError(f"{path}: the format '{path.suffix}' cannot be read in parts",
                             mend=f"readable in parts are {', '.join(known)}")
    if len({name for name, _ in sets}) < len(sets):
        names = record_names([parts[0] if len(parts) == 1 else parts[0].parent for _, parts in sets])
        sets = [(name, parts) for name, (_, parts) in zip(names, sets, strict=True)]
    rate = None if sample_rate is None else _checks.positive(sample_rate, "sample_rate", "Hz")
    return Chunks(tuple(sets), _checks.count(rows, "rows", at_least=2), dict(roles or {}), rate,
                  readings=readings_of(like))


def read_ahead(items: Iterable[T]) -> Iterator[T]:
    """The same items, the next of which a thread reads while the caller works on the last.

    Two are in memory at once. What goes wrong while reading is raised where the item would have come.

    Parameters
    ----------
    items : iterable

    Yields
    ------
    object

    Examples
    --------
    >>> list(read_ahead(range(3)))
    [0, 1, 2]
    """
    source = iter(items)
    with ThreadPoolExecutor(1) as reading:
        following = reading.submit(next, source, _END)
        while (item := following.result()) is not _END:
            following = reading.submit(next, source, _END)
            yield item  # type: ignore[misc]


def _behind(last: Record, record: Record, where: str, row: int) -> Record:
    """The next part; its clock begins behind that of the part before."""
    assert last.time is not None and record.time is not None
    before, begin = last.time[-1], record.time[0]
    if begin <= before:
        raise InputError(f"{where}: time {'repeats' if begin == before else 'runs backward'} in row {row + 1}",
                         got=f"{begin:.9g} s after {before:.9g} s", mend="sort the rows, or drop the repeated one")
    return record


def _length(path: Path) -> int:
    """Rows of a part of a data set that a restart passes over."""
    if path.suffix.lower() in (".parquet", ".pq"):
        import pyarrow.parquet as pq

        return int(pq.read_metadata(path).num_rows)
    return 0


_PLURAL = {DATE: "dates", DATE_WITH_ZONE: "dates with zone", TIME_OF_DAY: "times of day"}
_Placed = tuple[int, int, ColumnTable]
_ClockOf = Callable[[ColumnTable, int], Column | None]


class _SetClock:
    """One clock for the files of a set: the unit of the first, and calendar stamps from its first instant on.

    Each file states its own unit, and its calendar stamps count from its own first one.
    """

    def __init__(self, clock: _ClockOf, parts: Sequence[Path]) -> None:
        self._clock, self._parts = clock, parts
        self._first: Column | None = None
        self._origin: tuple[np.datetime64, str] | None = None
        self._last = np.nan

    def on(self, k: int, table: ColumnTable) -> ColumnTable:
        """The next table, of file `k`, on that clock."""
        own = self._clock(table, k)
        if own is None or own.fault is not None or not np.isfinite(own.values).any():
            return table
        origin = table.origins.get(own.name)
        if self._first is None:
            self._first, self._origin = own, origin
        moved = own
        if k and own.unit != self._first.unit and own.unit is not None and self._first.unit is not None:
            moved = _in_unit_of(self._first, own, str(self._parts[k]))
            near = np.abs(moved.values - self._last) <= 2 * np.spacing(abs(self._last))
            moved = replace(moved, values=np.where(near, self._last, moved.values))  # 2.005 s and 2005 ms
        if (origin and origin[1]) != (self._origin and self._origin[1]):
            kinds = ["numbers" if o is None else _PLURAL[o[1]] for o in (self._origin, origin)]
            raise InputError(f"{self._parts[k]}: the clock has another kind of stamps than in the files before",
                             got=f"{kinds[1]} behind {kinds[0]}", mend="export the files of a data set alike")
        if origin is not None and self._origin is not None:
            moved = replace(moved, values=moved.values + self._since(k, origin, moved.values))
        known = moved.values[np.isfinite(moved.values)]
        self._last = float(known[-1]) if known.size else self._last
        return replace(table, columns=[moved if c is own else c for c in table.columns])

    def _since(self, k: int, origin: tuple[np.datetime64, str], values: np.ndarray) -> float:
        """Seconds from the set's first instant to that of a file, over midnight where stamps have no date."""
        assert self._origin is not None
        offset = float((origin[0] - self._origin[0]) / np.timedelta64(1, "s"))
        known = values[np.isfinite(values)]
        if k and origin[1] == TIME_OF_DAY and known.size and np.isfinite(self._last):
            offset += DAY * max(np.ceil((self._last - known[0] - offset) / DAY - 0.5), 0.0)
        return offset


def _whole_stamps(tables: Iterable[_Placed],
                  clock: _ClockOf,
                  parts: Sequence[Path]) -> Iterator[_Placed]:
    """The same tables, rows that repeat the last time stamp of the table before moved to its end.

    Rows of one stamp may complete each other (`one_row_per_stamp`), and whether they do shows only where all of them
    are in one record.
    """
    held: _Placed | None = None
    for k, after, table in tables:
        stamps, size, same = clock(table, k), table.columns[0].values.size, 0
        before = None if held is None else clock(held[2], held[0])
        if held is not None and stamps is not None and before is not None and before.values.size:
            other = np.flatnonzero(stamps.values != before.values[-1])
            same = int(other[0]) if other.size else size
        if held is not None and same:
            held = k, after - size + same, _joined(held[2], _rows(table, 0, same), str(parts[k]))
            if same == size:
                continue
            table = _rows(table, same, size)
        if held is not None:
            yield held
        held = k, after, table
    if held is not None:
        yield held


def _rows(table: ColumnTable, first: int, last: int) -> ColumnTable:
    return replace(table, columns=[replace(c, values=c.values[first:last]) for c in table.columns])


def _no_lone_row(tables: Iterable[_Placed], parts: Sequence[Path]) -> Iterator[_Placed]:
    """The same tables with a single row joined to the table before it: one sample has no clock."""
    held: _Placed | None = None
    for k, after, table in tables:
        if held is not None and (table.columns[0].values.size < 2 or held[2].columns[0].values.size < 2):
            held = k, after, _joined(held[2], table, str(parts[k]))
            continue
        if held is not None:
            yield held
        held = k, after, table
    if held is not None:
        yield held


def _joined(first: ColumnTable, second: ColumnTable, where: str) -> ColumnTable:
    """The rows of both, in the units of the first; what one of them lacks is missing there. `where` names the second.

    Tables of two files of a data set may have different columns and units.
    """
    sizes = [t.columns[0].values.size for t in (first, second)]
    own, later = ({c.name: c for c in t.columns} for t in (first, second))
    columns = []
    for name in dict.fromkeys((*own, *later)):
        a, b = own.get(name), later.get(name)
        behind = None if b is None or a is None else _in_unit_of(a, b, where)
        values = [c.values if c is not None else np.full(size, np.nan)
                  for c, size in zip((a, behind or b), sizes, strict=True)]
        kept = a or b
        assert kept is not None
        columns.append(replace(kept, values=np.concatenate(values), fault=(a and a.fault) or (b and b.fault)))
    return replace(first, columns=columns)


def _in_unit_of(before: Column, column: Column, where: str) -> Column:
    """A column in the unit that it has in the file before."""
    if column.unit == before.unit:
        return column
    try:
        return replace(column, values=convert(column.values, column.unit or "", before.unit or ""), unit=before.unit)
    except InputError:
        raise InputError(f"{where}: column '{column.name}' has another unit than in the file before",
                         got=f"[{column.unit or ''}] behind [{before.unit or ''}]",
                         mend="give the column one unit in all files of the data set") from None
