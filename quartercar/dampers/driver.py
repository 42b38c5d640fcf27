"""Driver: the quantity that sets a controllable damper, by the unit it was recorded in."""

from __future__ import annotations


def driver(unit: str) -> str:
    """The word for what drives the damper: a voltage stands for the current where that was not recorded.

    Parameters
    ----------
    unit : str
        Of the channel that plays the current's part.

    Returns
    -------
    str

    Examples
    --------
    >>> driver("A"), driver("V")
    ('current', 'voltage')
    """
    return "voltage" if unit == "V" else "current"
