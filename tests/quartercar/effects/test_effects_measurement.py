"""Delays, filters, zero, clipping and rounding: independent filters at a finer clock, shifts, rounding laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, composed, guo, motion, nothing, road_like, speed_itself
from scipy.signal import bessel, bilinear, lfilter

from lpvid.baselines.signals import Signals
from lpvid.baselines.spectra import _derived
from lpvid.condition import resample
from lpvid.effects.composition import Composition
from lpvid.effects.extended import ExtendedModel
from lpvid.record import Record
from quartercar.effects.measurement import (
    DisplacementDelay,
    ForceClipping,
    ForceDelay,
    ForceOffset,
    OneSidedFilter,
    piled_up,
)
from quartercar.effects.quantisation import Quantisation, grid_step, mean_rounding, smoothed_within

FINE = 16


def recorded(x: np.ndarray, v: np.ndarray, **more: np.ndarray) -> Signals:
    return Signals(PERIOD, {"displacement": x, "velocity": v, **more}, np.zeros(x.size))


class TestDelays:
    @pytest.mark.parametrize("delay", [0.002, 0.0055])
    def test_late_motion_is_put_right(self, delay: float) -> None:
        t = PERIOD * np.arange(2048)
        true = motion(t)[1]
        late = recorded(*motion(t - delay))
        got = composed(DisplacementDelay(), [delay, 0.0], late, speed_itself)
        error = np.abs(got - true)[:-8].max() / np.abs(late["velocity"] - true).max()
        assert error < 0.05

    def test_motion_late_by_a_delay_and_a_lag_is_put_right(self) -> None:
        """A sum of sines behind exp(-.8 T s)/(1 + .2 T s), in closed form."""
        t, delay, share = PERIOD * np.arange(4096), 0.01, 0.2
        parts = [(0.9 + 1.7 * k, 1 / (1 + k), 0.7 * k) for k in range(5)]
        true = sum(a * np.sin(2 * np.pi * f * t + p) for f, a, p in parts)
        late = np.zeros(t.size)
        for f, a, p in parts:
            passed = np.exp(-(1 - share) * delay * 2j * np.pi * f) / (1 + share * delay * 2j * np.pi * f)
            late += a * np.abs(passed) * np.sin(2 * np.pi * f * t + p + np.angle(passed))
        s = recorded(late, late)
        right, delayed = (composed(DisplacementDelay(), [delay, lag], s, speed_itself) for lag in (share, 0.0))
        inside = slice(200, -200)
        assert np.abs(right - true)[inside].max() < 0.02 * np.abs(late - true)[inside].max()
        assert np.abs(delayed - true)[inside].max() > 5 * np.abs(right - true)[inside].max()

    def test_a_file_from_before_the_lag_is_read_without_one(self) -> None:
        composition = Composition(guo(), (DisplacementDelay(), ForceOffset()))
        vector = composition.neutral
        vector[-3:] = 0.004, 0.3, 12.0
        square = np.diag(np.arange(1.0, vector.size + 1))
        data = ExtendedModel(composition, vector, square).to_dict()
        assert data["effects"][0]["parameters"].pop()["name"] == "lag_share"
        data["covariance"] = [[v for k, v in enumerate(row) if k != vector.size - 2]
                              for j, row in enumerate(data["covariance"]) if j != vector.size - 2]
        old = ExtendedModel.from_dict(data)
        np.testing.assert_array_equal(old.vector, np.r_[vector[:-2], 0.0, 12.0])
        np.testing.assert_array_equal(np.diag(old.covariance), np.r_[np.diag(square)[:-2], np.nan, vector.size])

    @pytest.mark.parametrize("delay", [0.002, 0.0055])
    def test_a_force_recorded_late_is_that_of_earlier(self, delay: float) -> None:
        t = PERIOD * np.arange(2048)
        got = composed(ForceDelay(), [delay], recorded(*motion(t)), speed_itself)
        late = motion(t - delay)[1]
        assert np.abs(got - late)[8:].max() < 0.05 * np.abs(motion(t)[1] - late).max()

    def test_opposite_delays_undo_each_other_without_a_current(self) -> None:
        s = recorded(*motion(PERIOD * np.arange(2048)))
        twice = DisplacementDelay().compose(ForceDelay().compose(speed_itself, np.array([0.004]), guo()),
                                            np.array([0.004, 0.0]), guo())(s)
        assert np.abs(twice - s["velocity"])[8:-8].max() < 0.02 * np.abs(s["velocity"]).max()

    def test_a_late_force_reads_a_held_current_in_whole_samples(self) -> None:
        """No value between two levels is invented."""
        s = road_like(1)
        for delay in (0.3, 1.0, 2.6):
            got = composed(ForceDelay(), [delay * PERIOD], s, lambda s: s["current"])
            assert set(np.unique(got)) <= set(np.unique(s["current"]))
            np.testing.assert_array_equal(got[5:], np.roll(s["current"], int(np.ceil(delay - 0.05)))[5:])


class TestOneSidedFilter:
    @pytest.mark.parametrize("damping", [0.5, 0.7071, 1.0])
    @pytest.mark.parametrize("corner", [20.0, 40.0])
    @pytest.mark.parametrize("third", [0.0, 1.0])
    def test_a_causal_filter_at_a_finer_clock_is_undone(self, corner: float, damping: float, third: float) -> None:
        period = 1 / (2 * np.pi * corner)
        t = PERIOD / FINE * np.arange(4096 * FINE)
        poles = np.polymul([period**2, 2 * damping * period, 1.0], [third * period, 1.0])
        b, a = bilinear([1.0], np.trim_zeros(poles, "f"), FINE / PERIOD)
        true, filtered = [], []
        for channel in motion(t):
            true.append(channel[::FINE])
            filtered.append((lfilter(b, a, channel - channel[0]) + channel[0])[::FINE])
        got = composed(OneSidedFilter(), [period, damping, third * period], recorded(*filtered), speed_itself)
        inside = slice(256, -128)  # the periods of the motion are not whole in the record
        before = np.abs(filtered[1] - true[1])[inside].max()
        assert np.abs(got - true[1])[inside].max() < 0.03 * before

    def test_refits_begin_at_filters_of_order_three_of_every_lag(self) -> None:
        """Third-order Bessel: the delay 2 zeta T + T_3 is that of scipy's filter of unit delay."""
        points = np.array(OneSidedFilter().refit_points((), lambda unit: 0.01 if unit == "s" else None))
        lags, order_three = np.unique(points[:, 0]), points[points[:, 2] > 0]
        np.testing.assert_array_equal(np.unique(order_three[:, 0]), lags)
        _, poles, _ = bessel(3, 1.0, analog=True, output="zpk", norm="delay")
        pair, single = poles[poles.imag > 0][0], poles[np.abs(poles.imag) < 1e-9][0].real
        np.testing.assert_allclose(order_three[:, 1], -pair.real / abs(pair), rtol=1e-3)
        np.testing.assert_allclose(order_three[:, 2] / order_three[:, 0], -abs(pair) / single, rtol=1e-3)

    def test_noise_is_not_blown_up(self, rng: np.random.Generator) -> None:
        """Undoing a 20 Hz filter by plain differences multiplies white noise by T²/h² = 16."""
        quiet = motion(PERIOD * np.arange(4096))
        noise = [1e-3 * c.std() * rng.standard_normal(c.size) for c in quiet]
        clean, noisy = (composed(OneSidedFilter(), [0.008, 0.7071, 0.0], recorded(*channels), speed_itself)
                        for channels in (quiet, [c + e for c, e in zip(quiet, noise, strict=True)]))
        assert np.std((noisy - clean)[256:-256]) < 3 * noise[1].std()

    def test_only_noise_is_left_alone(self, rng: np.random.Generator) -> None:
        noise = recorded(1e-6 * rng.standard_normal(4096), 3e-4 * rng.standard_normal(4096))
        got = composed(OneSidedFilter(), [0.008, 0.7071, 0.0], noise, speed_itself)
        assert got.std() < 1.05 * noise["velocity"].std()

    def test_a_velocity_that_was_derived_is_found_after_decimation(self, rng: np.random.Generator) -> None:
        """The filter of the decimation takes the top of the band away; its noise then counted as motion."""
        t = np.arange(8192) / 1000.0
        x = 0.01 * np.sin(2 * np.pi * 1.7 * t) + 1e-5 * rng.standard_normal(t.size)
        record = Record({"displacement": x, "velocity": np.gradient(x, t)}, sample_time=t[1])
        for rate in (1000.0, 250.0):
            found = resample(record, rate)
            s = Signals(1 / rate, {n: found[n] for n in ("displacement", "velocity")}, found["velocity"])
            assert _derived(s, "velocity", "displacement")
            separate = s.replace(velocity=s["velocity"] + 0.05 * rng.standard_normal(s.n_samples))
            assert not _derived(separate, "velocity", "displacement")


class TestZeroAndRange:
    def test_offset(self) -> None:
        np.testing.assert_array_equal(composed(ForceOffset(), [-35.0], road_like(), nothing), np.full(4096, -35.0))

    def test_clipping(self) -> None:
        s = road_like()
        got, limit = composed(ForceClipping(), [1 / 0.1], s, speed_itself), 0.1
        np.testing.assert_array_equal(got, np.clip(s["velocity"], -limit, limit))
        assert 0.01 < np.mean(np.abs(got) == limit) < 0.99

    def test_only_a_force_that_piles_up_at_its_largest_value_is_clipped(self) -> None:
        """A fact of the record: smooth peaks hold half as many samples within a width as within four of it."""
        noise = 0.005 * np.random.default_rng(1).standard_normal(8192)
        wave = np.sin(np.linspace(0.0, 300.0, 8192)) * (1 + 0.1 * np.sin(np.linspace(0.0, 17.0, 8192)))
        assert not piled_up(wave) and not piled_up(wave + noise) and not piled_up(np.zeros(100))
        for scale in (1e-3, 1.0, 1e4):
            assert piled_up(scale * np.clip(wave, -0.8, 0.8)) and piled_up(scale * (np.clip(wave, -0.8, 0.8) + noise))
        smooth, clipped = (Signals(PERIOD, {"velocity": wave}, y) for y in (wave, np.clip(wave, -0.8, 0.8)))
        assert "pile up" in str(ForceClipping().applies(guo(), (smooth,)))
        assert ForceClipping().applies(guo(), (clipped,)) is None

    def test_clipping_is_looked_for_below_the_peak(self) -> None:
        s = road_like()
        peak = np.abs(s.output).max()
        limits = [1 / p[0] for p in ForceClipping().points((s,))]
        assert max(limits) == pytest.approx(peak) and min(limits) < peak
        level = float(np.quantile(np.abs(s.output), 0.9))
        noisy = np.clip(s.output, -level, level) + 0.002 * peak * np.sin(np.arange(s.n_samples))
        limits = [1 / p[0] for p in ForceClipping().points((replace(s, output=noisy),))]
        assert min(abs(limit / level - 1) for limit in limits) < 0.002


class TestQuantisation:
    def test_steps_are_read_off_the_values(self, rng: np.random.Generator) -> None:
        smooth = np.cumsum(rng.standard_normal(3000))
        for step in (0.5, 1.0, 3.0):
            assert grid_step(step * np.round(smooth / step)) == pytest.approx(step, rel=1e-9)
        assert grid_step(smooth) is None
        assert grid_step(1e-4 * np.round(smooth / 1e-4)) is None, "a fine step is no finding"
        assert grid_step(np.zeros(100)) is None
        assert grid_step(np.repeat([0.0, 0.44, 0.8, 1.2], 50)) is None, "levels of a current are no grid"

    def test_smoothing_stays_within_the_steps_and_finds_the_signal(self) -> None:
        x = motion(PERIOD * np.arange(4096))[1]
        step = 5e-3
        stored = step * np.round(x / step)
        got = smoothed_within(stored, step)
        assert np.abs(got - stored).max() <= step / 2 * (1 + 1e-12)
        assert np.std(stored - x) == pytest.approx(step / np.sqrt(12), rel=0.05), "what rounding does"
        assert np.std(got - x) < 0.45 * np.std(stored - x)

    def test_a_channel_that_jumps_stays_as_it_is(self, rng: np.random.Generator) -> None:
        stored = 0.02 * np.round(np.repeat(rng.uniform(0, 2.5, 100), 40) / 0.02)
        np.testing.assert_allclose(smoothed_within(stored, 0.02), stored, atol=0.01)
        assert np.std(smoothed_within(stored, 0.02) - stored) < 0.004

    def test_mean_of_a_rounded_noisy_force(self, rng: np.random.Generator) -> None:
        """Monte Carlo: the mean over noise of 0.15 steps of what rounding adds."""
        values = np.linspace(-20, 20, 41)
        drawn = values + 0.15 * 10 * rng.standard_normal((40000, 41))
        mean = np.mean(10 * np.round(drawn / 10), axis=0) - values
        np.testing.assert_allclose(mean_rounding(values, 10.0), mean, atol=0.12)

    def test_a_coarse_record_is_explained_as_far_as_its_signals_allow(self) -> None:
        """A steep law of a rounded speed: the error falls to a fraction."""
        def law(s: Signals) -> np.ndarray:
            return 800 * np.tanh(s["velocity"] / 0.02)

        x, v = motion(PERIOD * np.arange(4096))
        force = 800 * np.tanh(v / 0.02)
        stored = Signals(PERIOD, {"displacement": 1e-4 * np.round(x / 1e-4), "velocity": 5e-3 * np.round(v / 5e-3)},
                         40 * np.round(force / 40))
        effect = Quantisation()
        assert effect.applies(guo(), (stored,)) is None
        point = effect.points((stored,))[0]
        np.testing.assert_allclose(point, [1.0, 40.0], rtol=1e-9)
        before = np.std(stored.output - law(stored))
        after = np.std(stored.output - composed(effect, list(point), stored, law))
        assert after < 0.6 * before

    def test_fine_channels_are_left_alone(self) -> None:
        s = road_like()
        assert "coarse grid" in str(Quantisation().applies(guo(), (s,)))
        np.testing.assert_array_equal(composed(Quantisation(), [1.0, 0.0], s, speed_itself), s["velocity"])
