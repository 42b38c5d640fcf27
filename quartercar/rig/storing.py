"""Records to CSV files, whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Record


def write_csv(record: Record, path: str | Path) -> Path:
    """Write a record as CSV: header ``name [unit]``, time first, numbers that read back to the same bits.

    The text goes to a temporary file in the same folder, which takes the final name only when complete.

    Parameters
    ----------
    record : Record
    path : str or Path
        File to write; an existing one is replaced.

    Returns
    -------
    Path
        Where it was written.

    Raises
    ------
    InputError
        A folder that does not exist or cannot be written to, a full disk; nothing is left behind.
    """
    path = Path(path)
    names = list(record.channels)
    header = ",".join(["time [s]", *(_header(n, record.unit(n)) for n in names)])
    columns = [record.times, *(record[n] for n in names)]
    try:
        _write_whole(path, header, columns)
    except OSError as error:
        raise InputError(f"cannot write '{path}'", why=str(error.strerror)) from None
    return path


def _write_whole(path: Path, header: str, columns: list[np.ndarray]) -> None:
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(header + "\n")
            for row in np.column_stack(columns).tolist():
                file.write(",".join(map(repr, row)) + "\n")
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _header(name: str, unit: str) -> str:
    text = f"{name} [{unit}]" if unit else name
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n') else text
