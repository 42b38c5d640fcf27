"""Kinds of remarks: strings whose class states their subject, so that no code matches their words."""

from __future__ import annotations


class Cut(str):
    """What a record lost at gaps and missing samples.

    Examples
    --------
    >>> notes = ("units from the header", Cut("cut into 2 pieces at missing samples"))
    >>> [n for n in notes if isinstance(n, Cut)]
    ['cut into 2 pieces at missing samples']
    """

    __slots__ = ()


class LeftOut(Cut):
    """That a record was left out as a whole; it names the record itself, since another one carries it."""

    __slots__ = ()


class Turned(str):
    """That the sign of a channel was turned."""

    __slots__ = ()


class Derivation(str):
    """How a velocity that was not measured was derived."""

    __slots__ = ()


class QuietDerivation(Derivation):
    """How it was derived without the noise of the displacement's sensor."""

    __slots__ = ()


class Cost(str):
    """What a constraint costs a fitted model."""

    __slots__ = ()


class OutOfTime(str):
    """Why something was not done: the budget of time was spent."""

    __slots__ = ()
