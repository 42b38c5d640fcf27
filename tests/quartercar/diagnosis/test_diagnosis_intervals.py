"""Intervals hold what the clock leaves open of a lag, beside the scatter of the fit."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, guo, motion

from lpvid.baselines.signals import Signals
from lpvid.diagnosis import refitting
from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.intervals import covariance
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from quartercar.effects.electrical import CommandDelay
from quartercar.effects.friction_gas import GasStiffness


def fitted(effect: Effect, values: tuple[float, ...], rng: np.random.Generator) -> tuple[DiagnosisProblem, Refit]:
    """Guo's law with an effect, a current in steps that last, 1 N of noise."""
    x, v = motion(PERIOD * np.arange(6000))
    current = np.repeat(rng.uniform(0.0, 2.0, 60), 100)
    s = Signals(PERIOD, {"displacement": x, "velocity": v, "current": current}, np.zeros(6000))
    composition = Composition(guo(), (effect,))
    vector = composition.neutral
    vector[composition.places[0]] = values
    s = Signals(PERIOD, s.channels, composition.predict(s, vector) + rng.standard_normal(6000))
    problem = DiagnosisProblem((s,), Blocks.of((s,)))
    return problem, refit(problem, composition, vector)


def test_a_stiffness_has_no_error_of_the_clock(rng: np.random.Generator) -> None:
    problem, fit = fitted(GasStiffness(), (2000.0,), rng)
    np.testing.assert_array_equal(covariance(problem, fit), refitting.covariance(problem, fit))


def test_a_delay_of_held_samples_is_known_to_a_sample(rng: np.random.Generator) -> None:
    """Uniform over a sample: T/sqrt(12), and no covariance with what derivatives give."""
    problem, fit = fitted(CommandDelay(), (0.01, 0.0), rng)
    place = fit.composition.places[0].start
    found = covariance(problem, fit)
    assert found[place, place] == pytest.approx(PERIOD**2 / 12)
    assert not np.delete(found[place], place).any() and not np.delete(found[:, place], place).any()
    assert abs(fit.vector[place] - 0.01) < 1.96 * np.sqrt(found[place, place])
