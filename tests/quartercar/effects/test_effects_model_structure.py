"""Causes of form: the bend over the current, an unlogged modulation, a further mode."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, composed, current_itself, guo, nothing, road_like, speed_itself
from scipy.signal import lsim, lti

from lpvid.baselines.signals import Signals, in_turn
from lpvid.effects.composition import Composition
from quartercar.effects.hydraulics import QuadraticLoss
from quartercar.effects.model_structure import (
    MODES,
    ColouredNoise,
    MissingScheduling,
    ModelOrder,
    SchedulingDegree,
    slow_modes,
)
from quartercar.effects.structure import FixtureResonance


def of(current: np.ndarray) -> Signals:
    return Signals(PERIOD, {"current": current}, np.zeros(current.size))


class TestSchedulingDegree:
    def test_keeps_zero_and_one_ampere(self) -> None:
        ends = of(np.array([0.0, 1.0, 0.0, 1.0]))
        for values in ([0.4, 0.0], [0.0, -0.3], [-1.0, 0.7]):
            np.testing.assert_allclose(composed(SchedulingDegree(), values, ends, current_itself), ends["current"],
                                       atol=1e-15)

    def test_is_the_polynomial_of_its_numbers(self) -> None:
        i = np.linspace(0, 2.5, 26)
        got = composed(SchedulingDegree(), [0.2, -0.1], of(i), current_itself)
        np.testing.assert_allclose(np.polyfit(i, got, 3), [-0.1, 0.2, 1 - 0.2 + 0.1, 0.0], atol=1e-12)

    def test_means_the_same_on_every_record(self) -> None:
        """A record at one level sees what a record of all levels sees there."""
        every = composed(SchedulingDegree(), [0.2, 0.05], of(np.array([0.5, 1.5, 2.5])), current_itself)
        each = [composed(SchedulingDegree(), [0.2, 0.05], of(np.full(3, i)), current_itself)[0]
                for i in (0.5, 1.5, 2.5)]
        np.testing.assert_allclose(each, every, rtol=1e-14)

    def test_makes_up_for_a_quadratic_law_that_a_straight_one_misses(self) -> None:
        """F = 900 i + 150 i² is A (i + q (i² − i)) with A = 1050, q = 1/7."""
        i = np.linspace(0, 2.5, 26)
        got = 1050 * composed(SchedulingDegree(), [1 / 7, 0.0], of(i), current_itself)
        np.testing.assert_allclose(got, 900 * i + 150 * i**2, atol=1e-9)


class TestMissingScheduling:
    def test_modes_are_those_of_a_cosine_transform(self) -> None:
        n = 2000
        ones = Signals(PERIOD, {"velocity": np.ones(n)}, np.zeros(n), span=(0.0, 1.0))
        values = np.random.default_rng(0).uniform(-0.1, 0.1, MODES)
        ratio = composed(MissingScheduling(), [*values, 0.0, 0.0], ones, speed_itself) - 1
        place = np.linspace(0, 1, n)
        found = [2 * np.trapezoid(ratio * np.cos(np.pi * k * place), place) for k in range(1, MODES + 1)]
        np.testing.assert_allclose(found, values, atol=1e-4)

    @pytest.mark.parametrize(("periods", "left"), [(0.5, 1e-3), (2.0, 5e-3), (4.0, 0.06)])
    def test_meets_a_sine_that_does_not_fit_the_record(self, periods: float, left: float) -> None:
        place = np.linspace(0, 1, 2000)
        wanted = np.sin(2 * np.pi * periods * place)
        columns = np.column_stack([np.ones(place.size), slow_modes(place)])
        missed = wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
        assert np.std(missed) < left * np.std(wanted)

    def test_runs_through_several_records(self) -> None:
        """Cut in two, a run is modulated as it was in one piece."""
        whole = road_like(1, 4096)
        values = [0.1, -0.2, 0.05, 0.0, 0.03, 0.0, -0.02, 0.0, 0.0, 0.01, 0.02, -0.03]
        parts = in_turn([Signals(PERIOD, {k: c[a:b] for k, c in whole.channels.items()}, whole.output[a:b])
                         for a, b in ((0, 1024), (1024, 4096))])
        assert parts[0].span == (0.0, 0.25) and parts[1].span == (0.25, 1.0)
        cut = np.concatenate([composed(MissingScheduling(), values, p, speed_itself) for p in parts])
        one = composed(MissingScheduling(), values, whole, speed_itself)
        assert np.abs(cut - one).max() < 2e-3 * np.abs(one).max()

    def test_says_nothing_about_a_record_whose_place_is_unknown(self) -> None:
        s = road_like(1)
        apart = Signals(PERIOD, s.channels, s.output)
        got = composed(MissingScheduling(), [0.3] * (MODES + 2), apart, speed_itself)
        np.testing.assert_array_equal(got, s["velocity"])

    def test_the_place_is_kept_when_channels_are_replaced(self) -> None:
        parts = in_turn([road_like(0, 512), road_like(1, 512)])
        assert parts[1].replace(velocity=np.zeros(512)).span == (0.5, 1.0)

    def test_what_the_law_holds_besides_is_modulated_with_it(self) -> None:
        """A turbulent loss is part of the force whose modulation nobody logged: (F_0 + c v|v|) m(t)."""
        composition = Composition(guo(), (MissingScheduling(), QuadraticLoss()))
        places = dict(zip((e.name for e in composition.effects), composition.places, strict=True))
        s, vector = road_like(1), composition.neutral
        vector[places["quadratic-loss"]] = 3000.0
        steady = composition.predict(s, vector)
        values = np.linspace(-0.05, 0.05, MODES + 2)
        vector[places["missing-scheduling"]] = values
        expected = steady * (1 + slow_modes(np.linspace(0.0, 1.0, s.n_samples)) @ values)
        np.testing.assert_allclose(composition.predict(s, vector), expected, rtol=1e-12)


class TestModelOrder:
    def test_is_a_share_of_a_second_order_mode(self) -> None:
        times = PERIOD / 20 * np.arange(20 * 1024)
        fine = 1 + np.sin(2 * np.pi * 3.0 * times) + 0.3 * np.sin(2 * np.pi * 20.0 * times)
        v = fine[::20]
        s = Signals(PERIOD, {"velocity": v, "current": np.linspace(0, 1, v.size)}, np.zeros(v.size))
        share, period, damping = 0.4, 0.006, 0.2
        mode = lsim(lti([1.0], [period**2, 2 * damping * period, 1.0]), fine - v[0], times, interp=True)[1][::20] + v[0]
        np.testing.assert_allclose(composed(ModelOrder(), [share, period, damping], s, speed_itself),
                                   v + share * (mode - v), atol=1e-4)

    def test_leaves_a_constant_force_alone(self) -> None:
        s = road_like(5).replace(velocity=np.full(4096, 0.1))
        np.testing.assert_allclose(composed(ModelOrder(), [0.5, 0.02, 0.1], s, speed_itself), 0.1, rtol=1e-12)

    def test_all_of_the_force_is_left_to_the_fixture(self) -> None:
        """A share of one is a fixture that swings, which is another cause: the search stops short of it."""
        s = road_like(6)
        np.testing.assert_allclose(composed(ModelOrder(), [1.0, 0.004, 0.1], s, speed_itself),
                                   composed(FixtureResonance(), [0.004, 0.1], s, speed_itself), atol=1e-12)
        assert ModelOrder().parameters[0].bounds[1] < 1


def test_coloured_noise_is_never_composed() -> None:
    assert ColouredNoise().points((road_like(),)) == [] and ColouredNoise().applies(guo(), (road_like(),))
    np.testing.assert_array_equal(composed(ColouredNoise(), [5.0], road_like(), nothing), np.zeros(4096))
