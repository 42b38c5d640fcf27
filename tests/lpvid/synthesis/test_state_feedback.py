"""State feedback against Riccati equations, closed forms and simulation."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.responses import largest_gain
from helpers.shaped_plants import plant_of, regulator, simulated_gain, spring_mass
from scipy.linalg import solve_continuous_are, solve_discrete_are

import lpvid as lpv
from lpvid.synthesis import figures
from lpvid.synthesis.interconnection import close_loop


def largest_response(a, b, c, d) -> float:
    """Largest singular value of the frequency response over a grid of frequencies."""
    return largest_gain((a, b, c, d), 1j * np.r_[0.0, np.geomspace(1e-3, 1e3, 600)])


def test_h2_state_feedback_of_a_still_plant_is_the_linear_quadratic_regulator():
    plant, a, b = regulator(np.random.default_rng(0))
    x = solve_continuous_are(a, b, np.eye(4), np.eye(2))
    found = lpv.StateFeedback(lpv.H2(), back_off=1.001).solve(plant)
    optimum = float(np.sqrt(np.trace(x)))
    assert found.verdict == "solved"
    level = float(found.notes[0].split("at most ")[1].split(" ")[0])
    assert optimum * (1 - 1e-5) <= level <= optimum * 1.0015
    np.testing.assert_allclose(found.controller.D[0], -b.T @ x, atol=0.2 * np.abs(b.T @ x).max())


def test_discrete_h2_state_feedback_is_the_discrete_regulator():
    plant, a, b = regulator(np.random.default_rng(1), sample_time=0.1)
    x = solve_discrete_are(a, b, np.eye(4), np.eye(2))
    found = lpv.StateFeedback(lpv.H2(), back_off=1.001).solve(plant)
    level = float(found.notes[0].split("at most ")[1].split(" ")[0])
    assert np.sqrt(np.trace(x)) * (1 - 1e-5) <= level <= np.sqrt(np.trace(x)) * 1.0015
    assert found.closed_loop.sample_time == 0.1


def test_h_infinity_state_feedback_of_an_integrator_reaches_the_closed_form():
    """ẋ = w + u, z = [x; u]: the Riccati equation 1 − X²(1 − γ⁻²) = 0 has a solution for γ > 1 only."""
    plant = plant_of([[0.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], [[0.0], [0.0]], [[0.0], [1.0]], [[1.0]], [[0.0]])
    found = lpv.StateFeedback(back_off=1.01).solve(plant)
    assert found.gamma == pytest.approx(1.01, rel=1e-4)
    assert 1.0 <= found.gamma_verified <= 1.0101
    assert found.between_grid


@pytest.mark.seconds
def test_polytopic_gain_varies_and_its_bound_holds_on_random_trajectories():
    plant, rng = spring_mass(), np.random.default_rng(2)
    found = lpv.StateFeedback().solve(plant)
    assert found.verdict == "solved" and found.between_grid
    assert found.controller.order == 0 and [s.name for s in found.controller.inputs] == ["y0", "y1"]
    assert all(simulated_gain(found.closed_loop, rng) <= found.gamma_verified for _ in range(5))
    assert found.gamma_lower <= found.gamma_verified * (1 + 1e-9)


@pytest.mark.seconds
def test_a_moving_lyapunov_matrix_never_promises_more_than_the_quadratic_one():
    slow = spring_mass(1.0, 9.0, rate=0.1)
    quadratic = lpv.StateFeedback().solve(slow)
    moving = lpv.StateFeedback(lyapunov=lpv.Polynomial("stiffness", 1), points=5).solve(slow)
    assert moving.solved and moving.gamma < quadratic.gamma
    assert simulated_gain(moving.closed_loop, np.random.default_rng(3)) <= moving.gamma_verified


@pytest.mark.slow
def test_a_moving_lyapunov_matrix_proves_its_own_promise(monkeypatch):
    """Three states, two variables: P = X(p)⁻¹ is re-checked on the whole box, no other one is looked for."""
    rng, basis = np.random.default_rng(1), lpv.Polynomial(("p", "q"), degree=1)
    a = rng.normal(size=(3, 3, 3)) * np.array([0.7, 0.17, 0.17])[:, None, None] - np.array([1, 0, 0])[:, None, None] * (
        np.eye(3))
    plant = plant_of(a[0], rng.normal(size=(3, 1)), rng.normal(size=(3, 1)),
                     np.vstack([rng.normal(size=3), np.zeros(3)]), np.zeros((2, 1)), [[0.0], [0.5]], np.eye(3),
                     np.zeros((3, 1)), basis=basis, more=a[1:],
                     box=lpv.Scheduling(("p", "q"), (-1, -1), (1, 1), (0.5, 0.5)))

    def searched(*given, **options):
        raise AssertionError("a search was begun")

    with monkeypatch.context() as patch:
        patch.setattr(figures, "l2_gain", searched)
        found = lpv.StateFeedback(lyapunov=basis, points=4).solve(plant)
    assert found.solved and found.between_grid and lpv.verify(found.certificate, found.closed_loop).holds
    assert found.gamma < found.gamma_verified <= 1.005 * found.gamma
    still = [largest_response(*found.closed_loop.frozen(p)) for p in found.closed_loop.box.grid(5)]
    assert max(still) <= found.gamma_lower * (1 + 1e-4) <= found.gamma_verified
    assert simulated_gain(found.closed_loop, rng, jump=False) <= found.gamma_verified


@pytest.mark.seconds
def test_discrete_poly_quadratic_design_with_slack():
    plant = spring_mass(sample_time=0.1)
    quadratic = lpv.StateFeedback().solve(plant)
    moving = lpv.StateFeedback(lyapunov=lpv.Polynomial("stiffness", 1), points=3).solve(plant)
    assert quadratic.solved and moving.solved
    assert moving.gamma <= quadratic.gamma * 1.001
    assert all(simulated_gain(moving.closed_loop, np.random.default_rng(k)) <= moving.gamma_verified for k in (4, 5))


def test_poles_lie_in_every_region_asked_for():
    found = lpv.StateFeedback(regions=[lpv.HalfPlane(1.0), lpv.Cone(0.6), lpv.Disc(0.0, 40.0)]).solve(spring_mass())
    assert found.solved
    loop = close_loop(spring_mass(), found.controller)
    poles = np.concatenate([np.linalg.eigvals(loop.frozen([p])[0]) for p in np.linspace(1, 4, 31)])
    assert poles.real.max() < -1.0 and np.abs(poles).max() < 40.0
    assert (-poles.real / np.abs(poles)).min() > 0.6


@pytest.mark.seconds
def test_mixed_design_keeps_the_bound_and_pays_for_it():
    plant = spring_mass()
    free = lpv.StateFeedback(lpv.H2("w0")).solve(plant)
    mixed = lpv.StateFeedback([lpv.H2("w0"), lpv.HInfinity("w0", "z1", bound=0.6)]).solve(plant)
    assert mixed.solved and mixed.gamma_verified <= 0.6
    assert [s.name for s in mixed.closed_loop.outputs] == ["z1"]  # what the certificate is about
    assert lpv.verify(mixed.certificate, mixed.closed_loop).holds
    nu = [float(r.notes[0].split("promised ")[1].split(")")[0]) for r in (free, mixed)]
    assert nu[0] <= nu[1] * 1.0001


def test_typed_outcomes_and_faults_name_the_signals():
    deaf = plant_of(np.diag([1.0, -1.0]), np.eye(2), [[0.0], [1.0]], np.eye(2), np.zeros((2, 2)), np.zeros((2, 1)),
                    np.eye(2), np.zeros((2, 2)))
    assert lpv.StateFeedback().solve(deaf).verdict == "unstabilisable"
    tight = lpv.StateFeedback(lpv.HInfinity(bound=1e-3)).solve(spring_mass())
    assert tight.verdict == "infeasible" and tight.controller is None and "z0" in tight.mend
    with pytest.raises(lpv.InputError, match="needs measurements that are the states themselves"):
        lpv.StateFeedback().solve(spring_mass(full=False))
    with pytest.raises(lpv.InputError, match="whose rate has no bound"):
        lpv.StateFeedback(lyapunov=lpv.Polynomial("stiffness", 1)).solve(spring_mass())
    with pytest.raises(lpv.InputError, match="no disturbance 'road'"):
        lpv.StateFeedback(lpv.HInfinity("road")).solve(spring_mass())
    with pytest.raises(lpv.InputError, match="region of the s plane"):
        lpv.StateFeedback(regions=lpv.Cone(0.5)).solve(spring_mass(sample_time=0.1))
    with pytest.raises(lpv.InputError, match="objects of this package"):
        lpv.StateFeedback("hinf")  # type: ignore[arg-type]
