"""Columns with units as a table: csv, parquet or mat, as the readers of `lpvid.files` take them back."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from pathlib import Path

import numpy as np

from lpvid.errors import InputError

Columns = Mapping[str, tuple[np.ndarray, str]]
"""Name to values and unit."""
ROWS = 4096
"""rows of a csv file that are written at a time"""


def write_table(columns: Columns, path: str | Path) -> Path:
    """Write columns of equal length to a file whose extension states how: ``.csv``, ``.parquet`` or ``.mat``.

    A header is ``name [unit]``; in a mat file a struct ``units`` stands beside the variables. A number that is not
    finite is an empty cell, or NaN where the format has it.

    Parameters
    ----------
    columns : mapping of str to ((n,) array, str)
    path : str or Path

    Returns
    -------
    Path

    Raises
    ------
    InputError
        Another extension; parquet without pyarrow.

    Examples
    --------
    >>> import tempfile
    >>> from lpvid.files import read
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     read(write_table({"time": (np.arange(3.0), "s"), "force": (np.ones(3), "N")}, f"{folder}/run.csv"))
    [Record 'run': 3 samples, 1 Hz, force [N]]
    """
    path = Path(path)
    writer = {".csv": _csv, ".parquet": _parquet, ".mat": _mat}.get(path.suffix.lower())
    if writer is None:
        raise InputError(f"{path}: the format '{path.suffix}' is not known", mend="csv, parquet or mat")
    writer(columns, path)
    return path


def _header(name: str, unit: str) -> str:
    return f"{name} [{unit or '1'}]"


def _csv(columns: Columns, path: Path) -> None:
    size = max((values.size for values, _ in columns.values()), default=0)
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(_header(n, unit) for n, (_, unit) in columns.items()) + "\n")
        for k in range(0, size, ROWS):  # a number of Python takes four times the memory of one in an array
            for row in zip(*(values[k:k + ROWS].tolist() for values, _ in columns.values()), strict=True):
                file.write(",".join(repr(x) if isfinite(x) else "" for x in row) + "\n")


def _parquet(columns: Columns, path: Path) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise InputError("parquet needs the package pyarrow", mend="pip install pyarrow, or --format csv") from None
    parquet.write_table(pyarrow.table({_header(n, unit): values for n, (values, unit) in columns.items()}), path)


def _mat(columns: Columns, path: Path) -> None:
    from scipy.io import savemat

    units = {n: unit or "1" for n, (_, unit) in columns.items()}
    savemat(path, {**{n: values for n, (values, _) in columns.items()}, "units": units}, oned_as="column")
