"""What an analysis asks a basis: every answer against samples of the functions themselves."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.scheduling import Basis, Fourier, Polynomial, Product, Scheduling, Shifted, Spline, Stacked

BOX = Scheduling(("p", "q"), (0.0, -1.0), (4.0, 2.0))
SQUARE, SINES = Polynomial("p", 2, (0.3,), (1.5,)), Fourier("q", 2, 3.0)
PIECES, HATS = Spline("p", 3, 2, (0.0, 1.0, 2.0, 4.0)), Spline("q", 2, 1, (-1.0, 0.0, 2.0))
BASES = [Polynomial(("p", "q"), 3, (0.5, 1.0), (2.0, 1.0)), Product(SQUARE, SINES), Product(PIECES, HATS),
         Stacked((SQUARE, SINES)), Stacked((Product(SQUARE, HATS), PIECES)), Product(Shifted(PIECES, 2), HATS),
         Shifted(Stacked((SQUARE, Shifted(HATS, 1))), 1)]


@pytest.fixture(params=BASES, ids=lambda b: repr(b)[:40])
def basis(request) -> Basis:
    return request.param


def points(basis: Basis, p: np.ndarray) -> np.ndarray:
    return p[:, [BOX.names.index(n) for n in basis.names]]


def test_values_stay_within_their_ranges(basis):
    low, high = basis.ranges(BOX.limits)
    values = basis.still().evaluate(points(basis, BOX.grid(41)))
    assert np.all(values >= low - 1e-12) and np.all(values <= high + 1e-12)


def test_ranges_of_monomials_are_attained():
    low, high = BASES[0].ranges(BOX.limits)
    values = BASES[0].evaluate(BOX.grid(121))
    assert np.abs(values.min(axis=0) - low).max() < 1e-3 and np.abs(values.max(axis=0) - high).max() < 1e-12


def test_without_delays_is_the_value_of_a_scheduling_that_stands_still(basis, rng):
    point = rng.uniform(BOX.lower, BOX.upper)
    held = points(basis, np.tile(point, (8, 1)))
    np.testing.assert_allclose(basis.still().evaluate(held)[0], basis.evaluate(held)[-1], atol=1e-14)
    assert basis.still().lags == (0, 0)


@pytest.mark.parametrize("lag", [0, 1, 3])
def test_shifted_reads_earlier(basis, lag, rng):
    p = points(basis, rng.uniform(BOX.lower, BOX.upper, (30, 2)))
    np.testing.assert_array_equal(basis.shifted(lag).evaluate(p)[10:], basis.evaluate(p)[10 - lag: 30 - lag])


def test_trimmed_is_the_same_function(basis, rng):
    c = rng.normal(size=(basis.size, 2))
    c[basis.size // 2:] = 0.0
    narrow, kept = basis.trimmed(c)
    p = points(basis, BOX.grid(9))
    np.testing.assert_allclose(narrow.evaluate(p) @ kept, basis.evaluate(p) @ c, atol=1e-12)
    assert narrow.size <= basis.size


def test_readings_name_every_delay_and_the_degree_along_it(basis):
    readings = basis.readings()
    lags = [r.lag for r in readings]
    assert (min(lags), max(lags)) == basis.lags
    assert {r.name for r in readings} == set(basis.names)


def test_readings_have_the_degree_of_the_highest_power():
    degrees = {r.name: r.degree for r in Product(SQUARE, Polynomial(("p", "q"), 1)).readings()}
    assert degrees == {"p": 3, "q": 1}
    assert Product(SINES, SINES).readings()[0].frequency == pytest.approx(2 * 2 * 2 * np.pi / 3.0)


def test_between_knots_a_function_is_a_polynomial_of_the_degree_of_a_piece():
    for basis, moving in ((Product(PIECES, HATS), "p"), (Stacked((SQUARE, PIECES)), "p"), (BASES[0], "q")):
        degree = basis.piece_degree([moving])
        assert degree is not None
        ends = [*basis.knots_of.get(moving, ()), *BOX.limits[moving]]
        low, high = sorted(set(ends))[:2]
        line = np.full((40, 2), 0.7)
        line[:, BOX.names.index(moving)] = np.linspace(low, high, 40)
        values = basis.evaluate(points(basis, line))
        powers = np.linspace(-1, 1, 40)[:, None] ** np.arange(degree + 1)
        rest = values - powers @ np.linalg.lstsq(powers, values, rcond=None)[0]
        assert np.abs(rest).max() < 1e-10
    assert Product(SQUARE, SINES).piece_degree(["q"]) is None


@pytest.mark.parametrize("order", [1, 2])
def test_the_penalty_leaves_the_constant_alone_and_nothing_negative(basis, order):
    penalty = basis.penalty(order)
    assert np.linalg.eigvalsh(penalty).min() > -1e-9 * np.abs(penalty).max()
    if basis.unity is not None:
        np.testing.assert_allclose(penalty @ basis.unity, 0.0, atol=1e-9)


def test_a_basis_that_knows_no_answer_says_which():
    class Own(Fourier):
        readings, ranges = Basis.readings, Basis.ranges

    with pytest.raises(InputError, match="certificate needs a basis of polynomials, splines or sines: got Own"):
        Own("q", 1, 3.0).readings()
    with pytest.raises(InputError, match="no known bounds: got Own"):
        Own("q", 1, 3.0).ranges(BOX.limits)
