"""Friction and gas on creep triangles, sines and staircases: what an engineer reads off the loops."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import composed, guo, nothing, road_like
from scipy.integrate import solve_ivp

from lpvid.baselines.signals import Signals
from lpvid.diagnosis.problem import problem_of
from lpvid.diagnosis.refitting import refit
from lpvid.effects.composition import Composition
from lpvid.record import Record
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.laws.linear import Linear
from quartercar.effects.friction_gas import (
    NIL,
    REVERSAL,
    CoulombFriction,
    GasPreload,
    GasStiffness,
    StribeckFriction,
    direction,
)

STROKE = 0.02


def creep(speed: float = 0.02, n: int = 4001) -> Signals:
    """Out and in over ±STROKE at constant speed."""
    half = np.linspace(-STROKE, STROKE, n)
    x = np.concatenate([half, half[::-1]])
    v = np.concatenate([np.full(n, speed), np.full(n, -speed)])
    return Signals(2 * STROKE / speed / (n - 1), {"displacement": x, "velocity": v}, np.zeros(2 * n))


def test_half_the_difference_is_friction_and_half_the_sum_is_gas() -> None:
    friction, preload, stiffness = 45.0, 180.0, 500.0
    s = creep()
    force = np.sum([composed(e, v, s, nothing) for e, v in
                    ((CoulombFriction(), [friction, 0.0, REVERSAL]), (GasPreload(), [preload]),
                     (GasStiffness(), [stiffness, 0.0]))],
                   axis=0)
    out, back = force[:4001], force[4001:][::-1]
    np.testing.assert_allclose((out - back) / 2, friction * np.tanh(0.02 / REVERSAL), rtol=1e-12)
    even = (out + back) / 2
    slope, level = np.polyfit(s["displacement"][:4001], even, 1)
    assert slope == pytest.approx(stiffness, rel=1e-9) and level == pytest.approx(-preload, rel=1e-9)


@pytest.mark.parametrize("frequency", [0.2, 2.0])
def test_friction_dissipates_four_times_force_and_stroke_at_any_frequency(frequency: float) -> None:
    t = np.linspace(0, 1 / frequency, 20001)
    w = 2 * np.pi * frequency
    x, v = STROKE * np.sin(w * t), STROKE * w * np.cos(w * t)
    s = Signals(t[1], {"displacement": x, "velocity": v}, 0 * t)
    force = composed(CoulombFriction(), [60.0, 0.0, REVERSAL], s, nothing)
    rounding = (REVERSAL / (STROKE * w)) ** 2
    assert np.trapezoid(force * v, t) == pytest.approx(4 * 60.0 * STROKE, rel=max(rounding, 1e-3))


def test_gas_does_no_work_over_a_cycle() -> None:
    t = np.linspace(0, 1, 20001)
    x, v = STROKE * np.sin(2 * np.pi * t), STROKE * 2 * np.pi * np.cos(2 * np.pi * t)
    s = Signals(t[1], {"displacement": x, "velocity": v}, 0 * t)
    for effect, values in ((GasPreload(), [200.0]), (GasStiffness(), [5000.0, 0.0]), (GasStiffness(), [5000.0, 20.0])):
        assert abs(np.trapezoid(composed(effect, values, s, nothing) * v, t)) < 1e-9


def test_a_column_of_gas_keeps_pressure_times_volume_to_the_power() -> None:
    """p V^1.3 = const: 30 bar behind a rod of 11 mm that drives into a column of 80 mm."""
    area, pressure, length = np.pi / 4 * 0.011**2, 30e5, 0.08
    s = creep()
    x = s["displacement"]
    volume = area * (length - x)
    expected = pressure * ((area * length / volume) ** 1.3 - 1) * area
    values = [1.3 * pressure * area / length, 1 / length]
    np.testing.assert_allclose(composed(GasStiffness(), values, s, nothing), expected, rtol=1e-9, atol=1e-9)
    assert GasStiffness().parameters[1].neutral == 0.0 and "closing" in GasStiffness().added_later


class TestStribeck:
    def staircase(self, speeds: np.ndarray) -> np.ndarray:
        return composed(StribeckFriction(), [80.0, 0.01],
                        Signals(0.01, {"velocity": speeds}, np.zeros(speeds.size)), nothing)

    def test_falls_off_with_speed(self) -> None:
        speeds = np.array([0.008, 0.01, 0.02, 0.03, 0.05])
        force = self.staircase(speeds)
        np.testing.assert_allclose(force / np.tanh(speeds / REVERSAL), 80 * np.exp(-(speeds / 0.01) ** 2), rtol=1e-12)
        assert np.all(np.diff(force) < 0)
        assert force[1] == pytest.approx(80 / np.e, rel=1e-3), "an e-th at the Stribeck speed"

    def test_is_odd_and_gone_at_speed(self) -> None:
        speeds = np.linspace(-0.3, 0.3, 601)
        force = self.staircase(speeds)
        np.testing.assert_allclose(force, -force[::-1], atol=1e-12)
        assert np.abs(force[np.abs(speeds) > 0.06]).max() < 1e-10

    def test_is_not_plain_friction(self) -> None:
        """No level of Coulomb friction makes up for it."""
        speeds = np.linspace(-0.1, 0.1, 2001)
        sign = np.tanh(speeds / REVERSAL)
        force = self.staircase(speeds)
        rest = force - sign * (sign @ force) / (sign @ sign)
        assert rest @ rest > 0.5 * (force @ force)


class TestPresliding:
    PERIOD = 1 / 512

    def motion(self, step: float) -> tuple[np.ndarray, np.ndarray]:
        t = np.arange(0.0, 4.0, step)
        return t, 0.03 * np.sin(9 * t) + 0.05 * np.sin(31 * t + 1)

    @pytest.mark.parametrize("deflection", [1e-7, 1e-6, 1.5e-5, 1e-4, 6e-4])
    @pytest.mark.slow
    def test_is_that_of_the_differential_equation(self, deflection: float) -> None:
        """dz/dt = |v|(tanh(v/ε) − z)/d by scipy's Radau, against samples at 512 Hz, from the same bristles on."""
        t, v = self.motion(self.PERIOD)

        def slope(time: float, z: np.ndarray) -> np.ndarray:
            speed = np.interp(time, t, v)
            return abs(speed) * (np.tanh(speed / REVERSAL) - z) / deflection

        s = Signals(self.PERIOD, {"velocity": v}, 0 * t)
        got = composed(CoulombFriction(), [1.0, deflection, REVERSAL], s, nothing)
        exact = solve_ivp(slope, (t[0], t[-1]), [got[0]], "Radau", t, rtol=1e-7, atol=1e-8,
                          max_step=self.PERIOD / 4).y[0]
        assert 0 < got[0] <= np.tanh(v[0] / REVERSAL)  # as it is on average where this record moves that way
        assert np.sqrt(np.mean((got - exact) ** 2)) < 0.006

    def test_the_reversal_is_as_sharp_as_the_data_say(self) -> None:
        """A friction that turns within 0.1 mm/s, of a motion that is slow there: fitted from the usual 2 mm/s."""
        t = np.arange(0.0, 20.0, 0.004)
        v = 0.02 * np.sin(0.9 * t) + 0.01 * np.sin(2.3 * t)
        force = 400 * v + 20 * np.tanh(v / 1e-4) + 0.3 * np.random.default_rng(0).normal(size=t.size)
        record = Record({"velocity": v, "force": force}, sample_time=0.004, units={"velocity": "m/s", "force": "N"})
        baseline = DamperBaseline(Linear(spring=False)).fit([record])
        problem = problem_of([record], baseline)
        composition = Composition(baseline, (CoulombFriction(),))
        found = refit(problem, composition, np.concatenate([baseline.vector, [20.0, 0.0, REVERSAL]]))
        assert found.vector[-1] < 4e-4 and found.vector[-3] == pytest.approx(20.0, abs=0.2)
        assert found.cost < 1.05 * 0.3**2 * problem.n_samples

    @pytest.mark.parametrize("period", [1e-5, PERIOD])
    def test_vanishes_without_a_deflection(self, period: float) -> None:
        """However few samples lie within a reversal: a fit that starts from none could not leave it otherwise."""
        t, v = self.motion(period)
        s = Signals(period, {"velocity": v}, 0 * t)
        sharp, *soft = (composed(CoulombFriction(), [50.0, d, REVERSAL], s, nothing)
                        for d in (0.0, 1.1 * NIL, 0.9 * NIL))
        assert np.sqrt(np.mean((sharp - soft[0]) ** 2)) < 0.03 * 50
        np.testing.assert_array_equal(soft[1], sharp)

    def test_a_small_motion_is_a_spring(self) -> None:
        """Amplitudes well below the deflection: force in proportion to the displacement, F_c/d."""
        t = np.arange(0.0, 1.0, 1e-4)
        v = 6e-5 * np.cos(60 * t)  # of an amplitude of 1 µm
        got = composed(CoulombFriction(), [60.0, 2e-4, REVERSAL], Signals(1e-4, {"velocity": v}, 0 * t), nothing)
        assert not CoulombFriction().is_static(np.array([60.0, 2e-4, REVERSAL]))
        assert CoulombFriction().is_static(np.array([60.0, 0.0, REVERSAL]))
        assert np.ptp(got) < 0.02 * 60

    def test_of_a_deflection_that_is_none_no_fit_follows_the_rounding(self) -> None:
        """Errors are known to the last digit of the output, which divided by a small step looked like a derivative."""
        s = road_like(4, 2000)
        composition = Composition(guo(), (CoulombFriction(),))
        vector = composition.neutral
        vector[composition.places[0]] = 60.0, 0.0, REVERSAL
        at = s.output - (s.output - composition.predict(s, vector))
        assert np.any(at != composition.predict(s, vector))
        *_, of_force, of_deflection, _ = composition.sensitivities(s, vector, at=at).T
        assert np.std(of_force) > 0.1 and not of_deflection.any()


@pytest.mark.parametrize("deflection", [0.01, 0.1, 0.3, 1.0, 3.0])
def test_friction_begins_nearer_to_what_went_before_than_sliding_or_at_rest(deflection: float) -> None:
    """A wandering motion cut anywhere, the whole one as the oracle; deflections over half of its reach."""
    t = 1e-3 * np.arange(8000)
    v = sum(a * np.cos(2 * np.pi * f * t + p) for a, f, p in ((1.0, 1.3, 0.3), (0.6, 2.1, 2.0), (0.4, 3.7, 5.0)))
    d = deflection * float(np.ptp(np.cumsum(v))) * 1e-3 / 2
    whole = direction(Signals(1e-3, {"velocity": v}, 0 * t), d)
    cuts = np.arange(4000, 6000, 37)
    begun = np.array([direction(Signals(1e-3, {"velocity": v[k:]}, 0 * t[k:]), d)[0] for k in cuts])
    missed = [np.sqrt(np.mean((z - whole[cuts]) ** 2)) for z in (begun, np.tanh(v[cuts] / REVERSAL), 0 * begun)]
    assert missed[0] < 1.05 * min(missed[1:])
    assert missed[0] < 0.85 * max(missed[1:])


def test_friction_begins_between_rest_and_sliding() -> None:
    """A fast stroke, then creep below the speed over which it turns: what it carries is more than that speed's."""
    v = np.concatenate([np.full(100, 0.05), np.full(20000, 1e-4)])
    for deflection in (1e-4, 1e-3, 3e-3):
        z = direction(Signals(1e-3, {"velocity": v}, 0 * v), deflection, 1e-3)
        assert 0 <= z[0] <= np.tanh(50.0) and np.abs(z).max() <= 1.0
