"""ASAM MDF 4, by asammdf: one raster per file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from lpvid.condition.tables import Column, ColumnTable
from lpvid.errors import InputError
from lpvid.files._table import check_claim, corrupt, intact, without_library

EXTENSIONS = (".mf4", ".mdf")


def read_table(path: Path) -> ColumnTable:
    """Read an MDF file whose channel groups share one raster.

    Parameters
    ----------
    path : Path

    Returns
    -------
    ColumnTable
        The master channel as ``time`` [s], every numeric channel with its unit; the rest left out, with a note.

    Raises
    ------
    InputError
        Damaged, groups on different rasters, a size claim beyond all bounds, or asammdf is not installed.
    """
    where = str(path)
    with opened(path) as file:
        groups = [g for g in file.virtual_groups if file.groups[g].channel_group.cycles_nr]
        claimed = sum(_claim(file.groups[g]) for g in groups)
        check_claim(claimed, where, held=path.stat().st_size)
        found = [s for g in groups for s in signals(file, g)]
    return table(found, where)


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """An MDF file of asammdf; whatever it cannot make sense of becomes one line.

    Parameters
    ----------
    path : Path

    Yields
    ------
    asammdf.MDF
        Open for reading.

    Raises
    ------
    InputError
        The file is no MDF file or is damaged, or asammdf is not installed.
    """
    where = str(path)
    with path.open("rb") as stream:
        if stream.read(3) != b"MDF":
            raise corrupt(where, "MDF", ValueError("the file does not begin with MDF"))
    try:
        from asammdf import MDF  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise without_library(where, "asammdf") from None
    with intact(where, "MDF"), path.open("rb") as stream, MDF(stream) as file:
        yield file


def _claim(group: Any) -> int:
    return 8 * int(group.channel_group.cycles_nr) * max(len(group.channels), 1)


def signals(file: Any, group: int, first: int = 0, rows: int | None = None,
            wanted: Sequence[str] | None = None) -> list[Any]:
    """Channels of a group, whole or `rows` samples from `first` on; of the names wanted, where any of them is there.

    Parameters
    ----------
    file : asammdf.MDF
        From `opened`.
    group : int
        Channel group.
    first : int
        Row of the first sample; counts only with `rows`.
    rows : int, optional
        Left out, all of them.
    wanted : sequence of str, optional
        Channel names, in upper or lower case; left out, all channels.

    Returns
    -------
    list of asammdf.Signal
        Without the master channel, which each carries as time stamps.
    """
    channels, master = file.groups[group].channels, file.masters_db.get(group)
    indices = [i for i in range(len(channels)) if i != master]
    if wanted is not None:
        folded = {w.casefold() for w in wanted}
        indices = [i for i in indices if channels[i].name.strip().casefold() in folded] or indices
    part = {} if rows is None else {"record_offset": first, "record_count": rows}
    return [file.get(group=group, index=i, ignore_invalidation_bits=True, **part) for i in indices]


def table(signals: list[Any], where: str) -> ColumnTable:
    """Signals on one raster as columns after their clock.

    Parameters
    ----------
    signals : list of asammdf.Signal
        Of one group.
    where : str
        The file, for messages.

    Returns
    -------
    ColumnTable
        Invalidated samples are NaN; channels without numbers are left out, with a note.

    Raises
    ------
    InputError
        No signals, or signals with different time stamps.
    """
    if not signals:
        raise InputError(f"{where}: there are no samples", mend="export the data again")
    clock = np.asarray(signals[0].timestamps, dtype=float)
    columns, notes = [Column("time", clock, "s")], []
    for signal in signals:
        if not np.array_equal(signal.timestamps, clock):
            raise InputError(f"{where}: channels '{signals[0].name}' and '{signal.name}' have different time stamps",
                             why="nothing is interpolated here", mend="export the channels on one raster")
        values = np.asarray(signal.samples)
        if values.ndim != 1 or values.dtype.kind not in "fiub":
            notes.append(f"channel '{signal.name}' is left out: it holds no numbers")
            continue
        values = values.astype(float)
        if signal.invalidation_bits is not None:
            values[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
        columns.append(Column(signal.name.strip(), values, signal.unit.strip() or None))
    return ColumnTable(columns, None, notes)
