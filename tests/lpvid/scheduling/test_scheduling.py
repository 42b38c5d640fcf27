"""Scheduling boxes and bases, against finite differences, interpolation and spanned spaces."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lpvid.errors import InputError
from lpvid.scheduling import Basis, Fourier, Polynomial, Product, Scheduling, Shifted, Spline, Stacked, basis_from_dict

BOX = Scheduling(("p", "q"), (-1.0, 10.0), (3.0, 250.0), rate=(2.0, None), units=("A", "K"))
P, Q = Polynomial("p", degree=3), Spline("q", segments=4, order=3)
BASES = [
    Polynomial(),
    P,
    Polynomial(("p", "q"), degree=3),
    Q,
    Spline("p", segments=3, order=1),
    Product(P, Q),
    Fourier("p", 3, 5.0, 0.3),
    Product(Fourier("q", 2, 300.0), P),
    Product(Polynomial("q", degree=1), Spline("p", segments=2, order=2)),
    Stacked((P, Shifted(P, 1))),
    Shifted(Polynomial(("p", "q"), degree=2), -2),
    Shifted(Product(P, Q), 3),
    Product(Shifted(P, 1), Polynomial("q", degree=1)),
]


def inside(basis: Basis, rng: np.random.Generator, n: int) -> np.ndarray:
    limits = [(BOX.lower[BOX.names.index(v)], BOX.upper[BOX.names.index(v)]) for v in basis.names]
    return np.column_stack([rng.uniform(a, b, n) for a, b in limits]) if limits else np.empty((n, 0))


@pytest.mark.parametrize("basis", BASES, ids=repr)
def test_sizes_labels_and_dict_round_trip(basis: Basis, rng: np.random.Generator) -> None:
    bound = basis.bound(BOX)
    p = inside(basis, rng, 30)
    phi = bound.evaluate(p)
    assert phi.shape == (30, bound.size)
    assert len(bound.labels) == bound.size
    if not isinstance(basis, Stacked):
        assert len(set(bound.labels)) == bound.size
    again = basis_from_dict(json.loads(json.dumps(bound.to_dict())))
    assert again == bound
    assert np.array_equal(again.evaluate(p), phi)


@pytest.mark.parametrize("basis", [b for b in BASES if b.names], ids=repr)
def test_derivatives_agree_with_finite_differences(basis: Basis, rng: np.random.Generator) -> None:
    bound = basis.bound(BOX)
    p = inside(basis, rng, 25)
    for column, name in enumerate(bound.names):
        i = BOX.names.index(name)
        step = 1e-6 * (BOX.upper[i] - BOX.lower[i])
        low, high = p.copy(), p.copy()
        low[:, column] -= step
        high[:, column] += step
        difference = (bound.evaluate(high) - bound.evaluate(low)) / (2 * step)
        np.testing.assert_allclose(
            bound.derivative(p, name), difference, rtol=1e-6, atol=1e-7 * np.abs(difference).max()
        )
    with pytest.raises(InputError, match="no scheduling variable 'nobody'"):
        bound.derivative(p, "nobody")


@pytest.mark.parametrize(
    "basis",
    [
        P,
        Polynomial(("p", "q"), degree=2),
        Product(P, Polynomial("q", degree=1)),
        Stacked((P, Polynomial("q", degree=2))),
    ],
    ids=repr,
)
def test_normalisation_spans_the_same_functions(basis: Basis, rng: np.random.Generator) -> None:
    p = inside(basis, rng, 200)
    raw, bound = basis.evaluate(p), basis.bound(BOX).evaluate(p)
    scaled = raw / np.linalg.norm(raw, axis=0)
    mapped = scaled @ np.linalg.lstsq(scaled, bound, rcond=None)[0]
    np.testing.assert_allclose(mapped, bound, atol=1e-8)
    assert np.linalg.matrix_rank(bound) == np.linalg.matrix_rank(scaled)


def test_bound_polynomials_stay_within_one(rng: np.random.Generator) -> None:
    p = inside(Polynomial(("p", "q")), rng, 500)
    assert np.abs(Polynomial(("p", "q"), degree=4).bound(BOX).evaluate(p)).max() <= 1.0


@pytest.mark.seconds
@given(degree=st.integers(0, 5), variables=st.integers(1, 4))
def test_a_polynomial_has_every_monomial_once(degree: int, variables: int) -> None:
    basis = Polynomial(tuple("pqrs"[:variables]), degree=degree)
    assert basis.size == math.comb(degree + variables, variables)
    assert len({tuple(e) for e in basis.exponents}) == basis.size
    assert basis.exponents.sum(axis=1).max(initial=0) == degree
    assert basis.degree == degree
    assert basis.labels[0] == "1"


def test_monomials_by_hand() -> None:
    values = Polynomial(("p", "q"), degree=2).evaluate(np.array([[2.0, 5.0]]))
    assert values.tolist() == [[1, 2, 5, 4, 10, 25]]


@settings(deadline=None)
@given(segments=st.integers(1, 6), order=st.integers(1, 5), seed=st.integers(0, 999))
def test_splines_are_a_partition_of_unity(segments: int, order: int, seed: int) -> None:
    basis = Spline("p", segments=segments, order=order).bound(BOX)
    p = np.concatenate([np.random.default_rng(seed).uniform(-1, 3, 40), np.linspace(-1, 3, segments + 1), [-9, 77]])
    phi = basis.evaluate(p[:, None])
    np.testing.assert_allclose(phi.sum(axis=1), 1.0, atol=1e-12)
    assert phi.min() >= -1e-15
    assert (phi > 1e-14).sum(axis=1).max() <= order + 1


def test_a_spline_of_order_one_is_linear_interpolation(rng: np.random.Generator) -> None:
    knots = (-1.0, 0.3, 0.5, 3.0)
    heights = rng.normal(size=4)
    p = np.concatenate([rng.uniform(-2, 4, 100), knots])
    values = Spline("p", segments=3, order=1, knots=knots).evaluate(p[:, None]) @ heights
    np.testing.assert_allclose(values, np.interp(p, knots, heights), atol=1e-13)


def test_a_cubic_spline_holds_any_cubic(rng: np.random.Generator) -> None:
    p = rng.uniform(-1, 3, 200)[:, None]
    phi = Spline("p", segments=5, order=3).bound(BOX).evaluate(p)
    cubic = (p**3 - 2 * p**2 + p - 7).ravel()
    np.testing.assert_allclose(phi @ np.linalg.lstsq(phi, cubic, rcond=None)[0], cubic, atol=1e-11)


def test_outside_its_box_a_spline_holds_its_end_value() -> None:
    basis = Spline("p", segments=3, order=3).bound(BOX)
    ends = basis.evaluate(np.array([[-1.0], [3.0]]))
    assert np.array_equal(basis.evaluate(np.array([[-50.0], [50.0]])), ends)
    assert np.array_equal(basis.derivative(np.array([[-50.0], [50.0]]), "p"), np.zeros((2, basis.size)))


def test_shifting_reads_the_past_and_holds_the_ends() -> None:
    p = np.arange(6.0)[:, None]
    base = Polynomial("p", degree=1)
    assert Shifted(base, 2).evaluate(p)[:, 1].tolist() == [0, 0, 0, 1, 2, 3]
    assert Shifted(base, -2).evaluate(p)[:, 1].tolist() == [2, 3, 4, 5, 5, 5]
    assert Shifted(base, 9).evaluate(p)[:, 1].tolist() == [0] * 6
    assert Shifted(Shifted(base, 1), 2).lags == (3, 3)
    assert Stacked((base, Shifted(base, 2), Shifted(base, -1))).lags == (-1, 2)
    assert Product(Shifted(base, 1), Shifted(base, 4)).lags == (1, 4)
    assert Shifted(base, 1).labels == ("1", "p(k-1)")
    assert Shifted(base, -1).labels == ("1", "p(k+1)")


def test_composites_pick_their_columns_by_name(rng: np.random.Generator) -> None:
    product = Product(Polynomial(("q", "p"), degree=1), Polynomial("p", degree=2))
    assert product.names == ("q", "p")
    qp = rng.normal(size=(20, 2))
    q, p = qp.T
    expected = np.column_stack([a * b for a in (np.ones(20), q, p) for b in (np.ones(20), p, p**2)])
    np.testing.assert_allclose(product.evaluate(qp), expected, rtol=1e-14)
    assert product.degree == 3
    assert Product(P, Q).degree is None


def test_a_basis_of_a_constant_variable_stays_finite() -> None:
    flat = Scheduling(("p",), (2.0,), (2.0,))
    assert Polynomial("p", degree=2).bound(flat).evaluate(np.array([[2.0]])).tolist() == [[1, 0, 0]]
    with pytest.raises(InputError, match="needs 'p' to move: got the constant 2"):
        Spline("p").bound(flat)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Polynomial("p", degree=-1), "degree of a polynomial basis"),
        (lambda: Polynomial("p", degree=1.5), "degree of a polynomial basis"),  # type: ignore[arg-type]
        (lambda: Polynomial("p", 1, (0.0,), (0.0,)), "positive half width"),
        (lambda: Polynomial("p", 1, (0.0, 1.0), (1.0,)), "one centre"),
        (lambda: Spline("p", segments=0), "segments of a spline"),
        (lambda: Spline("p", order=6), "between 1 and 5"),
        (lambda: Spline("p", segments=2, knots=(0.0, 1.0)), "rising knots"),
        (lambda: Spline("p", segments=2, knots=(0.0, 1.0, 1.0)), "rising knots"),
        (lambda: Spline("p").evaluate(np.zeros((1, 1))), "no knots yet"),
        (lambda: Polynomial("r").bound(BOX), "no scheduling variable 'r'"),
        (lambda: basis_from_dict({"kind": "wavelet"}), "unknown basis in a model file: got wavelet"),
        (lambda: Scheduling(("p",), (1.0,), (0.0,)), "lower bound above the upper"),
        (lambda: Scheduling(("p",), (0.0,), (np.inf,)), "must be finite"),
        (lambda: Scheduling(("p",), (0.0,), (1.0, 2.0)), "one lower, upper"),
        (lambda: Scheduling(("p",), (0.0,), (1.0,), rate=(-1.0,)), "rate bound of 'p' must not be negative"),
        (lambda: Scheduling(("p", "p"), (0.0, 0.0), (1.0, 1.0)), "names a variable twice"),
    ],
)
def test_what_is_no_basis_or_box_is_refused(make, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()


def test_the_box() -> None:
    assert Scheduling.from_dict(json.loads(json.dumps(BOX.to_dict()))) == BOX
    assert BOX.centre.tolist() == [1.0, 130.0]
    assert BOX.half_width.tolist() == [2.0, 120.0]
    inside_out = BOX.contains(np.array([[0.0, 20.0], [3.0, 250.0], [3.1, 20.0], [0.0, 9.0], [np.nan, 20.0]]))
    assert inside_out.tolist() == [True, True, False, False, False]
    tight = Scheduling.of(("a", "b"), np.array([[1.0, 5.0], [-2.0, 7.0]]))
    assert (tight.lower, tight.upper) == ((-2.0, 5.0), (1.0, 7.0))


@pytest.mark.parametrize("points", [1, 2, 5])
def test_the_grid_is_a_tensor_over_the_box(points: int) -> None:
    grid = BOX.grid(points)
    assert grid.shape == (points**2, 2)
    assert len({tuple(g) for g in grid}) == points**2
    assert BOX.contains(grid).all()
    if points > 1:
        assert grid.min(axis=0).tolist() == [-1.0, 10.0]
        assert grid.max(axis=0).tolist() == [3.0, 250.0]
    assert Scheduling((), (), ()).grid(points).shape == (1, 0)
