"""An inertia stands beside what is in series with the damper: the element carries the damper's force alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lpvid as lpv
from lpvid.baselines.signals import Signals
from lpvid.effects.composition import Composition
from lpvid.effects.effect import by_name
from lpvid.record import Record
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.laws.linear import Linear
from quartercar.effects import CATALOGUE

PERIOD = 1 / 512
DAMPING, MASS, OFFSET, FRICTION, COMPLIANCE = 800.0, 6.0, 15.0, 40.0, 4e-5
CAUSES = by_name(CATALOGUE)


def motion(n: int = 3000) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(time, position, velocity, acceleration) of three tones."""
    t, (x, v, a) = PERIOD * np.arange(n), np.zeros((3, n))
    for f, size in ((1.1, 0.01), (4.3, 0.003), (9.0, 0.001)):
        w = 2 * np.pi * f
        x, v, a = x + size * np.sin(w * t), v + size * w * np.cos(w * t), a - size * w**2 * np.sin(w * t)
    return t, x, v, a


def composed(names: tuple[str, ...], values: list[float]) -> tuple[Composition, np.ndarray]:
    baseline = DamperBaseline(Linear(spring=False).with_values(damping=DAMPING, mass=MASS, offset=OFFSET))
    return Composition(baseline, tuple(CAUSES[n] for n in names)), np.array([DAMPING, MASS, OFFSET, *values])


@pytest.mark.parametrize("friction", [
    pytest.param(0.0, marks=pytest.mark.slow), pytest.param(FRICTION, marks=pytest.mark.seconds)])
def test_of_a_spring_before_damper_and_friction_with_a_mass_outside(friction: float) -> None:
    """F = F_s + m a + F_0, Ḟ_s/k = v − w, F_s = c w + F_c tanh(w/ε) by scipy's Radau along the motion itself."""
    t, x, v, a = motion(1200)

    def rate(time: float, w: np.ndarray) -> np.ndarray:
        speed = np.interp(time, t, v)
        slope = DAMPING + friction * (1 - np.tanh(w / 2e-3) ** 2) / 2e-3
        return (speed - w) / (COMPLIANCE * slope)

    w = solve_ivp(rate, (0.0, t[-1]), [v[0]], "Radau", t, rtol=1e-7, atol=1e-10, max_step=PERIOD).y[0]
    exact = DAMPING * w + friction * np.tanh(w / 2e-3) + MASS * a + OFFSET
    names = ("inner-friction", "series-compliance") if friction else ("series-compliance",)
    composition, vector = composed(names, [friction, 2e-3, COMPLIANCE] if friction else [COMPLIANCE])
    got = composition.predict(Signals(PERIOD, {"velocity": v, "displacement": x}, 0 * t), vector)
    inside = slice(200, -5)
    assert np.sqrt(np.mean((got - exact)[inside] ** 2)) < 0.01 * exact.std()


@pytest.mark.parametrize("names, values", [(("series-compliance",), [0.0]), (("asymmetry",), [0.0]),
                                           (("asymmetry", "series-compliance"), [0.0, 0.0])])
def test_is_the_baseline_to_the_last_bit_without_them(names: tuple[str, ...], values: list[float]) -> None:
    t, x, v, _ = motion(500)
    s = Signals(PERIOD, {"velocity": v, "displacement": x}, 0 * t)
    composition, vector = composed(names, values)
    np.testing.assert_array_equal(composition.predict(s, vector), composition.baseline.core(vector[:3])(s))


@pytest.mark.slow
def test_what_a_mass_changes_is_the_acceleration_whatever_is_in_series() -> None:
    t, x, v, a = motion(2000)
    s = Signals(PERIOD, {"velocity": v, "displacement": x}, 0 * t)
    composition, vector = composed(("asymmetry", "series-compliance", "backlash"), [0.3, 2e-4, 5.0, COMPLIANCE])
    of_mass = composition.sensitivities(s, vector)[:, 1]
    np.testing.assert_allclose(of_mass[5:-5], a[5:-5], atol=0.01 * np.abs(a).max())


@pytest.mark.slow
def test_of_a_motion_that_never_turns() -> None:
    """A slow compression: the velocity never changes its sign, and nothing comes after a reversal."""
    rng, t = np.random.default_rng(1), 0.01 * np.arange(3000)
    v = 0.01 + 0.004 * np.sin(0.7 * t) + 0.003 * np.sin(2.9 * t)
    force = 900 * v + 3e4 * v**2 + 0.05 * rng.normal(size=t.size)
    record = Record({"velocity": v, "displacement": np.cumsum(v) * 0.01, "force": force}, sample_time=0.01,
                    units={"velocity": "m/s", "displacement": "m", "force": "N"})
    few = tuple(CAUSES[n] for n in ("quadratic-loss", "coulomb-friction", "gas-stiffness"))
    found = lpv.diagnose(record, "linear", few)
    assert found.verdict and not any(w.where == "after a reversal" for w in found.wrong)
