"""What lies beyond the ends of a record: what is done to a spectrum must err there no more than inside."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, without_noise

from lpvid.baselines.signals import Signals
from lpvid.baselines.spectra import before_filter, derivative
from lpvid.condition.continuation import Continued, ahead

T = PERIOD * np.arange(5120)
AT_A_PEAK = np.cos(2 * np.pi * 1.3 * T) + 0.5 * np.cos(2 * np.pi * 4.1 * T)
"""tones at a peak, where a reflection that keeps the slope turns the curvature round"""
RATE = -2 * np.pi * (1.3 * np.sin(2 * np.pi * 1.3 * T) + 0.5 * 4.1 * np.sin(2 * np.pi * 4.1 * T))


def at_the_ends(error: np.ndarray) -> float:
    """Root mean square over 0.1 s at either end."""
    count = round(0.1 / PERIOD)
    return float(np.sqrt(np.mean(np.concatenate([error[:count], error[-count:]]) ** 2)))


def of(v: np.ndarray) -> Signals:
    return Signals(PERIOD, {"velocity": v}, np.zeros(v.size))


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.05])
def test_tones_are_no_worse_at_the_ends(noise: float, rng: np.random.Generator) -> None:
    s = of(AT_A_PEAK + noise * rng.standard_normal(T.size))
    assert at_the_ends(without_noise(s, "velocity") - AT_A_PEAK) < max(0.75 * noise, 1e-4)
    assert at_the_ends(derivative(s, "velocity") - RATE) < max(1.5 * noise, 1e-3) * RATE.std()


def test_a_filter_is_undone_at_the_ends_as_inside() -> None:
    t = 0.01
    omega = np.array([1.3, 4.1]) * 2 * np.pi
    gains = 1 / (1 + 1.4 * t * 1j * omega - (t * omega) ** 2)
    late = sum(np.real(a * g * np.exp(1j * w * T)) for a, g, w in zip((1.0, 0.5), gains, omega, strict=True))
    error = before_filter(of(late), "velocity", (1.4 * t, t**2)) - AT_A_PEAK
    assert np.abs(error).max() < 0.002


def test_what_follows_stays_bounded_on_a_much_finer_clock() -> None:
    """Where all poles crowd at one place, rounding blows up what a direct recursion predicts."""
    t = PERIOD / 64 * np.arange(40000)
    x = np.cos(9 * t) + 0.3 * np.sin(31 * t)
    assert np.abs(ahead(x, 20000)).max() < 2.0


def test_a_constant_goes_on_and_chance_dies_away(rng: np.random.Generator) -> None:
    still = Continued.predicted(np.full(400, 3.0), PERIOD)
    np.testing.assert_allclose(still.spectrum[1:], 0.0, atol=1e-9)
    np.testing.assert_allclose(still.back(still.spectrum), 3.0, rtol=1e-12)
    assert np.abs(ahead(rng.standard_normal(4000), 2000)[-200:]).max() < 0.01


@pytest.mark.parametrize("predicted", [True, False])
@pytest.mark.parametrize("finer", [1, 4])
def test_the_way_to_the_spectrum_and_back_is_the_identity(predicted: bool, finer: int) -> None:
    found = Continued.predicted(AT_A_PEAK, PERIOD) if predicted else Continued.reflected(AT_A_PEAK, PERIOD, 0.1)
    back = found.back(found.spectrum, finer)
    assert back.size == finer * AT_A_PEAK.size
    np.testing.assert_allclose(back[::finer], AT_A_PEAK, atol=1e-7)
