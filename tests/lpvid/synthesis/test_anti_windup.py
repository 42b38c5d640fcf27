"""Anti-windup: bounds against simulation of the limited loop, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.shaped_plants import STILL, plant_of

import lpvid as lpv
from lpvid.synthesis.anti_windup import anti_windup, back_calculation
from lpvid.synthesis.saturated import saturate

LIMIT = {"u0": 1.0}


def tracking(pole: float, sample_time: float | None = None):
    """ẋ = pole·x + u, w0 = reference, y = reference − x, z = x − reference."""
    a, b = (pole, 1.0) if sample_time is None else (1 + sample_time * pole, sample_time)
    return plant_of([[a]], [[0.0]], [[b]], [[1.0]], [[-1.0]], [[0.0]], [[-1.0]], [[1.0]], sample_time)


def controller(sample_time: float | None = None):
    """Proportional and (leaky) integral action."""
    a, b = (-1e-3, 1.0) if sample_time is None else (1 - 1e-3 * sample_time, sample_time)
    return lpv.LPVStateSpace([[[a]]], [[[b]]], [[[1.0]]], [[[2.0]]], STILL, sample_time, inputs=("y0",),
                             outputs=("u0",))


def run(law, pole: float, reference: np.ndarray, dt: float) -> np.ndarray:
    """x − reference along a run of the limited loop, by small steps of an exact hold."""
    loop, x, out = law.start(dt), 0.0, []
    for r in reference:
        out.append(x - r)
        u = float(loop.advance(np.array([r - x]))[0])
        x = np.exp(pole * dt) * x + (np.expm1(pole * dt) / pole) * u
    return np.array(out)


@pytest.mark.parametrize("size", [0.2, 3.0, 30.0])
def test_global_bound_holds_for_references_of_any_size(size):
    found = anti_windup(tracking(-0.5), controller(), LIMIT)
    assert found.verdict == "solved" and found.between_grid
    dt, rng = 0.01, np.random.default_rng(1)
    reference = size * np.repeat(rng.choice([-1.0, 0.0, 1.0], 40), 100) * (np.arange(4000) < 3000)
    error = run(found.saturated, -0.5, reference, dt)
    assert np.linalg.norm(error) <= found.gamma * np.linalg.norm(reference) * 1.001


def test_local_bound_holds_within_its_energy_and_is_smaller():
    everywhere = anti_windup(tracking(-0.5), controller(), LIMIT)
    near = anti_windup(tracking(-0.5), controller(), LIMIT, energy=0.5)
    assert near.gamma <= everywhere.gamma
    dt = 0.01
    reference = np.where(np.arange(3000) * dt < 2.0, 0.5, 0.0)  # ∫ w² = 0.5
    error = run(near.saturated, -0.5, reference, dt)
    assert np.linalg.norm(error) <= near.gamma * np.linalg.norm(reference) * 1.001


def test_an_unstable_plant_has_a_local_bound_only():
    none = anti_windup(tracking(0.5), controller(), LIMIT)
    assert none.verdict == "infeasible" and none.saturated is None and "energy" in none.mend
    near = anti_windup(tracking(0.5), controller(), LIMIT, energy=0.05)
    assert near.verdict == "solved" and near.energy == 0.05


def test_discrete_design_bounds_the_discrete_run():
    dt = 0.1
    found = anti_windup(tracking(-0.5, dt), controller(dt), LIMIT)
    assert found.verdict == "solved"
    loop, x, error, size = found.saturated.start(), 0.0, 0.0, 0.0
    for k in range(600):
        r = 5.0 if k < 200 else 0.0
        error, size = error + (x - r) ** 2, size + r**2
        x = (1 - 0.5 * dt) * x + dt * float(loop.advance(np.array([r - x]))[0])
    assert np.sqrt(error) <= found.gamma * np.sqrt(size)


def test_both_gains_shorten_the_overshoot_of_a_wound_up_integrator():
    dt, pole = 0.01, -0.05
    reference = np.full(4000, 4.0)
    plain = run(saturate(controller(), LIMIT), pole, reference, dt)
    classical = run(back_calculation(controller(), LIMIT, 0.5), pole, reference, dt)
    designed = run(anti_windup(tracking(pole), controller(), LIMIT).saturated, pole, reference, dt)
    assert classical.max() < 0.5 * plain.max()
    assert designed.max() < 0.5 * plain.max()


def test_without_saturation_the_gain_does_nothing():
    dt, reference = 0.01, np.full(500, 0.01)
    plain, classical = (run(law, -0.5, reference, dt) for law in (
        saturate(controller(), LIMIT), back_calculation(controller(), LIMIT, 0.5)))
    np.testing.assert_allclose(plain, classical, atol=1e-15)


def test_faults_are_named():
    with pytest.raises(lpv.InputError, match="no control 'force'"):
        saturate(controller(), {"force": 1.0})
    with pytest.raises(lpv.InputError, match="leave nothing between them"):
        saturate(controller(), {"u0": (1.0, -1.0)})
    with pytest.raises(lpv.InputError, match="the time between its samples"):
        saturate(controller(), LIMIT).start()
    with pytest.raises(lpv.InputError, match="runs at its own period"):
        saturate(controller(0.1), LIMIT).start(0.2)
    box = lpv.Scheduling(("p",), (0.0,), (1.0,))
    moving = lpv.LPVStateSpace([[[0.5]], [[0.1]]], np.ones((2, 1, 1)), np.ones((2, 1, 1)), np.zeros((2, 1, 1)),
                               lpv.Polynomial("p", 1), 0.1, box, inputs=("y0",), outputs=("u0",))
    with pytest.raises(lpv.InputError, match="p = 2 outside"):
        saturate(moving, LIMIT).start().advance(np.zeros(1), np.array([2.0]))
