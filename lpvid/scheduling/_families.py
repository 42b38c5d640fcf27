"""Families of bases in which sums and products stay inside the family."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from lpvid.scheduling.basis import Basis
from lpvid.scheduling.fourier import Fourier
from lpvid.scheduling.polynomial import Polynomial
from lpvid.scheduling.product import Product
from lpvid.scheduling.spline import Spline


class BasisFamily(ABC):
    """Sum and product of two bases where both belong to the family."""

    @abstractmethod
    def joined(self, a: Basis, b: Basis) -> tuple[Basis, np.ndarray, np.ndarray] | None:
        """A basis that spans both and the maps into it; None where the family has none."""

    @abstractmethod
    def multiplied(self, a: Basis, b: Basis) -> tuple[Basis, np.ndarray] | None:
        """A basis that spans all products, and their (M_a, M_b, M) coefficients; None where it has none."""


class PolynomialFamily(BasisFamily):
    """Polynomials, and products of polynomials, of any variables in any normalisation."""

    def joined(self, a: Basis, b: Basis) -> tuple[Basis, np.ndarray, np.ndarray] | None:
        first, second = self._member(a), self._member(b)
        if first is None or second is None:
            return None
        wide = _wide(first[0], second[0], max(first[0].degree, second[0].degree))
        return wide, first[1] @ rewritten(first[0], wide), second[1] @ rewritten(second[0], wide)

    def multiplied(self, a: Basis, b: Basis) -> tuple[Basis, np.ndarray] | None:
        first, second = self._member(a), self._member(b)
        if first is None or second is None:
            return None
        wide, table = _monomial_products(first[0], second[0])
        return wide, np.einsum("ai,bj,ijm->abm", first[1], second[1], table)

    def _member(self, basis: Basis) -> tuple[Polynomial, np.ndarray] | None:
        """The basis as one polynomial, and its functions over that."""
        if isinstance(basis, Polynomial):
            return basis, np.eye(basis.size)
        if not isinstance(basis, Product):
            return None
        found = self.multiplied(basis.first, basis.second)
        if found is None:
            return None
        wide, table = found
        assert isinstance(wide, Polynomial)
        return wide, table.reshape(basis.size, wide.size)


class FourierFamily(BasisFamily):
    """Fourier bases of one variable, period and origin."""

    def joined(self, a: Basis, b: Basis) -> tuple[Basis, np.ndarray, np.ndarray] | None:
        if not _alike(a, b):
            return None
        wide = a if a.size >= b.size else b
        return wide, np.eye(a.size, wide.size), np.eye(b.size, wide.size)

    def multiplied(self, a: Basis, b: Basis) -> tuple[Basis, np.ndarray] | None:
        if not _alike(a, b):
            return None
        assert isinstance(a, Fourier) and isinstance(b, Fourier)
        wide = replace(a, harmonics=a.harmonics + b.harmonics)
        p = (np.arange(wide.size) * wide.period / wide.size)[:, None]
        pairs = np.einsum("ni,nj->nij", a.evaluate(p), b.evaluate(p)).reshape(wide.size, -1)
        table = np.linalg.solve(wide.evaluate(p), pairs).T.reshape(a.size, b.size, wide.size)
        return wide, np.round(2 * table) / 2  # cos a cos b = ½ cos(a − b) + ½ cos(a + b) and the like


class SplineFamily(BasisFamily):
    """Splines of one variable between the same ends: products are splines on the knots of both, as smooth there as the
    less smooth factor, so that three tables of 60 knots make 240 functions in place of 216,000.

    Sums of unequal ones stay side by side.
    """

    HIGHEST = 5

    def joined(self, a: Basis, b: Basis) -> tuple[Basis, np.ndarray, np.ndarray] | None:
        return None

    def multiplied(self, a: Basis, b: Basis) -> tuple[Basis, np.ndarray] | None:
        if not (isinstance(a, Spline) and isinstance(b, Spline) and a.name == b.name and a.knots and b.knots):
            return None
        order = a.order + b.order
        if order > self.HIGHEST or (a.knots[0], a.knots[-1]) != (b.knots[0], b.knots[-1]):
            return None
        smooth = [{k: s.order - s.knots.count(k) for k in s.knots} for s in (a, b)]
        knots = [k for k in sorted({*a.knots, *b.knots})
                 for _ in range(1 if k in (a.knots[0], a.knots[-1]) else
                                order - min(s.get(k, order) for s in smooth))]
        wide = Spline(a.name, len(knots) - 1, order, tuple(knots))
        return wide, _spline_products(a, b, wide)


def _spline_products(a: Spline, b: Spline, wide: Spline) -> np.ndarray:
    """(M_a, M_b, M) coefficients of all products, from their values at order + 1 places of every piece.

    A function of `wide` has no share in a product of which it leaves the support: these are exact zeros.
    """
    ends = np.unique(wide.knots)
    places = 0.5 - 0.5 * np.cos(np.pi * (np.arange(wide.order + 1) + 0.5) / (wide.order + 1))
    p = (ends[:-1, None] + np.diff(ends)[:, None] * places).reshape(-1, 1)
    first, second, values = (s.evaluate(p) for s in (a, b, wide))
    rows, columns = np.nonzero(first.T @ second)  # the others share no piece
    pairs = first[:, rows] * second[:, columns]
    found = np.linalg.lstsq(values, pairs, rcond=None)[0].T
    outside = (pairs == 0.0).astype(float).T @ (values > 0.0) > 0
    table = np.zeros((a.size, b.size, wide.size))
    table[rows, columns] = np.where(outside, 0.0, found)
    return table


def _alike(a: Basis, b: Basis) -> bool:
    return (isinstance(a, Fourier) and isinstance(b, Fourier)
            and (a.name, a.period, a.origin) == (b.name, b.period, b.origin))


def _wide(a: Polynomial, b: Polynomial, degree: int) -> Polynomial:
    """Polynomial of a degree over the variables of both, normalised as the first that names a variable."""
    extra = [i for i, n in enumerate(b.names) if n not in a.names]
    return Polynomial(a.names + tuple(b.names[i] for i in extra), degree, a.centre + tuple(b.centre[i] for i in extra),
                      a.half_width + tuple(b.half_width[i] for i in extra))


def rewritten(narrow: Polynomial, wide: Polynomial) -> np.ndarray:
    """(M_narrow, M_wide) the monomials of one polynomial basis over another with at least its variables and degree."""
    place = {tuple(e): i for i, e in enumerate(wide.exponents.tolist())}
    out = np.zeros((narrow.size, wide.size))
    for row, exponents in enumerate(narrow.exponents.tolist()):
        for key, value in _expanded(exponents, narrow, wide).items():
            out[row, place[key]] += value
    return out


def _expanded(exponents: list[int], narrow: Polynomial, wide: Polynomial) -> dict[tuple[int, ...], float]:
    """One monomial as a sum of others: each variable z becomes scale·z + shift."""
    terms = {(0,) * len(wide.names): 1.0}
    for j, power in enumerate(exponents):
        column = wide.names.index(narrow.names[j])
        scale = wide.half_width[column] / narrow.half_width[j]
        shift = (wide.centre[column] - narrow.centre[j]) / narrow.half_width[j]
        grown: dict[tuple[int, ...], float] = {}
        for key, value in terms.items():
            for e in range(power + 1):
                new = (*key[:column], key[column] + e, *key[column + 1 :])
                grown[new] = grown.get(new, 0.0) + value * math.comb(power, e) * scale**e * shift ** (power - e)
        terms = grown
    return {key: value for key, value in terms.items() if value}


def _monomial_products(a: Polynomial, b: Polynomial) -> tuple[Polynomial, np.ndarray]:
    wide = _wide(a, b, a.degree + b.degree)
    left, right = rewritten(a, replace(wide, degree=a.degree)), rewritten(b, replace(wide, degree=b.degree))
    place = {tuple(e): i for i, e in enumerate(wide.exponents.tolist())}
    table = np.zeros((a.size, b.size, wide.size))
    for i in range(left.shape[1]):
        for j in range(right.shape[1]):
            target = place[tuple((wide.exponents[i] + wide.exponents[j]).tolist())]
            table[:, :, target] += np.outer(left[:, i], right[:, j])
    return wide, table
