"""The same columns written in every format that `lpvid.files` reads: extension to function."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

Columns = dict[str, tuple[str, np.ndarray]]
"""Name to unit and values; the first is the time [s]."""


def headers(columns: Columns) -> list[str]:
    return [f"{name} [{unit}]" for name, (unit, _) in columns.items()]


def delimited(delimiter: str) -> Callable[[Path, Columns], None]:
    def write(path: Path, columns: Columns) -> None:
        rows = np.column_stack([values for _, values in columns.values()])
        lines = [delimiter.join(headers(columns)), *(delimiter.join(map(repr, row)) for row in rows.tolist())]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    return write


def parquet(path: Path, columns: Columns) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = [pa.array(values) for _, values in columns.values()]
    pq.write_table(pa.table(arrays, names=headers(columns)), path)


def mat(path: Path, columns: Columns) -> None:
    from scipy.io import savemat

    units = {name: unit for name, (unit, _) in columns.items()}
    savemat(path, {name: values[:, None] for name, (_, values) in columns.items()} | {"units": units})


def mdf(path: Path, columns: Columns) -> None:
    import asammdf

    (_, (_, time)), *rest = columns.items()
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(values, time, unit=unit, name=name) for name, (unit, values) in rest])
        made = Path(file.save(path.with_suffix(".mf4"), overwrite=True))
    made.replace(path)


def tdms(path: Path, columns: Columns) -> None:
    import nptdms

    (_, (_, time)), *rest = columns.items()
    step = float(time[1] - time[0])
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment([nptdms.ChannelObject("run", name, values, {"unit_string": unit, "wf_increment": step})
                            for name, (unit, values) in rest])


WRITERS: dict[str, Callable[[Path, Columns], None]] = {
    ".csv": delimited(","), ".tsv": delimited("\t"), ".txt": delimited("   "), ".parquet": parquet, ".pq": parquet,
    ".mat": mat, ".mf4": mdf, ".mdf": mdf, ".tdms": tdms}
