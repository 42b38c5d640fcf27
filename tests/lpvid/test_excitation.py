"""Test signals against golden bits, closed forms and spectra."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid import excitation
from lpvid.errors import InputError

RATE = 512.0


def test_register_golden_bits():
    bits = "".join(map(str, excitation.register_bits(7, 32)))
    assert bits == "11111110000001000001100001010001"


@pytest.mark.parametrize("cells", sorted(excitation.REGISTER_TAPS))
def test_register_has_full_period(cells):
    period = 2**cells - 1
    bits = excitation.register_bits(cells, 2 * period)
    np.testing.assert_array_equal(bits[:period], bits[period:])
    assert bits[:period].sum() == 2 ** (cells - 1)
    padded = np.concatenate([bits[:period], bits[: cells - 1]])
    words = np.lib.stride_tricks.sliding_window_view(padded, cells) @ (1 << np.arange(cells))
    assert np.unique(words).size == period  # every word but zero, once


def test_register_autocorrelation_is_two_valued():
    signal = 2.0 * excitation.register_bits(9, 511) - 1.0
    correlation = np.fft.ifft(np.abs(np.fft.fft(signal)) ** 2).real
    np.testing.assert_allclose(correlation[0], 511)
    np.testing.assert_allclose(correlation[1:], -1.0, atol=1e-9)


def test_register_refuses_unknown_cells_and_zero_start():
    with pytest.raises(InputError, match="7, 9, 10, 11, 15"):
        excitation.register_bits(8, 10)
    with pytest.raises(InputError, match="start"):
        excitation.register_bits(7, 10, start=[0] * 7)


def test_icps_holds_and_covers(rng):
    i = excitation.icps(30_005, RATE, hold=0.02, low=0.0, high=2.5, rng=rng)
    assert i.size == 30_005
    blocks = i[:30_000].reshape(-1, 10)  # 20 ms at 512 Hz is 10.24 samples: 10 are held
    assert np.all(blocks == blocks[:, :1])
    levels = blocks[:, 0]
    assert levels.min() >= 0.0 and levels.max() <= 2.5
    assert levels.mean() == pytest.approx(1.25, abs=4 * 2.5 / np.sqrt(12 * 3000))
    assert levels.std() == pytest.approx(2.5 / np.sqrt(12), rel=0.03)


def test_prbs_has_null_at_the_clock():
    u = excitation.prbs(511 * 4, RATE, clock=4 / RATE, low=-1.0, high=1.0, cells=9)
    power = np.abs(np.fft.rfft(u)) ** 2
    null = 511  # frequency rate/4 in bins of rate/(4·511)
    assert power[null] < 1e-18 * power.max()
    assert set(np.unique(u)) == {-1.0, 1.0}


def test_aprbs_switches_with_the_prbs():
    binary = excitation.prbs(4000, RATE, clock=1 / RATE, low=0.0, high=1.0, rng=np.random.default_rng(5))
    levels = excitation.aprbs(4000, RATE, clock=1 / RATE, low=0.5, high=2.5, rng=np.random.default_rng(5))
    np.testing.assert_array_equal(np.diff(binary) != 0, np.diff(levels) != 0)
    assert levels.min() >= 0.5 and levels.max() <= 2.5
    assert np.unique(levels).size == 1 + np.count_nonzero(np.diff(binary))


def test_stepped_shares_the_time():
    u = excitation.stepped(23, [0.0, 0.44, 0.8])
    values, counts = np.unique(u, return_counts=True)
    np.testing.assert_array_equal(values, [0.0, 0.44, 0.8])
    np.testing.assert_array_equal(counts, [8, 8, 7])


@pytest.mark.parametrize("acceleration", [16.0, 20.0, 400.0])
def test_triangle_keeps_amplitude_frequency_and_limit(acceleration):
    amplitude, frequency, rate = 0.02, 5.0, 20_000.0  # the limit of the possible is 32 X f² = 16
    x = excitation.triangle(8000, rate, amplitude=amplitude, frequency=frequency, acceleration=acceleration)
    v, a = np.diff(x) * rate, np.diff(x, 2) * rate**2
    assert x.max() == pytest.approx(amplitude, rel=1e-5) and x.min() == pytest.approx(-amplitude, rel=1e-5)
    np.testing.assert_allclose(x[:4000], x[4000:], atol=1e-12)
    np.testing.assert_allclose(x[:2000], -x[2000:4000], atol=1e-12)
    assert np.abs(a).max() <= acceleration * (1 + 1e-6)
    speed = np.abs(v).max()
    # a stroke of 2X in half a period: flank at `speed` and two ramps of duration speed/a that lose half of it each
    assert speed * (0.1 - speed / acceleration) == pytest.approx(2 * amplitude, rel=1e-3)


def test_triangle_sharp_has_speed_4xf():
    x = excitation.triangle(1000, 1000.0, amplitude=0.01, frequency=2.0)
    assert np.abs(np.diff(x)).max() * 1000 == pytest.approx(4 * 0.01 * 2.0)


def test_triangle_refuses_impossible_limit():
    with pytest.raises(InputError, match="needs 16 m/s²"):
        excitation.triangle(100, RATE, amplitude=0.02, frequency=5.0, acceleration=15.9)


def test_chirp_frequency_and_equal_peak_velocity():
    rate, seconds = 4096.0, 40.0
    x = excitation.chirp(int(rate * seconds), rate, f_start=0.5, f_end=16.0, amplitude=0.02, peak_velocity=0.2)
    crossings = np.flatnonzero(np.diff(np.sign(x)) != 0) / rate
    middle = 0.5 * (crossings[1:] + crossings[:-1])
    measured = 0.5 / np.diff(crossings)
    expected = 0.5 * 32.0 ** (middle / seconds)
    np.testing.assert_allclose(measured[3:], expected[3:], rtol=0.02)
    v = np.diff(x) * rate
    late = v[int(0.6 * v.size) :]
    assert np.abs(late).max() == pytest.approx(0.2, rel=0.01)
    assert np.abs(x).max() < 0.02 and np.abs(v).max() < 0.2 * 1.01


def test_multisine_lines_are_equal_and_crest_is_low():
    frequencies = np.arange(1, 65) / 4.0
    x = excitation.multisine(2048, RATE, frequencies=frequencies, rms=2.0)
    spectrum = 2 * np.abs(np.fft.rfft(x)) / 2048
    np.testing.assert_allclose(spectrum[1:65], 2.0 * np.sqrt(2 / 64), rtol=1e-9)
    assert np.abs(np.delete(spectrum, np.arange(1, 65))).max() < 1e-12
    assert np.abs(x).max() / np.sqrt(np.mean(x**2)) < 2.0
    noisy = excitation.multisine(2048, RATE, frequencies=frequencies, rms=2.0, rng=np.random.default_rng(0))
    assert np.abs(noisy).max() > np.abs(x).max()


def test_sum_of_cosines_equals_the_sum(rng):
    f, a, phase = rng.uniform(0.5, 20, 7), rng.uniform(0, 1, 7), rng.uniform(0, 6, 7)
    t = np.arange(5000) / RATE
    direct = (a * np.cos(2 * np.pi * np.outer(t, f) + phase)).sum(axis=1)
    np.testing.assert_allclose(excitation.sum_of_cosines(5000, RATE, f, a, phase), direct, atol=1e-10)


def test_random_phase_has_the_spectrum(rng):
    def psd(f):
        return 1e-4 / f**2

    power = np.zeros(20)
    for _ in range(40):
        x = excitation.random_phase(5120, RATE, psd, f_min=1.0, f_max=21.0, lines=100, rng=rng)
        window = np.hanning(5120)
        raw = 2 * np.abs(np.fft.rfft(x * window)) ** 2 / (RATE * np.sum(window**2))
        power += raw[10:210].reshape(20, 10).mean(axis=1) / 40
    f = np.arange(10, 210).reshape(20, 10) / 10.0
    np.testing.assert_allclose(power[1:-1], psd(f).mean(axis=1)[1:-1], rtol=0.15)
    assert power.sum() == pytest.approx(psd(f).mean(axis=1).sum(), rel=0.05)


def test_equally_spaced_lines_repeat_and_spread_lines_do_not(rng):
    keep = {"f_min": 0.5, "f_max": 20.5, "lines": 100}
    repeating = excitation.random_phase(7680, RATE, lambda f: f**-2.1, rng=rng, incommensurate=False, **keep)
    np.testing.assert_allclose(repeating[:2560], -repeating[2560:5120], atol=1e-9)
    np.testing.assert_allclose(repeating[:2560], repeating[5120:], atol=1e-9)
    free = excitation.random_phase(7680, RATE, lambda f: f**-2.1, rng=rng, **keep)
    assert abs(np.corrcoef(free[:2560], free[5120:])[0, 1]) < 0.9
    lines = excitation.spread_lines(0.5, 20.5, 100, rng)
    np.testing.assert_array_equal(np.floor((lines - 0.5) / 0.2 + 1e-12), np.arange(100))


@pytest.mark.parametrize(
    "call",
    [
        lambda r: excitation.icps(10, RATE, hold=1e-4, low=0, high=1, rng=r),
        lambda r: excitation.icps(10, RATE, hold=0.1, low=1, high=1, rng=r),
        lambda r: excitation.icps(0, RATE, hold=0.1, low=0, high=1, rng=r),
        lambda r: excitation.stepped(2, [1, 2, 3]),
        lambda r: excitation.sine(10, 0.0, amplitude=1, frequency=1),
        lambda r: excitation.chirp(10, RATE, f_start=1, f_end=300, amplitude=1),
        lambda r: excitation.sum_of_cosines(10, RATE, np.array([300.0]), np.ones(1), np.zeros(1)),
        lambda r: excitation.random_phase(10, RATE, lambda f: -f, f_min=1, f_max=2, lines=3, rng=r),
        lambda r: excitation.multisine(10, RATE, frequencies=[], rms=1.0),
    ],
)
def test_bad_input_is_refused(call, rng):
    with pytest.raises(InputError):
        call(rng)


DRAWN = {"icps": lambda rng: excitation.icps(50, RATE, hold=0.01, low=0.0, high=2.0, rng=rng),
         "prbs": lambda rng: excitation.prbs(50, RATE, clock=0.01, low=0.0, high=2.0, rng=rng),
         "aprbs": lambda rng: excitation.aprbs(50, RATE, clock=0.01, low=0.0, high=2.0, rng=rng),
         "multisine": lambda rng: excitation.multisine(50, RATE, frequencies=[1.0, 3.0], rms=1.0, rng=rng),
         "spread_lines": lambda rng: excitation.spread_lines(1.0, 9.0, 5, rng),
         "random_phase": lambda rng: excitation.random_phase(50, RATE, lambda f: 1 / f, f_min=1.0, f_max=9.0, lines=5,
                                                             rng=rng)}


@pytest.mark.parametrize("signal", DRAWN.values(), ids=DRAWN)
def test_a_seed_draws_as_the_generator_of_that_seed(signal):
    for seed in (3, np.int64(3)):
        np.testing.assert_array_equal(signal(seed), signal(np.random.default_rng(3)))
    for wrong in ("three", 3.5, -1, True):
        with pytest.raises(InputError, match="rng must be a seed"):
            signal(wrong)


def test_a_signal_that_must_be_drawn_does_not_take_the_machines_entropy():
    with pytest.raises(InputError, match=r"rng must be a seed.*got None"):
        DRAWN["icps"](None)
