"""A lag of the force takes the sensor's noise out of the simulation: that alone must not count as a lag."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, guo, motion
from scipy.signal import lsim, lti

from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.deciding import judge, out_of_fold
from lpvid.diagnosis.input_noise import _quiet, gain_without_input_noise
from lpvid.diagnosis.noise import WHITE, Whitening
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.selection import ForwardSelection
from lpvid.diagnosis.signals import Signals
from lpvid.diagnosis.spectra import without_noise
from quartercar.effects.hydraulics import ValveDynamics
from quartercar.effects.measurement import OneSidedFilter

LAG = np.array([0.35, 25.0, 0.5])
NOISE = 0.004
"""of the recorded velocity [m/s]"""


def fits(rng: np.random.Generator, valve: bool, velocity: np.ndarray | None = None, noise: float = NOISE
         ) -> tuple[DiagnosisProblem, Refit, Refit]:
    """Guo's law with a valve's dynamics and without, fitted to a force whose valve lags or does not."""
    x, v = motion(PERIOD * np.arange(6000))
    v = v if velocity is None else velocity
    current = np.ones(v.size)
    clean = Signals(PERIOD, {"displacement": x, "velocity": v, "current": current}, np.zeros(v.size))
    with_valve, alone = Composition(guo(), (ValveDynamics(),)), Composition(guo())
    vector = with_valve.neutral
    if valve:
        vector[with_valve.places[0]] = LAG
    force = with_valve.predict(clean, vector) + rng.standard_normal(v.size)
    recorded = Signals(PERIOD, {**clean.channels, "velocity": v + noise * rng.standard_normal(v.size)}, force)
    problem = DiagnosisProblem((recorded,), Blocks.of((recorded,)), WHITE)
    begun = with_valve.neutral
    begun[with_valve.places[0]] = LAG
    return problem, refit(problem, with_valve, begun), refit(problem, alone, alone.neutral)


def objections(problem: DiagnosisProblem, fit: Refit) -> tuple[str, ...]:
    """What the gates say against the valve."""
    valve, = fit.composition.effects
    search = ForwardSelection(problem, fit, (valve,), np.random.default_rng(0), lambda text: None)
    return judge(search, valve, out_of_fold(problem, fit), ()).objections


def test_a_lag_that_only_takes_the_noise_away_is_told(rng: np.random.Generator) -> None:
    problem, fit, rest = fits(rng, valve=False)
    assert rest.cost - fit.cost > 100 * fit.variance, "it wins by far all the same"
    assert gain_without_input_noise(problem, fit, rest) < 0.1
    assert any("noise in the recorded motion" in stated for stated in objections(problem, fit))


def test_a_lag_of_the_motion_is_one(rng: np.random.Generator) -> None:
    problem, fit, rest = fits(rng, valve=True, noise=NOISE / 4)
    assert gain_without_input_noise(problem, fit, rest) > 0.7
    assert objections(problem, fit) == ()


@pytest.mark.parametrize("offset", [0.03, -1.0])
def test_where_the_motion_is_measured_from_does_not_matter(offset: float, rng: np.random.Generator) -> None:
    x, v = motion(PERIOD * np.arange(4096))
    noisy = x + 1e-4 * rng.standard_normal(x.size)
    here, there = (Signals(PERIOD, {"displacement": noisy + far, "velocity": v}, v) for far in (0.0, offset))
    quiet, moved = (without_noise(s, "displacement") for s in (here, there))
    np.testing.assert_allclose(moved - offset, quiet, atol=1e-9)
    assert np.std(quiet - x) < 0.5 * np.std(noisy - x)


@pytest.mark.parametrize("noise", [0.0, 2e-3])
def test_a_filter_that_is_undone_by_much_stays_one(noise: float, rng: np.random.Generator) -> None:
    """Of 5 Hz, so that the top of the band is raised two thousandfold and whatever has no place there with it."""
    t, period = PERIOD * np.arange(6000), 0.03
    x, v = motion(t)
    current = np.ones(t.size)
    force = guo().core(guo().vector)(Signals(PERIOD, {"displacement": x, "velocity": v, "current": current}, v))
    system = lti([1.0], [period**2, 1.4142 * period, 1.0])
    late = {c: lsim(system, m, t)[1] for c, m in (("displacement", x), ("velocity", v))}
    late = {c: m + noise * m.std() * rng.standard_normal(t.size) for c, m in late.items()}
    recorded = Signals(PERIOD, {**late, "current": current}, force + rng.standard_normal(t.size))
    problem = DiagnosisProblem((recorded,), Blocks.of((recorded,)), Whitening(np.array([1.0, -0.95]), 1.0))
    filtered, alone = Composition(guo(), (OneSidedFilter(),)), Composition(guo())
    begun = filtered.neutral
    begun[filtered.places[0]] = period, 0.7071, 0.0
    fit, rest = refit(problem, filtered, begun), refit(problem, alone, alone.neutral)
    assert gain_without_input_noise(problem, fit, rest) == pytest.approx(1.0, abs=1e-3)


def test_at_the_ends_a_channel_is_as_quiet_as_inside(rng: np.random.Generator) -> None:
    """What lies beyond a record is guessed: continued by its reflection it erred there by ten times the noise."""
    t = PERIOD * np.arange(4096)
    v = np.sin(2 * np.pi * (1.0 + 2.4 * t) * t)
    s = Signals(PERIOD, {"velocity": v + 2e-3 * rng.standard_normal(t.size)}, v)
    error = without_noise(s, "velocity") - v
    assert np.std(error[-40:]) < 1.5e-3 and np.std(error[:40]) < 1.5e-3 and np.std(error[400:-400]) < 1.5e-3


def test_edges_are_no_noise(rng: np.random.Generator) -> None:
    voltage = np.repeat(rng.uniform(0, 5, 60), 50) + 0.01 * rng.standard_normal(3000)
    s = Signals(PERIOD, {"voltage": voltage}, voltage)
    assert _quiet(s, "voltage") is s["voltage"]


def test_a_white_input_is_no_noise(rng: np.random.Generator) -> None:
    """What excites up to half the sample rate has nothing at the top of its spectrum that is only the sensor's."""
    problem, fit, rest = fits(rng, valve=True, velocity=0.1 * rng.standard_normal(6000), noise=0.0)
    assert gain_without_input_noise(problem, fit, rest) == pytest.approx(1.0, abs=0.05)
