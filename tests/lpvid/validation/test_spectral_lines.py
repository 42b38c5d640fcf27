"""Lines in the spectrum of an error that the motion does not have: found, sized, and not found where there is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

import lpvid as lpv
from lpvid.validation.regimes import FreeRunStretch, regimes
from lpvid.validation.spectral_lines import spectral_lines

RATE, N = 500.0, 3000
T = np.arange(N) / RATE


def by_least_squares(error: np.ndarray, frequency: float) -> float:
    """Amplitude of a sinusoid of that frequency."""
    wave = np.exp(2j * np.pi * frequency * T)
    coefficients = np.linalg.lstsq(np.column_stack([wave.real, wave.imag]), error, rcond=None)[0]
    return float(np.hypot(*coefficients))


def test_lines_between_the_frequencies_of_the_transform_are_sized(rng: np.random.Generator) -> None:
    error = 3 * np.sin(2 * np.pi * 17.23 * T + 1) + np.cos(2 * np.pi * 50.04 * T) + rng.standard_normal(N)
    found = spectral_lines(error, [], 1 / RATE)
    assert [x.frequency for x in found] == pytest.approx([17.23, 50.04], abs=0.1 * RATE / N)
    assert [x.amplitude for x in found] == pytest.approx(
        [by_least_squares(error, x.frequency) for x in found], rel=0.05)
    assert found[0].power == pytest.approx(4.5, rel=0.05)


@pytest.mark.thinned(3, "seconds")
@pytest.mark.parametrize("colour", ["white", "walk", "band"])
def test_noise_has_no_lines_whatever_its_colour(colour: str) -> None:
    """At most twice the level, of 200 draws; the band of noise is 2 Hz wide, a dozen times the resolution."""
    band = butter(2, [19.0, 21.0], "bandpass", fs=RATE)
    of = {"white": lambda e: e, "walk": np.cumsum, "band": lambda e: lfilter(*band, e)}[colour]
    alarms = [bool(spectral_lines(of(np.random.default_rng(k).standard_normal(N)), [], 1 / RATE)) for k in range(200)]
    assert np.mean(alarms) <= 0.1


def lines_beside(v: np.ndarray, error: np.ndarray) -> list[str]:
    """Lines among the regimes of a model that has none of an error."""
    found = regimes([FreeRunStretch(v + error, v, v, np.empty((v.size, 0)))], "u", (), 1 / RATE)
    return [r.where for r in found if "line" in r.where]


@pytest.mark.parametrize("part", [lambda v: v**3, np.sign, np.abs, lambda v: np.tanh(5 * v - 1)])
def test_harmonics_of_the_motion_are_no_lines(part, rng: np.random.Generator) -> None:
    v = np.sin(2 * np.pi * 3.1 * T)
    assert lines_beside(v, part(v) + 0.02 * rng.standard_normal(N)) == []


def test_neither_are_those_of_a_sum_of_sines(rng: np.random.Generator) -> None:
    v = np.sum([np.sin(2 * np.pi * k / 2.0 * T + p) for k, p in enumerate(rng.uniform(0, 6, 19), 1)], axis=0)
    assert lines_beside(v, np.tanh(v) + 0.02 * rng.standard_normal(N)) == []
    assert spectral_lines(rng.standard_normal(8), [], 1 / RATE) == [] == spectral_lines(np.zeros(N), [v], 1 / RATE)


def test_a_line_is_a_regime_of_its_own(rng: np.random.Generator) -> None:
    """In two records of which it holds nine tenths of the error; the model does not have it."""
    stretches = []
    for n in (N, 2000):
        u, t = rng.standard_normal(n), np.arange(n) / RATE
        error = np.sqrt(1.8) * np.sin(2 * np.pi * 33.3 * t + n) + np.sqrt(0.1) * rng.standard_normal(n)
        stretches.append(FreeRunStretch(10 * u + error, 10 * u, u, np.empty((n, 0))))
    line, = (r for r in regimes(stretches, "u", (), 1 / RATE) if "line" in r.where)
    frequency = line.where.removeprefix("a line at ").removesuffix(" Hz that no input has")
    assert float(frequency) == pytest.approx(33.3, abs=0.05)
    assert line.error_share == pytest.approx(0.9, abs=0.03) and line.share == pytest.approx(0.9 / 101, rel=0.1)


def test_a_line_of_any_input_is_none_of_the_error(rng: np.random.Generator) -> None:
    u, second = rng.standard_normal(N), np.sin(2 * np.pi * 33.3 * T)
    for further, count in ((None, 1), (second[:, None], 0)):
        stretch = FreeRunStretch(u + second, u, u, np.empty((N, 0)), further)
        assert sum("line" in r.where for r in regimes([stretch], "u", (), 1 / RATE)) == count


def test_a_validation_states_a_line_with_its_frequency(rng: np.random.Generator) -> None:
    """A gain of two without memory, and a tone of half the output's rms: its share of the error and of the output."""
    model = lpv.LPVTransferFunction.siso([[]], [[2.0]], lpv.Polynomial(), 1 / RATE, inputs=("u",), outputs=("y",))
    u = rng.standard_normal(N)
    y = 2 * u + np.sqrt(2) * np.sin(2 * np.pi * 24.4 * T) + 0.1 * rng.standard_normal(N)
    found = lpv.validate(model, lpv.Record({"u": u, "y": y}, sample_time=1 / RATE))
    assert "worst where a line at 24.4 Hz that no input has: 99 % of the free-run error in 20 % of the measured power" \
        in str(found)


def test_a_constant_output_has_no_power_of_which_a_line_is_a_share(rng: np.random.Generator) -> None:
    """A model that swings where nothing was measured; its own output has the line, so it is no line."""
    swing = np.sin(2 * np.pi * 24.4 * T) + 0.01 * rng.standard_normal(N)
    still = FreeRunStretch(np.zeros(N), -swing, None, np.empty((N, 0)))
    assert not any("line" in r.where for r in regimes([still], "u", (), 1 / RATE))
    assert spectral_lines(np.zeros(0), [], 1 / RATE) == []
