"""Rows of one time stamp: one row where they nowhere contradict each other, an error where they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.remark import Repeated


def one_row_per_stamp(record: Record, channels: Sequence[str] | None = None) -> Record:
    """The record with rows of one time stamp as one row, where they nowhere contradict each other; else as it is.

    A logger that writes a row twice, or a row per message of its bus with the other channels empty, gives rows of one
    stamp. They are one row where every channel has one value in them, or a value and missing samples. Nothing is
    averaged: which of two values was measured at that time is not known, and their mean was measured at none.

    Parameters
    ----------
    record : Record
        A clock that is no number or runs backward somewhere is left as it is.
    channels : sequence of str, optional
        Names or roles that must not contradict each other, and of which the others keep the first value; all by
        default.

    Returns
    -------
    Record
        With a note of how many rows were repeated.

    Examples
    --------
    >>> nan = float("nan")
    >>> record = Record({"v": [0.0, 1.0, nan, 2.0], "F": [0.0, nan, 5.0, 9.0]}, time=np.array([0.0, 0.1, 0.1, 0.2]))
    >>> one_row_per_stamp(record)["F"].tolist(), [str(n) for n in one_row_per_stamp(record).notes]
    ([0.0, 5.0, 9.0], ['1 row repeats a time stamp with no other value, first row 3: read as one with the row before'])
    """
    base, time = record.time_base, record.time
    if time is None or not base.duplicates or base.backward or base.invalid:
        return record
    starts = _starts(record)
    if contradictions(record, list(record.channels) if channels is None else channels):
        return record
    values = {name: replace(c, values=_first_finite(c.values, starts)) for name, c in record.channels.items()}
    count = len(base.duplicates)
    alike = "" if channels is None else " of the channels in use"
    stated = Repeated(f"{count} row{'s repeat' if count > 1 else ' repeats'} a time stamp with no other value{alike}, "
                      f"first row {base.duplicates[0] + 1}: read as one with the row before")
    return replace(record, channels=values, time=time[starts], sample_time=None, notes=(*record.notes, stated))


def contradictions(record: Record, channels: Sequence[str]) -> dict[str, int]:
    """The first row (0-based) that repeats a stamp with another value, for every channel that has one.

    Parameters
    ----------
    record : Record
    channels : sequence of str
        Names or roles.

    Returns
    -------
    dict of str to int
        By the names of channels.
    """
    starts, stamp = _starts(record), stamp_of_rows(record)
    found = {}
    for name in dict.fromkeys(record.resolve(n) for n in channels):
        values = record.channels[name].values
        expected = _first_finite(values, starts)[stamp]
        odd = np.flatnonzero(~np.isnan(values) & (values != expected))
        if odd.size:
            found[name] = int(odd[0])
    return found


def refuse_contradictions(record: Record, channels: Sequence[str], before: int = 0) -> None:
    """Refuse two values of a channel in use at one time.

    Parameters
    ----------
    record : Record
        A clock that runs backward or is no number somewhere is not looked at.
    channels : sequence of str
        Names or roles.
    before : int
        Rows of the file before the record, where it is a part of one.

    Raises
    ------
    InputError
        With row, channel and both values.
    """
    base = record.time_base
    odd = contradictions(record, channels) if base.duplicates and not (base.backward or base.invalid) else {}
    if not odd:
        return
    name = min(odd, key=odd.__getitem__)
    row, values, times = odd[name], record[name], record.times
    others = values[np.searchsorted(times, times[row]):row]
    raise InputError(f"record '{record.name}': time repeats in row {before + row + 1} with another value of '{name}'",
                     got=f"{others[np.isfinite(others)][0]:.6g} and {values[row]:.6g} {record.unit(name)}".rstrip()
                     + f" at {times[row]:.9g} s; {len(base.duplicates)} row(s) in all repeat a stamp",
                     why="which of them was measured then is not known",
                     mend="drop the wrong rows, or print the time with more digits")


def stamp_of_rows(record: Record) -> np.ndarray:
    """(n,) number of the stamp of every row, from 0.

    Parameters
    ----------
    record : Record

    Returns
    -------
    (n,) array of int

    Examples
    --------
    >>> stamp_of_rows(Record({"v": [0.0, 1.0, 1.0, 2.0]}, time=np.array([0.0, 0.1, 0.1, 0.2]))).tolist()
    [0, 1, 1, 2]
    """
    starts = _starts(record)
    return np.repeat(np.arange(starts.size), np.diff(starts, append=record.n_samples))


def _starts(record: Record) -> np.ndarray:
    """(m,) first row of every stamp."""
    first = np.ones(record.n_samples, dtype=bool)
    first[list(record.time_base.duplicates)] = False
    return np.flatnonzero(first)


def _first_finite(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """(m,) first sample of each stamp that is not missing; NaN where all are."""
    n = values.size
    place = np.where(np.isnan(values), n, np.arange(n))
    first = np.minimum.reduceat(place, starts)
    return np.where(first < n, values[np.minimum(first, n - 1)], np.nan)
