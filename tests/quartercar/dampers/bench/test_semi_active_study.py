"""The virtual study of source 002: its waves, and its explicit step where that is stable."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lpvid import InputError
from quartercar.dampers.bench.semi_active_study import fixed_steps, measured, paper_plan, runge_kutta, virtual_device
from quartercar.dampers.fitting.stepwise import sort_records
from quartercar.dampers.laws.extended_bouc_wen import DIRECTIONS, ExtendedBoucWen


def blunt() -> ExtendedBoucWen:
    return ExtendedBoucWen(values={f"sharpness_{d}": 2e3 for d in DIRECTIONS})


@pytest.mark.parametrize("wave", ["sine", "saw"])
def test_velocity_is_the_derivative_of_displacement(wave: str) -> None:
    record = measured(blunt(), wave, 0.0, wave, 0.025, 0.15, 2.0, np.random.default_rng(0))
    x, v = record["displacement"], record["velocity"]
    steady = np.abs(np.diff(v)) < 0.01
    middle = 0.5 * (v[1:] + v[:-1])
    assert np.allclose((np.diff(x) / 1e-3)[steady], middle[steady], atol=1e-5)
    assert np.abs(x).max() == pytest.approx(0.025, rel=1e-2) and np.abs(v).max() == pytest.approx(0.15)
    with pytest.raises(InputError, match="wave"):
        measured(blunt(), "x", 0.0, "square", 0.025, 0.15, 2.0, np.random.default_rng(0))


def test_the_papers_plan_holds_every_kind_of_record() -> None:
    device, nodes = virtual_device(), (0.1, 0.3, 0.5)
    records = paper_plan(device, nodes, np.random.default_rng(0))
    model = device.replace(nodes=nodes, values={})
    kinds = sort_records(model, [model.drive(r, force=True) for r in records])
    assert (kinds.slow, kinds.constant, kinds.switching) == ((0,), {0: (1,), 1: (2,), 2: (3,)}, (4,))


@pytest.mark.seconds
def test_the_explicit_step_converges_to_a_tight_integration_where_it_is_stable() -> None:
    damper = blunt()
    record = measured(damper, "sine", 0.0, "sine", 0.02, 0.1, 1.0, np.random.default_rng(0))
    p, w = damper.values, 5.0

    def rates(t: float, s: np.ndarray) -> np.ndarray:
        x, v = 0.02 * np.sin(w * t), 0.1 * np.cos(w * t)
        share = 0.5 + 0.5 * np.tanh(v / damper.switch_speed)
        c0, k0, c1, alpha, delta, gamma = (
            share * p[f"{n}_rebound"] + (1 - share) * p[f"{n}_compression"]
            for n in ("damping", "stiffness", "roll_off_damping", "yield_force", "sharpness", "unloading"))
        rate = (alpha * s[1] + c0 * v + k0 * (x - s[0])) / (c0 + c1)
        slip, z = v - rate, s[1]
        return np.array([rate, delta * (slip - gamma * abs(slip) * z * abs(z) - (1 - gamma) * slip * z * z)])

    start = damper.rest(0.0, 0.1, 0.0, None, damper.vector)[1:]
    run = solve_ivp(rates, (0, record.times[-1]), start, "Radau", record.times, rtol=1e-10, atol=1e-12)
    c1 = p["roll_off_damping_rebound"]  # both directions alike in c_1
    exact = c1 * np.array([rates(t, s)[0] for t, s in zip(run.t, run.y.T, strict=True)])
    exact += damper.conservative_force(record["displacement"])
    assert np.abs(runge_kutta(damper, record) - exact).max() < 1e-3 * exact.std()
    _, stepped, explicit = fixed_steps(damper, record)
    assert stepped < 1e-8 and explicit < 1e-6


def test_the_virtual_device_is_too_sharp_for_the_explicit_step() -> None:
    device = virtual_device()
    record = measured(device, "fast", 0.5, "sine", 0.025, 0.126, 0.6, np.random.default_rng(0))
    run, stepped, explicit = fixed_steps(device, record)
    assert stepped < 1e-8 and explicit == np.inf
    assert np.isnan(run["runge-kutta"]).any() and np.isfinite(run["stepped"]).all()
