"""Lag, delay, saturation and play on a current, against closed forms, quadrature and a dense solver."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, composed, current_itself, guo, road_like
from scipy.integrate import solve_ivp
from scipy.signal import butter, lfilter

from lpvid.baselines.signals import Signals, in_turn
from lpvid.diagnosis.evidence.thinning import stretched
from quartercar.effects.current_edges import SPACING, edges_unfiltered, find_edges, is_sharp
from quartercar.effects.electrical import (
    SEEN_AFTER,
    CoilLag,
    CommandDelay,
    CurrentEffect,
    CurrentSaturation,
    Remanence,
    RiseFallLag,
    clocked,
    held,
    is_constant,
    is_held,
    lagged,
    levels,
)
from quartercar.effects.model_structure import SchedulingDegree
from quartercar.effects.sensors import SENSORS, scaled


def of(current: np.ndarray) -> Signals:
    return Signals(PERIOD, {"current": current, "velocity": np.ones(current.size)}, np.zeros(current.size))


def steps(*heights: float, hold: int = 100) -> Signals:
    return of(np.repeat(np.array(heights), hold))


class TestClock:
    @pytest.mark.parametrize("noise", [0.0, 0.005, 0.012])
    @pytest.mark.parametrize("share", [0.5, 0.55])
    def test_two_levels_that_jump_at_every_second_sample_have_the_clock_of_the_samples(self, share, noise):
        rng, n = np.random.default_rng(3), 20000
        current = 2.0 * (np.cumsum(rng.random(n) < share) % 2) + 2.0 * noise * rng.standard_normal(n)
        whole = in_turn([Signals(PERIOD, {"current": current, "velocity": np.sin(np.arange(n))}, np.zeros(n))])
        for s in (*whole, *stretched(whole)):
            assert held(s) and clocked(s)

    @pytest.mark.parametrize("noise", [0.0, 0.008, 0.012])
    def test_neither_noise_nor_a_spike_gives_a_current_the_clock_of_the_samples(self, noise):
        """Levels that last 25.4 samples jump between samples: 25 or 26 apart."""
        rng = np.random.default_rng(4)
        current = rng.uniform(0, 2, 300)[(np.arange(6000) / 25.37).astype(int)]
        current[1234] += 2.0
        s = of(current + 2.0 * noise * rng.standard_normal(6000))
        assert held(s) and not clocked(s)

    def test_no_current_is_not_held(self):
        assert not is_held(np.zeros(0))


class TestLag:
    @pytest.mark.parametrize("tau", [3e-4, 4e-3, 0.03])
    def test_step_of_a_held_current(self, tau: float) -> None:
        """1 − exp(−t/τ), the force being taken shortly after the sample at which the current steps."""
        got = composed(CoilLag(), [tau], steps(0.0, 2.0), current_itself)
        t = PERIOD * (np.arange(100) + SEEN_AFTER)
        np.testing.assert_allclose(got[:100], 0.0, atol=0)
        np.testing.assert_allclose(got[100:], 2 * (1 - np.exp(-t / tau)), atol=1e-12)

    @pytest.mark.parametrize("tau", [3e-4, 4e-3, 0.03])
    def test_ramp_of_a_linear_current(self, tau: float) -> None:
        """A ramp of slope s is followed by s (t − τ (1 − exp(−t/τ)))."""
        t = PERIOD * np.arange(200)
        got = composed(CoilLag(), [tau], of(3.0 * t), current_itself)
        np.testing.assert_allclose(got, 3 * (t - tau * (1 - np.exp(-t / tau))), atol=1e-12)

    @pytest.mark.parametrize(("rise", "fall"), [(0.004, 0.02), (0.02, 0.004)])
    def test_edges_of_their_own(self, rise: float, fall: float) -> None:
        mean, ratio = np.sqrt(rise * fall), np.sqrt(rise / fall)
        got = composed(RiseFallLag(), [mean, ratio], steps(0.0, 1.0, 0.0, hold=400), current_itself)
        t = PERIOD * (np.arange(400) + SEEN_AFTER)
        np.testing.assert_allclose(got[400:800], 1 - np.exp(-t / rise), atol=1e-9)
        top = 1 - np.exp(-400 * PERIOD / rise)
        np.testing.assert_allclose(got[800:], top * np.exp(-t / fall), atol=1e-9)

    def test_smooth_current_with_unequal_edges(self) -> None:
        """Against a dense solver; the switch between edges falls inside a sample, hence the tolerance."""
        t = PERIOD * np.arange(1024)
        current = 1 + np.sin(2 * np.pi * 1.5 * t)
        rise, fall = 0.01, 0.03
        got = lagged(of(current), rise, fall)

        def rate(time: float, y: np.ndarray) -> np.ndarray:
            gap = np.interp(time, t, current) - y
            return gap / np.where(gap > 0, rise, fall)

        exact = solve_ivp(rate, (0, t[-1]), [current[0]], t_eval=t, rtol=1e-8, atol=1e-10, max_step=PERIOD).y[0]
        assert np.abs(got - exact).max() < 2e-4

    @pytest.mark.parametrize(("rise", "fall"), [(0.004, 0.02), (0.02, 0.004), (0.01, 0.0), (0.0, 0.01)])
    def test_a_current_and_its_negative_are_lagged_alike(self, rise: float, fall: float) -> None:
        for s in (steps(0.0, 2.0, 0.5, 1.0, 0.0, hold=20), of(1 + np.sin(0.1 * np.arange(300)))):
            np.testing.assert_array_equal(lagged(s.replace(current=-s["current"]), rise, fall), -lagged(s, rise, fall))

    @pytest.mark.parametrize(("rise", "fall"), [(0.004, 0.02), (0.02, 0.004), (0.01, 0.0), (0.0, 0.01)])
    def test_a_held_current_that_turns_over_decays_first(self, rise: float, fall: float) -> None:
        """From a to −b the field is zero after τ_fall ln(1 + a/b), and builds up from there."""
        a, b, hold = 1.0, 0.6, 400
        got = lagged(steps(0.0, a, -b, hold=hold), rise, fall)[2 * hold:]
        top = a * (1 - np.exp(-hold * PERIOD / rise)) if rise else a
        t = PERIOD * (np.arange(hold) + SEEN_AFTER)
        zero = fall * np.log1p(top / b)
        down = (-b + (top + b) * np.exp(-t / fall)) if fall else np.full(hold, -b)
        up = -b * (1 - np.exp(-(t - zero) / rise)) if rise else np.full(hold, -b)
        np.testing.assert_allclose(got, np.where(t < zero, down, up), atol=1e-12)

    @pytest.mark.parametrize(("rise", "fall"), [(0.01, 0.03), (0.03, 0.01), (0.02, 0.0), (0.0, 0.02)])
    def test_smooth_current_that_turns_over(self, rise: float, fall: float) -> None:
        """Against exponential steps of a hundredth of a sample."""
        t = PERIOD * np.arange(700)
        current = np.sin(2 * np.pi * 3.0 * t) + 0.4 * np.sin(2 * np.pi * 7.3 * t)
        got = lagged(of(current), rise, fall)
        fine, y, exact = PERIOD / 100, current[0], np.empty(t.size)
        for k in range(t.size):
            exact[k] = y
            if k + 1 < t.size:
                for part in (np.arange(100) + 0.5) / 100:
                    i = current[k] + part * (current[k + 1] - current[k])
                    tau = rise if (i - y) * y > 0 or y == 0 else fall
                    y = i + (y - i) * np.exp(-fine / tau) if tau else i
        assert np.abs(got - exact).max() < 2e-3 and np.ptp(exact) > 1.0

    def test_equal_edges_are_one_lag(self) -> None:
        for s in (road_like(), road_like(hold=1)):
            np.testing.assert_allclose(composed(RiseFallLag(), [0.01, 1.0], s, current_itself),
                                       composed(CoilLag(), [0.01], s, current_itself), atol=1e-13)

    def test_vanishes_without_a_step(self) -> None:
        """τ → 0 leaves no delay of a sample behind: the error falls with τ."""
        t = PERIOD * np.arange(512)
        for s in (steps(0.0, 1.0, 0.5), of(np.sin(20 * t))):
            got = composed(CoilLag(), [1e-6], s, current_itself)
            assert np.abs(got - s["current"]).max() < 1e-4


class TestConstant:
    def test_a_drift_that_no_fit_distinguishes_from_the_sensor(self) -> None:
        """Two per cent from end to end, as a scheduling variable that is constant over a data set."""
        assert is_constant(np.linspace(0.99, 1.005, 500), 1.005)
        assert not is_constant(np.linspace(0.9, 1.0, 500), 1.0)

    def test_noise_of_a_sensor_of_a_larger_range(self, rng: np.random.Generator) -> None:
        """A low-pass takes it off the simulated force, so that it would be evidence for a lag of the current."""
        current = 0.5 + 0.02 * rng.standard_normal(6000)
        assert is_constant(current, float(np.abs(current).max()))
        assert not is_constant(0.5 + np.repeat(0.02 * rng.standard_normal(60), 100), 0.6), "levels, no noise"


class TestHold:
    def test_is_recognised_under_noise(self, rng: np.random.Generator) -> None:
        current = np.repeat(rng.uniform(0, 2.5, 60), 100) + 2e-3 * rng.standard_normal(6000)
        assert is_held(current)
        assert not is_held(np.cumsum(rng.standard_normal(6000)))
        assert not is_held(np.ones(100))

    def test_edges_behind_a_filter_are_not_held(self, rng: np.random.Generator) -> None:
        """What two samples share runs between them: a lag found there has no half sample to account for."""
        edges = np.repeat(rng.uniform(0, 2.5, 60), 100)
        b, a = butter(2, 100.0, fs=512)
        filtered = lfilter(b, a, edges - edges[0]) + edges[0]
        assert is_held(edges) and not is_held(filtered)
        for current, expected in ((edges, PERIOD / np.sqrt(12)), (filtered, SPACING * PERIOD)):
            s = (of(current),)
            assert CoilLag().clock_error(s) == RiseFallLag().clock_error(s) == pytest.approx(expected)
            assert CommandDelay().clock_error(s) == pytest.approx(PERIOD / np.sqrt(12))
            late = CommandDelay().clock_errors(np.array([0.01, 0.2]), s)
            assert late == pytest.approx([PERIOD / np.sqrt(12), PERIOD / np.sqrt(12) / 0.01])

    def test_nor_are_those_behind_a_filter_that_takes_little_more_than_a_sample(self, rng: np.random.Generator) -> None:
        """It misses the level by two per cent at the first sample of every edge, which no jump does."""
        edges = np.repeat(rng.uniform(0, 2.5, 60), 100)
        fast = lfilter([1.02, -0.02], [1.0], edges)
        assert is_held(edges) and is_held(fast), "by their increments alone"
        assert held(of(edges)) and not held(of(fast))

    def test_all_edges_together_show_what_no_single_one_does(self) -> None:
        """Each misses by 2 %, under noise of 4 % of a middling one; the median edge shows it in half of the records."""
        seen, imagined = 0, 0
        for rng in map(np.random.default_rng, range(20)):
            edges = np.repeat(rng.uniform(0, 2.5, 60), 100)
            noise = 0.03 * rng.standard_normal(edges.size)
            passed = lfilter([1.02, -0.02], [1.0], edges)
            through, alone = (edges_unfiltered([c], [find_edges(c, PERIOD)]) for c in (passed + noise, edges + noise))
            seen, imagined = seen + (not through), imagined + (not alone)
        assert seen > 16 and imagined == 0

    @pytest.mark.parametrize("jumps", [1, 2])
    def test_few_edges_under_noise_have_passed_no_filter(self, jumps: int, rng: np.random.Generator) -> None:
        """The fit of one share to one jump leaves no residual from which to estimate its error."""
        edges = np.repeat(np.arange(jumps + 1) % 2.0, 300)
        noisy = [edges + 0.01 * rng.standard_normal(edges.size) for _ in range(50)]
        assert sum(not edges_unfiltered([c], [find_edges(c, PERIOD)]) for c in noisy) <= 2
        behind = lfilter([0.9, 0.1], [1.0], edges) + 0.01 * rng.standard_normal(edges.size)
        assert not edges_unfiltered([behind], [find_edges(behind, PERIOD)])

    def test_all_records_of_a_diagnosis_tell_it_together(self) -> None:
        """By its own edges one is held and another is not, though one chain made them all."""
        rng = np.random.default_rng(3)
        parts = []
        for _ in range(6):
            edges = np.repeat(rng.uniform(0, 2.5, 20), 60)
            parts.append(of(lfilter([1.013, -0.013], [1.0], edges) + 0.02 * rng.standard_normal(edges.size)))
        assert {held(s) for s in parts} == {True, False}
        together = in_turn([Signals(PERIOD, s.channels, s.output) for s in parts])
        assert {held(s) for s in together} == {False}
        assert not held(together[0].replace(velocity=np.zeros(1200))), "whatever else is replaced"

    def test_a_wrong_scale_changes_nothing_that_is_told_of_steps(self, rng: np.random.Generator) -> None:
        """The law takes up a scale altogether; to think otherwise of its edges made one of 1 % the best of causes."""
        edges = np.repeat(np.round(rng.uniform(0, 2.5, 20), 2), 60)
        sensor = list(SENSORS).index("current")
        for current in (edges, lfilter([1.03, -0.03], [1.0], edges)):
            s = of(current)
            believed: list[bool] = []

            def law(x: Signals, believed: list[bool] = believed) -> np.ndarray:
                believed.append(held(x))
                return x["current"]

            scaled(law, sensor, 0.99)(s.replace(current=current))
            scaled(law, sensor, -1.0)(s)
            assert believed == [held(s)] * 2

    @pytest.mark.parametrize("noise", [1e-3, 5e-3, 1e-2])
    @pytest.mark.parametrize("levels", [30, 2])
    def test_noise_of_the_current_is_no_filter(self, noise: float, levels: int, rng: np.random.Generator) -> None:
        heights = rng.uniform(0, 2.5, 60) if levels > 2 else np.tile([0.0, 2.5], 30)
        current = np.repeat(heights, rng.integers(20, 60, 60))
        s = of(current + 2.5 * noise * rng.standard_normal(current.size))
        assert held(s) and is_sharp(s)
        assert CoilLag().clock_error((s,)) == pytest.approx(PERIOD / np.sqrt(12))

    @pytest.mark.parametrize(("heights", "count"), [((0.0, 2.0), 2), ((0.0, 1.0, 2.0), 3), ((1.5,), 1)])
    def test_levels_under_noise(self, heights: tuple, count: int, rng: np.random.Generator) -> None:
        current = np.tile(np.repeat(heights, 200), 5)
        noise = 2e-3 * rng.standard_normal(current.size) if len(heights) > 1 else 0.0
        assert levels([of(current + noise)]) == count
        assert levels([of(np.linspace(0, 2, 500))]) == 0

    def test_two_levels_carry_no_bend_and_no_unequal_edges(self) -> None:
        two, three = steps(0.0, 2.0, 0.0, 2.0), steps(0.0, 2.0, 1.0, 2.0)
        bent: tuple[CurrentEffect, ...] = (RiseFallLag(), CurrentSaturation(), SchedulingDegree())
        for effect in bent:
            assert "two levels" in str(effect.applies(guo(), (two,)))
            assert effect.applies(guo(), (three,)) is None
        for effect in (CoilLag(), CommandDelay(), Remanence()):
            assert effect.applies(guo(), (two,)) is None

    def test_unequal_edges_between_two_levels_are_a_lag_and_a_bend(self) -> None:
        """Why: with two levels the path of a rise-fall lag is that of one lag seen through a static bend."""
        rise, fall = 0.006, 0.015
        s = steps(0.0, 1.0, 0.0, hold=300)
        unequal = lagged(s, rise, fall)
        one = lagged(s, 0.01, 0.01)
        for half in (slice(300, 600), slice(600, 900)):
            order = np.argsort(one[half])
            assert np.all(np.diff(unequal[half][order]) >= -1e-12), "a function of the one lag, on each edge"


class TestDelay:
    @pytest.mark.parametrize("samples", [1.0, 2.5, 7.25])
    def test_of_a_smooth_current(self, samples: float) -> None:
        t = PERIOD * np.arange(2048)
        got = composed(CommandDelay(), [samples * PERIOD, 0.0], of(np.sin(8 * t)), current_itself)
        exact = np.sin(8 * (t - samples * PERIOD))
        assert np.abs(got - exact)[20:].max() < (8 * PERIOD) ** 2 / 8 * 1.01, "linear interpolation's own error"

    def test_with_the_lag_of_the_driver_behind_it(self) -> None:
        """A sine behind exp(-.8 T s)/(1 + .2 T s), in closed form."""
        t, delay, share, w = PERIOD * np.arange(2048), 5 * PERIOD, 0.2, 8.0
        got = composed(CommandDelay(), [delay, share], of(np.sin(w * t)), current_itself)
        passed = np.exp(-1j * w * (1 - share) * delay) / (1 + 1j * w * share * delay)
        exact = np.abs(passed) * np.sin(w * t + np.angle(passed))
        assert np.abs(got - exact)[100:].max() < (w * PERIOD) ** 2 / 8 * 1.1, "linear interpolation's own error"

    @pytest.mark.parametrize("share", [0.0, 0.2, 0.5])
    def test_of_steps_the_lateness_is_the_same_whatever_the_fraction_of_a_sample(self, share: float) -> None:
        """The area between steps and what became of them, over their heights: T and the half sample of a held one."""
        s = steps(0.0, 2.0, 0.5, 1.7, hold=400)
        heights = np.abs(np.diff(s["current"])).sum()
        for samples in np.arange(2.0, 6.0, 0.125):
            got = composed(CommandDelay(), [samples * PERIOD, share], s, current_itself)
            area = sum(abs(float(np.sum((s["current"] - got)[400 * k:400 * (k + 1)]))) for k in range(1, 4))
            assert area / heights == pytest.approx(samples + 0.5, abs=0.06)

    @pytest.mark.parametrize("samples", [0.6, 1.1, 3.5, 4.9])
    def test_of_a_held_current_is_told_to_half_a_sample(self, samples: float) -> None:
        """A step that comes d samples late is first seen at the next sample: the delay that fits is within ½ of d."""
        current = np.repeat(np.random.default_rng(0).uniform(0, 2, 40), 64)
        s = of(current)
        late = np.concatenate([np.full(k := int(np.ceil(samples)), current[0]), current[:-k]])
        tried = np.arange(0.1, 8, 0.02)
        errors = [np.sum((composed(CommandDelay(), [d * PERIOD, 0.0], s, current_itself) - late) ** 2) for d in tried]
        assert abs(tried[int(np.argmin(errors))] - samples) <= 0.5 + 0.02

    def test_a_delay_is_no_lag(self) -> None:
        s = road_like(4)
        delayed = composed(CommandDelay(), [0.01, 0.0], s, current_itself)
        best = min(np.sum((composed(CoilLag(), [tau], s, current_itself) - delayed) ** 2)
                   for tau in np.geomspace(1e-3, 0.1, 30))
        assert best > 0.1 * np.sum((s["current"] - delayed) ** 2)


class TestMagnet:
    def test_saturation(self) -> None:
        s = of(np.linspace(-2.5, 2.5, 101))
        got = composed(CurrentSaturation(), [0.8, 0.0], s, current_itself)
        np.testing.assert_allclose(got, np.tanh(0.8 * s["current"]) / 0.8, rtol=1e-14)
        assert np.abs(got).max() < 1 / 0.8
        small = composed(CurrentSaturation(), [0.01, 0.0], s, current_itself)
        np.testing.assert_allclose(small, s["current"] - 0.01**2 * s["current"] ** 3 / 3, atol=1e-6)
        soft = composed(CurrentSaturation(), [0.8, 1.0], s, current_itself)
        np.testing.assert_allclose(soft, s["current"] / (1 + 0.8 * np.abs(s["current"])), rtol=1e-12)

    def test_play_on_a_triangle(self) -> None:
        """Loop of width 2w: follows w behind on the way up, w ahead on the way down, rests for 2w at each turn."""
        up = np.linspace(0.0, 2.0, 201)
        triangle = np.concatenate([up, up[-2::-1], up[1:]])
        w = 0.15
        got = composed(Remanence(), [w], of(triangle), current_itself)
        rising, falling = got[:201], got[201:401]
        np.testing.assert_allclose(rising, np.maximum(up - w, 0.0), atol=1e-12)
        np.testing.assert_allclose(falling, np.minimum(up[-2::-1] + w, 2.0 - w), atol=1e-12)
        area = np.trapezoid(got[200:], triangle[200:])
        assert area == pytest.approx(-2 * w * (2.0 - 2 * w), rel=1e-3), "dissipated per turn: 2w times the travel"

    def test_play_forgets_no_level(self) -> None:
        """Return-point memory: a small loop inside a large one leaves no trace."""
        large = np.concatenate([np.linspace(0, 2, 50), np.linspace(2, 1, 25), np.linspace(1, 2, 25)])
        direct = np.linspace(0, 2, 50)
        w = [0.2]
        assert composed(Remanence(), w, of(large), current_itself)[-1] == pytest.approx(
            composed(Remanence(), w, of(direct), current_itself)[-1], abs=1e-12)
