"""Bernstein coefficients against direct evaluation, and positivity against polynomials whose minimum is known."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lpvid.lmi import bernstein


def evaluate(coefficients: np.ndarray, t: np.ndarray) -> float:
    """Sum of coefficients times Bernstein polynomials at one point, written out."""
    total = 0.0
    for index in np.ndindex(*coefficients.shape):
        weight = 1.0
        for j, d, x in zip(index, coefficients.shape, t, strict=True):
            weight *= math.comb(d - 1, j) * x**j * (1 - x) ** (d - 1 - j)
        total += weight * coefficients[index]
    return total


def test_coefficients_of_a_known_quadratic():
    # t² = 0·B0 + 0·B1 + 1·B2 and 1 − t = 1·B0 + ½·B1 + 0·B2
    t = bernstein.nodes(2)
    np.testing.assert_allclose(bernstein.from_nodes(2) @ t**2, [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(bernstein.from_nodes(2) @ (1 - t), [1, 0.5, 0], atol=1e-15)


@pytest.mark.parametrize("degrees", [(3,), (9,), (2, 3), (1, 0, 4)])
def test_coefficients_reproduce_a_polynomial(degrees, rng):
    exact = rng.normal(size=[d + 1 for d in degrees])
    grid = np.meshgrid(*(bernstein.nodes(d) for d in degrees), indexing="ij")
    values = np.array([evaluate(exact, t) for t in np.stack([g.ravel() for g in grid], axis=1)])
    found = bernstein.coefficients(values.reshape(1, *exact.shape), len(degrees))[0]
    np.testing.assert_allclose(found, exact, atol=1e-15 * 10 * bernstein.amplification(degrees))


def test_halves_are_the_same_polynomial(rng):
    boxes = rng.normal(size=(1, 4, 3))
    left, right = bernstein.split(boxes, 1)
    for t in rng.uniform(size=(20, 2)):
        assert evaluate(left, t) == pytest.approx(evaluate(boxes[0], t * [0.5, 1]), abs=1e-13)
        assert evaluate(right, t) == pytest.approx(evaluate(boxes[0], t * [0.5, 1] + [0.5, 0]), abs=1e-13)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.05, 0.95), st.floats(1e-4, 0.1))
def test_positivity_between_grid_points_is_decided_exactly(place, least):
    # (t − place)² ± least has its minimum ± least at an irrational place, between any grid's points
    t = bernstein.nodes(2)[None, :, None, None]
    above = bernstein.positive(bernstein.coefficients((t - place) ** 2 + least, 1), 1)
    assert above.holds is True
    assert 0 < above.bound <= least * (1 + 1e-9)
    below = bernstein.positive(bernstein.coefficients((t - place) ** 2 - least, 1), 1)
    assert below.holds is False


def test_matrix_positivity_sees_the_smallest_eigenvalue():
    # [[1, x], [x, 1]] has smallest eigenvalue 1 − |x|; x = 0.9·(2t−1)(2s−1) reaches ±0.9 at the corners
    t, s = bernstein.nodes(1)[:, None], bernstein.nodes(1)[None, :]
    x = 0.9 * (2 * t - 1) * (2 * s - 1)
    values = np.stack([np.stack([np.ones_like(x), x], -1), np.stack([x, np.ones_like(x)], -1)], -1)[None]
    found = bernstein.positive(bernstein.coefficients(values, 2), 2)
    assert found.holds is True
    assert found.bound == pytest.approx(0.1)


def test_a_spent_budget_is_undecided():
    t = bernstein.nodes(6)[None, :, None, None]
    values = (t - 0.3) ** 2 * (t - 0.7) ** 2 * (1 + t**2) + 1e-9
    found = bernstein.positive(bernstein.coefficients(values, 1), 1, budget=30)
    assert found.holds is None
    assert bernstein.positive(bernstein.coefficients(values, 1), 1).holds is True


@pytest.mark.parametrize("rows", [3, 12])
@pytest.mark.parametrize("sharpness", [0.0, 0.5])
def test_factors_of_large_matrices_show_what_eigenvalues_show(rows, sharpness, rng):
    """A rotated diag((t − 0.3)² + least, 1, 2, …): its smallest eigenvalue is `least`, at t = 0.3."""
    q, _ = np.linalg.qr(rng.normal(size=(rows, rows)))
    t = bernstein.nodes(4)
    least = 0.01

    def boxes(lowest):
        diagonals = np.stack([(t - 0.3) ** 2 + lowest, *(k + t**3 for k in range(1, rows))], axis=1)
        return bernstein.coefficients(np.einsum("ik,tk,jk->tij", q, diagonals, q)[None], 1)

    found = bernstein.positive(boxes(least), 1, sharpness=sharpness)
    assert found.holds and sharpness * least <= found.bound <= least * (1 + 1e-9)
    assert bernstein.positive(boxes(least), 1, above=1.01 * least).holds is False
    assert bernstein.positive(boxes(least), 1, above=0.9999 * least).holds
    assert bernstein.positive(boxes(-least), 1).holds is False
    assert bernstein.positive(boxes(least), 1, above=0.9999 * least, budget=20).holds is None


def test_a_factor_that_rounding_let_through_proves_nothing(rng):
    """Of singular matrices every second or so is factored to the end; none is shown to be positive."""
    factored = 0
    for _ in range(40):
        half = rng.normal(size=(12, 11))
        singular = half @ half.T
        assert not bernstein._exceed(singular[None, None], 0.0)[0]
        with contextlib.suppress(np.linalg.LinAlgError):
            np.linalg.cholesky(singular)
            factored += 1
    assert factored > 5
    assert bernstein._exceed(np.eye(12)[None, None], 1 - 1e-12)[0]


@pytest.mark.parametrize("axes", [0, 1, 2])
def test_a_constant_is_decided_by_its_eigenvalues(axes):
    """Twelve rows, of which one exceeds the level by less than the rounding of a factor: there is nothing to halve."""
    f = np.diag([3e-15, *np.ones(11)])
    boxes = f.reshape(1, *(1,) * axes, 12, 12)
    assert not bernstein._exceed(f[None, None], 1e-15)[0]
    found = bernstein.positive(boxes, axes, above=1e-15)
    assert found.holds and found.bound == pytest.approx(3e-15) and found.work <= 2
    assert bernstein.positive(boxes, axes, above=4e-15).holds is False
