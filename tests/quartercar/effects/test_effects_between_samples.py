"""A law without memory asked between the samples."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, guo, motion

from lpvid.baselines.signals import Signals
from lpvid.effects.composition import Composition
from quartercar.effects.between_samples import FAST, FINEST, between, times_as_fast
from quartercar.effects.compliance import SeriesCompliance
from quartercar.effects.structure import acceleration

FINER = 4


def sampled(current: np.ndarray) -> Signals:
    x, v = motion(PERIOD * np.arange(current.size))
    return Signals(PERIOD, {"displacement": x, "velocity": v, "current": current}, np.zeros(current.size))


def test_samples_stay_and_motion_runs_on_between_them() -> None:
    s = sampled(np.repeat([0.0, 1.0, 0.5, 2.0], 500))
    fine = between(s, FINER)
    assert fine.sample_time == pytest.approx(PERIOD / FINER)
    for channel in s.channels:
        np.testing.assert_allclose(fine[channel][::FINER], s[channel], atol=1e-12)
    x, v = motion(PERIOD / FINER * np.arange(FINER * 2000))
    inside = slice(FINER * 3, -FINER * 3)
    np.testing.assert_allclose(fine["displacement"][inside], x[inside], atol=1e-4 * x.std())
    np.testing.assert_allclose(fine["velocity"][inside], v[inside], atol=1e-3 * v.std())
    assert between(s, FINER) is fine and between(s, 1) is s


@pytest.mark.parametrize(("lengths", "steps"), [((200, 300, 100, 250), True), ((201, 298, 103, 248), False)])
def test_a_current_steps_between_samples_only_where_it_keeps_their_clock(lengths: tuple[int, ...], steps: bool) -> None:
    s = sampled(np.repeat([0.0, 1.0, 0.5, 2.0], lengths))
    fine = between(s, FINER)["current"]
    assert set(np.unique(fine)) == {0.0, 0.5, 1.0, 2.0} if steps else np.unique(fine).size > 4
    np.testing.assert_array_equal(fine[::FINER], s["current"])


def test_a_law_is_asked_as_fast_as_that_needs() -> None:
    s = sampled(np.ones(100))
    assert times_as_fast(guo(), s) == np.ceil(FAST * PERIOD)
    assert times_as_fast(guo(), Signals(1 / 50, s.channels, s.output)) == FINEST
    assert times_as_fast(guo(), Signals(1e-4, s.channels, s.output)) == 1


def test_elements_in_series_are_marched_along_the_samples_only() -> None:
    """Between them the core's own kinks stay, and the change by the elements runs straight."""
    s = sampled(np.repeat([0.0, 1.0, 0.5, 2.0], 100))
    fine = between(s, FINER)
    for compliance in (0.0, 1e-9, 2e-6):
        composition = Composition(guo(), (SeriesCompliance(),))
        vector = composition.neutral
        vector[composition.places[0].start] = compliance
        rigid, rigid_fine = (guo().core(guo().vector)(x) for x in (s, fine))
        got, along = composition.predict(fine, vector), composition.predict(s, vector)
        np.testing.assert_allclose(got[::FINER], along, atol=1e-9 * np.abs(along).max())
        np.testing.assert_allclose(got - rigid_fine, fine.refined(along - rigid), atol=1e-9 * np.abs(along).max())


def test_an_acceleration_moves_in_the_band_of_the_record(rng: np.random.Generator) -> None:
    x, v = motion(PERIOD * np.arange(4000))
    s = Signals(PERIOD, {"displacement": x, "velocity": v + 1e-3 * rng.standard_normal(v.size)}, np.zeros(v.size))
    got = acceleration(between(s, FINER))
    np.testing.assert_array_equal(got[::FINER], acceleration(s))
