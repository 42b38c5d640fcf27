"""Intervals hold the pull of a filter of all channels that nothing else shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from helpers.effect_signals import PERIOD, guo, motion
from scipy.signal import bilinear, lfilter

from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.intervals import deviations, of_effect
from lpvid.diagnosis.noise import WHITE
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import covariance, refit
from lpvid.diagnosis.selection import ForwardSelection
from lpvid.diagnosis.signals import Signals
from quartercar.effects.friction_gas import GasStiffness
from quartercar.effects.shared_filter import SharedFilter

FINE, TRUE = 16, 2000.0


def plain(x: np.ndarray) -> np.ndarray:
    return x[::FINE]


def filtered(x: np.ndarray) -> np.ndarray:
    """Behind a Butterworth filter of 80 Hz at the finer clock."""
    t = 1 / (2 * np.pi * 80)
    b, a = bilinear([1.0], [t**2, np.sqrt(2) * t, 1.0], FINE / PERIOD)
    return (lfilter(b, a, x - x[0]) + x[0])[::FINE]


def search_of(chain: Callable[[np.ndarray], np.ndarray], candidates: tuple[Effect, ...],
              hold: int = 6000) -> ForwardSelection:
    """Guo's law with a gas spring, recorded through a chain, and fitted without it; the current rests so long."""
    rng = np.random.default_rng(3)
    gas = GasStiffness()
    composition = Composition(guo(), (gas,))
    t = PERIOD / FINE * np.arange(6000 * FINE)
    x, v = motion(t)
    current = np.repeat(1 + 0.7 * (-1.0) ** np.arange(6000 // hold), hold * FINE)
    fine = Signals(PERIOD / FINE, {"displacement": x, "velocity": v, "current": current}, np.zeros(t.size))
    vector = composition.neutral
    vector[composition.places[0].start] = TRUE
    force = chain(composition.predict(fine, vector))
    s = Signals(PERIOD, {c: chain(value) for c, value in fine.channels.items()},
                force + rng.standard_normal(force.size))
    problem = DiagnosisProblem((s,), Blocks.of((s,)), WHITE)
    begun = vector.copy()
    begun[composition.places[0].start] = 0.7 * TRUE
    return ForwardSelection(problem, refit(problem, composition, begun), candidates, rng, lambda text: None)


def described(search: ForwardSelection) -> tuple[float, float, float]:
    """Error of the stiffness, its standard error by the sensitivities alone, and the one that is told [N/m]."""
    place = search.fit.composition.places[0]
    statistical = float(np.sqrt(covariance(search.problem, search.fit)[place.start, place.start]))
    sure = of_effect(search, deviations(search), search.fit.composition.effects[0])
    return float(abs(search.fit.vector[place.start] - TRUE)), statistical, float(sure[0])


def test_behind_a_filter_the_interval_is_wide_enough() -> None:
    error, statistical, sure = described(search_of(filtered, (SharedFilter(),)))
    assert error > 3 * statistical, "the sensitivities alone are too sure of it"
    assert error < 2 * sure


def test_edges_of_the_current_count_where_the_force_says_little() -> None:
    """Where they come thick and fast the filter is undone badly and fits no better; it is there all the same."""
    error, statistical, sure = described(search_of(filtered, (SharedFilter(),), hold=30))
    assert error > 3 * statistical and error < 2 * sure


def test_without_one_it_stays_about_what_it_was() -> None:
    error, statistical, sure = described(search_of(plain, (SharedFilter(),)))
    assert error < 3 * statistical and statistical <= sure < 1.6 * statistical


def test_nothing_pulls_where_the_filter_is_no_candidate() -> None:
    _, statistical, sure = described(search_of(filtered, ()))
    assert sure == statistical
