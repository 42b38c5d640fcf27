"""When a scheduling variable counts as constant over a data set."""

from __future__ import annotations

DISTINCT = 0.02
"""Share of the largest value below which a variable counts as constant, and two of its values as one level.

A coefficient that is at most proportional to the variable, as a damper's force to its current, changes by this share
at most, evenly spread by 0.02/√12 = 0.6 % rms: no more than the 1 % of a good load cell, so that no fit can tell it
from the sensor.
"""
ROUNDING = 1e-9
"""the same share where zero is only a convention: nine digits, as files write them"""
CONVENTIONAL = ("K", "s", "m", "rad")
"""SI units of a variable whose zero is only a convention: temperature, time, place and angle. A share of its largest
value means nothing."""


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
    share = ROUNDING if unit in CONVENTIONAL else DISTINCT
    return high - low <= share * max(abs(low), abs(high))
