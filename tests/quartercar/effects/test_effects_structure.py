"""Stops, inertia and resonance of the fixture, against energy balances, derivatives and scipy's linear simulation."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, composed, current_itself, guo, motion, nothing, road_like, speed_itself
from scipy.signal import lsim, lti

from lpvid.baselines.budgets import LONG
from lpvid.baselines.signals import Signals
from lpvid.effects.composition import Composition
from lpvid.effects.extended import ExtendedModel
from quartercar.effects.electrical import SEEN_AFTER
from quartercar.effects.hydraulics import ValveDynamics
from quartercar.effects.model_structure import ModelOrder
from quartercar.effects.second_order import second_order
from quartercar.effects.structure import EndStop, FixtureInertia, FixtureResonance, acceleration


def sine(size: float, frequency: float, n: int = 2048) -> Signals:
    t = np.arange(n) / n / frequency
    w = 2 * np.pi * frequency
    return Signals(t[1], {"displacement": size * np.sin(w * t), "velocity": size * w * np.cos(w * t)}, np.zeros(n))


@pytest.mark.parametrize("effect", [FixtureResonance(), ModelOrder()], ids=lambda e: e.name)
def test_files_that_call_the_time_constant_a_period_are_read(effect) -> None:
    """T is 1/ω: the period is 2π T."""
    composition = Composition(guo(), (effect,))
    vector = composition.neutral
    vector[composition.places[0]] = [p.grid[0] for p in effect.parameters]
    model = ExtendedModel(composition, vector, np.full((vector.size, vector.size), np.nan))
    data = model.to_dict()
    entry = next(p for p in data["effects"][0]["parameters"] if p["name"] == "time_constant")
    assert entry["unit"] == "s"
    entry["name"] = "period"
    np.testing.assert_array_equal(ExtendedModel.from_dict(data).vector, vector)


@pytest.mark.parametrize("rate, radian", [(250.0, 0.3), (500.0, 0.01), (5000.0, 0.002)])
def test_a_resonance_is_screened_between_the_motion_and_half_the_sampling_rate(rate, radian) -> None:
    """Whatever the clock and the motion: inside of both and of the bounds, evenly in the logarithm, no point twice."""
    s = Signals(1 / rate, {"velocity": np.zeros(8)}, np.zeros(8))
    points = FixtureResonance().spread_points((s,), {"s": radian, "Hz": 1 / radian}.get)
    periods = np.unique([p[0] for p in points])
    longest = min(radian, FixtureResonance().parameters[0].bounds[1])
    assert 1 / (np.pi * rate) < periods.min() and periods.max() < longest
    assert len(points) == 14 and len({tuple(p) for p in points}) == 14
    np.testing.assert_allclose(np.diff(np.log(periods)), np.log(longest * np.pi * rate) / 8)
    frequencies = {p[1] for p in ValveDynamics().spread_points((s,), {"s": radian, "Hz": 1 / radian}.get)}
    assert all(1 / (2 * np.pi * radian) < f < rate / 2 for f in frequencies)


class TestEndStop:
    def test_does_no_work_over_a_cycle_and_stores_what_a_spring_stores(self) -> None:
        s = sine(0.02, 1.5)
        force = composed(EndStop(), [5e4, 0.015, 1.0], s, nothing)
        x, v = s["displacement"], s["velocity"]
        assert abs(np.sum(force * v) * s.sample_time) < 1e-9 * np.abs(force * v).max()
        quarter = slice(0, 513)
        stored = np.trapezoid(force[quarter], x[quarter])
        assert stored == pytest.approx(0.5 * 5e4 * 0.005**2, rel=1e-4)

    def test_is_absent_within_the_stroke_and_odd_beyond(self) -> None:
        s = sine(0.02, 1.0)
        force, x = composed(EndStop(), [1e5, 0.012, 1.0], s, nothing), s["displacement"]
        assert np.all(force[np.abs(x) <= 0.012] == 0) and np.all(force * x >= 0)
        np.testing.assert_allclose(force[1024:], -force[:1024], atol=1e-9)

    def test_is_looked_for_within_the_reach(self) -> None:
        s = road_like()
        reach = np.abs(s["displacement"]).max()
        assert all(0.1 * reach < p[1] < reach for p in EndStop().points((s,)))

    @pytest.mark.parametrize("amplitude", [2e-3, 0.05])
    def test_a_linear_stop_at_mid_stroke_is_a_spring_at_any_stroke(self, amplitude: float) -> None:
        s = (sine(amplitude, 1.0),)
        assert EndStop().comes_to(np.array([1e5, 0.03 * amplitude, 1.0]), s) == ("gas-stiffness",)
        assert EndStop().comes_to(np.array([1e5, 0.2 * amplitude, 1.0]), s) == ()

    def test_a_progressive_stop_has_its_stiffness_at_a_millimetre(self) -> None:
        depth = np.array([0.0, 5e-4, 1e-3, 2e-3])
        s = Signals(PERIOD, {"displacement": np.concatenate([0.01 + depth, -0.01 - depth])}, np.zeros(8))
        soft, hard = (composed(EndStop(), [4e4, 0.01, n], s, nothing) for n in (1.0, 1.5))
        np.testing.assert_allclose(soft, 4e4 * np.concatenate([depth, -depth]), rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(hard[:4], 4e4 * 1e-3 * (depth / 1e-3) ** 1.5, rtol=1e-10)
        assert hard[2] == pytest.approx(soft[2]) and hard[3] > soft[3] and hard[1] < soft[1]


class TestInertia:
    def test_is_mass_times_the_second_derivative(self) -> None:
        s = sine(0.01, 2.0)
        exact = -4.0 * (2 * np.pi * 2.0) ** 2 * s["displacement"]
        force = composed(FixtureInertia(), [4.0], s, nothing)
        assert np.abs(force - exact).std() < 0.02 * exact.std(), "one period: the ends tell"

    @pytest.mark.parametrize("noise", [0.0, 2e-3, 1e-2])
    def test_the_noise_of_the_velocity_is_not_differentiated(self, noise: float, rng: np.random.Generator) -> None:
        """By central differences at 512 Hz a hundredth of noise would make a mass a twelfth too light."""
        t = PERIOD * np.arange(6000)
        x, v = motion(t)
        s = Signals(PERIOD, {"displacement": x, "velocity": v + noise * v.std() * rng.standard_normal(6000)},
                    np.zeros(6000))
        exact = sum(-size * (w := 2 * np.pi * f) ** 2 * np.sin(w * t + phase)
                    for size, f, phase in ((4e-3, 0.8, 0.3), (2e-3, 2.7, 1.0), (8e-4, 9.0, 2.0)))
        force = composed(FixtureInertia(), [4.0], s, nothing)
        assert np.std(force - 4 * exact) < (1e-3 + noise) * 4 * np.std(exact)
        assert 4.0 * (force @ exact) / (force @ force) == pytest.approx(1.0, abs=1e-3)

    @pytest.mark.parametrize("top", [0.6, 0.9, 1.0])
    def test_a_motion_of_the_whole_band_is_no_noise(self, top: float, rng: np.random.Generator) -> None:
        """What excites up to a share of half the sample rate is differentiated up to there."""
        spectrum = np.fft.rfft(rng.standard_normal(8192))
        spectrum[round(top * spectrum.size):] = 0.0
        v = np.fft.irfft(spectrum)
        exact = np.fft.irfft(2j * np.pi * np.fft.rfftfreq(8192, PERIOD) * spectrum)
        found = acceleration(Signals(PERIOD, {"velocity": v}, v))[256:-256]
        assert found @ exact[256:-256] > 0.98 * np.sqrt(found @ found * (exact[256:-256] @ exact[256:-256]))

    @pytest.mark.parametrize("samples", [600, 1500])
    def test_from_400_samples_on_the_acceleration_has_less_noise(self, samples: int, rng: np.random.Generator) -> None:
        t = PERIOD * np.arange(samples)
        v = motion(t)[1] + 1e-3 * rng.standard_normal(samples)
        exact = np.gradient(motion(PERIOD / 8 * np.arange(8 * samples))[1], PERIOD / 8)[::8]
        found = acceleration(Signals(PERIOD, {"velocity": v}, v))
        assert np.std(found - exact) < 0.8 * np.std(np.gradient(v, PERIOD) - exact)

    @pytest.mark.parametrize("samples", [120, 399])
    def test_few_samples_tell_no_band(self, samples: int, rng: np.random.Generator) -> None:
        v = motion(PERIOD * np.arange(samples))[1] + 1e-3 * rng.standard_normal(samples)
        np.testing.assert_array_equal(acceleration(Signals(PERIOD, {"velocity": v}, v)), np.gradient(v, PERIOD))

    def test_a_velocity_that_jumps_is_taken_as_it_is(self) -> None:
        v = np.repeat([0.1, -0.1, 0.1], 200)
        s = Signals(PERIOD, {"velocity": v}, np.zeros(600))
        np.testing.assert_array_equal(acceleration(s), np.gradient(v, PERIOD))

    def test_a_measured_acceleration_is_used(self) -> None:
        s = sine(0.01, 2.0).replace(acceleration=np.full(2048, 3.0))
        np.testing.assert_array_equal(composed(FixtureInertia(), [2.0], s, nothing), np.full(2048, 6.0))
        np.testing.assert_array_equal(acceleration(s), np.full(2048, 3.0))

    def test_grows_with_the_square_of_frequency(self) -> None:
        peaks = [np.abs(composed(FixtureInertia(), [1.0], sine(0.01, f), nothing)).max() for f in (1.0, 3.0)]
        assert peaks[1] / peaks[0] == pytest.approx(9.0, rel=1e-3)


class TestSecondOrder:
    @pytest.mark.parametrize("damping", [0.05, 0.7, 1.0, 1.8])
    @pytest.mark.parametrize("period", [0.0008, 0.003, 0.02])
    def test_linear_between_samples_is_exact(self, period: float, damping: float, rng: np.random.Generator) -> None:
        values = np.cumsum(rng.standard_normal(300))
        t = PERIOD * np.arange(300)
        system = lti([1.0], [period**2, 2 * damping * period, 1.0])
        exact = values[0] + lsim(system, values - values[0], t, interp=True)[1]
        np.testing.assert_allclose(second_order(values, period, damping, PERIOD), exact, atol=1e-9)

    @pytest.mark.parametrize("damping", [0.05, 0.7])
    def test_jumps_at_samples_are_exact(self, damping: float, rng: np.random.Generator) -> None:
        """A ramp and jumps: what is held is seen shortly after each sample, by a solver of a hundred times the rate."""
        held, ramp = rng.standard_normal(200), np.linspace(0, 3, 200)
        before = np.concatenate([held[:1], held[:-1]])
        got = second_order(held + ramp, 0.004, damping, PERIOD, before + ramp, SEEN_AFTER)
        t = PERIOD * np.arange(200)
        system = lti([1.0], [0.004**2, 2 * damping * 0.004, 1.0])
        fine = lsim(system, np.repeat(held - held[0], 100), PERIOD / 100 * np.arange(20_000), interp=False)[1]
        exact = held[0] + fine[round(100 * SEEN_AFTER)::100] + lsim(system, ramp, t)[1]
        np.testing.assert_allclose(got, exact, atol=1e-9)

    @pytest.mark.parametrize("damping", [0.3, 1.0, 1.0 + 1e-9, 2.0])
    def test_tends_to_the_values_as_the_time_constant_vanishes(self, damping: float, rng: np.random.Generator) -> None:
        """A signal that is linear between samples comes 2ζT late, however far T is below a sample."""
        values = np.cumsum(rng.standard_normal(100))
        late = np.concatenate([[0.0], np.diff(values)]) * 2 * damping / PERIOD
        for period in (1e-6, 1e-9, 1e-12):
            got = second_order(values, period, damping, PERIOD)
            np.testing.assert_allclose(got, values - period * late, atol=1e-12)

    def test_step_response_overshoots_as_the_damping_says(self) -> None:
        values = np.concatenate([np.zeros(5), np.ones(2000)])
        before = np.concatenate([np.zeros(6), np.ones(1999)])
        got = second_order(values, 0.01, 0.3, PERIOD, before, SEEN_AFTER)
        assert got.max() - 1 == pytest.approx(np.exp(-np.pi * 0.3 / np.sqrt(1 - 0.09)), rel=1e-2)
        assert got[-1] == pytest.approx(1.0, abs=1e-6)


class TestResonance:
    @pytest.mark.seconds
    def test_a_force_that_follows_a_held_current_jumps_where_the_current_does(self) -> None:
        s = road_like(2, 1024)
        current = s["current"]
        got = composed(FixtureResonance(), [0.004, 0.1], s, current_itself)
        system = lti([1.0], [0.004**2, 2 * 0.1 * 0.004, 1.0])
        fine = lsim(system, np.repeat(current - current[0], 100), PERIOD / 100 * np.arange(100 * 1024), interp=False)[1]
        np.testing.assert_allclose(got, current[0] + fine[round(100 * SEEN_AFTER)::100], atol=1e-9)

    @pytest.mark.seconds
    @pytest.mark.parametrize("frequency", [40.0, 120.0])
    def test_a_force_that_turns_between_samples_rings_from_there(self, frequency: float) -> None:
        """Friction on tones, of which the reference knows every reversal, and this one the samples."""
        times = PERIOD / 32 * np.arange(32 * 2048)
        speed = np.sin(2 * np.pi * 1.3 * times) + 0.4 * np.sin(2 * np.pi * 5.7 * times)
        period, v = 1 / (2 * np.pi * frequency), speed[::32]
        force = np.tanh(speed / 0.01)
        exact = lsim(lti([1.0], [period**2, 2 * 0.05 * period, 1.0]), force, times)[1][::32]
        s = Signals(PERIOD, {"velocity": v}, np.zeros(v.size))
        got = composed(FixtureResonance(), [period, 0.05], s, lambda s: np.tanh(s["velocity"] / 0.01))
        by_samples = second_order(np.tanh(v / 0.01), period, 0.05, PERIOD)
        error, before = (np.std(f - exact) / np.std(exact - force[::32]) for f in (got, by_samples))
        assert error < 0.5 * before and error < 0.1

    @pytest.mark.parametrize(("samples", "times"), [(LONG // 4, 4), (LONG // 2, 2), (LONG // 2 + 1, 1)])
    def test_a_long_record_is_asked_less_often_between_its_samples(self, samples: int, times: int) -> None:
        s = Signals(PERIOD, {"velocity": np.sin(2 * np.pi * 3 * PERIOD * np.arange(samples))}, np.zeros(samples))
        asked = []

        def core(at: Signals) -> np.ndarray:
            asked.append(at.n_samples)
            return np.tanh(at["velocity"] / 0.01)

        assert composed(FixtureResonance(), [0.004, 0.1], s, core).size == samples
        assert asked == [times * samples]

    def test_slow_forces_pass_and_those_at_resonance_grow(self) -> None:
        t = PERIOD * np.arange(8192)

        def gain(frequency: float) -> float:
            s = Signals(PERIOD, {"velocity": np.sin(2 * np.pi * frequency * t)}, np.zeros(t.size))
            force = composed(FixtureResonance(), [1 / (2 * np.pi * 20.0), 0.1], s, speed_itself)
            return float(np.abs(force[4096:]).max())

        assert gain(0.5) == pytest.approx(1.0, abs=2e-3)
        assert gain(20.0) == pytest.approx(1 / 0.2, rel=0.03)
        assert gain(60.0) == pytest.approx(1 / 8.0, rel=0.05)

    def test_a_short_period_leaves_the_force_alone(self) -> None:
        s = road_like(3)
        for law in (speed_itself, current_itself):
            assert np.abs(composed(FixtureResonance(), [1e-6, 0.7], s, law) - law(s)).max() < 1e-4

    @pytest.mark.parametrize("period", [1e-8, 2e-9, 1e-10, 1e-12, 1e-25, 1e-300])
    @pytest.mark.parametrize("damping", [0.005, 0.7])
    def test_a_vanishing_period_vanishes_without_rounding(self, period: float, damping: float) -> None:
        """Its transition overflows where it is a sample's 1e-20, and a fit may end there."""
        s = road_like(3)
        for law in (speed_itself, current_itself):
            least = np.abs(composed(FixtureResonance(), [1e-8, damping], s, law) - law(s)).max()
            assert np.abs(composed(FixtureResonance(), [period, damping], s, law) - law(s)).max() <= least < 1e-5
