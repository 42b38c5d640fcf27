"""Road profiles against the formulas of their spectra."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from quartercar import roads

SPEED = 25 * roads.MILES_PER_HOUR


def test_smooth_highway_matches_the_thesis(rng):
    # 440 in/s; integrals of the spectrum: rms 3.62 mm and 0.066 m/s; peak 0.5 in printed, median 9.7 mm computed
    assert pytest.approx(440 * 0.0254, rel=1e-12) == SPEED
    runs = [roads.profile(15360, 512.0, roads.WONG["smooth-highway"], speed=SPEED, rng=rng) for _ in range(40)]
    assert np.sqrt(np.mean(np.square(runs))) == pytest.approx(3.62e-3, rel=0.03)
    velocity = np.diff(runs, axis=1) * 512
    assert np.sqrt(np.mean(velocity**2)) == pytest.approx(0.066, rel=0.03)
    assert 8.4e-3 < np.median(np.abs(runs).max(axis=1)) < 12.7e-3


def test_wong_units_agree():
    # the table in feet, converted by C' = 35.3147·0.3048^N·C, up to the 4 % (14 % for highways) of the printed digits
    feet = {"smooth-runway": 1.6e-11, "rough-runway": 2.3e-5, "smooth-highway": 1.2e-6, "highway-with-gravel": 1.1e-5,
            "pasture": 1.6e-3, "ploughed-field": 3.4e-3}
    for name, printed in feet.items():
        road = roads.WONG[name]
        converted = 35.3147 * 0.3048**road.exponent * road.coefficient
        assert converted == pytest.approx(printed, rel=0.17 if "highway" in name else 0.045)


def test_profile_spectrum_in_bands(rng):
    power = np.zeros(9)
    road = roads.iso_roughness("B")
    for _ in range(30):
        z = roads.profile(10240, 512.0, road, speed=20.0, rng=rng, f_min=0.5, f_max=20.5, lines=200)
        window = np.hanning(z.size)
        raw = 2 * np.abs(np.fft.rfft(z * window)) ** 2 / (512.0 * np.sum(window**2))
        power += raw[40:400].reshape(9, 40).mean(axis=1) / 30
    f = np.arange(40, 400).reshape(9, 40) / 20.0
    formula = (64e-6 * 0.1**2 * 20.0 / f**2).mean(axis=1)  # G(f) = G_d(n0) n0² V / f²
    np.testing.assert_allclose(power, formula, rtol=0.12)
    assert (power / formula).mean() == pytest.approx(1.0, abs=0.04)


def test_shaping_filter_variance_and_spectrum(rng):
    from scipy.signal import welch

    z = roads.iso8608(2_000_000, 200.0, "B", speed=20.0, rng=rng)
    assert np.var(z) == pytest.approx(1.005e-4, rel=0.08)  # πn0²G_d/(2n00)
    f, power = welch(z, 200.0, nperseg=8192)
    band = (f > 0.5) & (f < 20)
    corner = 0.01 * 20.0
    formula = 64e-6 * 0.1**2 * 20.0 / (f[band] ** 2 + corner**2)
    assert np.mean(power[band] / formula) == pytest.approx(1.0, abs=0.03)


def test_shaping_filter_starts_in_steady_state(rng):
    starts = np.array([roads.iso8608(2, 512.0, "A", speed=10.0, rng=rng)[0] for _ in range(4000)])
    assert np.var(starts) == pytest.approx(np.pi * 0.01 * 16e-6 / 0.02, rel=0.1)


def test_shaping_filter_recursion_is_exact():
    # the same draws through a plain loop
    z = roads.iso8608(150_000, 512.0, "C", speed=30.0, rng=np.random.default_rng(4))
    g = np.random.default_rng(4).standard_normal(150_001)
    a = np.exp(-2 * np.pi * 0.01 * 30.0 / 512.0)
    spread = np.sqrt(np.pi * 0.01 * 256e-6 / 0.02)
    state, expected = spread * g[150_000], np.empty(150_000)
    for k in range(150_000):
        state = state if k == 0 else a * state + spread * np.sqrt(1 - a * a) * g[k]
        expected[k] = state
    np.testing.assert_allclose(z, expected, rtol=1e-9, atol=1e-12)


def test_iso_classes_are_factors_of_four():
    assert roads.ISO_CLASSES["A"] == 16e-6
    ratios = np.array([roads.ISO_CLASSES[k] for k in "BCDEFGH"]) / [roads.ISO_CLASSES[k] for k in "ABCDEFG"]
    np.testing.assert_allclose(ratios, 4.0)
    assert roads.surface("iso-c").psd(np.array([2.0]), 10.0)[0] == pytest.approx(256e-6 * 0.01 * 10.0 / 4.0)


def test_unknown_names_are_refused(rng):
    with pytest.raises(InputError, match="did you mean 'smooth-highway'"):
        roads.surface("smooth-higway")
    with pytest.raises(InputError, match="class"):
        roads.iso_roughness("Z")
    with pytest.raises(InputError, match="speed"):
        roads.profile(10, 512.0, roads.WONG["pasture"], speed=0.0, rng=rng)
