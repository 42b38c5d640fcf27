"""Peak of z for a disturbance of unit energy: Lyapunov equations, Riccati equations, covariances along trajectories."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.shaped_plants import plant_of, spring_mass
from scipy.linalg import expm, solve_continuous_are, solve_continuous_lyapunov

import lpvid as lpv

STILL = lpv.Polynomial((), 0)


def random_system(seed: int, n: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray, lpv.LPVStateSpace]:
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    a -= (np.linalg.eigvals(a).real.max() + 0.3) * np.eye(n)
    b, c = rng.normal(size=(n, 2)), rng.normal(size=(2, n))
    return a, b, c, lpv.LPVStateSpace([a], [b], [c], [np.zeros((2, 2))], STILL, None)


def test_peak_gain_is_that_of_the_gramian_and_is_reached():
    """ν² is the largest eigenvalue of CWCᵀ; w = Bᵀexp(Aᵀ(T − t))Cᵀv reaches it at T."""
    a, b, c, system = random_system(1)
    w = solve_continuous_lyapunov(a, -b @ b.T)
    values, vectors = np.linalg.eigh(c @ w @ c.T)
    found = lpv.peak_gain(system)
    assert found.between_grid and np.sqrt(values[-1]) * (1 - 1e-9) <= found.lower <= found.upper
    assert found.upper <= np.sqrt(values[-1]) * 1.001
    h, step = 0.01, expm(0.01 * np.block([[a, b], [np.zeros((2, 6))]]))
    x, energy = np.zeros(4), 0.0
    for t in np.arange(3000):
        push = b.T @ expm(a.T * h * (2999.5 - t)) @ c.T @ vectors[:, -1]
        x, energy = step[:4, :4] @ x + step[:4, 4:] @ push, energy + h * push @ push
    assert np.linalg.norm(c @ x) / np.sqrt(energy) == pytest.approx(np.sqrt(values[-1]), rel=1e-3)


def test_a_loop_without_finite_peak_is_refused():
    a, b, c, _ = random_system(2)
    through = lpv.LPVStateSpace([a], [b], [c], [np.eye(2)], STILL, None)
    assert lpv.peak_gain(through).upper == np.inf
    unstable = lpv.LPVStateSpace([-a], [b], [c], [np.zeros((2, 2))], STILL, None)
    assert lpv.peak_gain(unstable).upper == np.inf


@pytest.mark.seconds
def test_optimum_for_one_output_is_the_linear_quadratic_one():
    """One z: the generalised H2 norm is the H2 norm; cost with a cross term, ν² = tr B1ᵀXB1 + tr KSKᵀR."""
    rng = np.random.default_rng(3)
    a, b, c2 = rng.normal(size=(3, 3)), rng.normal(size=(3, 1)), rng.normal(size=(1, 3))
    c1, r = rng.normal(size=(1, 3)), 0.5
    while np.linalg.eigvals(a - b @ c1 / r).real.max() < 0.3:  # else a control exists that leaves nothing of z
        c1 = rng.normal(size=(1, 3))
    plant = plant_of(a, np.hstack([np.eye(3), np.zeros((3, 1))]), b, c1, np.zeros((1, 4)), [[r]], c2, [[0, 0, 0, 1]])
    x = solve_continuous_are(a, b, c1.T @ c1, [[r * r]], s=r * c1.T)
    s = solve_continuous_are(a.T, c2.T, np.eye(3), [[1.0]])
    k = (b.T @ x + r * c1) / (r * r)
    optimum = np.sqrt(np.trace(x) + float((k @ s @ k.T).item()) * r * r)
    found = lpv.synthesize(plant, lpv.MultiObjective(lpv.GeneralizedH2(), back_off=1.002))
    assert found.figures[0]["criterion"] == "generalized H2"
    assert optimum * (1 - 1e-4) <= found.figures[0]["verified"] <= optimum * 1.01


@pytest.mark.seconds
def test_peak_of_two_outputs_costs_less_than_both_and_more_than_one():
    plant = spring_mass(lower=2.0, upper=2.0, full=False)
    peak = lpv.synthesize(plant, lpv.MultiObjective(lpv.GeneralizedH2())).figures[0]
    both = lpv.synthesize(plant, lpv.MultiObjective(lpv.H2())).figures[0]
    assert peak["verified"] < both["verified"] < np.sqrt(2) * peak["verified"] * 1.03


@pytest.mark.seconds
@pytest.mark.parametrize("moving", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_no_trajectory_exceeds_the_bound_in_discrete_time(moving):
    """|z(k)| over ‖w‖ along a given path is √λmax(CW(k)Cᵀ + DDᵀ) with W⁺ = AWAᵀ + BBᵀ."""
    plant = spring_mass(rate=0.3, full=False, sample_time=0.1)
    design = lpv.MultiObjective([lpv.GeneralizedH2(performance="z0"), lpv.H2()], points=3,
                                lyapunov=lpv.Polynomial("stiffness", 1) if moving else None)
    found = lpv.synthesize(plant, design)
    loop, (peak, rms) = found.closed_loop, found.figures
    assert found.solved and peak["between_grid"] and loop.order == 4
    rng, worst, power = np.random.default_rng(5), 0.0, 0.0
    for _ in range(3):
        w, p, turn = np.zeros((4, 4)), rng.uniform(1, 4), 0.03
        for _ in range(300):
            a, b, c, d = loop.frozen([p])
            seen = c @ w @ c.T + d @ d.T
            worst, power = max(worst, seen[0, 0]), max(power, np.trace(seen))
            w = a @ w @ a.T + b @ b.T
            turn = -turn if rng.random() < 0.02 else turn
            p = float(np.clip(p + turn, 1, 4))
    assert 0.8 * peak["verified"] < np.sqrt(worst) <= peak["verified"]
    assert np.sqrt(power) <= rms["verified"]


def test_design_file_names_it(tmp_path):
    from lpvid.synthesis.design_file import design_of

    plant = spring_mass(rate=0.1, full=False)
    design = design_of({"design": "multi-objective", "lyapunov_degree": 1, "varying": "measurements",
                        "criteria": [{"kind": "generalized-h2", "performance": ["z0"], "bound": 1.0}]}, plant)
    assert isinstance(design, lpv.MultiObjective) and design.varying == "measurements"
    assert design.criteria == (lpv.GeneralizedH2(performance="z0", bound=1.0),)
