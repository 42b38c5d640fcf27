"""Products of twice the digits, and systems over other states, against rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import lpvid as lpv
from lpvid.lmi.coordinates import Change, over_states
from lpvid.lmi.driven import driven
from lpvid.lmi.long_products import EPS, long_product

Exact = list[list[Fraction]]


def exact(m: np.ndarray) -> Exact:
    return [[Fraction(float(x)) for x in row] for row in m]


def times(a: Exact, b: Exact) -> Exact:
    return [[sum((x * y for x, y in zip(row, column, strict=True)), Fraction(0)) for column in zip(*b, strict=True)]
            for row in a]


def inverse(m: Exact) -> Exact:
    n = len(m)
    work = [row[:] + [Fraction(int(i == j)) for j in range(n)] for i, row in enumerate(m)]
    for i in range(n):
        pivot = next(k for k in range(i, n) if work[k][i])
        work[i], work[pivot] = work[pivot], work[i]
        work[i] = [x / work[i][i] for x in work[i]]
        for k in (k for k in range(n) if k != i):
            work[k] = [x - work[k][i] * y for x, y in zip(work[k], work[i], strict=True)]
    return [row[n:] for row in work]


def errors(made: np.ndarray, of: Exact) -> np.ndarray:
    return np.array([[abs(float(Fraction(float(x)) - y)) for x, y in zip(row, true, strict=True)]
                     for row, true in zip(made, of, strict=True)])


@pytest.mark.parametrize("seed", range(5))
def test_the_error_of_a_long_product(seed: int) -> None:
    rng = np.random.default_rng([seed, 41])
    a, b = (rng.normal(size=(7, 7)) * 10 ** rng.uniform(-6, 6, (7, 7)) for _ in range(2))
    a[0, -1], b[-1] = 1.0, -a[0, :-1] @ b[:-1]  # the first row of the product is rounding alone
    high, low = long_product(a, b)
    true = times(exact(a), exact(b))
    left = [[t - Fraction(float(h)) for t, h in zip(row, some, strict=True)]
            for row, some in zip(true, high, strict=True)]
    assert np.all(errors(low, left) <= (7 * EPS) ** 2 * (np.abs(a) @ np.abs(b)))
    first = np.abs(np.array([float(x) for x in true[0]]))
    assert np.all(errors(high + low, true)[0] <= 1e-6 * first) and np.all(errors(a @ b, true)[0] > 1e-6 * first)


@pytest.mark.parametrize("nearness", [1e-1, 1e-4, 1e-6])
def test_a_system_over_other_states(nearness: float) -> None:
    """Where states all but coincide, T⁻¹AT by doubles loses what the long products keep; the bound holds for each."""
    rng = np.random.default_rng([41, 5])
    n, m = 6, 2
    turn = rng.normal(size=(n, n))
    turn[:, 0] = turn[:, 1] + nearness * turn[:, 0]
    slow = rng.normal(size=(n, n))
    a, b, c = (turn @ slow @ np.linalg.inv(turn))[None], rng.normal(size=(1, n, m)), rng.normal(size=(1, m, n))
    system = driven(lpv.LPVStateSpace(a, b, c, np.zeros((1, m, m)), lpv.Polynomial((), 0), None))
    changed = over_states(system, turn)
    assert changed is not None and changed.sizes is not None
    into, back = exact(turn), inverse(exact(turn))
    parts = (changed.matrices(np.zeros((1, 0))), changed.magnitudes(np.zeros((1, 0))))
    for made, size, true in zip(*parts, (times(times(back, exact(a[0])), into), times(back, exact(b[0])),
                                         times(exact(c[0]), into)), strict=False):
        off = errors(made[0], true)
        assert np.all(off <= 6 * n * EPS * (size[0] - np.abs(made[0])) + 1e-300)
        assert np.all(off <= 4 * EPS * np.abs(made[0]).max()), "the digits of the product itself"


def test_states_that_coincide_are_refused() -> None:
    system = driven(lpv.LPVStateSpace(-np.eye(2)[None], np.ones((1, 2, 1)), np.ones((1, 1, 2)), np.zeros((1, 1, 1)),
                                      lpv.Polynomial((), 0), None))
    assert over_states(system, np.ones((2, 2))) is None


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_states_in_unlike_units_have_an_inverse(seed):
    """Rows and columns of T decades apart: L lacks a thousandth of what it lacks without scaling."""
    rng, n = np.random.default_rng(seed), 8
    mixed = np.eye(n) + np.triu(rng.normal(size=(n, n)), 1) + 1e-4 * rng.normal(size=(n, n))
    states = 10.0 ** rng.uniform(-8, 8, n)[:, None] * mixed * 10.0 ** rng.uniform(-4, 4, n)
    high, low = long_product(np.linalg.inv(states), states)
    change = Change.of(states)
    assert change is not None
    assert np.linalg.norm(change.off) < 1e-3 * np.linalg.norm((np.eye(n) - high) - low)
