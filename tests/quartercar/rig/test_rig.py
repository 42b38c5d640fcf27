"""The virtual rig against closed forms, a stiff ODE solver and its own contract over all causes."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from lpvid.errors import InputError
from quartercar.rig import CAUSES, EXPERIMENTS, Experiment, Motion, Rig, RigDamper, Sensors, effect, respond
from quartercar.rig.damper import low_passed
from quartercar.rig.patterns import Constant, Creep, Road, Sine, Triangle
from quartercar.rig.setup import MeasurementChain, Setup

FINE = 8192.0
NAMES = [cause.name for cause in CAUSES]


def sine_motion(amplitude, frequency, cycles, current=0.0, rate=FINE):
    t = np.arange(round(cycles * rate / frequency) + 1) / rate
    w = 2 * np.pi * frequency
    return Motion(amplitude * np.sin(w * t), amplitude * w * np.cos(w * t),
                  np.full(t.size, float(current)), rate)


def run(damper, motion, *effects):
    setup = Setup(damper.physics(), MeasurementChain())
    for item in effects:
        setup = item.apply(setup)
    return respond(Setup(setup.physics, setup.chain), motion)


def last_cycle(motion, force, frequency):
    """Work [J] of the last cycle and force where the displacement peaks in it."""
    n = round(motion.rate / frequency)
    x, f = motion.displacement[-n - 1 :], force[-n - 1 :]
    work = np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(x))
    return work, f[np.argmax(x)]


def yielding(stiffness, force=1000.0):
    """Yield in series with a spring and nothing else: a Jenkins element."""
    return RigDamper(viscous=0.0, viscous_per_current=0.0, yield_base=force, yield_per_current=0.0, yield_speed=1e-5,
                     asymmetry=1.0, series_stiffness=stiffness, gas_preload=0.0, gas_stiffness=0.0, friction=0.0)


def force_at(speed, *effects, current=0.0, damper=None):
    """Steady force at constant speed, at x = 0."""
    t = np.arange(-1200, 1) / FINE
    motion = Motion(speed * t, np.full(t.size, speed), np.full(t.size, current), FINE)
    return run(damper or RigDamper.static(), motion, *effects).force[-1]


# -- closed forms -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("c", "k", "frequency"), [(1500.0, 1e5, 4.0), (3000.0, 5e5, 16.0), (800.0, 2e4, 8.0)])
def test_maxwell_element(c, k, frequency):
    amplitude, w = 0.01, 2 * np.pi * frequency
    tau = c / k
    motion = sine_motion(amplitude, frequency, 12)
    work, peak = last_cycle(motion, run(RigDamper.viscous_only(c, k), motion).force, frequency)
    assert work == pytest.approx(np.pi * c * w * amplitude**2 / (1 + (w * tau) ** 2), rel=1e-3)
    assert peak == pytest.approx(c * w**2 * amplitude * tau / (1 + (w * tau) ** 2), rel=1e-3)


@pytest.mark.parametrize("stiffness", [2e5, 1e6, 5e6])
def test_jenkins_element(stiffness):
    amplitude, yield_force = 0.008, 1000.0
    motion = sine_motion(amplitude, 4.0, 3)
    work, peak = last_cycle(motion, run(yielding(stiffness), motion).force, 4.0)
    assert work == pytest.approx(4 * yield_force * (amplitude - yield_force / stiffness), rel=1e-3)
    assert peak == pytest.approx(yield_force, rel=1e-3)


def test_jenkins_element_stays_elastic_below_its_yield():
    motion = sine_motion(0.0009, 4.0, 3)
    force = run(yielding(1e6), motion).force
    np.testing.assert_allclose(force, 1e6 * motion.displacement, atol=5.0)


def test_rigid_viscous_damper_is_exact():
    motion = sine_motion(0.01, 5.0, 2)
    force = run(RigDamper.viscous_only(1500.0), motion).force
    np.testing.assert_allclose(force, 1500.0 * motion.velocity, rtol=1e-10, atol=1e-9)


def test_filters_of_the_chain_are_neither_early_nor_late():
    """Against scipy's exact response to straight lines: half a step would be 60 µs."""
    period = 1 / 8192
    t = period * np.arange(24000)
    signal = np.sin(2 * np.pi * 3 * t) + 0.4 * np.sin(2 * np.pi * 11 * t)
    exact = lsim(([1.0], [0.01**2, 2 * 0.7 * 0.01, 1.0]), signal, t)[1]
    slope, error = np.gradient(exact, t), low_passed(signal, 1 / (2 * np.pi * 0.01), 0.7, 8192.0) - exact
    assert abs(slope @ error) < 1e-6 * (slope @ slope)
    assert np.abs(error[4000:]).max() < 1e-5


def test_step_size_is_second_order():
    def at(rate):  # with a damper slow enough for whole steps
        motion = sine_motion(0.005, 8.0, 2, current=2.5, rate=rate)
        damper = RigDamper(asymmetry=1.0, viscous=1400.0, viscous_per_current=150.0, yield_base=200.0,
                           yield_per_current=640.0, yield_current=3.0, yield_speed=0.03, series_stiffness=5e6)
        return run(damper, motion).force[:: round(rate / 2048)]

    finest = at(131072.0)
    coarse, fine = (np.abs(at(rate) - finest)[20:].max() for rate in (8192.0, 16384.0))
    assert 3.0 < coarse / fine < 5.5


@pytest.mark.seconds
@pytest.mark.parametrize(
    "damper",
    [RigDamper(), RigDamper(yield_speed=1e-3, viscous=50.0, viscous_per_current=300.0, series_stiffness=4e6),
     RigDamper(series_stiffness=3e5)],
    ids=["default", "stiff", "soft"],
)
def test_against_radau(damper):
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    x0, w, current = 0.006, 2 * np.pi * 6.0, 1.8
    p = damper
    level = p.yield_base + p.yield_per_current * p.yield_current * math.tanh(current / p.yield_current)
    c = p.viscous + p.viscous_per_current * current

    def law(speed):
        side = p.asymmetry if speed > 0 else 1.0
        return side * (c * speed + level * math.tanh(speed / p.yield_speed))

    def slope(t, force):
        speed = brentq(lambda s: law(s) - force[0], -20.0, 20.0, xtol=1e-15, rtol=1e-14)
        return [p.series_stiffness * (x0 * w * math.cos(w * t) - speed)]

    motion = sine_motion(x0, 6.0, 1.5, current=current)
    ours = run(damper, motion)
    ticks = np.arange(0, motion.velocity.size, 64)
    start = ours.series_force[0]
    exact = solve_ivp(slope, (0, ticks[-1] / FINE), [start], "Radau", ticks / FINE, rtol=1e-8, atol=1e-4).y[0]
    worst = np.abs(ours.series_force[ticks] - exact).max() / np.abs(exact).max()
    assert worst < 1e-4


def test_force_follows_current_with_5_and_10_ms():
    n, speed = 6000, 0.1
    t = np.arange(n) / FINE
    command = np.where((t >= 0.2) & (t < 0.4), 2.0, 0.0)
    motion = Motion(speed * t, np.full(n, speed), command, FINE)
    damper = replace(RigDamper.static(), rise_time=0.005, fall_time=0.010)
    force = run(damper, motion).force
    low, high = force[1600], force[3200]
    up = t[np.argmax((force > low + (1 - np.exp(-1)) * (high - low)) & (t > 0.2))] - 0.2
    down = t[np.argmax((force < high - (1 - np.exp(-1)) * (high - low)) & (t > 0.4))] - 0.4
    assert up == pytest.approx(0.005, abs=2 / FINE)
    assert down == pytest.approx(0.010, abs=2 / FINE)


def test_default_damper_is_asymmetric_by_1_3_and_spans_the_printed_range():
    bare = replace(RigDamper(), gas_preload=0.0, gas_stiffness=0.0, friction=0.0)
    up, down = force_at(0.25, current=2.5, damper=bare), force_at(-0.25, current=2.5, damper=bare)
    assert up / -down == pytest.approx(1.3, rel=1e-6)
    assert 2300 < force_at(0.25, current=2.5, damper=RigDamper()) < 2850  # 0 … 2850 N measured in the thesis
    assert 100 < force_at(0.25, current=0.0, damper=RigDamper()) < 400


def test_creep_leaves_friction_and_gas():
    damper = replace(RigDamper.viscous_only(0.0), gas_preload=180.0, gas_stiffness=490.0, friction=47.0)
    rig = Rig(damper, Sensors.perfect())
    record = rig.run(Experiment("creep", Creep(speed=0.01, amplitude=0.02), Constant((0.0,)), 16.0))
    x, v, f = record["displacement"], record["velocity"], record["force"]
    outward, inward = (np.polyfit(x[m], f[m], 3) for m in ((v > 0.0099), (v < -0.0099)))
    assert outward[3] - inward[3] == pytest.approx(2 * 47.0, rel=1e-3)
    assert 0.5 * (outward[3] + inward[3]) == pytest.approx(-180.0, rel=1e-3)
    assert outward[2] == pytest.approx(490.0, rel=1e-2)


def test_energy_is_dissipated():
    rng = np.random.default_rng(3)
    samples = 6000
    rig = Rig()
    x = Road().displacement(samples * 16, FINE, rng)
    command = np.repeat(np.repeat(rng.uniform(0, 2.5, 600), 10), 16)
    motion = Motion.along(x, command, FINE)
    physics = rig.setup().physics._replace(gas_preload=0.0)  # gas as a plain spring: its energy is ½Kx²
    out = respond(Setup(physics, MeasurementChain()), motion)
    dx = np.diff(x)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (out.force[1:] + out.force[:-1]) * dx)])
    stored = 0.5 * physics.compliance * out.series_force**2 + 0.5 * physics.gas_stiffness * x**2
    lost = work - (stored - stored[0])
    assert lost[-1] > 50.0
    drop = np.max(np.maximum.accumulate(lost) - lost)
    assert drop < 1e-3 * lost[-1]  # rounding of the trapezoidal sums only


# -- causes: closed forms -----------------------------------------------------------------------------------------
def _base(v, current=0.0):
    """Static damper: (900 + 300 i) v + (60 + 580 i) tanh(v/0.025), typed here from its description."""
    return (900.0 + 300.0 * current) * v + (60.0 + 580.0 * current) * math.tanh(v / 0.025)


def _parallel(v, laminar=3000.0, turbulent=12000.0):
    from scipy.optimize import brentq

    return brentq(lambda f: f / laminar + math.sqrt(f / turbulent) - v, 0.0, 1e5)


@pytest.mark.parametrize(
    ("item", "v", "current", "expected"),
    [
        (effect("coulomb-friction", level=50.0), 0.1, 0.0, _base(0.1) + 50.0),
        (effect("coulomb-friction", level=50.0), -0.1, 0.0, _base(-0.1) - 50.0),
        (effect("stribeck-friction", level=80.0, speed=0.02), 0.02, 0.0, _base(0.02) + 80.0 * math.exp(-1.0)),
        (effect("gas-preload", preload=200.0), 0.1, 0.0, _base(0.1) - 200.0),
        (effect("quadratic-loss", coefficient=5000.0), -0.2, 0.0, _base(-0.2) - 200.0),
        (effect("relief-valve", force=90.0, slope=0.25), 0.2, 1.0, _base(0.2, 1.0) - 240.0 + 90.0 + 0.25 * 150.0),
        (effect("series-orifice", coefficient=1e4, onset=0.1), 0.2, 0.0, _base(0.2) + 100.0),
        (effect("asymmetry", gain=0.5), 0.2, 1.0, 1.5 * _base(0.2, 1.0)),
        (effect("asymmetry", gain=0.5), -0.2, 1.0, _base(-0.2, 1.0)),
        (effect("cavitation", limit=300.0), -0.2, 2.0, -300.0),
        (effect("cavitation", limit=300.0), 0.2, 2.0, _base(0.2, 2.0)),
        (effect("network-topology"), 0.15, 0.0, _base(0.15) - 900.0 * 0.15 + _parallel(0.15)),
        (effect("input-nonlinearity", exponent=2.0, speed=0.1), 0.2, 0.0, _base(0.2) + 900.0 * (0.4 - 0.2)),
        (effect("current-saturation", limit=1.0), 0.2, 2.0,
         _base(0.2, 2.0) + 580.0 * (math.tanh(2.0) - 2.0) * math.tanh(8.0)),
        (effect("scheduling-degree", square=-1000.0, cube=400.0), 0.2, 1.25,
         _base(0.2, 1.25) + (250.0 - 400.0 * 0.375) * math.tanh(8.0)),
        (effect("relief-valve", strength=0.5, force=90.0, slope=0.0), 0.2, 0.0, _base(0.2) - 180.0 + 90.0 + 45.0),
    ],
    ids=lambda value: value.name if hasattr(value, "name") else None,
)
def test_static_law_of_cause(item, v, current, expected):
    assert force_at(v, item, current=current) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(
    ("item", "deflection"),
    [
        (effect("series-compliance", stiffness=5e5), 1000 / 1e6 + 1000 / 5e5),
        (effect("backlash", play=1e-3), 1000 / 1e6 + 0.5e-3),
        (effect("entrained-air", stroke=2e-3, pressure_force=500.0), 1000 / 1e6 + 2e-3 * (1 - 3.0 ** (-1 / 1.3))),
    ],
    ids=lambda value: value.name if hasattr(value, "name") else None,
)
def test_series_causes_take_stroke_from_the_loop(item, deflection):
    # elastic elements give back what they take: the loop's work is 4 F_y (X − D(F_y))
    motion = sine_motion(0.008, 4.0, 3)
    work, _ = last_cycle(motion, run(yielding(1e6), motion, item).force, 4.0)
    assert work == pytest.approx(4 * 1000.0 * (0.008 - deflection), rel=1e-3)


def _harmonic(signal, frequency, rate=FINE):
    n = round(4 * rate / frequency)
    t = np.arange(signal.size)[-n:] / rate
    return 2 * np.mean(signal[-n:] * np.exp(-2j * np.pi * frequency * t))


@pytest.mark.parametrize(
    ("item", "share"),
    [
        (effect("valve-dynamics", frequency=30.0, damping=0.15), 1.0),
        (effect("model-order", share=0.4, frequency=30.0, damping=0.15), 0.4),
        (effect("fixture-resonance", frequency=30.0, damping=0.15), 1.0),
    ],
    ids=lambda value: value.name if hasattr(value, "name") else None,
)
def test_dynamic_causes_have_their_frequency_response(item, share):
    frequency = 16.0
    motion = sine_motion(0.002, frequency, 40)
    damper = RigDamper.viscous_only(1500.0)
    ratio = _harmonic(run(damper, motion, item).force, frequency) / _harmonic(run(damper, motion).force, frequency)
    s = 1j * frequency / 30.0
    expected = 1 + share * (1 / (s**2 + 0.3 * s + 1) - 1)
    assert abs(ratio - expected) < 0.01


def test_fixture_inertia_adds_mass_times_acceleration():
    motion = sine_motion(0.005, 8.0, 2)
    damper = RigDamper.viscous_only(1500.0)
    added = run(damper, motion, effect("fixture-inertia", mass=4.0)).force - run(damper, motion).force
    expected, step = -4.0 * (2 * np.pi * 8.0) ** 2 * motion.displacement, 2 * np.pi * 8.0 / FINE
    # a second difference of a sine is smaller by the share (ωΔt)²/12; at the ends it is one-sided
    np.testing.assert_allclose(added[1:-1], expected[1:-1] * (1 - step**2 / 12), rtol=step**4, atol=1e-6)


def test_end_stop_adds_a_spring_beyond_its_position():
    motion = sine_motion(0.010, 2.0, 2)
    damper = RigDamper.viscous_only(1500.0)
    added = run(damper, motion, effect("end-stop", position=0.006, stiffness=5e4)).force - run(damper, motion).force
    x = motion.displacement
    np.testing.assert_allclose(added, 5e4 * np.sign(x) * np.maximum(np.abs(x) - 0.006, 0.0), atol=1e-9)


def test_gas_stiffness_is_the_slope_at_mid_stroke():
    motion = sine_motion(0.001, 1.0, 1)
    damper = RigDamper.viscous_only(0.0)
    soft = run(replace(damper, gas_preload=300.0), motion, effect("gas-stiffness", stiffness=4000.0)).force
    slope = (soft[20] - soft[0]) / (motion.displacement[20] - motion.displacement[0])
    assert slope == pytest.approx(4000.0, rel=5e-3)
    np.testing.assert_allclose(run(damper, motion, effect("gas-stiffness", stiffness=4000.0)).force,
                               4000.0 * motion.displacement, atol=1e-9)


def test_cavitation_delays_the_next_rebound():
    motion = sine_motion(0.01, 4.0, 3, current=2.0)
    free = run(RigDamper.static(), motion).force
    broken = run(RigDamper.static(), motion, effect("cavitation", limit=500.0)).force
    assert broken.min() == pytest.approx(-500.0)
    missing = (motion.velocity > 0.01) & (broken < -499.0)
    assert missing.any() and free[missing].min() > 0
    work = np.sum(0.5 * (broken[1:] + broken[:-1]) * np.diff(motion.displacement))
    assert work > 0


def test_thermal_state_follows_the_power():
    damper = RigDamper.viscous_only(1500.0)
    n, speed = 5 * 8192, 0.2
    t = np.arange(n) / FINE
    motion = Motion(speed * t, np.full(n, speed), np.zeros(n), FINE)
    power, capacity, loss = 1500.0 * speed**2, 20.0, 5.0
    warm = run(damper, motion, effect("viscous-fade", rate=0.0, capacity=capacity, loss=loss))
    expected = power / loss * (1 - np.exp(-loss * t / capacity))
    np.testing.assert_allclose(warm.temperature, expected, rtol=1e-3, atol=1e-2)
    faded = run(damper, motion, effect("thermal-fade", rate=0.01, capacity=capacity, loss=loss))
    np.testing.assert_allclose(faded.force, 300.0 * (1 - 0.01 * faded.temperature), rtol=1e-3)
    thinned = run(damper, motion, effect("viscous-fade", rate=0.02, capacity=capacity, loss=loss))
    np.testing.assert_allclose(thinned.force, 300.0 * np.exp(-0.02 * thinned.temperature), rtol=1e-3)


@pytest.mark.parametrize(
    ("item", "up", "down"),
    [(effect("coil-lag", tau=0.02), 0.02, 0.02), (effect("rise-fall-lag", rise=0.008, fall=0.025), 0.008, 0.025),
     (effect("command-delay", delay=0.0125), 0.0125, 0.0125)],
    ids=lambda value: value.name if hasattr(value, "name") else None,
)
def test_current_path_step_response(item, up, down):
    n = 8192
    t = np.arange(n) / FINE
    command = np.where((t >= 0.2) & (t < 0.6), 2.0, 0.0)
    still = Motion(np.zeros(n), np.zeros(n), command, FINE)
    current = run(RigDamper.static(), still, item).current
    rising = t[np.argmax(current > 2.0 * (1 - np.exp(-1)))] - 0.2
    falling = t[np.argmax((current < 2.0 * np.exp(-1)) & (t > 0.6))] - 0.6
    assert rising == pytest.approx(up, abs=2 / FINE)
    assert falling == pytest.approx(down, abs=2 / FINE)


def test_remanence_opens_a_loop_of_twice_its_width():
    n = 8192
    command = 1.0 + np.sin(2 * np.pi * 2 * np.arange(n) / FINE)
    still = Motion(np.zeros(n), np.zeros(n), command, FINE)
    current = run(RigDamper.static(), still, effect("remanence", width=0.1)).current
    quarter = n // 8
    rising, falling = current[4 * quarter], current[6 * quarter]  # command 1.0 A, on its way up and down
    assert falling - rising == pytest.approx(0.2, abs=1e-9)


def test_missing_scheduling_modulates_with_its_period():
    n = 4 * 8192
    motion = Motion(np.zeros(n), np.full(n, 0.1), np.zeros(n), FINE)
    force = run(RigDamper.viscous_only(1000.0), motion, effect("missing-scheduling", gain=0.2, period=2.0)).force
    np.testing.assert_allclose(force, 100.0 * (1 + 0.2 * np.sin(2 * np.pi * np.arange(n) / FINE / 2.0)), rtol=1e-9)


# -- causes: measurement chain ------------------------------------------------------------------------------------
SHORT = Experiment("short", Road(), Constant((1.2,)), duration=2.0)
SWITCHED = replace(EXPERIMENTS["test-1"], duration=3.0)


def perfect(*effects, experiment=SHORT):
    return Rig(sensors=Sensors.perfect(), effects=effects).run(experiment, seed=2)


def test_channel_delays_shift_by_samples():
    clean = perfect()
    motion = perfect(effect("displacement-delay", delay=3 / 512))
    force = perfect(effect("force-delay", delay=3 / 512))
    for name in ("displacement", "velocity"):
        np.testing.assert_allclose(motion[name][3:], clean[name][:-3], atol=1e-12)
    np.testing.assert_array_equal(motion["force"], clean["force"])
    np.testing.assert_allclose(force["force"][3:], clean["force"][:-3], atol=1e-9)
    np.testing.assert_array_equal(force["velocity"], clean["velocity"])


def test_one_sided_filter_has_its_frequency_response():
    sine = Experiment("sine", Sine(0.005, 8.0), Constant((1.2,)), duration=2.0)
    clean, filtered = perfect(experiment=sine), perfect(effect("one-sided-filter"), experiment=sine)
    s = 1j * 8.0 / 20.0
    expected = 1 / (s**2 + math.sqrt(2) * s + 1)
    for name in ("displacement", "velocity"):
        ratio = _harmonic(filtered[name], 8.0, 512.0) / _harmonic(clean[name], 8.0, 512.0)
        assert abs(ratio - expected) < 5e-3
    np.testing.assert_array_equal(filtered["force"], clean["force"])


def test_force_chain():
    clean = perfect()["force"]
    np.testing.assert_allclose(perfect(effect("force-offset", offset=-75.0))["force"], clean - 75.0)
    np.testing.assert_allclose(perfect(effect("force-clipping", limit=500.0))["force"], np.clip(clean, -500, 500))
    np.testing.assert_allclose(perfect(effect("sensor-scale", gain=0.2))["force"], 1.2 * clean)
    np.testing.assert_array_equal(perfect(effect("channel-sign"))["force"], -clean)
    flipped = perfect(effect("channel-sign", channel="velocity"))
    assert np.mean(flipped["force"] * flipped["velocity"]) < 0 < np.mean(clean * -flipped["velocity"])
    rough = perfect(effect("quantisation", force=25.0))["force"]
    np.testing.assert_allclose(rough / 25.0, np.round(rough / 25.0), atol=1e-9)
    assert np.abs(rough - clean).max() <= 12.5 + 1e-9


@pytest.mark.slow
def test_coloured_noise_has_its_spread_and_memory():
    long = replace(SHORT, duration=60.0)
    noise = perfect(effect("coloured-noise", std=40.0, pole=0.9), experiment=long)["force"] - perfect(
        experiment=long)["force"]
    assert noise.std() == pytest.approx(40.0, rel=0.05)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.9, abs=0.015)
    grown = perfect(effect("coloured-noise", std=0.0, pole=0.0, proportional=0.1), experiment=long)
    force = perfect(experiment=long)["force"]
    large, small = np.abs(force) > 800, np.abs(force) < 200
    excess = grown["force"] - force
    assert excess[large].std() > 4 * excess[small].std()


def test_cached_kernels_know_the_layout_of_their_parameters():
    import zlib

    from quartercar.rig import _integrator
    from quartercar.rig.setup import Physics

    assert zlib.crc32(",".join(Physics._fields).encode()) == _integrator.LAYOUT


@pytest.mark.parametrize("found_at", [1.0, 1.0 + 1e-12, 0.3, 2.0])
def test_a_stage_is_the_inverse_of_its_equation_wherever_it_starts(found_at):
    """The root is chosen, the right side of the equation computed from it by the laws as they are printed."""
    from quartercar.rig import _integrator

    p, h, gain = RigDamper().physics(), 1.8e-5, 700.0
    for w in (-0.21, -2e-3, 3e-7, 4.9e-3, 0.0277):
        scale = p.asymmetry if w > 0 else 1.0
        force = scale * (p.viscous * w + gain * math.tanh(w / p.yield_speed))
        root, found = _integrator._stage(p.compliance * force + h * w, h, found_at * w, p.viscous, gain, 1.0, -1e300,
                                         0.0, p)
        assert root == pytest.approx(w, rel=1e-13, abs=1e-15)  # rounding of D(F) against h w
        assert found == pytest.approx(force, rel=1e-13)


# -- contract over all causes -------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def clean():
    return Rig().run(SWITCHED, seed=5)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", NAMES)
def test_cause_of_strength_zero_is_no_cause(name, clean):
    record = Rig(effects=(effect(name, strength=0.0),)).run(SWITCHED, seed=5)
    for channel in clean.channels:
        np.testing.assert_array_equal(record[channel], clean[channel])


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", NAMES)
def test_cause_of_strength_one_changes_the_record(name, clean):
    experiment = SWITCHED
    if name in ("thermal-fade", "viscous-fade", "end-stop"):  # need time to warm up, or a rare large stroke
        experiment = replace(SWITCHED, duration=30.0)
        clean = Rig().run(experiment, seed=5)
    record = Rig(effects=(effect(name),)).run(experiment, seed=5)
    change = max(np.std(record[c] - clean[c]) / np.std(clean[c]) for c in clean.channels)
    if name in ("force-offset", "gas-preload"):
        change = abs(np.mean(record["force"] - clean["force"])) / np.std(clean["force"])
    assert change > 0.01
    assert all(np.all(np.isfinite(record[c])) for c in record.channels)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", [n for n in NAMES if n != "channel-sign"])
def test_cause_grows_from_nothing(name, clean):
    record = Rig(effects=(effect(name, strength=1e-5),)).run(SWITCHED, seed=5)
    assert all(np.std(record[c] - clean[c]) < 2e-3 * np.std(clean[c]) for c in clean.channels)


def test_car_causes_and_unknown_ones_are_refused():
    for name in ("strut-friction", "payload", "tyre-stiffness", "tyre-damping", "actuator-delay"):
        with pytest.raises(InputError, match="quarter-car rig"):
            effect(name)
    with pytest.raises(InputError, match="did you mean 'coil-lag'"):
        effect("coil-lagg")
    with pytest.raises(InputError, match="no parameter of 'coil-lag': 'taus'"):
        effect("coil-lag", taus=1.0)
    with pytest.raises(InputError, match="negative"):
        effect("coil-lag", tau=-1.0)
    with pytest.raises(InputError, match="negative"):
        effect("coil-lag", strength=-1.0)
    with pytest.raises(InputError, match="must be 0 or 1"):
        effect("channel-sign", strength=0.5)


def test_every_damper_cause_of_the_catalogue_is_here():
    promised = (
        """coulomb-friction stribeck-friction gas-preload gas-stiffness series-compliance backlash quadratic-loss
        relief-valve series-orifice asymmetry cavitation valve-dynamics entrained-air network-topology coil-lag
        command-delay rise-fall-lag current-saturation remanence thermal-fade viscous-fade end-stop fixture-inertia
        fixture-resonance displacement-delay force-delay one-sided-filter force-offset force-clipping quantisation
        scheduling-degree missing-scheduling model-order input-nonlinearity sensor-scale channel-sign
        coloured-noise"""
    )
    assert sorted(NAMES) == sorted(promised.split())


# -- records ------------------------------------------------------------------------------------------------------
def test_record_has_the_channels_and_one_per_cent_noise():
    record = Rig().run(EXPERIMENTS["test-3"], seed=1, truth=True)
    assert record.n_samples == 15360 and record.sample_time == 1 / 512
    assert [record.unit(c) for c in ("displacement", "velocity", "current", "force")] == ["m", "m/s", "A", "N"]
    noise = record["force"] - record["force_true"]
    assert noise.std() / np.sqrt(np.mean(record["force_true"] ** 2)) == pytest.approx(0.01, rel=0.03)
    assert (record["velocity"] - record["velocity_true"]).std() == pytest.approx(3e-4, rel=0.03)
    assert np.mean(record["force"] * record["velocity"]) > 0
    derived = np.gradient(record["displacement_true"]) * 512
    assert np.corrcoef(derived, record["velocity_true"])[0, 1] > 0.999


def test_velocity_without_a_sensor_is_derived_from_the_measured_displacement():
    record = Rig(sensors=Sensors(velocity_sensor=False)).run(SHORT)
    np.testing.assert_allclose(record["velocity"][1:-1],
                               (record["displacement"][2:] - record["displacement"][:-2]) * 256)


def test_seed_fixes_the_record_and_replicates_differ():
    rig = Rig()
    first, again = rig.run(SWITCHED, seed=7), rig.run(SWITCHED, seed=7)
    np.testing.assert_array_equal(first["force"], again["force"])
    other = rig.run(SWITCHED, seed=7, replicate=1)
    assert abs(np.corrcoef(first["displacement"], other["displacement"])[0, 1]) < 0.9
    same = replace(SWITCHED, redraw=False)
    one, two = rig.run(same, seed=7, truth=True), rig.run(same, seed=7, replicate=1, truth=True)
    np.testing.assert_array_equal(one["force_true"], two["force_true"])
    assert not np.array_equal(one["force"], two["force"])


def test_presets_are_the_thesis_experiments():
    assert [e.replicates for e in EXPERIMENTS.values()] == [11, 11, 11, 3, 4, 7, 7, 7]
    kinds = [e.current.kind for e in EXPERIMENTS.values()]
    assert kinds == ["icps", "prbs", "aprbs", "icps", "aprbs", "constant", "constant", "constant"]
    record = Rig().run(replace(EXPERIMENTS["test-6"], duration=1.0), replicate=4)
    assert np.median(record["current"]) == pytest.approx(1.6, abs=1e-3)
    thesis = replace(EXPERIMENTS["test-1"], displacement=Road(incommensurate=False))
    x = Rig(sensors=Sensors.perfect()).run(thesis)["displacement"]
    np.testing.assert_allclose(x[:2560], -x[2560:5120], atol=1e-9)


@pytest.mark.seconds
def test_default_records_split():
    from quartercar.rig import default_records

    names = ["test-1", "test-3"]
    assert [r.name for r in default_records(part="training", names=names)] == ["test-1-r0", "test-3-r0"]
    assert [r.name for r in default_records(part="held-out", names=names)] == ["test-1-r1", "test-3-r1"]
    with pytest.raises(InputError, match="part"):
        default_records(part="test")


def test_bad_rigs_and_experiments_are_refused():
    with pytest.raises(InputError, match="negative"):
        RigDamper(viscous=-1.0)
    with pytest.raises(InputError, match="positive"):
        RigDamper(yield_speed=0.0)
    with pytest.raises(InputError, match="finite"):
        RigDamper(viscous=math.inf)
    with pytest.raises(InputError, match="effect"):
        Rig(effects=("coil-lag",))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="too short"):
        Rig().run(replace(SHORT, duration=0.001))
    with pytest.raises(InputError, match="too long"):
        Rig().run(replace(SHORT, duration=1e7))
    with pytest.raises(InputError, match="amplitude"):
        Sine(amplitude=math.nan)
    with pytest.raises(InputError, match="acceleration limit"):
        Rig().run(Experiment("t", Triangle(acceleration=0.1), Constant((0.0,)), 1.0))


def test_import_is_light():
    heavy = "('numba', 'pint', 'scipy', 'matplotlib')"
    code = f"import sys, quartercar.rig; print([m for m in {heavy} if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
