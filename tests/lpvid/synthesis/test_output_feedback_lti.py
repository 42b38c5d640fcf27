"""Output feedback of time-invariant plants against published optima, python-control and loops closed by hand."""

import math

import numpy as np
import pytest
from helpers.responses import largest_gain
from helpers.synthesis_plants import column, ill_conditioned, plant, sb10fd, scherer, trivial
from scipy.linalg import expm

import lpvid as lpv
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.output_feedback import OutputFeedback
from lpvid.synthesis.synthesizing import synthesize


def _peak(loop) -> float:
    """Largest gain over a dense grid of frequencies."""
    return largest_gain(loop.frozen([]), 1j * np.concatenate([[0.0], np.geomspace(1e-4, 1e8, 6001)]))


def _kept(result, limit):
    assert result.verdict == "solved", result
    a = result.closed_loop.frozen([])[0]
    assert np.linalg.eigvals(a).real.max() < 0
    peak = _peak(result.closed_loop)
    assert peak <= result.gamma_verified * (1 + 1e-9) <= result.gamma * (1 + 1e-9)
    assert result.gamma_verified <= limit
    assert result.gamma_lower <= result.gamma_verified
    assert peak <= result.gamma_lower * (1 + 1e-6)


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("make", "optimum"), [(scherer, 9.50808), (sb10fd, 10.1843),
                                                (ill_conditioned, math.sqrt(0.65))])
def test_published_optima_are_reached_and_kept(make, optimum):
    result = synthesize(make(), OutputFeedback())
    assert result.infimum == pytest.approx(optimum, rel=2e-5)
    _kept(result, 1.0125 * optimum)
    assert lpv.verify(result.certificate, result.closed_loop).holds and result.between_grid


@pytest.mark.seconds
def test_an_optimum_that_is_not_attained():
    """The infimum is 0, with X and Y growing without bound."""
    result = synthesize(trivial(), OutputFeedback())
    _kept(result, 1e-3)


@pytest.mark.seconds
def test_the_controller_in_the_plants_own_loop_by_control():
    """python-control closes the loop: same poles, gain below the promise."""
    p = scherer()
    result = synthesize(p, OutputFeedback())
    k = result.controller.to_control(at=[])
    whole = p.system.to_control(at=[])
    loop = whole.lft(k)
    assert np.sort_complex(loop.poles()) == pytest.approx(
        np.sort_complex(result.closed_loop.frozen_poles([])), rel=1e-6)
    assert [s.name for s in result.controller.inputs] == ["y1"]
    assert [s.name for s in result.controller.outputs] == ["u1"]
    gain = max(np.linalg.norm(loop(1j * w), 2) for w in np.geomspace(1e-3, 1e3, 2000))
    assert gain <= result.gamma_verified


@pytest.mark.seconds
def test_without_feedthrough():
    result = synthesize(sb10fd(), OutputFeedback(strictly_proper=True))
    assert not result.controller.D.any()
    _kept(result, 1.0125 * max(10.1843, result.infimum))


@pytest.mark.seconds
def test_a_direct_path_from_control_to_measurement_is_allowed_for():
    plain, direct = scherer(), scherer(d22=0.7)
    one, other = (synthesize(p, OutputFeedback()) for p in (plain, direct))
    assert other.infimum == pytest.approx(one.infimum, rel=1e-5)
    _kept(other, 1.0125 * 9.50808)


@pytest.mark.seconds
def test_units_of_time_and_signals_change_nothing():
    """Ten thousand times faster, with the control in another unit: the same optimum."""
    p = scherer()
    s, unit = p.system, np.diag([1.0, 1e-3])
    quick = s.replace(A=1e4 * s.A, B=1e4 * s.B @ unit, D=s.D @ unit)
    result = synthesize(type(p)(quick, p.controls, p.measurements), OutputFeedback())
    assert result.infimum == pytest.approx(9.50808, rel=2e-5)
    _kept(result, 1.0125 * 9.50808)


@pytest.mark.seconds
def test_discrete_time_against_the_continuous_optimum():
    """The bilinear transformation keeps H-infinity optima: Scherer's plant through z = (1 + s)/(1 − s)."""
    from lpvid.synthesis.bilinear import to_discrete

    p = scherer()
    s = p.system
    at = to_discrete(tuple(m[0][None] for m in (s.A, s.B, s.C, s.D)), 1.0)
    digital = s.replace(A=at[0], B=at[1], C=at[2], D=at[3], sample_time=0.01)
    result = synthesize(type(p)(digital, p.controls, p.measurements), OutputFeedback())
    assert result.infimum == pytest.approx(9.50808, rel=2e-5)
    assert result.verdict == "solved" and result.gamma_verified <= 1.0125 * 9.50808
    a, b, c, d = result.closed_loop.frozen([])
    assert np.abs(np.linalg.eigvals(a)).max() < 1
    gains = [np.linalg.norm(c @ np.linalg.solve(np.exp(1j * w) * np.eye(len(a)) - a, b) + d, 2)
             for w in np.linspace(0, np.pi, 4001)]
    assert 0.9 * result.gamma_verified <= max(gains) <= result.gamma_verified
    assert lpv.verify(result.certificate, result.closed_loop).holds


@pytest.mark.seconds
def test_a_sampled_plant_runs_below_its_bound():
    """Simulation: noise through the closed loop of a sampled resonance never gains more than was verified."""
    h, rng = 0.05, np.random.default_rng(3)
    a, b = np.array([[0.0, 1.0], [-4.0, 0.1]]), np.array([[0.0, 0.0], [1.0, 1.0]])
    m = expm(np.block([[a, b], [np.zeros((2, 4))]]) * h)
    p = plant(m[:2, :2], m[:2, 2:3], m[:2, 3:], [[1, 0], [0, 0]], np.zeros((2, 1)), column(0, 0.1), [[0, 1.0]],
              [[0.1]], sample_time=h)
    result = synthesize(p, OutputFeedback())
    a, b, c, d = result.closed_loop.frozen([])
    for _ in range(5):
        w, x, z = rng.normal(size=(4000, 1)), np.zeros(len(a)), np.zeros((4000, 2))
        for k in range(4000):
            z[k] = c @ x + d @ w[k]
            x = a @ x + b @ w[k]
        assert np.linalg.norm(z) <= result.gamma_verified * np.linalg.norm(w)


@pytest.mark.seconds
def test_asked_for_a_bound_it_gives_that_or_says_what_is_least():
    result = synthesize(scherer(), OutputFeedback(bound=12.0))
    assert result.verdict == "solved" and 11 < result.gamma_verified <= 12.0 * 1.005
    refused = synthesize(scherer(), OutputFeedback(bound=9.0))
    assert refused.verdict == "infeasible" and refused.controller is None
    assert "9.508" in refused.why and "9.508" in refused.mend


@pytest.mark.seconds
def test_a_loop_is_what_close_loop_says():
    p = scherer()
    result = synthesize(p, OutputFeedback())
    again = close_loop(p, result.controller)
    assert all(np.array_equal(x, y) for x, y in zip(again.frozen([]), result.closed_loop.frozen([]), strict=True))


@pytest.mark.seconds
@pytest.mark.parametrize("noise", [1e-2, 1e-1])
def test_a_pole_near_zero_does_not_raise_the_bound(noise):
    """The gain of a plant with a pole of 2e-7 rad/s says nothing of what its loop can reach."""
    a = np.diag([-2e-7, -1.0, -30.0])
    a[1, 2] = 5.0
    near = plant(a, [[50, 0], [1, 0], [3, 0]], column(40, 1, 20), [[100, 2, 1], [0, 0, 0]], np.zeros((2, 2)),
                 column(0, noise), [[80, 1, 2]], [[0, noise]])
    result = synthesize(near, OutputFeedback())
    assert result.verdict == "solved" and result.gamma_verified <= 1.02 * result.infimum
