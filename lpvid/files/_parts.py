"""Tables of consecutive samples from the middle of a file on: CSV, Parquet and MDF 4 in parts."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from lpvid.condition.tables import Column, ColumnTable, is_time_name
from lpvid.errors import InputError
from lpvid.files import csv, mdf4, parquet
from lpvid.files._stamps import DATE, DATE_WITH_ZONE
from lpvid.files._table import fault_text, headed, stated_period, the_thousands, thousands_in

Reader = Callable[[Path, int, int, Sequence[str] | None], Iterator[ColumnTable]]
"""(path, rows of a part, row to begin with, channels wanted or None for all) to tables."""


def reader(path: Path) -> Reader | None:
    """What reads a file of this extension in parts; None where nothing does."""
    for extensions, read in READERS:
        if path.suffix.lower() in extensions:
            return read
    return None


# -- text ------------------------------------------------------------------------------------------------------------
def _csv_tables(path: Path, rows: int, first: int, wanted: Sequence[str] | None) -> Iterator[ColumnTable]:
    where = str(path)
    if path.stat().st_size == 0:
        raise InputError(f"{where}: the file is empty (0 bytes)", mend="export the data again")
    layout = csv.with_thousands(path, csv._layout(path, where), where)
    line, row, midnights = layout.data_line, 0, layout.midnights()
    origins = {headed(n)[0]: (s.origin, s.kind)
               for n, s in zip(layout.names, layout.stamps, strict=False) if s is not None}
    with path.open(encoding=layout.encoding, newline=None) as stream:
        lines = islice(stream, layout.data_line - 1, None)
        while row < first:
            block = list(islice(lines, min(first - row, rows)))
            if not block:
                return
            row += _passed(block, replace(layout, data_line=line), where, midnights)
            line += len(block)
        while block := list(islice(lines, rows)):
            columns = _columns(block, replace(layout, data_line=line), where, row, midnights)
            line += len(block)
            if columns[0].values.size:
                row += columns[0].values.size
                yield ColumnTable(csv._without_trailing(columns), origins=origins)


def _passed(block: list[str], layout: Any, where: str, midnights: Mapping[int, Any]) -> int:
    """Rows of a block of lines that is passed over, of which times of day alone are read, to carry them on."""
    if not midnights:
        return sum(1 for _ in csv._content(block))
    rows = [cells for _, cells in csv._rows(block, layout, where)]
    for place, midnight in midnights.items():
        midnight.on(layout.parsed(place, [cells[place] for cells in rows])[0])
    return len(rows)


def _columns(block: list[str], layout: Any, where: str, row: int, midnights: Mapping[int, Any]) -> list[Column]:
    """Columns of a block of lines, quickly where they hold nothing but numbers; `row` rows stand before it.

    `midnights` carries times of day on from the block before.
    """
    numbers = None if any(layout.thousands) else _numbers(block, layout)
    if numbers is not None:
        return [csv._column(header, numbers[:, i], None) for i, header in enumerate(layout.names)]
    numbered = list(csv._rows(block, layout, where))
    columns = []
    for i in range(len(layout.names)):
        cells = [cells[i] for _, cells in numbered]
        values, at_fault = layout.parsed(i, cells)
        values = midnights[i].on(values) if i in midnights else values
        fault = None
        if at_fault:
            k = at_fault[0]
            fault = fault_text(cells[k], row + k + 1, len(at_fault), numbered[k][0])
        columns.append(csv._column(csv._dated(layout, i), values, fault))
    return columns


def _numbers(block: list[str], layout: Any) -> np.ndarray | None:
    """(n, columns) samples of lines that hold nothing but numbers; None for others."""
    text = [line.replace(",", ".") for line in block] if layout.decimal_comma else block
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            values = np.loadtxt(text, delimiter=layout.delimiter, comments=None, ndmin=2)
    except (ValueError, UserWarning):
        return None
    return values if values.shape[1] == len(layout.names) else None


# -- Parquet ---------------------------------------------------------------------------------------------------------
def _parquet_tables(path: Path, rows: int, first: int, wanted: Sequence[str] | None) -> Iterator[ColumnTable]:
    where, origin = str(path), dict[str, int]()
    with parquet.opened(path) as file:
        import pyarrow as pa

        if not file.metadata.num_rows:
            raise InputError(f"{where}: there are no samples", mend="export the data again")
        period = stated_period(parquet._texts(file.schema_arrow.metadata), where)
        columns = _in_use(file.schema_arrow.names, wanted)
        thousands = _text_thousands(file, columns)
        if first:
            _batch_columns(pa.Table.from_batches([next(file.iter_batches(1, columns=columns))]), period, origin,
                           thousands)
        groups, behind = _groups_from(file.metadata, first)
        batches = (b for g in groups for b in file.iter_batches(rows, [g], columns, use_threads=False))
        for content in _batches(batches, rows, behind):
            kinds = {f.name: f.type for f in file.schema_arrow if pa.types.is_timestamp(f.type)}
            found = _batch_columns(content, period, origin, thousands)
            yield ColumnTable(*found, origins={headed(n)[0]: (np.datetime64(ticks, kinds[n].unit),
                                                              DATE_WITH_ZONE if kinds[n].tz else DATE)
                                               for n, ticks in origin.items()})


def _text_thousands(file: Any, columns: Sequence[str] | None) -> dict[str, str]:
    """What separates thousands in each column of text, by all of its cells."""
    names = [f.name for f in file.schema_arrow if parquet.holds_text(f.type) and (columns is None or f.name in columns)]
    shown: dict[str, set[str]] = {n: set() for n in names}
    for group in range(file.metadata.num_row_groups if names else 0):
        for batch in file.iter_batches(row_groups=[group], columns=names, use_threads=False):
            for name in names:
                shown[name] |= thousands_in(cell or "" for cell in batch.column(name).to_pylist())
    return {name: the_thousands(found) for name, found in shown.items()}


def _in_use(names: Sequence[str], wanted: Sequence[str] | None) -> list[str] | None:
    """Columns of the file that hold the clock or a channel in use; None for all."""
    if wanted is None:
        return None
    folded = {w.casefold() for w in wanted}
    held = [n for n in names if headed(n)[0].casefold() in folded or is_time_name(headed(n)[0])]
    return held if any(not is_time_name(headed(n)[0]) for n in held) else None


def _groups_from(metadata: Any, first: int) -> tuple[list[int], int]:
    """Row groups from the one that holds a row on, and how many of their rows stand before it."""
    sizes = [metadata.row_group(i).num_rows for i in range(metadata.num_row_groups)]
    before = 0
    for i, size in enumerate(sizes):
        if before + size > first:
            return list(range(i, len(sizes))), first - before
        before += size
    return [], 0


def _batches(batches: Iterator[Any], rows: int, drop: int) -> Iterator[Any]:
    """Tables of about `rows` rows, without the first `drop`.

    Batches come from one row group after the other: an iterator over several keeps all that it has read (pyarrow 26).
    Small ones are put together.
    """
    import pyarrow as pa

    held: list[Any] = []
    for batch in batches:
        if drop >= batch.num_rows:
            drop -= batch.num_rows
            continue
        held.append(batch.slice(drop))
        drop = 0
        if sum(b.num_rows for b in held) > rows // 2:
            yield pa.Table.from_batches(held)
            held = []
    if held:
        yield pa.Table.from_batches(held)


def _batch_columns(content: Any, period: float | None, origin: dict[str, int], thousands: Mapping[str, str],
                   ) -> tuple[list[Column], float | None, list[str]]:
    """Columns of one batch; calendar stamps count from the first one of the whole file, kept in `origin`."""
    import pyarrow as pa

    columns, notes = [], []
    for entry, data in zip(content.schema, content.columns, strict=True):
        column = parquet._column(entry, data, thousands.get(entry.name, ""))
        if column is None:
            notes.append(f"column '{entry.name}' is left out: it holds {entry.type}, not numbers")
            continue
        if pa.types.is_timestamp(entry.type):
            ticks = data.drop_null().cast(pa.int64()).to_numpy()
            if ticks.size:
                scale = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[entry.type.unit]
                first = origin.setdefault(entry.name, int(ticks[0]))
                column = replace(column, values=column.values + float(ticks[0] - first) / scale)
        columns.append(column)
    return columns, period, notes


# -- MDF -------------------------------------------------------------------------------------------------------------
def _mdf_tables(path: Path, rows: int, first: int, wanted: Sequence[str] | None) -> Iterator[ColumnTable]:
    where = str(path)
    with mdf4.opened(path) as file:
        groups = [g for g in file.virtual_groups if file.groups[g].channel_group.cycles_nr]
        total = max((int(file.groups[g].channel_group.cycles_nr) for g in groups), default=0)
        if not total:
            raise InputError(f"{where}: there are no samples", mend="export the data again")
        for row in range(first, total, rows):
            signals = [s for g in groups for s in mdf4.signals(file, g, row, rows, wanted)]
            yield mdf4.table(signals, where)


READERS: tuple[tuple[tuple[str, ...], Reader], ...] = (
    (csv.EXTENSIONS, _csv_tables), (parquet.EXTENSIONS, _parquet_tables), (mdf4.EXTENSIONS, _mdf_tables),
)
"""Extensions and what reads them in parts."""
