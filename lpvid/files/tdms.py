"""National Instruments TDMS, by npTDMS: waveforms, or a time channel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lpvid.condition.tables import Column, ColumnTable
from lpvid.errors import InputError
from lpvid.files._table import check_claim, headed, intact, without_library

EXTENSIONS = (".tdms",)


def read_table(path: Path) -> ColumnTable:
    """Read a TDMS file whose channels share one clock.

    Parameters
    ----------
    path : Path

    Returns
    -------
    ColumnTable
        Numeric channels with their ``unit_string``, named ``group/channel`` where two groups share a name; the period
        from the waveform's ``wf_increment`` when every channel states the same.

    Raises
    ------
    InputError
        Damaged, channels on different clocks, a size claim that the file cannot hold, or npTDMS is not installed.
    """
    where = str(path)
    try:
        from nptdms import TdmsFile  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise without_library(where, "npTDMS") from None
    # npTDMS leaves a stream of its own open when the file is damaged
    with intact(where, "TDMS"), path.open("rb") as stream, TdmsFile.open(stream) as file:
        channels = [c for group in file.groups() for c in group.channels() if len(c)]
        check_claim(sum(8 * len(c) for c in channels), where, held=path.stat().st_size)
        loaded = [(c, np.asarray(c[:])) for c in channels]
    return _table(loaded, where)


def _table(loaded: list[tuple[Any, np.ndarray]], where: str) -> ColumnTable:
    names = [channel.name for channel, _ in loaded]
    columns, notes, periods = [], [], set()
    for channel, values in loaded:
        whole = channel.name if names.count(channel.name) == 1 else f"{channel.group_name}/{channel.name}"
        if values.dtype.kind not in "fiub":
            notes.append(f"channel '{whole}' is left out: it holds no numbers")
            continue
        name, unit = headed(whole)
        columns.append(Column(name, values.astype(float), channel.properties.get("unit_string") or unit))
        periods.add(float(channel.properties.get("wf_increment") or 0.0))
    if len(periods) > 1:
        raise InputError(f"{where}: channels have different sampling periods", got=sorted(periods),
                         mend="export the channels at one rate")
    period = periods.pop() if periods else 0.0
    return ColumnTable(columns, period if period > 0 else None, notes)
