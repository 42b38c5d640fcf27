"""Scheduling variables by name: their box, and how fast they may move."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.codec import Coded
from lpvid.errors import InputError


@dataclass(frozen=True)
class Scheduling(Coded):
    """Named scheduling variables with their box and how fast they may move.

    Parameters
    ----------
    names : tuple of str
        Channel names; empty for a time-invariant model. Of one variable, this and the others may stand alone.
    lower, upper : tuple of float
        Box, in the variables' SI units.
    rate : tuple of (float or None), optional
        Bound on |dp/dt| in units per second; None leaves the variation arbitrary.
    units : tuple of str, optional
        SI units, for printing.

    Examples
    --------
    >>> current = Scheduling(("current",), (0.0,), (2.5,), rate=(100.0,), units=("A",))
    >>> current.contains(np.array([[1.0], [3.0]]))
    array([ True, False])
    """

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    rate: tuple[float | None, ...] = ()
    units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "names", _each(self.names))
        n = len(self.names)
        set_(self, "lower", tuple(_checks.real(v, "a lower scheduling bound") for v in _each(self.lower)))
        set_(self, "upper", tuple(_checks.real(v, "an upper scheduling bound") for v in _each(self.upper)))
        set_(self, "rate", _each(self.rate) or (None,) * n)
        set_(self, "units", _each(self.units) or ("",) * n)
        if not len(self.lower) == len(self.upper) == len(self.rate) == len(self.units) == n:
            raise InputError("scheduling needs one lower, upper, rate and unit for each name", got=self)
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if low > high:
                raise InputError(f"scheduling variable '{name}': lower bound above the upper", got=f"{low} > {high}")
        for name, rate in zip(self.names, self.rate, strict=True):
            if rate is not None and _checks.real(rate, f"the rate bound of '{name}'") < 0:
                raise InputError(f"the rate bound of '{name}' must not be negative", got=rate)
        if len(set(self.names)) < n:
            raise InputError("scheduling names a variable twice", got=", ".join(self.names))

    @classmethod
    def of(cls, names: Sequence[str], p: np.ndarray, units: Sequence[str] = ()) -> Scheduling:
        """The smallest box around samples `p` of shape (n, len(names)).

        Parameters
        ----------
        names : sequence of str
            Variables.
        p : (n, len(names)) array
            Samples, in the units of the variables.
        units : sequence of str
            One for each variable; none where they are not known.

        Returns
        -------
        Scheduling
            Least and largest sample of each variable.
        """
        return cls(tuple(names), tuple(p.min(axis=0)), tuple(p.max(axis=0)), units=tuple(units))

    @property
    def centre(self) -> np.ndarray:
        """(len(names),) middle of the box."""
        return 0.5 * (np.array(self.lower) + np.array(self.upper))

    @property
    def half_width(self) -> np.ndarray:
        """(len(names),) half the box."""
        return 0.5 * (np.array(self.upper) - np.array(self.lower))

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Lower and upper end of each variable."""
        return {n: (a, b) for n, a, b in zip(self.names, self.lower, self.upper, strict=True)}

    def part(self, names: Sequence[str]) -> Scheduling:
        """Some of the variables, with their box and rate bounds.

        Parameters
        ----------
        names : sequence of str
            Which, in the order wanted.

        Returns
        -------
        Scheduling
            Of these alone.
        """
        index = [self.names.index(n) for n in names]
        return Scheduling(*(tuple(getattr(self, field)[i] for i in index)
                            for field in ("names", "lower", "upper", "rate", "units")))

    def contains(self, p: np.ndarray, *, tolerance: float = 1e-9) -> np.ndarray:
        """(n,) bool: which samples of `p` (n, len(names)) lie in the box, within `tolerance` of its width.

        Parameters
        ----------
        p : (n, len(names)) array
            Samples, in the units of the variables.
        tolerance : float
            Share of the half width.

        Returns
        -------
        (n,) bool array
            Which lie inside.
        """
        slack = tolerance * np.maximum(self.half_width, 1e-300)
        return np.all((p >= np.array(self.lower) - slack) & (p <= np.array(self.upper) + slack), axis=1)

    def grid(self, points: int) -> np.ndarray:
        """(points**len(names), len(names)) tensor grid over the box.

        Parameters
        ----------
        points : int
            Along each variable.

        Returns
        -------
        (points**len(names), len(names)) array
            In the units of the variables; (1, 0) without variables.
        """
        axes = [np.linspace(lo, up, points) for lo, up in zip(self.lower, self.upper, strict=True)]
        return np.array(list(itertools.product(*axes))) if axes else np.empty((1, 0))


def _each(given: Any) -> tuple[Any, ...]:
    """One entry for each variable; a name or number that stands alone is that of the only one."""
    if given is None:
        return ()
    return (given,) if isinstance(given, (str, Real)) else tuple(given)
