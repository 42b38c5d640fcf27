"""Spline: B-splines of one scheduling variable; of order 1, a grid."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.scheduling.basis import Basis
from lpvid.scheduling.reading import Reading
from lpvid.scheduling.variables import Scheduling

COINCIDE = 1e-12
"""Knots nearer to each other, over the whole range, count as one of higher multiplicity: between them the slope changes
over a distance that the cells of `lpvid.lmi.box_positivity.Axis` do not resolve."""


@dataclass(frozen=True)
class Spline(Basis):
    """B-splines of one scheduling variable on equal segments of its box; degree 1 interpolates a grid linearly.

    Outside the box the end value holds (and validation counts the share of samples out there).

    Parameters
    ----------
    name : str
        Scheduling variable.
    segments : int
        Number of polynomial pieces.
    order : int
        Degree of each piece, 1 to 5.
    knots : tuple of float, optional
        Breakpoints in physical units, ``segments + 1`` of them; left out, equal pieces of the bound box. One that
        stands there twice, or up to `order` times, takes away so many derivatives that are continuous there.

    Examples
    --------
    >>> Spline("current", segments=2, order=1, knots=(0.0, 1.0, 2.0)).evaluate(np.array([[0.5]]))
    array([[0.5, 0.5, 0. ]])
    """

    kind = "spline"

    name: str
    segments: int = 3
    order: int = 3
    knots: tuple[float, ...] = ()
    degree: ClassVar[None] = None
    lags: ClassVar[tuple[int, int]] = (0, 0)

    def __post_init__(self) -> None:
        _checks.count(self.segments, "segments of a spline", at_least=1)
        if not 1 <= _checks.count(self.order, "order of a spline") <= 5:
            raise InputError("the order of a spline must lie between 1 and 5", got=self.order)
        if self.knots and not self._rising():
            raise InputError("a spline needs segments + 1 rising knots", got=self.knots)
        object.__setattr__(self, "knots", tuple(float(k) for k in self.knots))

    def _rising(self) -> bool:
        steps = np.diff(self.knots)
        _, often = np.unique(self.knots, return_counts=True)
        return (len(self.knots) == self.segments + 1 and not np.any(steps < 0) and often.max() <= self.order
                and often[0] == often[-1] == 1)

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """The one scheduling variable."""
        return (self.name,)

    @property
    def size(self) -> int:
        return self.segments + self.order

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(f"B{i}({self.name})" for i in range(self.size))

    @property
    def summary(self) -> str:
        return f"{{spline of order {self.order} in {self.name}, {self.segments} segments}}"

    def _full_knots(self) -> np.ndarray:
        if not self.knots:
            raise InputError(f"the spline in '{self.name}' has no knots yet", mend="bind it to a box with .bound(box)")
        k = np.array(self.knots)
        return np.concatenate([np.repeat(k[0], self.order), k, np.repeat(k[-1], self.order)])

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        from scipy.interpolate import BSpline

        knots = self._full_knots()
        inside = np.clip(np.asarray(p, dtype=float)[:, 0], knots[0], knots[-1])
        return BSpline.design_matrix(inside, knots, self.order).toarray()

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        from scipy.interpolate import BSpline

        _checks.known_name(name, self.names, "scheduling variable")
        knots = self._full_knots()
        values = np.asarray(p, dtype=float)[:, 0]
        inside = (values >= knots[0]) & (values <= knots[-1])
        slope = BSpline(knots, np.eye(self.size), self.order).derivative()(np.clip(values, knots[0], knots[-1]))
        return np.where(inside[:, None], slope, 0.0)

    def bound(self, box: Scheduling) -> Spline:
        if self.knots:
            return self
        i = box.names.index(_checks.known_name(self.name, box.names, "scheduling variable"))
        if not box.upper[i] > box.lower[i]:
            raise InputError(f"a spline needs '{self.name}' to move", got=f"the constant {box.lower[i]}")
        return replace(self, knots=tuple(np.linspace(box.lower[i], box.upper[i], self.segments + 1)))

    @property
    def unity(self) -> np.ndarray:
        return np.ones(self.size)

    def readings(self, shift: int = 0) -> tuple[Reading, ...]:
        return (Reading(self.name, shift, self.order, self.knots_of[self.name], kinks=self._kinks()),)

    def _kinks(self) -> tuple[float, ...]:
        """Knots without a continuous slope: of multiplicity `order` or more, and both ends, beyond which it is zero."""
        if not self.knots:
            return ()
        knots, distinct = self._full_knots(), np.unique(self.knots)
        close = np.abs(distinct[:, None] - knots) <= COINCIDE * (knots[-1] - knots[0])
        return tuple(distinct[close.sum(axis=1) >= self.order].tolist())

    def ranges(self, limits: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros(self.size), np.ones(self.size)

    def penalty(self, order: int) -> np.ndarray:
        differences = np.diff(np.eye(self.size), n=min(order, self.size - 1), axis=0) * self.segments**order
        return differences.T @ differences

    def piece_degree(self, moving: Collection[str]) -> int | None:
        return self.order if self.name in moving else 0

    @property
    def knots_of(self) -> Mapping[str, tuple[float, ...]]:
        return {self.name: tuple(dict.fromkeys(self.knots))}
