"""Pole locus, its band and the probability of frozen stability against closed forms."""

from __future__ import annotations

import time

import numpy as np
import pytest

from lpvid.analysis.critical import critical_scheduling
from lpvid.analysis.pole_locus import pole_locus
from lpvid.analysis.uncertainty import pole_band, stability_probability
from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Scheduling, Spline

D0 = np.array([-1.63, 0.964, -0.149, -0.083])
D1 = np.array([0.15, -0.1745, 0.06372222, -0.01844444])
BOX = Scheduling(("current",), (0.0,), (2.5,), units=("A",))


@pytest.fixture
def damper() -> LPVTransferFunction:
    return LPVTransferFunction.siso(np.column_stack([D0, D1]), [[0, 0], [1, 0]], Polynomial("current", 1), 1 / 512,
                                    scheduling=BOX)


def states(A, sample_time=1.0, **kwargs) -> LPVStateSpace:
    a = np.array(A, dtype=float)
    m, n, _ = a.shape
    return LPVStateSpace(a, np.zeros((m, n, 1)), np.zeros((m, 1, n)), np.zeros((m, 1, 1)),
                         Polynomial("p", degree=m - 1), sample_time, **kwargs)


def first_order(pole, slope=0.0) -> LPVTransferFunction:
    """z = pole + slope·p on −1 … 1."""
    return LPVTransferFunction.siso([[-pole, -slope]], [[1, 0]], Polynomial("p", degree=1), 0.1)


def test_the_branches_of_the_damper_are_the_published_poles(damper):
    locus = pole_locus(damper, points=101)
    assert sorted(locus.poles[0], key=lambda z: (z.real, z.imag)) == pytest.approx([-0.2, 0.5 - 0.5j, 0.5 + 0.5j, 0.83])
    end = sorted(locus.poles[-1], key=lambda z: (z.real, z.imag))
    assert end == pytest.approx([-0.3492, 0.3871 - 0.5436j, 0.3871 + 0.5436j, 0.83], abs=1e-4)
    for k, p in enumerate(locus.p):
        assert np.sort_complex(locus.poles[k]) == pytest.approx(np.sort_complex(damper.frozen_poles([p])), abs=1e-9)
    assert locus.stable.all() and locus.max_modulus == pytest.approx(0.83, abs=1e-6)


def test_the_pole_that_does_not_move_and_the_ringing_one_are_pointed_out(damper):
    """0.83 at 512 Hz: time constant 10.48 ms, 15.2 Hz (equations.md 1.4.7)."""
    locus = pole_locus(damper)
    (fixed,) = locus.fixed
    assert fixed.pole == pytest.approx(0.83, abs=1e-6)
    assert fixed.time_constant == pytest.approx(-1 / (512 * np.log(0.83)), rel=1e-6)
    assert fixed.time_constant == pytest.approx(10.48e-3, abs=1e-5)
    assert fixed.frequency_hz == pytest.approx(15.18, abs=0.01)
    text = str(locus)
    assert "current-independent pole 0.83" in text and "256 Hz" in text
    assert "does not cover a moving scheduling variable" in text


def test_an_independent_filter_pole_of_a_continuous_model_and_a_moving_one():
    locus = pole_locus(states([np.diag([-40.0, -2.0]), np.diag([0.0, -1.0])], None))
    assert [f.pole for f in locus.fixed] == pytest.approx([-40])
    assert locus.fixed[0].time_constant == pytest.approx(0.025)
    assert pole_locus(first_order(0.5)).fixed == ()


def test_branches_that_pass_through_each_other_do_not_swap():
    """Real poles 0.5p and 0.1 − 0.3p cross at p = 0.125, off every grid point."""
    a = np.array([np.diag([0.0, 0.1]), np.diag([0.5, -0.3])])
    mixing = np.array([[1.0, 0.4], [0.2, 1.0]])
    model = states(mixing @ a @ np.linalg.inv(mixing))
    locus = pole_locus(model, points=12)
    expected = np.column_stack([0.5 * locus.p, 0.1 - 0.3 * locus.p])
    order = np.argmin(np.abs(locus.poles[0][:, None] - expected[0][None, :]), axis=1)
    assert locus.poles == pytest.approx(expected[:, order], abs=1e-9)


def test_close_complex_branches_keep_their_identity_on_a_coarse_grid():
    """Two pairs r_k e^{±jw_k(p)} whose angles cross at p = 0 while the radii differ by 0.02."""
    def block(radius, sign):
        c, s = radius * np.cos(0.8), radius * np.sin(0.8)
        return np.array([[c, s], [-s, c]]), sign * np.array([[-0.3, 0.0], [0.0, -0.3]])

    (one, one_slope), (two, two_slope) = block(0.80, 1), block(0.82, -1)
    zero = np.zeros((2, 2))
    model = states([np.block([[one, zero], [zero, two]]), np.block([[one_slope, zero], [zero, two_slope]])])
    locus = pole_locus(model, points=9)
    imaginary = np.sort(np.abs(locus.poles.imag[0]))
    for column in range(4):
        steady = locus.poles[:, column]
        assert np.abs(steady.imag) == pytest.approx(np.abs(steady.imag[0]) * np.ones(9), abs=1e-9)
        assert np.diff(steady.real, 2) == pytest.approx(np.zeros(7), abs=1e-9)
    assert imaginary == pytest.approx(np.sin(0.8) * np.array([0.80, 0.80, 0.82, 0.82]))


def test_two_real_poles_meet_where_the_discriminant_vanishes():
    """s² + 2s + (1 + p): real for p < 0, a pair for p > 0."""
    locus = pole_locus(states([[[0, 1], [-1, -2]], [[0, 0], [-1, 0]]], None), points=40)
    (meeting,) = locus.meetings
    assert meeting.value == pytest.approx(0.0, abs=1e-9) and meeting.becomes == "pair"
    assert meeting.pole == pytest.approx(-1, abs=1e-6)
    assert "become a complex pair" in str(locus)


def test_damping_and_natural_frequency_in_discrete_and_continuous_time():
    """ω = 2π·8 rad/s, ζ = 0.3, sampled at 100 Hz."""
    omega, zeta, ts = 2 * np.pi * 8, 0.3, 0.01
    s = -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)
    z = np.exp(s * ts)
    still = np.zeros((2, 2))
    continuous = pole_locus(states([[[0, 1], [-abs(s) ** 2, 2 * s.real]], still], None), points=3)
    discrete = pole_locus(states([[[0, 1], [-abs(z) ** 2, 2 * z.real]], still], ts), points=3)
    for locus in (continuous, discrete):
        assert locus.frequency_hz == pytest.approx(8.0 * np.ones((3, 2)))
        assert locus.damping_ratio == pytest.approx(0.3 * np.ones((3, 2)))
    assert continuous.max_modulus == pytest.approx(s.real * np.ones(3))
    dead_beat = pole_locus(first_order(0.0), points=2)
    assert dead_beat.damping_ratio == pytest.approx(1.0) and np.isinf(dead_beat.frequency_hz).all()


def test_a_locus_agrees_with_the_critical_values(damper):
    locus = pole_locus(damper, points=2001, range=(-8.0, 12.0))
    low, high = critical_scheduling(damper).stable_range
    inside = (locus.p > low) & (locus.p < high)
    assert (locus.stable == inside).all()


def test_rescaling_the_unit_leaves_the_poles():
    milli = LPVTransferFunction.siso(np.column_stack([D0, D1 / 1e3]), [[0, 0], [1, 0]], Polynomial("current", 1),
                                     1 / 512, scheduling=Scheduling(("current",), (0.0,), (2500.0,), units=("mA",)))
    ampere = LPVTransferFunction.siso(np.column_stack([D0, D1]), [[0, 0], [1, 0]], Polynomial("current", 1), 1 / 512,
                                      scheduling=BOX)
    assert pole_locus(milli, points=21).poles == pytest.approx(pole_locus(ampere, points=21).poles, abs=1e-9)


def test_a_locus_needs_one_variable_and_a_range(damper):
    two = LPVTransferFunction.siso([[-0.5, 0.1, 0.1]], [[1, 0, 0]], Polynomial(("p", "q"), degree=1), 1.0)
    with pytest.raises(InputError, match="variable="):
        pole_locus(two)
    assert pole_locus(two, "q", at={"p": 1.0}, points=2).poles.real.ravel() == pytest.approx([0.5, 0.3])
    for arguments in ({"points": 1}, {"range": (1.0, 1.0)}, {"variable": "voltage"}):
        with pytest.raises(InputError):
            pole_locus(damper, **arguments)


@pytest.mark.seconds
def test_the_band_holds_the_quantiles_of_the_draws():
    """z = m + 0.2 p with m of standard deviation 0.1: quantiles of a normal distribution."""
    rng = np.random.default_rng(3)
    draws = [first_order(0.6 + 0.1 * rng.standard_normal(), 0.2) for _ in range(4000)]
    band = pole_band(draws, points=5, level=0.9)
    centre = 0.6 + 0.2 * band.p
    assert band.median == pytest.approx(centre, abs=0.01)
    assert band.high - centre == pytest.approx(0.1645, abs=0.01)
    assert centre[2:] - band.low[2:] == pytest.approx(0.1645, abs=0.01)
    assert band.share_stable[-1] == pytest.approx(0.9772, abs=0.01)
    assert band.cloud.shape == (100, 5, 1)


@pytest.mark.slow
def test_the_probability_of_stability_is_that_of_the_normal_distribution():
    """max over −1 ≤ p ≤ 1 of |m + 0.2p| = |m| + 0.2 < 1 where |m| < 0.8: probability Φ(2) for m ~ N(0.6, 0.1²)."""
    rng = np.random.default_rng(4)
    draws = [first_order(0.6 + 0.1 * rng.standard_normal(), 0.2) for _ in range(1500)]
    result = stability_probability(draws)
    assert result.exact and result.interval[0] < 0.97725 < result.interval[1]
    assert result.standard_error == pytest.approx(np.sqrt(result.probability * (1 - result.probability) / 1500))


def test_an_instability_between_grid_points_is_not_overlooked():
    """z = h − 400 (p − 0.31)²: unstable for h > 1, on an interval far narrower than the grid."""
    def peak(h):
        return LPVTransferFunction.siso([[-(h - 400 * 0.31**2), -800 * 0.31, 400.0]], [[1, 0, 0]],
                                        Polynomial("p", degree=2), 1.0,
                                        scheduling=Scheduling(("p",), (0.26,), (0.36,)))

    draws = [peak(h) for h in (0.9, 0.99, 0.9999, 1.00001, 1.0001, 1.001)]
    assert stability_probability(draws, points=4).probability == pytest.approx(0.5)


def test_an_interval_of_certain_outcomes_is_not_empty():
    """Wilson's interval for 20 of 20 is 20/(20 + z²) … 1."""
    result = stability_probability([first_order(0.5)] * 20)
    assert result.probability == 1 and result.interval == pytest.approx((20 / (20 + 1.959964**2), 1.0), abs=1e-6)
    assert result.standard_error > 0 and "20 draws" in str(result)
    assert stability_probability([first_order(1.5)] * 5).probability == 0


def test_splines_and_several_variables_can_be_judged_too(rng):
    box = Scheduling(("p",), (0.0,), (2.0,))
    spline = Spline("p", segments=2, order=1).bound(box)
    draws = [LPVTransferFunction.siso([[-x, -1.02, -0.5]], [[1, 0, 0]], spline, 1.0, scheduling=box)
             for x in (0.2, 0.5)]
    assert stability_probability(draws, points=4).probability == 0
    two = [LPVTransferFunction.siso([[-c, -0.2, -0.2]], [[1, 0, 0]], Polynomial(("p", "q"), degree=1), 1.0)
           for c in (0.5, 0.7)]
    result = stability_probability(two)
    assert result.probability == 0.5 and not result.exact


def test_the_range_can_be_widened(damper):
    assert stability_probability([damper]).probability == 1
    assert stability_probability([damper], Scheduling(("current",), (0.0,), (8.99,))).probability == 1
    assert stability_probability([damper], Scheduling(("current",), (0.0,), (9.01,))).probability == 0


@pytest.mark.seconds
def test_five_hundred_draws_of_fourth_order_take_under_three_seconds(damper, rng):
    draws = [damper.replace(a=damper.a + 0.01 * rng.standard_normal(damper.a.shape)) for _ in range(500)]
    start = time.process_time()
    pole_band(draws)
    stability_probability(draws)
    assert time.process_time() - start < 3.0


def test_draws_must_be_alike_and_present():
    with pytest.raises(InputError):
        pole_band([])
    with pytest.raises(InputError):
        stability_probability([first_order(0.5), states([[[0.5]]])])
    with pytest.raises(InputError):
        pole_band([first_order(0.5)], level=1.0)
