"""The share of motion in a channel that was made of a recorded one."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, without_noise

from lpvid.baselines.signals import Signals
from lpvid.baselines.spectra import _derived, noisier, weighed_alike
from quartercar.effects.between_samples import between
from quartercar.effects.splines import spline_shifted


@pytest.fixture
def recorded() -> Signals:
    """A slow motion, and the noise of its sensor."""
    t = PERIOD * np.arange(8192)
    v = np.sin(2 * np.pi * 1.3 * t) + 0.5 * np.sin(2 * np.pi * 3.1 * t)
    return Signals(PERIOD, {"velocity": v + 0.05 * np.random.default_rng(0).standard_normal(t.size)}, np.zeros(t.size))


def smooth(s: Signals) -> Signals:
    """Less noise at high frequencies, as a channel has that was read between its samples or low-passed."""
    return s.replace(velocity=np.convolve(s["velocity"], [0.25, 0.5, 0.25], mode="same"))


def test_what_was_made_of_a_channel_has_its_noise_where_that_has_it(recorded: Signals) -> None:
    made = weighed_alike(smooth(recorded), recorded)
    again = weighed_alike(made.replace(velocity=spline_shifted(made["velocity"], 3.0)), made)
    inside = slice(1000, -1000)
    expected = np.convolve(without_noise(recorded, "velocity"), [0.25, 0.5, 0.25], mode="same")
    np.testing.assert_allclose(without_noise(made, "velocity")[inside], expected[inside], atol=2e-3)
    np.testing.assert_allclose(without_noise(again, "velocity")[inside], np.roll(expected, -3)[inside], atol=2e-3)


def test_a_channel_of_its_own_is_looked_at_anew(recorded: Signals) -> None:
    """The top of its spectrum, which the smoothing took away, no longer tells the noise below it."""
    made = smooth(recorded)
    left = without_noise(made, "velocity") - without_noise(weighed_alike(smooth(recorded), recorded), "velocity")
    assert np.std(left) > 1e-2


def test_on_a_faster_clock_there_is_no_motion_beyond_the_recorded_band(recorded: Signals) -> None:
    fine = between(recorded, 4)
    quiet = without_noise(fine, "velocity")
    inside = slice(800, -800)
    np.testing.assert_allclose(quiet[::4][200:-200], without_noise(recorded, "velocity")[200:-200], atol=3e-3)
    power = np.abs(np.fft.rfft(quiet[inside] * np.hanning(quiet[inside].size))) ** 2
    frequency = np.fft.rfftfreq(quiet[inside].size, fine.sample_time)
    assert power[frequency > 260].sum() < 1e-6 * power.sum()


def test_as_much_noise_again_is_added(recorded: Signals) -> None:
    added = noisier(recorded, np.random.default_rng(1))["velocity"] - recorded["velocity"]
    assert added.std() == pytest.approx(0.05, rel=0.05)


def test_noise_of_a_derived_channel_is_that_of_its_source_differentiated(recorded: Signals) -> None:
    position = np.cumsum(recorded["velocity"] - 0.0) * PERIOD + 1e-4 * np.random.default_rng(2).standard_normal(8192)
    both = recorded.replace(displacement=position, velocity=np.gradient(position, PERIOD))
    again = noisier(both, np.random.default_rng(1))
    added = {c: again[c] - both[c] for c in ("displacement", "velocity")}
    assert added["displacement"].std() == pytest.approx(1e-4, rel=0.15)
    np.testing.assert_allclose(added["velocity"], np.gradient(added["displacement"], PERIOD))


@pytest.mark.seconds
@pytest.mark.filterwarnings("error")
def test_a_record_on_a_clock_of_seconds_has_no_noise_to_compare() -> None:
    """Stamps in ms that are named s: .4 Hz, and no line of the spectrum above the band that moves."""
    t = 2.5 * np.arange(1200)
    x = 0.01 * np.sin(0.008 * t) + 0.003 * np.sin(0.023 * t)
    s = Signals(2.5, {"displacement": x, "velocity": np.gradient(x, 2.5)}, np.zeros(t.size))
    assert not _derived(s, "velocity", "displacement")
