"""Coefficients of a damper law as functions of the coil current, with parameters that keep their bounds."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.export.expression import Expr
from lpvid.toolkit import checks
from quartercar.dampers.parameter import Parameter

PLACES = {0: ("",), 1: ("_at_low", "_at_high"), 2: ("_at_low", "_between", "_at_high")}
"""What is appended to a name for the control values of a polynomial of each degree."""


class Coefficient(ABC):
    """A coefficient of a law, as a function of the current and of its own parameters θ."""

    linear: bool
    """whether it is linear in θ"""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """θ."""

    @abstractmethod
    def value(self, current: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """(n,) the coefficient at each current.

        Parameters
        ----------
        current : (n,) array
            In the unit of the law's current.
        theta : (p,) array
            Values of `parameters`.

        Returns
        -------
        (n,) array
            In the unit of the coefficient.
        """

    @abstractmethod
    def gradient(self, current: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """(n, len(θ)) its derivative in each parameter.

        Parameters
        ----------
        current : (n,) array
            In the unit of the law's current.
        theta : (p,) array
            Values of `parameters`.

        Returns
        -------
        (n, p) array
            [unit of the coefficient per unit of the parameter].
        """

    @abstractmethod
    def constant(self, value: float) -> dict[str, float]:
        """Parameters that come nearest to one value at every current; a start for a search.

        Parameters
        ----------
        value : float
            In the unit of the coefficient.

        Returns
        -------
        dict of str to float
            By parameter name.
        """

    @abstractmethod
    def powers(self, theta: np.ndarray) -> np.ndarray:
        """The coefficients a_0, a_1, … of c(i) = a_0 + a_1 i + a_2 i².

        Parameters
        ----------
        theta : array
            θ.

        Returns
        -------
        array
            Of the lowest power first.

        Raises
        ------
        InputError
            A coefficient that is no polynomial in the current.
        """

    @abstractmethod
    def expression(self, named: Mapping[str, Expr]) -> Callable[[Expr], Expr]:
        """The coefficient as an expression of the current, by the rule of `value`.

        Parameters
        ----------
        named : mapping of str to Expr
            θ, by the names of `parameters`.

        Returns
        -------
        callable
            Current to coefficient.
        """


@dataclass(frozen=True)
class Controlled(Coefficient):
    """A polynomial in the current by its control values over a span (Bernstein form).

    c(i) = Σ_k b_k C(d,k) s^k (1−s)^(d−k), s = (i − i_low)/(i_high − i_low): b_0 and b_d are the coefficient at the ends
    of the span, and whatever bounds every b_k keeps bounds c(i) on all of it, which bounds on powers of i cannot do.
    For degree 1 these are the two end values. Degree 0 is a constant.

    Attributes
    ----------
    prototype : Parameter
        Name, unit, meaning and bounds of the coefficient.
    defaults : tuple of float
        b_k; their number sets the degree, at most 2.
    span : (float, float)
        Currents between which the bounds hold.

    Examples
    --------
    >>> force = Controlled(Parameter("yield_force", "N", "A_1", 1.0, 0.0), (200.0, 1200.0), (0.0, 2.0))
    >>> force.value(np.array([0.0, 1.0]), np.array([200.0, 1200.0]))
    array([200., 700.])
    >>> force.powers(np.array([200.0, 1200.0]))
    array([200., 500.])
    """

    prototype: Parameter
    defaults: tuple[float, ...]
    span: tuple[float, float] = (0.0, 1.0)
    linear: bool = True

    @property
    def degree(self) -> int:
        """Degree of the polynomial."""
        return len(self.defaults) - 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        p, places = self.prototype, PLACES[self.degree]
        where = {"": "", "_at_low": " at the lowest current, {:.3g}", "_at_high": " at the highest current, {:.3g}",
                 "_between": ", control value between"}
        ends = {"_at_low": self.span[0], "_at_high": self.span[1]}
        return tuple(Parameter(p.name + place, p.unit, p.description + where[place].format(ends.get(place)), value,
                               p.lower, p.upper, search=p.search)
                     for place, value in zip(places, self.defaults, strict=True))

    def value(self, current: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """By de Casteljau's rule: no matrix of powers, which would take longer than the law itself."""
        if self.degree == 0:
            return np.full(np.shape(current), theta[0])
        return _casteljau((np.asarray(current) - self.span[0]) / (self.span[1] - self.span[0]), theta)

    def gradient(self, current: np.ndarray, theta: np.ndarray) -> np.ndarray:
        d, low, high = self.degree, *self.span
        s = (np.asarray(current) - low) / (high - low)
        return np.column_stack([comb(d, k) * s**k * (1 - s) ** (d - k) for k in range(d + 1)])

    def constant(self, value: float) -> dict[str, float]:
        return {p.name: value for p in self.parameters}

    def powers(self, theta: np.ndarray) -> np.ndarray:
        """The coefficients a_0, a_1, … of c(i) = a_0 + a_1 i + a_2 i².

        Parameters
        ----------
        theta : (degree + 1,) array
            Control values b_k.

        Returns
        -------
        (degree + 1,) array
            [unit of the coefficient per power of the current].
        """
        points = np.linspace(*self.span, self.degree + 1)
        return np.linalg.solve(np.vander(points, increasing=True), self.value(points, theta))

    def expression(self, named: Mapping[str, Expr]) -> Callable[[Expr], Expr]:
        return self.mixed([named[p.name] for p in self.parameters])

    def mixed(self, theta: Sequence) -> Callable[[Expr], Expr]:
        """De Casteljau's rule on control values that are expressions or numbers.

        Parameters
        ----------
        theta : sequence of Expr or float
            b_k.

        Returns
        -------
        callable
            Current to coefficient.
        """
        low, high = self.span

        return lambda current: theta[0] if self.degree == 0 else _casteljau((current - low) / (high - low), theta)


def _casteljau(share: Any, theta: Sequence | np.ndarray) -> Any:
    """De Casteljau's rule at a share of the span, for numbers, arrays and expressions."""
    level = list(theta)
    while len(level) > 1:
        level = [a + share * (b - a) for a, b in itertools.pairwise(level)]
    return level[0]


@dataclass(frozen=True)
class Proportional(Coefficient):
    """c(i) = θ i: nothing without current.

    Attributes
    ----------
    parameter : Parameter
        θ, the slope over the current.
    """

    parameter: Parameter
    linear: bool = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (self.parameter,)

    def value(self, current: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return theta[0] * current

    def gradient(self, current: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return np.asarray(current, dtype=float)[:, None]

    def constant(self, value: float) -> dict[str, float]:
        return {self.parameter.name: value}

    def powers(self, theta: np.ndarray) -> np.ndarray:
        return np.array([0.0, theta[0]])

    def expression(self, named: Mapping[str, Expr]) -> Callable[[Expr], Expr]:
        return lambda current: named[self.parameter.name] * current


@dataclass(frozen=True)
class Quotient(Coefficient):
    """c(i) = N(i)/D(i), two polynomials by control values, the first of D being 1: a common scale would cancel.

    Attributes
    ----------
    numerator : Controlled
    denominator : Controlled
        Its first control value is not a parameter but 1.
    """

    numerator: Controlled
    denominator: Controlled
    linear: bool = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (*self.numerator.parameters, *self.denominator.parameters[1:])

    def _split(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        count = self.numerator.degree + 1
        return theta[:count], np.concatenate([[1.0], theta[count:]])

    def value(self, current: np.ndarray, theta: np.ndarray) -> np.ndarray:
        above, below = self._split(theta)
        return self.numerator.value(current, above) / self.denominator.value(current, below)

    def gradient(self, current: np.ndarray, theta: np.ndarray) -> np.ndarray:
        above, below = self._split(theta)
        d = self.denominator.value(current, below)[:, None]
        ratio = self.numerator.value(current, above)[:, None] / d
        return np.column_stack([self.numerator.gradient(current, above) / d,
                                (-ratio * self.denominator.gradient(current, below) / d)[:, 1:]])

    def constant(self, value: float) -> dict[str, float]:
        # at N = κD the two move c alike, so that a search could not separate them: the quotient starts tilted
        tilts = np.linspace(1.0, 0.8, self.denominator.degree + 1)[1:]
        rest = zip(self.denominator.parameters[1:], tilts, strict=True)
        return {**self.numerator.constant(value), **{p.name: float(t) for p, t in rest}}

    def powers(self, theta: np.ndarray) -> np.ndarray:
        raise InputError("a quotient of polynomials is no polynomial in the current")

    def expression(self, named: Mapping[str, Expr]) -> Callable[[Expr], Expr]:
        above = self.numerator.expression(named)
        below = self.denominator.mixed([1.0, *(named[p.name] for p in self.denominator.parameters[1:])])
        return lambda current: above(current) / below(current)


def settled_span(span: tuple[float, float] | None, fitted: tuple[float, float] | None) -> tuple[float, float]:
    """Span of the control values: as set, else the fitted currents, else 0 to 1.

    Set it where `current_range` may change later: control values belong to their span.

    Parameters
    ----------
    span : (float, float) or None
        Lowest and highest current as set.
    fitted : (float, float) or None
        Currents of the fit; not taken where they are one current.

    Returns
    -------
    (float, float)
        Lowest and highest current.

    Raises
    ------
    InputError
        A span whose end is not above its beginning.
    """
    if span is None:
        span = fitted if fitted is not None and fitted[1] > fitted[0] else (0.0, 1.0)
    low, high = (checks.real(x, "an end of the current span") for x in span)
    if not high > low:
        raise InputError("the span of currents is empty", got=span, mend="(lowest, highest) current of the data")
    return low, high
