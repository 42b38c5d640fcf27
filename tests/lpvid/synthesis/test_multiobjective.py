"""Output feedback under several criteria: published numbers, Riccati equations, simulation."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.criteria_notes import promised, verified
from helpers.shaped_plants import plant_of, scherer_1997, simulated_gain, spring_mass
from scipy.linalg import solve_continuous_are, solve_discrete_are

import lpvid as lpv
from lpvid.synthesis.interconnection import close_loop


@pytest.mark.seconds
def test_h_infinity_optimum_of_scherer_1997():
    found = lpv.MultiObjective(back_off=1.001).solve(scherer_1997())
    assert 9.508 <= found.gamma <= 9.508 * 1.0025
    assert found.gamma_verified <= found.gamma and found.gamma_lower <= found.gamma_verified
    assert lpv.verify(found.certificate, found.closed_loop).holds


def random_plant(seed: int, sample_time: float | None = None):
    """Plant with process and sensor noise, for the linear-quadratic Gaussian problem: (plant, A, B, C)."""
    rng = np.random.default_rng(seed)
    a, b, c = rng.standard_normal((3, 3)) - np.eye(3), rng.standard_normal((3, 1)), rng.standard_normal((1, 3))
    if sample_time is not None:
        a, b = np.eye(3) + sample_time * a, sample_time * b
    plant = plant_of(a, np.hstack([np.eye(3), np.zeros((3, 1))]), b, np.vstack([np.eye(3), np.zeros((1, 3))]),
                     np.zeros((4, 4)), [[0]] * 3 + [[1]], c, [[0, 0, 0, 1]], sample_time)
    return plant, a, b, c


def test_h2_optimum_is_that_of_two_riccati_equations():
    """ν² = trace(X) + trace(K S Kᵀ) with the regulator's X, K and the filter's S."""
    plant, a, b, c = random_plant(5)
    x, s = solve_continuous_are(a, b, np.eye(3), [[1.0]]), solve_continuous_are(a.T, c.T, np.eye(3), [[1.0]])
    optimum = np.sqrt(np.trace(x) + np.trace(b.T @ x @ s @ x @ b))
    found = lpv.MultiObjective(lpv.H2(), back_off=1.001).solve(plant)
    assert optimum * (1 - 1e-5) <= verified(found) <= promised(found) * 1.00001 <= optimum * 1.003
    assert not found.controller.D.any()


def test_discrete_h2_optimum_is_that_of_two_riccati_equations():
    """Strictly proper: ν² = trace(X) + trace(K S Kᵀ (R + BᵀXB)) with the one-step predictor's S."""
    plant, a, b, c = random_plant(6, 0.1)
    x, s = solve_discrete_are(a, b, np.eye(3), [[1.0]]), solve_discrete_are(a.T, c.T, np.eye(3), [[1.0]])
    weight = np.eye(1) + b.T @ x @ b
    k = np.linalg.solve(weight, b.T @ x @ a)
    optimum = np.sqrt(np.trace(x) + np.trace(k @ s @ k.T @ weight))
    found = lpv.MultiObjective(lpv.H2(), feedthrough=False, back_off=1.001).solve(plant)
    assert optimum * (1 - 1e-5) <= verified(found) <= optimum * 1.003


@pytest.mark.seconds
def test_bounds_and_regions_are_kept_and_cost_something():
    plain = lpv.MultiObjective(lpv.H2()).solve(scherer_1997())
    mixed = lpv.MultiObjective([lpv.HInfinity(bound=14.0), lpv.H2()], lpv.HalfPlane(0.8)).solve(scherer_1997())
    assert mixed.solved and mixed.gamma_verified <= 14.0
    assert promised(mixed, 1) > promised(plain)
    poles = np.linalg.eigvals(close_loop(scherer_1997(), mixed.controller).frozen([])[0])
    assert poles.real.max() < -0.8


@pytest.mark.seconds
def test_polytopic_design_holds_on_jumping_trajectories():
    found = lpv.MultiObjective().solve(spring_mass(full=False))
    assert found.solved and found.between_grid
    assert {s.name for s in found.controller.inputs} == {"y0"}
    rng = np.random.default_rng(7)
    assert all(simulated_gain(found.closed_loop, rng) <= found.gamma_verified for _ in range(4))


@pytest.mark.seconds
def test_discrete_design_with_a_disc():
    plant = spring_mass(sample_time=0.1, full=False)
    found = lpv.MultiObjective(regions=lpv.Disc(0.0, 0.97)).solve(plant)
    assert found.solved
    loop = close_loop(plant, found.controller)
    assert max(np.abs(np.linalg.eigvals(loop.frozen([p])[0])).max() for p in np.linspace(1, 4, 13)) < 0.97
    assert simulated_gain(found.closed_loop, np.random.default_rng(8)) <= found.gamma_verified


@pytest.mark.seconds
def test_feedthrough_of_the_plant_is_taken_out_of_the_controller():
    direct = scherer_1997()
    d = direct.system.D.copy()
    d[0, 2, 1] = 0.5  # u0 -> y0
    plant = lpv.GeneralizedPlant(direct.system.replace(D=d), ("u0",), ("y0",))
    found = lpv.MultiObjective(back_off=1.01).solve(plant)
    assert found.gamma_verified <= 9.508 * 1.015


def test_white_noise_through_a_feedthrough_is_refused_by_name():
    plant = plant_of([[-1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], [[0.0]], [[1.0]], [[0.0]])
    with pytest.raises(lpv.InputError, match="H2 norm from w0 to z0 is infinite"):
        lpv.MultiObjective(lpv.H2()).solve(plant)
    impossible = lpv.MultiObjective(lpv.HInfinity(bound=9.0)).solve(scherer_1997())
    assert impossible.verdict == "infeasible" and impossible.controller is None and impossible.mend
