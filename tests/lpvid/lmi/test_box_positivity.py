"""Statements between grid points: polynomials, splines and sines, against their exact minima."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lpvid.lmi.box_positivity import Axis, everywhere


def scalar(function):
    """A function of the points as 1 × 1 matrices, with rounding of a few units."""
    def evaluate(points, moves):
        return function(points, moves)[:, :, None, None], 1e-14

    return evaluate


@pytest.mark.parametrize(("lift", "holds"), [(1e-6, True), (-1e-6, False)])
def test_a_parabola_that_dips_between_the_points_of_any_coarse_grid(lift, holds):
    found = everywhere(scalar(lambda p, m: (p - 0.1234567) ** 2 + lift), [Axis(-1.0, 1.0, 2)], [], budget=20_000)
    assert found.holds is holds


@pytest.mark.parametrize(("lift", "holds"), [(1e-4, True), (-1e-4, False)])
def test_a_wave_is_decided_within_its_interpolation_error(lift, holds):
    wave = scalar(lambda p, m: 1 + np.cos(3 * p - 0.4) + lift)
    found = everywhere(wave, [Axis(-np.pi, np.pi, frequency=3.0)], [], ceiling=2.1, budget=50_000)
    assert found.holds is holds


@settings(max_examples=30)
@given(st.integers(1, 4), st.lists(st.floats(-1, 1), min_size=9, max_size=9), st.floats(0.5, 3.0))
def test_a_proven_bound_is_below_every_value(harmonics, weights, width):
    k = np.arange(1, harmonics + 1)
    a, b = np.array(weights[:harmonics]), np.array(weights[4 : 4 + harmonics])

    def value(p):
        return np.cos(p * k) @ a + np.sin(p * k) @ b

    size = float(np.abs(a).sum() + np.abs(b).sum())
    lowest = float(value(np.linspace(-width, width, 20_001)[:, None]).min())
    lifted = scalar(lambda p, m: value(p)[:, None] - lowest + 1e-3)
    found = everywhere(lifted, [Axis(-width, width, frequency=float(harmonics))], [], ceiling=3 * size + 1)
    assert found.holds and found.bound <= 1e-3 + 1e-12


def test_pieces_meet_at_their_breaks():
    kinked = scalar(lambda p, m: np.abs(p - 0.3) + 0.01)
    assert everywhere(kinked, [Axis(0.0, 1.0, 1, (0.3,))], []).holds
    assert not everywhere(scalar(lambda p, m: np.abs(p - 0.3) - 0.01), [Axis(0.0, 1.0, 1, (0.3,))], []).holds


def test_moves_are_axes_too():
    saddle = scalar(lambda p, m: 0.26 + p * (m[:, 0][None, :] - 0.5))  # least at p = 1, m = 0 or p = −1, m = 1
    assert not everywhere(saddle, [Axis(-1.0, 1.0, 1)], [Axis(0.0, 1.0, 1)]).holds
    assert everywhere(scalar(lambda p, m: 0.51 + p * (m[:, 0][None, :] - 0.5)), [Axis(-1.0, 1.0, 1)],
                      [Axis(0.0, 1.0, 1)]).holds


def test_what_cannot_be_decided_is_not_claimed():
    one = scalar(lambda p, m: np.ones((len(p), max(len(m), 1))))
    assert everywhere(one, [Axis(0.0, 1.0, opaque=True)], []).holds is None
    assert everywhere(one, [Axis(0.0, 1.0, 2, frequency=1.0)], []).holds is None  # nothing bounds what lies between
    assert everywhere(one, [Axis(0.0, 1.0, 300)], [], budget=100).holds is None


@pytest.mark.parametrize(("lift", "holds"), [(1e-8, True), (-1e-8, False)])
def test_a_spline_times_a_wave_is_decided(lift, holds):
    """(p − ½)²(1 + cos(2p − 1 + π)) has its only zero at p = ½; a slope that jumps at 0.3 comes on top."""
    def value(p, m):
        return (p - 0.5) ** 2 * (1 - np.cos(2 * p - 1)) + 1e-3 * np.maximum(0.3 - p, 0.0) + 0.0 * p + lift

    axis = Axis(-1.0, 2.0, 2, (0.3,), 2.0)
    assert everywhere(scalar(value), [axis], [], ceiling=10.0, budget=50_000).holds is holds


@settings(max_examples=20)
@given(st.lists(st.floats(-1, 1), min_size=8, max_size=8), st.integers(1, 3))
def test_a_proven_bound_of_products_is_below_every_value(weights, frequency):
    a, b = np.array(weights[:4]), np.array(weights[4:])

    def value(p):
        return (np.polynomial.polynomial.polyval(p, a) * np.cos(frequency * p)
                + np.polynomial.polynomial.polyval(p, b) * np.sin(frequency * p))

    lowest = float(value(np.linspace(-1, 1, 20_001)).min())
    found = everywhere(scalar(lambda p, m: value(p) - lowest + 1e-3), [Axis(-1.0, 1.0, 3, (), float(frequency))], [],
                       ceiling=20.0)
    assert found.holds and found.bound <= 1e-3 + 1e-12


@pytest.mark.parametrize("lift", [1e-12, 2e-12, 5e-12])
def test_an_error_of_interpolation_is_no_failure(lift):
    """The coarser interpolant misses by 8e-11 and dips below 0; cells are halved until a corner of one lies there."""
    for phase in np.linspace(0, 1, 60):
        wave = everywhere(lambda p, m, phase=phase: ((1 + np.cos(8 * p + phase) + lift)[:, :, None, None], 1e-15),
                          [Axis(0.0, 1.0, frequency=8.0)], [], ceiling=2.1)
        assert wave.holds is not False


def test_a_failure_at_a_node_is_one_however_large_the_error_of_interpolation():
    wave = scalar(lambda p, m: np.cos(p) - 1 + 0 * p)  # 0 at the end p = 0, which is a node
    assert everywhere(wave, [Axis(0.0, 1.0, frequency=1.0)], [], ceiling=1e6).holds is False


def test_no_node_lies_beyond_the_box():
    low, high = -0.7, 1.92
    assert low + (high - low) > high  # by rounding
    seen = []
    everywhere(scalar(lambda p, m: seen.append(p) or 1 + p**2), [Axis(low, high, 2)], [])
    assert np.concatenate(seen).max() == high
