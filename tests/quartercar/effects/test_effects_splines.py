"""Splines on a uniform clock, against scipy's and the functions that they go through."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.ndimage import shift

from quartercar.effects.splines import END, spline_resampled, spline_shifted


@pytest.fixture
def walk() -> np.ndarray:
    return np.cumsum(np.random.default_rng(0).standard_normal(400))


@pytest.mark.parametrize("samples", [0.0, 0.2, 3.5, 7.999, -2.4, 5.0, 41.3, -41.3, 399.5, 1e4, -1e4])
def test_reading_later_is_shifting(walk: np.ndarray, samples: float) -> None:
    np.testing.assert_allclose(spline_shifted(walk, samples), shift(walk, -samples, order=3, mode="nearest"), atol=1e-6)


@pytest.mark.parametrize("finer", [2, 3, 7])
def test_a_faster_clock_is_the_cubic_spline_away_from_the_ends(walk: np.ndarray, finer: int) -> None:
    at = np.arange(finer * walk.size) / finer
    inside = slice(2 * END * finer, -2 * END * finer)
    through = CubicSpline(np.arange(walk.size), walk)(at)
    np.testing.assert_allclose(spline_resampled(walk, finer)[inside], through[inside], atol=1e-12)


def test_what_lies_far_beyond_the_ends_changes_nothing(walk: np.ndarray) -> None:
    """The odd reflection goes on as far as it has an effect."""
    longer = np.pad(walk, 100, mode="reflect", reflect_type="odd")
    inside = spline_resampled(longer, 3)[300:-302]  # but for the last sample, which is held
    np.testing.assert_allclose(spline_resampled(walk, 3)[:-2], inside, rtol=0, atol=1e-12)


def test_a_faster_clock_keeps_the_samples_and_goes_straight_at_the_ends() -> None:
    line = np.linspace(1.0, 5.0, 60)
    finer = spline_resampled(line, 4)
    assert np.array_equal(finer[::4], line) and np.all(finer[-4:] == line[-1])
    np.testing.assert_allclose(finer[:-4], np.interp(np.arange(236) / 4, np.arange(60), line), atol=1e-8)
