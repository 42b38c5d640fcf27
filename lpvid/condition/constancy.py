"""When a scheduling variable counts as constant over a data set."""

from __future__ import annotations

DISTINCT = 0.02
"""Share of its largest value below which a command counts as constant, and two of its values as one level.

A coefficient that is at most proportional to the command, as a damper's force to its current, changes by this share
at most, evenly spread by 0.02/√12 = 0.6 % rms: no more than the 1 % of a good load cell, so that no fit can tell it
from the sensor.
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
