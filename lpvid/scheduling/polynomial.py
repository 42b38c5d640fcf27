"""Polynomial: monomials of one or several scheduling variables."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb
from typing import ClassVar

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.scheduling.basis import Basis
from lpvid.scheduling.reading import Reading
from lpvid.scheduling.variables import Scheduling


@dataclass(frozen=True)
class Polynomial(Basis):
    """Monomials z_1^e_1 z_2^e_2 … of total degree up to `degree`, with z = (p − centre)/half_width.

    Díaz Salas 2011 (3.7) has one variable and a_i(p) = Σ_j a_ij p^j; several variables come with their products.

    Parameters
    ----------
    names : str or sequence of str
        Scheduling variables; empty for the constant alone.
    degree : int
        Highest total degree.
    centre, half_width : tuple of float, optional
        Normalisation; left out, z = p.

    Examples
    --------
    >>> Polynomial("current", degree=2).evaluate(np.array([[2.0]]))
    array([[1., 2., 4.]])
    >>> Polynomial(("p", "q"), degree=2).labels
    ('1', 'p', 'q', 'p^2', 'p*q', 'q^2')
    """

    kind = "polynomial"

    names: tuple[str, ...] = ()
    degree: int = 1  # type: ignore[assignment]
    centre: tuple[float, ...] = ()
    half_width: tuple[float, ...] = ()
    lags: ClassVar[tuple[int, int]] = (0, 0)

    def __post_init__(self) -> None:
        names = _checks.names(self.names, "a polynomial basis") if self.names else ()
        set_ = object.__setattr__
        set_(self, "names", names)
        set_(self, "degree", _checks.count(self.degree, "the degree of a polynomial basis"))
        set_(self, "centre", tuple(self.centre) or (0.0,) * len(names))
        set_(self, "half_width", tuple(self.half_width) or (1.0,) * len(names))
        if not names:
            set_(self, "degree", 0)
        if not len(self.centre) == len(self.half_width) == len(names) or not all(h > 0 for h in self.half_width):
            raise InputError("a polynomial basis needs one centre and one positive half width for each variable",
                             got=f"{self.centre} and {self.half_width}")

    @cached_property
    def exponents(self) -> np.ndarray:
        """(M, len(names)) exponent of each variable in each function, by rising total degree."""
        rows = [e for total in range(self.degree + 1) for e in _exponents(len(self.names), total)]
        return np.array(rows, dtype=int).reshape(len(rows), len(self.names))

    @property
    def size(self) -> int:
        return len(self.exponents)

    @property
    def labels(self) -> tuple[str, ...]:
        def label(row: np.ndarray) -> str:
            parts = [n if e == 1 else f"{n}^{e}" for n, e in zip(self.names, row, strict=True) if e]
            return "*".join(parts) or "1"

        return tuple(label(row) for row in self.exponents)

    def _normalised(self, p: np.ndarray) -> np.ndarray:
        return (np.asarray(p, dtype=float) - np.array(self.centre)) / np.array(self.half_width)

    def _powers(self, z: np.ndarray, exponents: np.ndarray) -> np.ndarray:
        values = np.empty((exponents.shape[0], z.shape[0]))  # one contiguous row per function
        fresh = np.ones(exponents.shape[0], dtype=bool)
        for column in range(z.shape[1]):
            base = np.ascontiguousarray(z[:, column])
            power = base
            for e in range(1, int(exponents[:, column].max(initial=0)) + 1):
                power = base if e == 1 else power * base
                for row in np.flatnonzero(exponents[:, column] == e):
                    if fresh[row]:
                        values[row], fresh[row] = power, False
                    else:
                        values[row] *= power
        values[fresh] = 1.0
        return values.T

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        return self._powers(self._normalised(p), self.exponents)

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        column = self.names.index(_checks.known_name(name, self.names, "scheduling variable"))
        lowered = self.exponents.copy()
        factor = lowered[:, column] / self.half_width[column]
        lowered[:, column] = np.maximum(lowered[:, column] - 1, 0)
        return self._powers(self._normalised(p), lowered) * factor

    def bound(self, box: Scheduling) -> Polynomial:
        index = [box.names.index(_checks.known_name(n, box.names, "scheduling variable")) for n in self.names]
        half = box.half_width[index]
        return replace(self, centre=tuple(box.centre[index].tolist()),
                       half_width=tuple(np.where(half > 0, half, 1.0).tolist()))

    def change_to(self, other: Polynomial) -> np.ndarray:
        """(M, M) matrix G of another normalisation of these monomials: ``other.evaluate(p) = self.evaluate(p) @ G``.

        With z' = αz + β, z'^e = Σ_i C(e, i) αⁱ β^(e−i) zⁱ, and the product over the variables. Where the other box
        holds this one, |α| and |β| are at most 1: no entry exceeds a product of binomials, and nothing is amplified.

        Parameters
        ----------
        other : Polynomial
            Of the same variables and degree.

        Returns
        -------
        (M, M) array

        Examples
        --------
        >>> Polynomial("p", 2).change_to(Polynomial("p", 2, (1.0,), (2.0,))).tolist()
        [[1.0, -0.5, 0.25], [0.0, 0.5, -0.5], [0.0, 0.0, 0.25]]
        """
        change = np.ones((self.size, self.size))
        for v in range(len(self.names)):
            alpha = self.half_width[v] / other.half_width[v]
            beta = (self.centre[v] - other.centre[v]) / other.half_width[v]
            row, column = self.exponents[:, v][:, None], self.exponents[:, v][None, :]
            choose = np.array([[comb(int(e), int(i)) for e in column[0]] for i in row[:, 0]], dtype=float)
            change *= np.where(row <= column, choose * alpha**row * beta ** np.maximum(column - row, 0), 0.0)
        return change

    @property
    def unity(self) -> np.ndarray:
        return np.eye(1, self.size)[0]

    def readings(self, shift: int = 0) -> tuple[Reading, ...]:
        highest = self.exponents.max(axis=0, initial=0)
        return tuple(Reading(name, shift, int(d)) for name, d in zip(self.names, highest, strict=True))

    def ranges(self, limits: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        out = [self._monomial_range(e, limits) for e in self.exponents.tolist()]
        return np.array([o[0] for o in out]), np.array([o[1] for o in out])

    def _monomial_range(self, exponents: list[int], limits: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
        low = high = 1.0
        for name, centre, half, e in zip(self.names, self.centre, self.half_width, exponents, strict=True):
            ends = [(v - centre) / half for v in limits[_checks.known_name(name, list(limits), "scheduling variable")]]
            powers = [z**e for z in ends]
            through_zero = e > 0 and e % 2 == 0 and ends[0] < 0 < ends[1]
            corners = [x * y for x in (low, high) for y in (0.0 if through_zero else min(powers), max(powers))]
            low, high = min(corners), max(corners)
        return low, high

    def penalty(self, order: int) -> np.ndarray:
        degree = self.exponents.sum(axis=1).astype(float)
        return np.diag((degree if order == 1 else degree * (degree - 1)) ** 2)

    def trimmed(self, c: np.ndarray) -> tuple[Basis, np.ndarray]:
        used = self.exponents[c.reshape(self.size, -1).any(axis=1)].sum(axis=1).max(initial=min(self.degree, 1))
        narrow = replace(self, degree=int(used))
        return narrow, c[: narrow.size]

    def piece_degree(self, moving: Collection[str]) -> int | None:
        return self.degree if any(n in moving for n in self.names) else 0


def _exponents(variables: int, total: int) -> list[tuple[int, ...]]:
    if variables == 0:
        return [()] if total == 0 else []
    if variables == 1:
        return [(total,)]
    return [(first, *rest) for first in range(total, -1, -1) for rest in _exponents(variables - 1, total - first)]
