"""Heat balance and fading against closed forms and a dense solver."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, composed, road_like, speed_itself
from scipy.integrate import solve_ivp

from lpvid.baselines.signals import Signals
from quartercar.effects import thermal
from quartercar.effects.between_samples import between
from quartercar.effects.thermal import ThermalFade, ViscousFade, stored_heat

DAMPING = 2000.0


def viscous(s: Signals) -> np.ndarray:
    return DAMPING * s["velocity"]


def constant(speed: float, n: int = 20 * 512) -> Signals:
    """Constant power: the sign of the speed changes, its size does not."""
    v = speed * np.sign(np.sin(2 * np.pi * 1.0 * PERIOD * (np.arange(n) + 0.5)))
    return Signals(PERIOD, {"velocity": v}, np.zeros(n))


def test_heat_under_constant_power_approaches_power_times_cooling_time() -> None:
    s, cooling = constant(0.2), 6.0
    heat = stored_heat(s, viscous(s) * s["velocity"], cooling)
    np.testing.assert_allclose(heat, DAMPING * 0.04 * cooling * (1 - np.exp(-s.times / cooling)), rtol=1e-10)


@pytest.mark.seconds
def test_heat_along_a_road_against_a_dense_solver() -> None:
    s, cooling = road_like(5, 2048), 3.0
    power = np.maximum(viscous(s) * s["velocity"], 0.0)
    exact = solve_ivp(lambda t, e: np.interp(t, s.times, power) - e / cooling, (0, s.times[-1]), [0.0],
                      t_eval=s.times, rtol=1e-8, atol=1e-8, max_step=PERIOD).y[0]
    assert np.abs(stored_heat(s, power, cooling) - exact).max() < 3e-3 * exact.max()


def test_heat_is_what_was_taken_up_where_nothing_cools() -> None:
    s = road_like(6)
    power = viscous(s) * s["velocity"]
    heat = stored_heat(s, power, 1e9)
    assert heat[-1] == pytest.approx(np.sum(power[:-1]) * PERIOD, rel=1e-6)
    assert np.all(np.diff(heat) >= -1e-9) and np.all(stored_heat(s, -power, 10.0) == 0.0)


def test_the_whole_force_fades() -> None:
    s, a, cooling = constant(0.2), 2e-4, 8.0
    force = composed(ThermalFade(), [a, cooling], s, viscous)
    power = DAMPING * 0.04
    pace = 1 / cooling + a * power  # the force that has faded heats less
    heat = power / pace * (1 - np.exp(-s.times * pace))
    np.testing.assert_allclose(force, viscous(s) * (1 - a * heat), rtol=1e-4)


def test_a_gas_does_not_fade() -> None:
    """800 N + 5 kN/m x beside a flow that yields and makes more force in one direction: only the flow's share fades."""
    s, a, cooling = road_like(4), 1e-3, 20.0

    def gas(signals: Signals) -> np.ndarray:
        return 800.0 + 5000.0 * signals["displacement"]

    def flow(signals: Signals) -> np.ndarray:
        v = signals["velocity"]
        return np.where(v > 0, 250.0, 150.0) * np.tanh(v / 0.01) + np.where(v > 0, 1800.0, 1200.0) * v

    def whole(signals: Signals) -> np.ndarray:
        return gas(signals) + flow(signals)

    faded = composed(ThermalFade(), [a, cooling], s, whole)
    share = (faded - gas(s)) / flow(s)
    moving = np.abs(s["velocity"]) > 0.02
    assert share[moving].min() < 0.95
    heat = stored_heat(s, faded * s["velocity"], cooling)
    np.testing.assert_allclose(share[moving], 1 - a * heat[moving], rtol=1e-3)


def test_the_viscous_share_fades_with_the_viscosity() -> None:
    """A law that is all viscous, c exp(−bE) v, by scipy along constant power."""
    s, b, cooling = constant(0.2), 1e-3, 8.0
    force = composed(ViscousFade(), [b, cooling], s, viscous)
    heat = solve_ivp(lambda t, e: DAMPING * 0.04 * np.exp(-b * e) - e / cooling, (0, s.times[-1]), [0.0],
                     t_eval=s.times, rtol=1e-9, atol=1e-9).y[0]
    assert heat[-1] * b > 0.3, "well beyond first order"
    np.testing.assert_allclose(force, viscous(s) * np.exp(-b * heat), rtol=5e-3)


def test_the_two_fades_differ_on_a_law_that_is_not_viscous() -> None:
    s = road_like(7)

    def partly_dry(signals: Signals) -> np.ndarray:
        return 500 * np.tanh(signals["velocity"] / 0.02) + 300 * signals["velocity"]

    cold = partly_dry(s)
    total = composed(ThermalFade(), [1e-4, 50.0], s, partly_dry) - cold
    share = composed(ViscousFade(), [1e-3, 50.0], s, partly_dry) - cold
    assert np.linalg.norm(share) > 1.0
    assert abs(total @ share) < 0.97 * np.linalg.norm(total) * np.linalg.norm(share)


def test_a_long_fade_never_turns_the_force_round() -> None:
    s = constant(0.5)
    force = composed(ThermalFade(), [2e-3, 1e4], s, viscous)
    assert np.all(force * s["velocity"] > 0)


def test_no_motion_no_heat() -> None:
    still = Signals(PERIOD, {"velocity": np.zeros(100)}, np.zeros(100))
    np.testing.assert_array_equal(composed(ThermalFade(), [1e-3, 20.0], still, speed_itself), np.zeros(100))


def test_a_law_that_is_only_asked_fades_between_samples_by_the_heat_of_its_record() -> None:
    """A faster clock over signals that stand for a record: their heat is the record's, at the faster samples."""
    s = road_like(4, 1024)
    asked = s.evaluated(velocity=1.1 * s["velocity"])
    fine = between(asked, 4)
    assert fine.n_samples == 4 * s.n_samples
    np.testing.assert_allclose(fine.of_record(s.times), np.minimum(fine.times, s.times[-1]), atol=1e-12)
    faded = composed(ThermalFade(), [1e-3, 20.0], fine, viscous)
    np.testing.assert_allclose(faded[::4], composed(ThermalFade(), [1e-3, 20.0], asked, viscous), rtol=1e-6, atol=1e-6)


def test_a_fade_beyond_all_force_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """A trial of a descent may be far too large: heat and force agree after as many sweeps as there are samples."""
    s, sweeps = constant(0.2), []
    monkeypatch.setattr(thermal, "stored_heat", lambda *a: sweeps.append(a) or stored_heat(*a))
    force = composed(ThermalFade(), [10.0, 100.0], s, viscous)
    assert len(sweeps) <= thermal.SWEEPS and np.all(np.isfinite(force))


def test_heat_and_force_agree() -> None:
    """A damper that falls to a fifth of its force: one more sweep changes nothing."""
    s, a, cooling = constant(0.2), 1e-3, 1e9
    force = composed(ThermalFade(), [a, cooling], s, viscous)
    heat = stored_heat(s, force * s["velocity"], cooling)
    assert abs(force[-1] / viscous(s)[-1]) < 0.3
    np.testing.assert_allclose(viscous(s) * (1 - a * heat), force, atol=1e-6 * np.abs(viscous(s)).max())
