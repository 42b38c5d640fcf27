"""Files larger than memory: CSV and Parquet read as a sequence of records."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.condition.tables import Column, Table, to_record
from lpvid.errors import InputError
from lpvid.files import csv, parquet
from lpvid.files._table import corrupt, fault_text, parse_cells, stated_period, without_library
from lpvid.record import Record


@dataclass(frozen=True)
class Chunks:
    """A file as consecutive records; every loop over it reads the file anew, `rows` samples at a time.

    Parameters
    ----------
    path : Path
    rows : int
    roles : mapping of str to str
    sample_rate : float or None
        Rate [Hz] of a file without a time column.
    """

    path: Path
    rows: int
    roles: Mapping[str, str] = field(default_factory=dict)
    sample_rate: float | None = None

    def __iter__(self) -> Iterator[Record]:
        read = _csv_tables if self.path.suffix.lower() in csv.EXTENSIONS else _parquet_tables
        return _records(_no_lone_row(read(self.path, self.rows)), self)


def read_chunks(path: str | Path, rows: int = 100_000, *, roles: Mapping[str, str] | None = None,
                sample_rate: float | None = None) -> Chunks:
    """Read a CSV or Parquet file as records of at most about `rows` samples that continue each other.

    The rules are those of `read`: units from the header, SI inside, missing samples NaN, text a fault of its channel.

    Parameters
    ----------
    path : str or Path
    rows : int
        Samples in memory at once (the last record may have one more).
    roles : mapping of str to str, optional
        Role name to channel name.
    sample_rate : float, optional
        Rate [Hz] of a file without a time column.

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
    found = Path(path)
    if not found.is_file():
        raise InputError(f"{path}: there is no such file", mend="check folder and extension")
    known = (*csv.EXTENSIONS, *parquet.EXTENSIONS)
    if found.suffix.lower() not in known:
        raise InputError(f"{path}: the format '{found.suffix}' cannot be read in parts",
                         mend=f"readable in parts are {', '.join(known)}")
    rate = None if sample_rate is None else _checks.positive(sample_rate, "sample_rate", "Hz")
    return Chunks(found, _checks.count(rows, "rows", at_least=2), dict(roles or {}), rate)


def _records(tables: Iterable[Table], chunks: Chunks) -> Iterator[Record]:
    """Records in SI; clocks that a file only states run on from chunk to chunk, and time must run forward."""
    where, name = str(chunks.path), chunks.path.stem
    before, rows_before = -np.inf, 0
    for table in tables:
        record = to_record(table, where, name=name, sample_rate=chunks.sample_rate, roles=chunks.roles)
        if record.time is None:
            assert record.sample_time is not None
            record = replace(record, time=None, start=rows_before * record.sample_time)
        elif record.time[0] <= before:
            what = "repeats" if record.time[0] == before else "runs backward"
            raise InputError(f"{where}: time {what} in row {rows_before + 1}",
                             got=f"{record.time[0]:.9g} s after {before:.9g} s",
                             mend="sort the rows, or drop the repeated one")
        rows_before += record.n_samples
        before = record.times[-1]
        yield record


def _no_lone_row(tables: Iterable[Table]) -> Iterator[Table]:
    """The same tables with a single last row joined to the one before: one sample has no clock."""
    held: Table | None = None
    for table in tables:
        if held is not None and table.columns[0].values.size < 2:
            held = _joined(held, table)
            continue
        if held is not None:
            yield held
        held = table
    if held is not None:
        yield held


def _joined(first: Table, second: Table) -> Table:
    later = {c.name: c for c in second.columns}
    columns = [replace(c, values=np.concatenate([c.values, later[c.name].values]), fault=c.fault or later[c.name].fault)
               for c in first.columns]
    return replace(first, columns=columns)


# -- text ------------------------------------------------------------------------------------------------------------
def _csv_tables(path: Path, rows: int) -> Iterator[Table]:
    where = str(path)
    if path.stat().st_size == 0:
        raise InputError(f"{where}: the file is empty (0 bytes)", mend="export the data again")
    layout = csv._layout(path, where)
    line, row = layout.data_line, 0
    with path.open(encoding=layout.encoding, newline=None) as stream:
        lines = islice(stream, layout.data_line - 1, None)
        while block := list(islice(lines, rows)):
            columns = _columns(block, replace(layout, data_line=line), where, row)
            line += len(block)
            if columns[0].values.size:
                row += columns[0].values.size
                yield Table(csv._without_trailing(columns))


def _columns(block: list[str], layout: Any, where: str, row: int) -> list[Column]:
    """Columns of a block of lines, quickly where they hold nothing but numbers; `row` rows stand before it."""
    text = [line.replace(",", ".") for line in block] if layout.decimal_comma else block
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            values = np.loadtxt(text, delimiter=layout.delimiter, comments=None, ndmin=2)
        if values.shape[1] == len(layout.names):
            return [csv._column(header, values[:, i], None) for i, header in enumerate(layout.names)]
    except (ValueError, UserWarning):
        pass
    numbered = list(csv._rows(block, layout, where))
    columns = []
    for i, header in enumerate(layout.names):
        cells = [cells[i] for _, cells in numbered]
        values, at_fault = parse_cells(cells)
        fault = None
        if at_fault:
            k = at_fault[0]
            fault = fault_text(cells[k], row + k + 1, len(at_fault), numbered[k][0])
        columns.append(csv._column(header, values, fault))
    return columns


# -- Parquet ---------------------------------------------------------------------------------------------------------
def _parquet_tables(path: Path, rows: int) -> Iterator[Table]:
    where = str(path)
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise without_library(where, "pyarrow") from None
    origin: dict[str, float] = {}
    try:
        with pq.ParquetFile(path) as file:
            if not file.metadata.num_rows:
                raise InputError(f"{where}: there are no samples", mend="export the data again")
            period = stated_period(parquet._texts(file.schema_arrow.metadata), where)
            for batch in file.iter_batches(batch_size=rows):
                content = pa.Table.from_batches([batch])
                yield Table(*_batch_columns(content, period, origin))
    except (pa.ArrowException, ValueError, OSError, MemoryError, OverflowError) as error:
        if isinstance(error, (InputError, PermissionError, FileNotFoundError)):
            raise
        raise corrupt(where, "Parquet", error) from None


def _batch_columns(content: Any, period: float | None, origin: dict[str, float],
                   ) -> tuple[list[Column], float | None, list[str]]:
    """Columns of one batch; calendar stamps count from the first one of the whole file, kept in `origin`."""
    import pyarrow as pa

    columns, notes = [], []
    for entry, data in zip(content.schema, content.columns, strict=True):
        column = parquet._column(entry, data)
        if column is None:
            notes.append(f"column '{entry.name}' is left out: it holds {entry.type}, not numbers")
            continue
        if pa.types.is_timestamp(entry.type):
            ticks = data.drop_null().cast(pa.int64()).to_numpy()
            if ticks.size:
                scale = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[entry.type.unit]
                first = origin.setdefault(entry.name, ticks[0])
                column = replace(column, values=column.values + float(ticks[0] - first) / scale)
        columns.append(column)
    return columns, period, notes
