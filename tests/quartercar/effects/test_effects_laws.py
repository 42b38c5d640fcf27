"""What a crude law lacks: hysteresis, a hardening spring, saturating damping, a dead zone, friction behind a spring."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from lpvid.baselines.signals import Signals
from lpvid.effects.composition import Composition
from lpvid.record import Record
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.laws.linear import Linear
from quartercar.effects.compliance import SeriesCompliance
from quartercar.effects.friction_gas import InnerFriction
from quartercar.effects.hydraulics import Asymmetry
from quartercar.effects.hysteresis import BoucWenHysteresis, loop
from quartercar.effects.laws import CubicSpring, ForceDeadZone, SaturatingDamping

RATE = 500.0


def motion(seconds: float = 4.0) -> Signals:
    """Two sines that turn at other places every time."""
    t = np.arange(round(seconds * RATE)) / RATE
    x = 0.01 * np.sin(2 * np.pi * 1.1 * t) + 0.004 * np.sin(2 * np.pi * 2.7 * t)
    v = 0.01 * 2 * np.pi * 1.1 * np.cos(2 * np.pi * 1.1 * t) + 0.004 * 2 * np.pi * 2.7 * np.cos(2 * np.pi * 2.7 * t)
    return Signals(1 / RATE, {"displacement": x, "velocity": v}, np.zeros(t.size))


def rate_of_change(s: Signals) -> np.ndarray:
    """(n,) acceleration of `motion`, from its formula."""
    t = np.arange(s.n_samples) / RATE
    return -sum(x * (2 * np.pi * f) ** 2 * np.sin(2 * np.pi * f * t) for x, f in ((0.01, 1.1), (0.004, 2.7)))


def linear(**values: float) -> DamperBaseline:
    """Mass, damper, spring."""
    return DamperBaseline(Linear(spring=True).replace(values=values))


@pytest.mark.thinned(5)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.8, -0.5])
def test_the_loop_solves_its_differential_equation(share):
    s, d = motion(1.0), 0.003
    v = lambda t: np.interp(t, s.times, s["velocity"])  # noqa: E731
    rate = lambda t, z: (v(t) - (1 - share) * abs(v(t)) * z - share * v(t) * abs(z)) / d  # noqa: E731
    exact = solve_ivp(rate, (0, s.times[-1]), [0.0], t_eval=s.times, rtol=1e-9, atol=1e-11, max_step=1 / RATE).y[0]
    assert np.abs(loop(s, d, share) - exact).max() < 2e-5


def test_without_a_straight_way_back_the_loop_is_dahls():
    s = motion()
    z = loop(s, 0.002, 0.0)
    assert np.abs(z).max() < 1.0
    energy = np.cumsum(z * s["velocity"]) / RATE
    assert energy[-1] > 0  # a loop over the way takes up work


def test_a_mass_is_moved_by_the_record_where_a_law_is_only_asked():
    s, base = motion(), linear(damping=800.0, stiffness=2e3, mass=3.0, offset=5.0)
    core = base.core(base.vector)
    faster = core(s.evaluated(velocity=2 * s["velocity"]))
    wanted = 800.0 * 2 * s["velocity"] + 2e3 * s["displacement"] + 3.0 * rate_of_change(s) + 5.0
    assert np.abs(faster - wanted).max() < 3e-3 * 3.0 * np.abs(rate_of_change(s)).max()


def test_a_mass_near_the_end_of_the_band_is_not_weighed_too_light():
    """At a fifth of the sample rate central differences are sin(2π/5)/(2π/5) = .76 of the rate of change."""
    t = np.arange(3000) / RATE
    v = 0.1 * np.cos(2 * np.pi * 100 * t) + 0.1 * np.cos(2 * np.pi * 37 * t)
    a = -0.1 * 2 * np.pi * (100 * np.sin(2 * np.pi * 100 * t) + 37 * np.sin(2 * np.pi * 37 * t))
    base = linear(mass=2.0, damping=0.0, stiffness=0.0, offset=0.0)
    force = base.core(base.vector)(Signals(1 / RATE, {"velocity": v, "displacement": 0 * v}, 2.0 * a))
    inside = slice(300, -300)
    assert np.abs(force - 2.0 * a)[inside].max() < 0.01 * np.abs(2.0 * a).max()
    assert np.abs(2.0 * np.gradient(v, 1 / RATE) - 2.0 * a)[inside].max() > 0.15 * np.abs(2.0 * a).max()


def test_asymmetry_of_a_linear_law_acts_on_its_damping_alone():
    s, base = motion(), linear(damping=800.0, stiffness=2e3, mass=3.0, offset=5.0)
    whole = Asymmetry().compose(base.core(base.vector), np.array([0.5]), base)(s)
    added = whole - base.core(base.vector)(s)
    assert np.allclose(added, 0.5 * 800.0 * np.maximum(s["velocity"], 0.0), atol=1e-9)


def test_friction_behind_a_spring_is_a_rounded_iwan_element():
    """Friction alone behind a spring, dF/dt = k (v − w), F = F_c tanh(w/ε): elastic, then plastic."""
    s, friction, stiffness, eps = motion(1.5), 100.0, 2e5, 2e-3
    composition = Composition(linear(), (InnerFriction(), SeriesCompliance()))
    force = composition.predict(s, np.array([0.0, 0.0, 0.0, 0.0, friction, eps, 1 / stiffness]))
    fine, exact, now = 8, np.empty(s.n_samples), force[0]
    exact[0], h = now, 1 / RATE / 8
    for k in range(1, s.n_samples):
        for v in np.interp(np.arange(1, fine + 1) / fine, [0, 1], s["velocity"][k - 1: k + 1]):  # implicit Euler
            known = now + stiffness * h * v
            w = brentq(lambda w, c=known: friction * np.tanh(w / eps) + stiffness * h * w - c, -5.0, 5.0)
            now = friction * np.tanh(w / eps)
        exact[k] = now
    assert np.sqrt(np.mean((force - exact) ** 2)) < 0.01 * friction


@pytest.mark.parametrize("effect, values, wanted", [
    (CubicSpring(), [2e8, 1e5], lambda v, x, f: f + 2e8 * x**3 + 1e5 * x**2),
    (SaturatingDamping(), [30.0], lambda v, x, f: f + 800.0 * (np.tanh(30 * v) / 30 - v)),
    (ForceDeadZone(), [20.0], lambda v, x, f: np.sign(f) * np.maximum(np.abs(f) - 20.0, 0.0)),
])
def test_each_adds_what_its_equation_says(effect, values, wanted):
    s, base = motion(), linear(damping=800.0, stiffness=2e3, mass=0.0, offset=0.0)
    core = base.core(base.vector)
    force = effect.compose(core, np.array(values), base)(s)
    assert np.allclose(force, wanted(s["velocity"], s["displacement"], core(s)), atol=1e-8)


def test_the_offset_of_hysteresis_is_nothing_at_rest():
    s = motion()
    with_loop = BoucWenHysteresis().compose(lambda q: np.zeros(q.n_samples), np.array([50.0, 1e-3, 0.3]), linear())
    assert with_loop(s)[0] == 0


def test_linear_simulates_what_it_did():
    """A record's own run: nothing of the mass changes."""
    s = motion()
    record = Record({"displacement": s["displacement"], "velocity": s["velocity"], "force": s["velocity"]},
                    sample_time=1 / RATE, units={"displacement": "m", "velocity": "m/s", "force": "N"})
    base = linear(damping=10.0, stiffness=5.0, mass=2.0, offset=1.0)
    signals = base.signals(record)
    force = base.core(base.vector)(signals)
    wanted = 10 * s["velocity"] + 5 * signals["displacement"] + 2 * rate_of_change(s) + 1
    assert np.abs(force - wanted).max() < 3e-3 * 2 * np.abs(rate_of_change(s)).max()
    np.testing.assert_array_equal(base.damper.simulate(record).output[:, 0], force)


def test_a_loop_is_smooth_about_flanks_that_are_half_straight() -> None:
    """c = 1 − 2s vanishes at s = ½: a formula that divides by it kept half of the digits there."""
    s = motion()
    half = loop(s, 1e-3, 0.5)
    for share in (0.5 - 1e-8, 0.5 + 1e-8):
        np.testing.assert_allclose(loop(s, 1e-3, share), half, atol=1e-7)
        np.testing.assert_allclose(loop(s, 1e-3, share) - half, half - loop(s, 1e-3, 1 - share), atol=1e-13)
