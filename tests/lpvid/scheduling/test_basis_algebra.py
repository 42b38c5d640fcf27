"""Sums and products of bases: exact at random points, and inside the family where there is one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.scheduling import Basis, Fourier, Polynomial, Product, Shifted, Spline, Stacked
from lpvid.scheduling.algebra import common, products

BASES = [Polynomial("p", 2), Polynomial("q", 1, (0.3,), (2.0,)), Polynomial(("q", "p"), 2, (0.1, -0.2), (1.5, 0.7)),
         Polynomial((), 0), Spline("p", 3, 1, (-1.0, -0.3, 0.4, 1.0)), Spline("q", 2, 3, (-1.0, 0.0, 1.0)),
         Spline("p", 4, 1, (-1.0, -0.5, -0.3, 0.8, 1.0)), Spline("p", 5, 2, (-1.0, -0.3, -0.3, 0.1, 0.4, 1.0)),
         Product(Polynomial("p", 1), Polynomial("q", 2)), Product(Polynomial("p", 1), Spline("q", 2, 1, (-1, 0, 1))),
         Stacked((Polynomial("p", 1), Spline("p", 3, 1, (-1.0, -0.3, 0.4, 1.0)))),
         Fourier("p", 2, 3.0, 0.2), Fourier("p", 1, 3.0, 0.2), Fourier("p", 1),
         Product(Fourier("q", 1), Polynomial("p", 1)),
         Product(Spline("q", 2, 1, (-1, 0, 1)), Product(Polynomial("p", 2), Polynomial("p", 1)))]


def values(basis: Basis, points: dict[str, np.ndarray]) -> np.ndarray:
    n = len(next(iter(points.values())))
    return basis.evaluate(np.column_stack([points[k] for k in basis.names]) if basis.names else np.empty((n, 0)))


@pytest.mark.parametrize("pair", list(itertools.product(range(len(BASES)), repeat=2)))
def test_sums_and_products_of_bases_are_exact(pair):
    first, second = (BASES[i] for i in pair)
    rng = np.random.default_rng(sum(pair))
    points = {"p": rng.uniform(-1, 1, 20), "q": rng.uniform(-1, 1, 20)}
    f, g = values(first, points), values(second, points)
    basis, e, h = common(first, second)
    together = values(basis, points)
    np.testing.assert_allclose(together @ e.T, f, atol=1e-12)
    np.testing.assert_allclose(together @ h.T, g, atol=1e-12)
    basis, table = products(first, second)
    np.testing.assert_allclose(np.einsum("ijm,nm->nij", table, values(basis, points)), f[:, :, None] * g[:, None, :],
                               atol=1e-11)


def test_products_of_polynomials_stay_polynomials():
    basis, _ = products(Polynomial("p", 2), Product(Polynomial("p", 1), Polynomial("q", 1)))
    assert isinstance(basis, Polynomial) and basis.degree == 4 and basis.names == ("p", "q")
    shifted = Shifted(Polynomial("p", 1), 1)
    assert isinstance(products(shifted, Polynomial("p", 1))[0], Product)  # p(k−1) is not p(k)
    assert isinstance(common(shifted, Polynomial("p", 1))[0], Stacked)


def test_products_of_fourier_bases_stay_fourier_bases():
    assert Fourier("a", 2) * Fourier("a", 3) == Fourier("a", 5)
    assert Fourier("a", 2) | Fourier("a", 3) == Fourier("a", 3)
    assert isinstance(Fourier("a", 2) * Fourier("a", 2, 1.0), Product)  # another period
    _, table = products(Fourier("a", 1), Fourier("a", 1))
    np.testing.assert_array_equal(table[2, 2], [0.5, 0, 0, -0.5, 0])  # sin² = ½ − ½ cos 2a


def test_products_of_splines_stay_splines():
    """Hats on 60 and 14 pieces: products of three such tables have three functions for each piece, not thousands."""
    fine, coarse = (Spline("p", k, 1, tuple(np.linspace(-1, 1, k + 1))) for k in (60, 14))
    basis, table = products(fine, coarse)
    pieces = len(set(fine.knots) | set(coarse.knots)) - 1
    assert isinstance(basis, Spline) and basis.order == 2 and basis.size == 2 * pieces + 1
    third, _ = products(basis, fine)
    assert isinstance(third, Spline) and third.size == 3 * pieces + 1
    assert np.count_nonzero(table[0, 5]) == 0  # no piece in common
    assert dict(basis.knots_of) == {"p": tuple(sorted(set(fine.knots) | set(coarse.knots)))}
    narrow = Spline("p", 4, 1, (-0.5, 0.0, 0.1, 0.2, 0.5))
    assert isinstance(products(fine, narrow)[0], Product)  # holds its end values where the other one still moves


def test_a_knot_may_stand_as_often_as_the_order():
    Spline("p", 4, 2, (0.0, 0.5, 0.5, 0.7, 1.0))
    for knots in ((0.0, 0.5, 0.5, 0.5, 1.0), (0.0, 0.0, 0.5, 0.7, 1.0), (0.0, 0.7, 0.5, 0.6, 1.0)):
        with pytest.raises(InputError, match="rising knots"):
            Spline("p", 4, 2, knots)


def test_the_constant_is_said_by_every_basis_that_holds_it():
    rng = np.random.default_rng(0)
    points = {"p": rng.uniform(-1, 1, 9), "q": rng.uniform(-1, 1, 9)}
    for basis in BASES:
        np.testing.assert_allclose(values(basis, points) @ basis.unity, 1.0, atol=1e-14)
