"""Scaled small gain: against published numbers, frozen norms and random trajectories."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.shaped_plants import scherer_1997, simulated_gain, spring_mass

import lpvid as lpv
from lpvid.model.signals import Signal
from lpvid.synthesis.forms import to_lft
from lpvid.synthesis.scaled_gain import recheck_scaled, scaled_gain


@pytest.mark.seconds
def test_without_scheduling_it_is_h_infinity_synthesis():
    """Scherer, Gahinet & Chilali 1997, example 7: 9.50808."""
    found = lpv.LFTFeedback(back_off=1.02).solve(scherer_1997())
    assert found.verdict == "solved"
    assert found.infimum == pytest.approx(9.50808, rel=1e-4)
    assert 9.50808 <= found.gamma_verified <= 9.50808 * 1.021


@pytest.mark.thinned(2, "slow", "seconds")
@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_scheduled_controller_keeps_its_promise_on_jumping_trajectories(sample_time):
    plant, rng = spring_mass(full=False, sample_time=sample_time), np.random.default_rng(0)
    found = lpv.LFTFeedback().solve(plant)
    assert found.solved and found.gamma_verified <= found.gamma * 1.005
    assert found.controller.box.names == ("stiffness",)
    assert all(simulated_gain(found.closed_loop, rng) <= found.gamma_verified for _ in range(3))


@pytest.mark.seconds
def test_small_gain_is_no_better_than_one_quadratic_lyapunov_matrix():
    """D scalings cover every Δ of the block's size: their least γ is never below that of the vertices."""
    plant = spring_mass(full=False)
    quadratic = lpv.OutputFeedback().solve(plant)
    assert lpv.LFTFeedback().solve(plant).infimum >= quadratic.infimum * (1 - 1e-3)


def _quarter_car(length: float, force: float) -> lpv.GeneralizedPlant:
    """Force between the masses of a car over a damper of 700 to 3000 Ns/m, in units of `length`/m and `force`/N."""
    ms, mu, k, kt = 315.0, 37.5, 29500.0, 208000.0
    still = np.array([[0, 1, 0, -1], [-k / ms, 0, 0, 0], [0, 0, 0, 1], [k / mu, 0, -kt / mu, 0]])
    damped = np.zeros((4, 4))
    damped[1, [1, 3]], damped[3, [1, 3]] = [-1 / ms, 1 / ms], [1 / mu, -1 / mu]
    b = np.array([[0, 0, 0], [0, 0, 1 / ms], [-1, 0, 0], [0, 0, -1 / mu]]) * length / [1, 1, force]
    weigh = np.array([[0.0] * 4, [20, 0, 0, 0], [0, 0, 60, 0], [0.0] * 4])
    sensors = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0]])
    c = np.array([np.vstack([weigh + 0.2 * np.outer([1, 0, 0, 0], still[1]), sensors * length]),
                  np.vstack([0.2 * np.outer([1, 0, 0, 0], damped[1]), 0 * sensors])]) / length
    d = np.zeros((6, 3))
    d[0, 2], d[3, 2], d[4:, 1] = 0.2 / ms / force, 1 / 2000 / force, 1e-3 * length
    names = ["comfort", "stroke", "tyre", "effort", "deflection", "speed"]
    system = lpv.LPVStateSpace([still, damped], [b, 0 * b], c, [d, 0 * d], lpv.Polynomial("c", 1), None,
                               lpv.Scheduling(("c",), (700.0,), (3000.0,)),
                               inputs=tuple(Signal(n) for n in ("road", "noise", "force")),
                               outputs=tuple(Signal(n) for n in names))
    return lpv.GeneralizedPlant(system, ["force"], names[4:])


@pytest.mark.seconds
@pytest.mark.parametrize(("length", "force"), [
    (1e3, 1e-3), *(pytest.param(x, 1 / x, marks=pytest.mark.slow) for x in (1.0, 1e-3))])
def test_units_change_neither_the_verdict_nor_the_gain(length, force):
    found = lpv.LFTFeedback().solve(_quarter_car(length, force))
    assert found.verdict == "solved" and found.infimum == pytest.approx(2.875, rel=2e-3)
    assert found.gamma_verified <= 1.05 * found.infimum


def test_what_no_controller_reaches_is_said_before_any_solver():
    lost = spring_mass(full=False)
    a = lost.system.A.copy()
    a[0], a[1] = np.diag([0.5, -1.0]), 0.0  # the control moves the second state only
    plant = lpv.GeneralizedPlant(lost.system.replace(A=a), lost.controls, lost.measurements)
    found = lpv.LFTFeedback().solve(plant)
    assert found.verdict == "unstabilisable" and "u0" in found.why and found.controller is None


@pytest.mark.seconds
def test_scaled_bounded_real_lemma_bounds_frozen_norms_and_is_exact_without_scheduling():
    loop = lpv.StateFeedback().solve(spring_mass()).closed_loop
    form = to_lft(loop).model
    found = scaled_gain(form)
    assert np.isfinite(found.gamma) and found.margin > 0
    assert lpv.l2_gain(loop, trajectories=False).lower <= found.gamma
    assert recheck_scaled(form, found.lyapunov, found.scaling, found.skew, 0.5 * found.gamma) < 0
    still = lpv.MultiObjective().solve(scherer_1997()).closed_loop
    assert scaled_gain(to_lft(still).model).gamma == pytest.approx(lpv.l2_gain(still).lower, rel=2e-3)


def test_multipliers_with_a_skew_part_use_that_the_parameter_is_real():
    """ẋ = (−1 + p [0 4; −4 0]) x + w decays for every |p| ≤ 1 with V = |x|²: gain 1, which S alone cannot show."""
    turn = np.array([[0.0, 4.0], [-4.0, 0.0]])
    model = lpv.LPVStateSpace([-np.eye(2), turn], [np.eye(2), 0 * turn], [np.eye(2), 0 * turn], np.zeros((2, 2, 2)),
                              lpv.Polynomial("p", 1), None, lpv.Scheduling(("p",), (-1.0,), (1.0,)))
    assert scaled_gain(to_lft(model).model).gamma == pytest.approx(1.0, abs=0.01)
