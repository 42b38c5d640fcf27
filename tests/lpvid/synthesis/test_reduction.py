"""Balanced reduction: gramians by scipy, Glover's bound, and a bounded gain on random trajectories."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

from lpvid.errors import InputError, NumericalError
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling, Spline
from lpvid.synthesis._gramians import bounding_gramian, frozen_matrices
from lpvid.synthesis.reduction import balanced_realization, reduce_order


def stable(seed: int, order: int, sample_time=None, basis=None, spread: float = 0.1) -> LPVStateSpace:
    """A random system with poles over three decades, in scrambled states, that varies by `spread`."""
    rng = np.random.default_rng(seed)
    basis = Polynomial("p", 1) if basis is None else basis
    a = np.zeros((basis.size, order, order))
    decay = np.logspace(0, 2, order)
    base = -np.diag(decay) if sample_time is None else np.diag(np.exp(-decay * 0.02))
    t = rng.normal(size=(order, order)) + 2 * np.eye(order)
    vary = rng.normal(size=(basis.size, order, order)) * spread * (0.3 if sample_time is None else 0.02)
    one = basis.unity
    a = np.array([t @ (base * one[m] + vary[m]) @ np.linalg.inv(t) for m in range(basis.size)])
    b = np.array([t @ (np.ones((order, 2)) * one[m] + spread * rng.normal(size=(order, 2))) for m in range(basis.size)])
    c = np.array([(rng.normal(size=(1, order)) * one[m]) @ np.linalg.inv(t) for m in range(basis.size)])
    box = Scheduling(("p",), (-1.0,), (1.0,)) if basis.names else None
    return LPVStateSpace(a, b, c, np.zeros((basis.size, 1, 2)), basis, sample_time, box)


@pytest.mark.parametrize("sample_time", [None, 0.02])
def test_a_balanced_realization_has_equal_diagonal_gramians(sample_time):
    system = stable(1, 4, sample_time, Polynomial())
    balanced = balanced_realization(system)
    a, b, c, _ = balanced.frozen([])
    if sample_time is None:
        p, q = solve_continuous_lyapunov(a, -b @ b.T), solve_continuous_lyapunov(a.T, -c.T @ c)
    else:
        p, q = solve_discrete_lyapunov(a, b @ b.T), solve_discrete_lyapunov(a.T, c.T @ c)
    np.testing.assert_allclose(p, q, atol=1e-9 * np.abs(p).max())
    np.testing.assert_allclose(p, np.diag(np.diag(p)), atol=1e-9 * np.abs(p).max())
    for s in (0.3j, 1.2 + 0.4j):
        np.testing.assert_allclose(balanced.to_control([])(s), system.to_control([])(s), rtol=1e-8)


def test_states_without_influence_are_dropped_and_unstable_systems_only_scaled():
    doubled = control.ss(control.tf([1, 3], [1, 4, 3]))  # (s + 3)/((s + 1)(s + 3))
    system = LPVStateSpace(doubled.A[None], doubled.B[None], doubled.C[None], doubled.D[None], Polynomial(), None)
    assert balanced_realization(system).order == 1
    badly = LPVStateSpace([[[1.0, 1e8], [0.0, 2.0]]], [[[0.0], [1.0]]], [[[1.0, 0.0]]], np.zeros((1, 1, 1)),
                          Polynomial(), None)
    scaled = balanced_realization(badly)
    assert scaled.order == 2 and np.abs(scaled.A).max() < 1e5
    np.testing.assert_allclose(scaled.to_control([])(2j), badly.to_control([])(2j), rtol=1e-11)


@pytest.mark.thinned(2, "slow", "seconds")
@pytest.mark.parametrize("sample_time", [None, 0.02])
def test_the_frozen_error_keeps_glovers_bound_on_a_time_invariant_system(sample_time):
    """For one point the bound of the inequalities tends to twice the sum of the Hankel singular values."""
    system = stable(2, 5, sample_time, Polynomial())
    full = system.to_control([])
    solve = solve_discrete_lyapunov if sample_time else (lambda x, y: solve_continuous_lyapunov(x, -y))
    p, q = solve(full.A, full.B @ full.B.T), solve(full.A.T, full.C.T @ full.C)
    hankel = np.sort(np.sqrt(np.abs(np.linalg.eigvals(p @ q))))[::-1]
    for order in (1, 2, 3):
        small = reduce_order(system, order)
        assert small.error <= small.bound
        assert small.bound == pytest.approx(2 * hankel[order:].sum(), rel=0.02, abs=1e-6 * hankel[0])
        gap = full - small.model.to_control([])
        omega = np.logspace(-3, 5, 600) if sample_time is None else np.linspace(0, np.pi / 0.02, 600)
        seen = max(np.linalg.norm(gap(np.exp(1j * w * 0.02) if sample_time else 1j * w), 2) for w in omega)
        assert seen <= small.error * (1 + 1e-6) and seen > 0.9 * small.error


@pytest.mark.parametrize("sample_time", [None, 0.02])
def test_the_gramians_hold_at_every_point_of_the_grid(sample_time):
    system = stable(3, 4, sample_time)
    grid = system.box.grid(5)
    a, b, _, _ = frozen_matrices(system, grid)
    p = bounding_gramian(a, b, np.eye(4), sample_time is not None)
    for x, y in zip(a, b, strict=True):
        rest = x @ p @ x.T - p + y @ y.T if sample_time else x @ p + p @ x.T + y @ y.T
        assert np.linalg.eigvalsh(rest)[-1] <= 1e-9 * np.linalg.norm(p)


@pytest.mark.slow
def test_the_bound_holds_on_random_trajectories():
    system = stable(9, 4, 0.02)
    small = reduce_order(system, 2)
    assert small.between_grid and small.error <= small.bound < 0.3 * small.size
    rng = np.random.default_rng(0)
    for _ in range(20):
        x, z, gap, drive = np.zeros(4), np.zeros(2), 0.0, 0.0
        held = rng.integers(1, 15)
        for k in range(400):
            if k % held == 0:
                p, u = rng.uniform(-1, 1, 1), rng.normal(size=2)
            if k > 200:
                u = np.zeros(2)
            (a, b, c, _), (e, f, g, _) = system.frozen(p), small.model.frozen(p)
            gap, drive = gap + float(((c @ x - g @ z) ** 2).sum()), drive + float(u @ u)
            x, z = a @ x + b @ u, e @ z + f @ u
        assert np.sqrt(gap / drive) <= small.bound


def test_averaged_gramians_promise_nothing_and_say_so():
    system = stable(5, 5)
    small = reduce_order(system, 3, certified=False)
    assert small.bound is None and "no bound" in str(small) and small.error < 0.2 * small.size


def test_the_order_is_chosen_by_the_tolerance():
    system = stable(6, 6)
    small = reduce_order(system, tolerance=0.05)
    assert 0 < small.model.order < 6
    assert small.bound <= 0.05 * small.singular_values[0]
    assert f"6 -> {small.model.order} states" in str(small) and "on the whole box" in str(small)


def test_what_has_no_gramians_is_refused():
    system = stable(7, 3)
    with pytest.raises(InputError, match=r"only a stable system has gramians.*p = 1"):
        reduce_order(system.replace(A=system.A + np.array([0.0, 5e3])[:, None, None] * np.eye(3)), 2)
    with pytest.raises(InputError, match="more states"):
        reduce_order(system, 4)
    pair = np.array([[[0.0, 2.0], [0.0, 0.0]], [[0.0, 0.0], [2.0, 0.0]]])  # nilpotent each, unstable in turn
    trap = LPVStateSpace(pair, np.ones((2, 2, 1)), np.ones((2, 1, 2)), np.zeros((2, 1, 1)),
                         Spline("p", 1, 1, (0.0, 1.0)), 0.1, Scheduling(("p",), (0.0,), (1.0,)))
    with pytest.raises(NumericalError, match="no gramians hold"):
        reduce_order(trap, 1, points=2)
