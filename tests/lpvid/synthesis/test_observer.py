"""Observers and filters against Kalman filters, closed forms and simulation."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.criteria_notes import promised, verified
from helpers.shaped_plants import plant_of, simulated_gain, spring_mass
from scipy.linalg import solve_continuous_are, solve_discrete_are

import lpvid as lpv
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.observer import estimation_plant


def noisy(seed: int, sample_time: float | None = None, shift: float = 0.0):
    """Plant with z = x and unit noises on states and sensors: (plant, A, C)."""
    rng = np.random.default_rng(seed)
    a, c, b = rng.standard_normal((4, 4)) - shift * np.eye(4), rng.standard_normal((2, 4)), rng.standard_normal((4, 1))
    if sample_time is not None:
        a = np.eye(4) + sample_time * a
    plant = plant_of(a, np.hstack([np.eye(4), np.zeros((4, 2))]), b, np.eye(4), np.zeros((4, 6)), np.zeros((4, 1)), c,
                     np.hstack([np.zeros((2, 4)), np.eye(2)]), sample_time)
    return plant, a, c


def test_h2_observer_is_the_kalman_bucy_filter():
    plant, a, c = noisy(1)
    s = solve_continuous_are(a.T, c.T, np.eye(4), np.eye(2))
    found = lpv.Observer(lpv.H2(), back_off=1.0001).solve(plant)
    assert np.sqrt(np.trace(s)) * (1 - 1e-5) <= verified(found) <= np.sqrt(np.trace(s)) * 1.001
    gain = found.controller.B[0][:, 1:]
    np.testing.assert_allclose(gain, s @ c.T, atol=0.05 * np.abs(s @ c.T).max())
    assert [x.name for x in found.controller.outputs] == [f"z{i}_estimate" for i in range(4)]
    assert [x.name for x in found.controller.inputs] == ["u0", "y0", "y1"]


def test_discrete_h2_observer_is_the_one_step_predictor():
    plant, a, c = noisy(2, 0.1)
    s = solve_discrete_are(a.T, c.T, np.eye(4), np.eye(2))
    found = lpv.Observer(lpv.H2(), back_off=1.0001).solve(plant)
    assert np.sqrt(np.trace(s)) * (1 - 1e-5) <= verified(found) <= np.sqrt(np.trace(s)) * 1.001


def test_discrete_filter_sees_the_present_sample():
    """The filter's variance is S − SCᵀ(CSCᵀ + I)⁻¹CS, less than the predictor's S."""
    plant, a, c = noisy(3, 0.1, shift=3.0)
    s = solve_discrete_are(a.T, c.T, np.eye(4), np.eye(2))
    optimum = np.sqrt(np.trace(s - s @ c.T @ np.linalg.solve(c @ s @ c.T + np.eye(2), c @ s)))
    found = lpv.Filter(lpv.H2(), back_off=1.001).solve(plant)
    assert optimum * (1 - 1e-5) <= verified(found) <= promised(found) * 1.00001 <= optimum * 1.004


def test_h_infinity_observer_of_an_integrator_reaches_the_closed_form():
    """ẋ = w0, y = x + w1, z = x: e = (w0 − L w1)/(s + L) has norm √(1 + L²)/L > 1, so the infimum is 1."""
    plant = plant_of([[0.0]], [[1.0, 0.0]], [[1.0]], [[1.0]], [[0.0, 0.0]], [[0.0]], [[1.0]], [[0.0, 1.0]])
    found = lpv.Observer(back_off=1.05).solve(plant)
    gain = float(found.controller.B[0, 0, 1])
    assert found.gamma == pytest.approx(1.05, rel=1e-3)
    assert found.gamma_verified == pytest.approx(np.sqrt(1 + gain**2) / gain, rel=1e-3)


@pytest.mark.seconds
def test_varying_observer_keeps_its_bound_and_its_decay():
    plant, rng = spring_mass(full=False), np.random.default_rng(4)
    found = lpv.Observer(regions=lpv.HalfPlane(0.5)).solve(plant)
    assert found.solved and found.between_grid
    assert all(simulated_gain(found.closed_loop, rng) <= found.gamma_verified for _ in range(3))
    poles = [np.linalg.eigvals(found.closed_loop.frozen([p])[0]).real.max() for p in np.linspace(1, 4, 21)]
    assert max(poles) < -0.5


@pytest.mark.seconds
def test_observer_by_regions_alone_and_with_a_moving_lyapunov_matrix():
    placed = lpv.Observer((), lpv.HalfPlane(2.0)).solve(spring_mass(full=False))
    assert placed.solved and placed.gamma is None and placed.gamma_verified is not None
    slow = spring_mass(1.0, 9.0, rate=0.2, full=False)
    still, moving = (lpv.Observer(lyapunov=basis, points=5).solve(slow)
                     for basis in (None, lpv.Polynomial("stiffness", 1)))
    assert moving.gamma <= still.gamma * 1.001
    assert simulated_gain(moving.closed_loop, np.random.default_rng(5)) <= moving.gamma_verified


@pytest.mark.seconds
def test_filter_keeps_its_bound_and_its_loop_is_the_plant_of_the_error_closed_with_it():
    plant = spring_mass(1.0, 1.05, full=False)
    found = lpv.Filter().solve(plant)
    again = close_loop(estimation_plant(plant), found.controller)
    for p in (1.0, 1.03):
        np.testing.assert_array_equal(again.frozen([p])[0], found.closed_loop.frozen([p])[0])
    assert simulated_gain(found.closed_loop, np.random.default_rng(6)) <= found.gamma_verified
    assert [s.name for s in found.controller.inputs] == ["y0", "u0_known"]


def test_no_filter_for_a_plant_that_jumping_makes_unstable():
    """ẍ = −p x − 0.2ẋ with p jumping between 1 and 4 can grow: nothing bounds the error of a filter that moves none."""
    assert lpv.Filter().solve(spring_mass(full=False)).verdict in ("infeasible", "numerical")


def test_what_is_not_seen_is_undetectable():
    blind = plant_of(np.diag([1.0, -1.0]), np.eye(2), np.eye(2)[:, :1], np.eye(2), np.zeros((2, 2)), np.zeros((2, 1)),
                     [[0.0, 1.0]], np.zeros((1, 2)))
    found = lpv.Observer().solve(blind)
    assert found.verdict == "undetectable" and "y0" in found.why
