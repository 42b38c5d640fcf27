"""Apache Parquet, by pyarrow: columns named ``name [unit]``, or with a ``unit`` in the column's metadata."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from lpvid.condition.tables import Column, ColumnTable
from lpvid.errors import InputError
from lpvid.files._table import (
    check_claim,
    corrupt,
    fault_text,
    headed,
    parse_cells,
    stated_period,
    the_thousands,
    thousands_in,
    without_library,
)

EXTENSIONS = (".parquet", ".pq")


def read_table(path: Path) -> ColumnTable:
    """Read a Parquet file.

    A column's unit stands in its name's brackets or in its metadata under ``unit``; ``sample_time`` [s] or
    ``sample_rate`` [Hz] may stand in the file's metadata. Nulls are missing samples. Time stamps of a calendar become
    seconds from the first one. Nested columns are left out, with a note.

    Parameters
    ----------
    path : Path

    Returns
    -------
    ColumnTable

    Raises
    ------
    InputError
        Not a readable Parquet file, a size claim beyond all bounds, or pyarrow is not installed.
    """
    where = str(path)
    with opened(path) as file:
        meta = file.metadata
        check_claim(8 * meta.num_rows * max(meta.num_columns, 1), where)
        check_claim(sum(meta.row_group(i).total_byte_size for i in range(meta.num_row_groups)), where)
        content = file.read()
    columns, notes = [], []
    for field, data in zip(content.schema, content.columns, strict=True):
        column = _column(field, data)
        if column is None:
            notes.append(f"column '{field.name}' is left out: it holds {field.type}, not numbers")
        else:
            columns.append(column)
    return ColumnTable(columns, stated_period(_texts(content.schema.metadata), where), notes)


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The file in pyarrow's hands.

    Parameters
    ----------
    path : Path

    Yields
    ------
    pyarrow.parquet.ParquetFile

    Raises
    ------
    InputError
        pyarrow is not installed; a damaged file, also where it is only noticed inside the block.
    """
    where = str(path)
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise without_library(where, "pyarrow") from None
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except (pa.ArrowException, ValueError, OSError, MemoryError, OverflowError) as error:
        if isinstance(error, (InputError, PermissionError, FileNotFoundError)):
            raise
        raise corrupt(where, "Parquet", error) from None


def _texts(metadata: dict | None) -> dict[str, str]:
    return {k.decode("utf-8", "replace"): v.decode("utf-8", "replace") for k, v in (metadata or {}).items()}


def holds_text(kind: Any) -> bool:
    """Whether a column of this type holds text, in which numbers may stand.

    Parameters
    ----------
    kind : pyarrow.DataType

    Returns
    -------
    bool
    """
    import pyarrow as pa

    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def _column(field: Any, data: Any, thousands: str | None = None) -> Column | None:
    """A column; `thousands` is what separates them in text, by all of its cells where it is left out."""
    import pyarrow as pa

    name, unit = headed(field.name)
    unit = _texts(field.metadata).get("unit", unit)
    kind, fault = field.type, None
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
        data = data.cast(kind)
    if holds_text(kind):
        cells = [cell or "" for cell in data.to_pylist()]
        values, at_fault = parse_cells(cells, thousands=the_thousands(thousands_in(cells)) if thousands is None
                                       else thousands)
        fault = fault_text(cells[at_fault[0]], at_fault[0] + 1, len(at_fault)) if at_fault else None
    elif pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        values, unit = _from_first(data) / {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[kind.unit], "s"
    elif pa.types.is_boolean(kind):
        values = _numbers(data.cast(pa.uint8()))
    elif pa.types.is_null(kind):
        values = np.full(len(data), np.nan)
    elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
        values = _numbers(data)
    else:
        return None
    return Column(name, values, unit, fault)


def _from_first(data: Any) -> np.ndarray:
    """Ticks since the first valid one, subtracted as whole numbers so that no digit is lost in the date."""
    import pyarrow as pa

    missing = data.is_null().to_numpy()
    ticks = data.cast(pa.int64()).fill_null(0).to_numpy()
    valid = ticks[~missing]
    offset = valid[0] if valid.size and pa.types.is_timestamp(data.type) else 0
    return np.where(missing, np.nan, (ticks - offset).astype(float))


def _numbers(data: Any) -> np.ndarray:
    import pyarrow as pa

    numbers = data.cast(pa.float64(), safe=False)
    if not numbers.null_count and numbers.num_chunks == 1:  # as they lie in the file's buffer; a record copies them
        return numbers.chunk(0).to_numpy(zero_copy_only=True)
    return np.asarray(numbers.fill_null(np.nan).to_numpy(), dtype=float)
