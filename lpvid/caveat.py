"""Remarks that belong beside the figures that they qualify."""

from __future__ import annotations


class Caveat(str):
    """A remark that qualifies the figures of its result: a report states it in its summary, not among other remarks.

    It is text like any other remark, so that lists of notes hold both.

    Examples
    --------
    >>> notes = ("resampled to 200 Hz", Caveat("2 % of 'velocity' lies outside the range of the training data"))
    >>> [isinstance(n, Caveat) for n in notes]
    [False, True]
    """

    __slots__ = ()
