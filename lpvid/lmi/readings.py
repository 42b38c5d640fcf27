"""What a basis reads: each scheduling variable at each delay, its degree, and where its pieces meet."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.scheduling import Basis, Fourier, Polynomial, Product, Scheduling, Shifted, Spline, Stacked


@dataclass(frozen=True)
class Reading:
    """One scheduling variable as it is read: at p(k − lag), with what degree, and where its pieces meet.

    A trigonometric dependence has a highest angular frequency [rad per unit] instead of a degree.
    """

    name: str
    lag: int
    degree: int
    breaks: tuple[float, ...] = ()
    frequency: float = 0.0

    @property
    def label(self) -> str:
        """Name, with the delay if there is one."""
        return f"{self.name}(k{-self.lag:+d})" if self.lag else self.name


def reading_weights(basis: Basis, readings: tuple[Reading, ...], points: np.ndarray) -> np.ndarray:
    """(K, M + 1) values of a basis, and 1, where the readings have the values `points` of shape (K, len(readings))."""
    names = basis.names
    lags = [r.lag for r in readings]
    ahead, back = max([0, *(-lag for lag in lags)]), max([0, *lags])
    path = np.zeros((len(points), back + 1 + ahead, len(names)))
    for column, reading in enumerate(readings):
        if reading.name in names:
            path[:, back - reading.lag, names.index(reading.name)] = points[:, column]
    phi = basis.evaluate(path.reshape(len(points) * (back + 1 + ahead), len(names)))[back :: back + 1 + ahead]
    return np.hstack([phi, np.ones((len(points), 1))])


def box_of(readings: tuple[Reading, ...], scheduling: Scheduling) -> Scheduling:
    """Box and rate bounds of what is read, one entry for each reading; a delayed copy has those of its variable."""
    index = [scheduling.names.index(r.name) for r in readings]
    return Scheduling(tuple(r.label for r in readings), tuple(scheduling.lower[i] for i in index),
                      tuple(scheduling.upper[i] for i in index), tuple(scheduling.rate[i] for i in index),
                      tuple(scheduling.units[i] for i in index))


def readings_of(basis: Basis, shift: int = 0) -> tuple[Reading, ...]:
    """What a basis reads: each variable at each delay; refuses one that is neither piecewise polynomial nor Fourier."""
    if isinstance(basis, Polynomial):
        highest = basis.exponents.max(axis=0, initial=0)
        return tuple(Reading(name, shift, int(d)) for name, d in zip(basis.names, highest, strict=True))
    if isinstance(basis, Spline):
        return (Reading(basis.name, shift, basis.order, basis.knots),)
    if isinstance(basis, Fourier):
        return (Reading(basis.name, shift, 0, (), 2 * math.pi * basis.harmonics / basis.period),)
    if isinstance(basis, Shifted):
        return readings_of(basis.basis, shift + basis.lag)
    if isinstance(basis, Product):
        return _merged([readings_of(f, shift) for f in basis.factors], sum)
    if isinstance(basis, Stacked):
        return _merged([readings_of(f, shift) for f in basis.factors], max)
    raise InputError("a stability certificate needs a basis of polynomials, splines or sines", got=type(basis).__name__,
                     why="its pieces carry the statement between grid points")


def _merged(parts: list[tuple[Reading, ...]], combine) -> tuple[Reading, ...]:
    together: dict[tuple[str, int], list[Reading]] = {}
    for reading in (r for part in parts for r in part):
        together.setdefault((reading.name, reading.lag), []).append(reading)
    return tuple(Reading(name, lag, combine(r.degree for r in same), tuple(sorted({b for r in same for b in r.breaks})),
                         combine(r.frequency for r in same)) for (name, lag), same in together.items())
