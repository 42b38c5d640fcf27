"""Each law against what its formula says, and laws side by side; the contract of all: tests/contracts."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.law_signals import HIGH, LOW, SETTING, force, seen
from scipy.linalg import solve_continuous_lyapunov

from lpvid import load, save
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling
from quartercar import controllers as laws
from quartercar.controllers.contract import SIGNALS, Controller, Setting, start_together
from quartercar.controllers.laws.clipped_optimal import STATES, optimal_gain
from quartercar.parameters import MEGANE, SAVARESI
from quartercar.vehicle.linear import LinearCar


def test_different_laws_side_by_side():
    pair = [laws.Skyhook(), laws.AccelerationDriven()]
    s = seen(2)
    both = start_together(pair, Setting(0.002, 2, MEGANE)).step(s)
    for c, law in enumerate(pair):
        assert both[c] == law.start(Setting(0.002, 1, MEGANE)).step({n: a[c:c + 1] for n, a in s.items()})[0]
    with pytest.raises(InputError, match="demand the same thing"):
        start_together([laws.Skyhook(), laws.Passive()], Setting(0.002, 2, MEGANE))
    with pytest.raises(InputError, match="every car needs one controller"):
        start_together(pair, Setting(0.002, 3, MEGANE))


@pytest.mark.parametrize(("values", "message"), [({"fixed_currant": 1.0}, "fixed_current"),
                                                 ({"fixed_current": 9.0}, "physical bounds"),
                                                 ({"fixed_current": "a lot"}, "number")])
def test_values_are_checked(values, message: str):
    with pytest.raises(InputError, match=message):
        laws.Passive(values=values)


def test_nearest_name_is_offered():
    with pytest.raises(InputError, match="skyhook"):
        laws.law_class("skyhok")


# -- the formulas of equation sheet 4.8 --------------------------------------------------------------------------------
def by_sign(law: Controller, **signals: float) -> float:
    """Damping that a law asks for, by its force."""
    s = {n: np.zeros(1) for n in SIGNALS} | {n: np.array([v]) for n, v in signals.items()}
    return float(force(law.with_values(low_damping=LOW, high_damping=HIGH), s)[0] / signals["suspension_velocity"])


@pytest.mark.parametrize("v", [0.2, -0.2])
@pytest.mark.parametrize("x", [0.1, -0.1])
def test_two_state_laws(v: float, x: float):
    assert by_sign(laws.Skyhook(), suspension_velocity=v, body_velocity=x) == pytest.approx(HIGH if x * v > 0 else LOW)
    assert by_sign(laws.Groundhook(), suspension_velocity=v, wheel_velocity=x) == pytest.approx(
        HIGH if -x * v > 0 else LOW)
    assert by_sign(laws.AccelerationDriven(), suspension_velocity=v, body_acceleration=x) == pytest.approx(
        HIGH if x * v > 0 else LOW)


@pytest.mark.parametrize("acceleration", [0.5, 2.0])
@pytest.mark.parametrize("velocity", [0.1, -0.1])
def test_mixed_laws_switch_at_the_crossover(acceleration: float, velocity: float):
    alpha, v = 10.0, 0.3
    law = laws.SkyhookAccelerationDriven(values={"crossover": alpha})
    slow = acceleration**2 - alpha**2 * velocity**2 <= 0
    wanted = HIGH if (slow and velocity * v > 0) or (not slow and acceleration * v > 0) else LOW
    assert by_sign(law, suspension_velocity=v, body_velocity=velocity, body_acceleration=acceleration) == wanted
    one = laws.SkyhookAccelerationDrivenOneSensor(values={"crossover": alpha})
    wanted = HIGH if acceleration**2 - alpha**2 * v**2 <= 0 else LOW
    assert by_sign(one, suspension_velocity=v, body_acceleration=acceleration) == wanted


def test_the_deadband_keeps_the_last_decision():
    law = laws.Skyhook(values={"low_damping": LOW, "high_damping": HIGH}).start(Setting(0.002, 1, MEGANE))

    def step(v: float) -> float:
        return float(law.step({"suspension_velocity": np.array([v]), "body_velocity": np.array([0.1])})[0] / v)

    assert [step(v) for v in (0.1, -0.004, -0.1, 0.004)] == pytest.approx([HIGH, HIGH, LOW, LOW])


def test_linear_skyhook_is_the_ideal_one_where_it_can_be_had():
    law = laws.LinearSkyhook(values={"low_damping": 0.0, "high_damping": 2000.0, "passive_share": 0.0})
    s = seen(200, seed=4)
    f, ideal, v = force(law, s), 2000.0 * s["body_velocity"], s["suspension_velocity"]
    free = (ideal * v > 0) & (np.abs(ideal) < 2000.0 * np.abs(v))
    np.testing.assert_allclose(f[free], ideal[free])
    np.testing.assert_allclose(f[ideal * v < 0], 0.0)
    passive = force(law.with_values(passive_share=1.0), s)
    np.testing.assert_allclose(passive, 2000.0 * v)


def test_hybrid_is_between_skyhook_and_groundhook():
    sky = laws.Hybrid(values={"low_damping": 0.0, "high_damping": 15000.0, "sky_damping": 1500.0, "sky_share": 1.0})
    s = seen(100, seed=5)
    np.testing.assert_allclose(force(sky, s), force(laws.Hybrid(values={**sky.values, "ground_damping": 9e3}), s))
    ground = sky.with_values(sky_share=0.0, ground_damping=900.0)
    f, free = force(ground, s), -900.0 * s["wheel_velocity"]
    inside = (free * s["suspension_velocity"] > 0) & (np.abs(free) < 15000 * np.abs(s["suspension_velocity"]))
    np.testing.assert_allclose(f[inside], free[inside])


def test_power_driven_takes_all_of_the_spring_where_it_can():
    law = laws.PowerDriven(values={"low_damping": LOW, "high_damping": HIGH})
    s = seen(500, seed=6)
    z, v, k = s["suspension_deflection"], s["suspension_velocity"], MEGANE.spring_stiffness
    f = force(law, s)
    np.testing.assert_allclose(f[k * z * v + LOW * v**2 >= 0], (LOW * v)[k * z * v + LOW * v**2 >= 0])
    np.testing.assert_allclose(f[k * z * v + HIGH * v**2 < 0], (HIGH * v)[k * z * v + HIGH * v**2 < 0])
    rest = (k * z * v + LOW * v**2 < 0) & (k * z * v + HIGH * v**2 >= 0)
    assert rest.sum() > 50
    np.testing.assert_allclose((k * z + f)[rest], 0.0, atol=1e-9)  # no force on the body, hence no power


# -- clipped optimal ---------------------------------------------------------------------------------------------------
def mean_cost(gain: np.ndarray, tyre: float, stroke: float) -> float:
    """E[z̈_s² + q_t (k_t z_t/m_s)² + q_d (k_s z_d/m_s)²] of the active car by Lyapunov, for white road velocity."""
    car = LinearCar(MEGANE.replace(damping=0.0)).relative()
    a = car.A - np.outer(car.B[:, 1], gain)
    if np.linalg.eigvals(a).real.max() >= 0:
        return np.inf
    p = solve_continuous_lyapunov(a, -np.outer(car.B[:, 0], car.B[:, 0]))
    rows = [car.C[0] - car.D[0, 1] * gain, np.sqrt(tyre) * car.C[3] / MEGANE.sprung_mass,
            np.sqrt(stroke) * MEGANE.spring_stiffness / MEGANE.sprung_mass * car.C[1]]
    return float(sum(r @ p @ r for r in rows))


@pytest.mark.parametrize(("tyre", "stroke"), [(0.1, 0.05), (1.0, 0.2), (0.01, 1.0)])
def test_optimal_gain_is_optimal(tyre: float, stroke: float, rng):
    gain = np.array(optimal_gain(MEGANE, tyre, stroke))
    best = mean_cost(gain, tyre, stroke)
    for _ in range(60):
        other = mean_cost(gain * (1 + 0.05 * rng.standard_normal(4)), tyre, stroke)
        assert other >= best * (1 - 1e-9)


def test_clipped_optimal_follows_its_gain_where_it_can():
    law = laws.ClippedOptimal(values={"low_damping": 0.0, "high_damping": 15000.0})
    s = seen(300, seed=8)
    wanted = -np.array([s[n] for n in STATES]).T @ optimal_gain(MEGANE, law.values["tyre_weight"],
                                                               law.values["stroke_weight"])
    v = s["suspension_velocity"]
    inside = (wanted * v > 0) & (np.abs(wanted) < 15000 * np.abs(v))
    assert inside.sum() > 50
    np.testing.assert_allclose(force(law, s)[inside], wanted[inside])


def test_the_designers_car_is_the_one_in_the_setting():
    s = seen(50)
    law = laws.ClippedOptimal()
    one, other = (law.start(Setting(0.002, 50, car)).step(s) for car in (SAVARESI, MEGANE))
    assert not np.allclose(one, other)


# -- scheduled controllers ---------------------------------------------------------------------------------------------
def scheduled(**changes) -> laws.ScheduledController:
    """x⁺ = (0.5 + 0.2ρ) x + y1 − y2, F = ρ x + 2 y1, ρ in [0, 1]."""
    model = LPVStateSpace([[[0.5]], [[0.2]]], [[[1.0, -1.0]], [[0.0, 0.0]]], [[[0.0]], [[1.0]]],
                          [[[2.0, 0.0]], [[0.0, 0.0]]], Polynomial("rho", degree=1), 0.002,
                          Scheduling(("rho",), (0.0,), (1.0,)),
                          inputs=(Signal("suspension_deflection", "m"), Signal("body_acceleration", "m/s^2")),
                          outputs=(Signal("damper_force", "N"),))
    return laws.ScheduledController(**{"model": model, "schedule": (laws.Measured("current"),), **changes})


def test_a_scheduled_controller_is_its_recursion_and_counts_what_it_clamps():
    law = scheduled(around=5.0, nominal_damping=100.0, anti_windup=np.array([0.3]))
    running = law.start(SETTING)
    x, beyond = np.zeros(7), np.zeros(7)
    for k in range(30):
        s = seen(seed=k)
        rho = np.clip(s["current"], 0, 1)
        beyond += (s["current"] < 0) | (s["current"] > 1)
        wanted = 5.0 + rho * x + 2 * s["suspension_deflection"] + 100 * s["suspension_velocity"]
        np.testing.assert_allclose(running.step(s), wanted, atol=1e-12)
        x = ((0.5 + 0.2 * rho) * x + s["suspension_deflection"] - s["body_acceleration"]
             + 0.3 * (s["attained"] - s["demanded"]))
    np.testing.assert_array_equal(running.counted()["scheduling_outside"], beyond)
    assert beyond.sum() > 0


def test_a_scheduled_controller_comes_back_from_a_file(tmp_path):
    law = scheduled(schedule=(laws.SaturationRatio(lowest=0.1),), anti_windup=np.array([0.3]), label="mine")
    back = load(save(law, tmp_path / "law.json"))
    a, b = (one.start(SETTING) for one in (law, back))
    for k in range(5):
        np.testing.assert_array_equal(a.step(seen(seed=k)), b.step(seen(seed=k)))
    assert back.label == "mine" and back.schedule == law.schedule


@pytest.mark.parametrize(("changes", "message"), [
    ({"schedule": ()}, "one rule"), ({"asks": "velocity"}, "asks"),
    ({"asks": "current", "nominal_damping": 1.0}, "force"),
    ({"anti_windup": np.zeros(3)}, "anti_windup")])
def test_what_makes_no_scheduled_controller(changes, message: str):
    with pytest.raises(InputError, match=message):
        scheduled(**changes)


def test_a_scheduled_controller_of_another_kind_is_refused():
    model = scheduled().model
    with pytest.raises(InputError, match="discrete"):
        scheduled(model=model.replace(sample_time=None))
    with pytest.raises(InputError, match="signal of a law"):
        scheduled(model=model.replace(inputs=(Signal("stroke"), Signal("body_acceleration"))))
    with pytest.raises(InputError, match="another rate"):
        scheduled().start(Setting(0.001, 7, MEGANE))


def test_schedule_rules():
    s = {n: np.zeros(3) for n in SIGNALS} | {
        "demanded": np.array([500.0, -500.0, 0.0]), "attained": np.array([250.0, 100.0, 3.0]),
        "suspension_velocity": np.array([0.0, 0.1, -0.2]), "suspension_deflection": np.array([0.0, 0.01, 0.0])}
    setting = Setting(0.002, 3, MEGANE)
    np.testing.assert_allclose(laws.SaturationRatio(lowest=0.1).start(setting)(s), [0.5, 0.1, 1.0])
    xi = 13.76 * s["suspension_velocity"] + 10.54 * s["suspension_deflection"]
    np.testing.assert_allclose(laws.Yield(13.76, 10.54).start(setting)(s), np.tanh(xi))
    np.testing.assert_allclose(laws.Yield(13.76, 10.54, ratio=True).start(setting)(s),
                               [1.0, *(np.tanh(xi[1:]) / xi[1:])])
    gap = np.abs(s["demanded"] - s["attained"]) / 400.0
    excess = laws.Excess(400.0, 50.0, 10.0).start(setting)(s)
    np.testing.assert_allclose(excess, 10 * 50 * gap**4 / (50 * gap**4 + 0.02))
    with pytest.raises(InputError, match="signal of a law"):
        laws.Measured("speed")
