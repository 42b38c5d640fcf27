"""When a scheduling variable counts as constant over a data set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.record import Record

DISTINCT = 0.02
"""Share of its largest value below which a command counts as constant, and two of its values as one level.

A coefficient that is at most proportional to the command, as a damper's force to its current, changes by this share
at most, evenly spread by 0.02/√12 = 0.6 % rms: no more than the 1 % of a good load cell, so that no fit can
distinguish it from the sensor's error.
"""
COMMANDS = ("A", "V")
"""SI units of a command, whose zero means none. The zero of others (temperature, place, a number without unit) may be
a convention: a share of the largest value means nothing there."""
ROUNDING = 1e-9
"""the same share of others: nine digits, as files write them"""


def constant(low: float, high: float, unit: str) -> bool:
    """Whether a variable that stays between two values is constant as far as a model can be scheduled on it.

    Parameters
    ----------
    low, high : float
        Least and largest value over all records, in SI.
    unit : str
        SI unit; empty for a pure number.

    Returns
    -------
    bool

    Examples
    --------
    >>> constant(0.799996, 0.800004, "A"), constant(0.0, 0.8, "A"), constant(293.0, 298.0, "K")
    (True, False, False)
    """
    share = DISTINCT if unit in COMMANDS else ROUNDING
    return bool(high - low <= share * max(abs(low), abs(high)))


def at_rest(records: Sequence[Record], names: Sequence[str]) -> bool:
    """Whether scheduling variables stand still within every record, though they may differ between records.

    A lag, a delay or a filter of the scheduling leaves no trace in such data.

    Parameters
    ----------
    records : sequence of Record
    names : sequence of str
        Of the variables; missing samples count for nothing.

    Returns
    -------
    bool
        False without any variable.

    Examples
    --------
    >>> runs = [Record({"current": np.full(9, i)}, sample_time=0.01, units={"current": "A"}) for i in (0.0, 1.0)]
    >>> at_rest(runs, ["current"])
    True
    """
    return bool(names) and all(_rests([r[n][np.isfinite(r[n])] for r in records], records[0].unit(n)) for n in names)


def _rests(values: Sequence[np.ndarray], unit: str) -> bool:
    """Whether every stretch stays within the share of the largest value of all that `constant` allows."""
    size = max((float(np.abs(v).max(initial=0.0)) for v in values), default=0.0)
    share = DISTINCT if unit in COMMANDS else ROUNDING
    return all(v.size == 0 or float(np.ptp(v)) <= share * size for v in values)
