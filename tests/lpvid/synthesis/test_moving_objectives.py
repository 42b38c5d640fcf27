"""Several criteria with a Lyapunov matrix that moves: never worse than a constant one, true along trajectories."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.shaped_plants import simulated_gain, spring_mass

import lpvid as lpv

MOVING = lpv.Polynomial("stiffness", 1)


@pytest.mark.slow
@pytest.mark.parametrize("varying", ["controls", "measurements"])
def test_a_moving_matrix_lowers_the_gain_under_a_bounded_variance(varying):
    plant = spring_mass(rate=0.05, full=False)
    criteria = [lpv.HInfinity(), lpv.H2("w0", ["z0", "z1"], bound=0.7)]
    still = lpv.synthesize(plant, lpv.MultiObjective(criteria))
    found = lpv.synthesize(plant, lpv.MultiObjective(criteria, lyapunov=MOVING, varying=varying, points=4))
    assert found.solved and found.figures[1]["verified"] <= 0.7
    assert found.gamma_verified < still.gamma_verified
    assert lpv.verify(found.certificate, found.closed_loop).holds
    assert {"stiffness"} == set(found.controller.box.names)  # no rate to be measured
    rng = np.random.default_rng(2)
    assert all(simulated_gain(found.closed_loop, rng) <= found.gamma_verified for _ in range(3))


def test_one_gain_agrees_with_output_feedback():
    """The change of variables and the projected inequalities admit the same gain where X alone moves."""
    plant = spring_mass(rate=0.1, full=False)
    one = lpv.synthesize(plant, lpv.OutputFeedback(MOVING, varying="controls", points=5))
    other = lpv.synthesize(plant, lpv.MultiObjective(lpv.HInfinity(), lyapunov=MOVING, points=5, back_off=1.01))
    assert other.gamma_verified == pytest.approx(one.gamma_verified, rel=0.03)


@pytest.mark.slow
def test_variance_along_trajectories_in_continuous_time():
    plant = spring_mass(rate=0.2, full=False)
    found = lpv.synthesize(plant, lpv.MultiObjective(lpv.H2(), lyapunov=MOVING, varying="measurements", points=4))
    loop, figure = found.closed_loop, found.figures[0]
    rng, most, h = np.random.default_rng(4), 0.0, 0.02
    for _ in range(3):
        p, w, turn = rng.uniform(1, 4), np.zeros((4, 4)), 0.2 * h
        for _ in range(1500):
            a, b, c, _ = loop.frozen([p])
            most = max(most, float(np.trace(c @ w @ c.T)))
            ahead = np.linalg.solve(np.eye(4) - h / 2 * a, np.eye(4) + h / 2 * a)
            w = ahead @ (w + h / 2 * b @ b.T) @ ahead.T + h / 2 * b @ b.T
            turn = -turn if rng.random() < 0.005 or not 1 <= p + turn <= 4 else turn
            p += turn
    assert 0.9 * figure["verified"] < np.sqrt(most) <= figure["verified"] * 1.001


def test_regions_and_moving_matrices_exclude_each_other():
    with pytest.raises(lpv.InputError, match="constant Lyapunov"):
        lpv.MultiObjective(lpv.H2(), lpv.HalfPlane(0.1), lyapunov=MOVING)


def test_a_variance_in_discrete_time_needs_the_controls_to_move():
    with pytest.raises(lpv.InputError, match="controls"):
        lpv.synthesize(spring_mass(rate=0.1, full=False, sample_time=0.1),
                       lpv.MultiObjective(lpv.H2(), lyapunov=MOVING, varying="measurements"))


@pytest.mark.parametrize(("sample_time", "needed"), [(0.1, "p(k+1)"), (None, "rates")])
def test_both_is_either_and_says_why(monkeypatch, sample_time, needed):
    """With X and Y moving at once the controller would need what nobody has at that time."""
    from lpvid.synthesis import multiobjective

    turned = []

    def design(*_, **settings):
        turned.append(settings["turned"])
        return lpv.Synthesis("numerical", why="not looked for", mend="none")

    for name in ("moving_feedback", "moving_objectives"):
        monkeypatch.setattr(multiobjective, name, design)
    found = lpv.synthesize(spring_mass(rate=0.1, full=False, sample_time=sample_time),
                           lpv.MultiObjective(lpv.HInfinity(), lyapunov=MOVING, varying="both", points=2))
    assert turned == [False, True] and needed in found.notes[-1] and found.solved
