"""Numbers, shares and lists of words as a page prints them."""

from __future__ import annotations

import math
from collections.abc import Sequence


def number(value: float | None, digits: int = 4, unit: str = "") -> str:
    """A number for a reader: `digits` significant, its unit behind a narrow space, a dash for none.

    Parameters
    ----------
    value : float or None
        A dash stands for None, NaN and infinities.
    digits : int
        Significant digits.
    unit : str
        Empty for none.

    Returns
    -------
    str
        Digits and unit.

    Examples
    --------
    >>> number(0.0123456), number(None), number(float("nan")), number(1234567.0), number(3.0, unit="A")
    ('0.01235', '–', '–', '1.235e+06', '3 A')
    >>> number(99.7, 2)  # a power of ten that hides no more digits than requested is written out
    '100'
    """
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e+" in text and abs(value) < 1e4:
        text = f"{float(text):.0f}"
    return f"{text} {unit}".rstrip()


def percent(share: float | None, digits: int = 3) -> str:
    """A share as percent.

    Parameters
    ----------
    share : float or None
        Fraction, 1 for all; a dash stands for None, NaN and infinities.
    digits : int
        Significant digits.

    Returns
    -------
    str
        With the sign "%".

    Examples
    --------
    >>> percent(0.1234), percent(None)
    ('12.3 %', '–')
    """
    return "–" if share is None or not math.isfinite(share) else f"{100 * share:.{digits}g} %"


def listing(words: Sequence[str], most: int = 6) -> str:
    """Words with commas; a long list ends in how many more there are.

    Parameters
    ----------
    words : sequence of str
        In the order to print.
    most : int
        Words that are written out.

    Returns
    -------
    str
        On one line.
    """
    shown = ", ".join(words[:most])
    return shown if len(words) <= most else f"{shown} and {len(words) - most} more"
