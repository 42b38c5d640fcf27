"""Largest range, largest rate, share of draws: closed forms and re-checks just inside and beyond."""

from __future__ import annotations

import math

import numpy as np
import pytest

import lpvid as lpv
from lpvid.analysis.certificates import certify_stability
from lpvid.analysis.certified_margins import certified_share, largest_range, largest_rate
from lpvid.errors import InputError
from lpvid.scheduling import Polynomial, Scheduling


def lag(slope: float = 0.25, sample_time: float | None = 0.1) -> lpv.LPVTransferFunction:
    """One pole, at 0.5 − slope·p: stable for |0.5 − slope·p| < 1, and then quadratically."""
    return lpv.LPVTransferFunction.siso([[-0.5, slope]], [[0, 0], [1, 0]], Polynomial("p", degree=1), sample_time,
                                        scheduling=Scheduling(("p",), (-1.0,), (1.0,)))


def pair(size: float) -> lpv.LPVStateSpace:
    """Nilpotent at both ends; alternating grows 2·size-fold per sample, frozen poles are ±size·√(1 − p²)."""
    up, down = np.array([[0, 2.0], [0, 0]]), np.array([[0, 0], [2.0, 0]])
    return lpv.LPVStateSpace(size * np.array([0.5 * (up + down), 0.5 * (down - up)]), np.zeros((2, 2, 1)),
                             np.zeros((2, 1, 2)), np.zeros((2, 1, 1)), Polynomial("p", degree=1), 1.0,
                             Scheduling(("p",), (-1.0,), (1.0,)))


def test_the_range_of_a_single_pole_ends_where_it_becomes_unstable():
    found = largest_range(lag())
    assert 1.95 < found.factor <= 2.0 and found.limit == "frozen"
    assert found.certificate.verified and found.certificate.between_grid
    assert lpv.verify(found.certificate, lag()).holds
    up = largest_range(lag(), towards="upper")  # up to p = 6: −1
    assert up.box.lower == (-1.0,) and 5.8 < up.box.upper[0] <= 6.0
    assert "frozen poles leave" in str(found) and up.to_dict()["range"]["p"][0] == -1.0


def test_a_range_that_must_shrink():
    found = largest_range(lag(slope=2.0))  # stable for p in (−0.25, 0.75) only
    assert found.limit == "frozen" and 0.24 < found.factor <= 0.25


@pytest.mark.slow
def test_jumping_narrows_what_holding_allows():
    """Alternating between ±s in the pair: A(s)A(−s) has eigenvalues size²(1 ± s)², so (1 + s)·size < 1."""
    found = largest_range(pair(0.7))
    assert found.limit == "certificate"
    assert 0.9 * (1 / 0.7 - 1) < found.factor <= 1 / 0.7 - 1


@pytest.mark.slow
def test_the_largest_rate_lies_between_a_certificate_and_a_trajectory_that_grows():
    model = pair(0.7)
    found = largest_rate(model)
    rate = found.rates[0]
    assert not found.arbitrary and lpv.verify(found.certificate, model).holds
    assert found.certificate.box.rate == (rate,)
    assert certify_stability(model, rate=2.0).divergence is not None  # any jump: 1.4-fold per sample
    assert 0.05 < rate < 2.0


def test_a_quadratically_stable_model_may_move_at_any_rate():
    found = largest_rate(lag())
    assert found.arbitrary and found.to_dict()["arbitrary"] and math.isinf(found.rates[0])
    assert "any motion" in str(found)


@pytest.mark.slow
def test_continuous_rates():
    """ẍ + 0.2ẋ + (1 + 0.6p)x = 0: parametrically excited when p moves fast, stable when slow."""
    a = [[[0, 1], [-1, -0.2]], [[0, 0], [-0.6, 0]]]
    model = lpv.LPVStateSpace(a, np.zeros((2, 2, 1)), np.zeros((2, 1, 2)), np.zeros((2, 1, 1)),
                              Polynomial("p", degree=1), None, Scheduling(("p",), (-1.0,), (1.0,)))
    found = largest_rate(model)
    assert found.rates is not None and not found.arbitrary
    free = certify_stability(model)
    assert not free.verified and free.divergence.growth_rate > 0
    assert lpv.verify(found.certificate, model).holds


def test_an_unstable_model_has_neither():
    model = lag(slope=0.0).replace(a=np.array([[[[-1.5, 0.0]]]]))
    assert largest_rate(model).rates is None and largest_range(model).box is None
    assert "none" in str(largest_rate(model)) and largest_range(model).to_dict()["factor"] == 0.0


@pytest.mark.seconds
def test_the_share_of_draws_counts_what_really_verifies(rng):
    """One pole at a ~ N(0.5, σ²), P = 1: the certificate holds exactly where |a| + 0.25 < 1."""
    certificate = certify_stability(lag())
    draws = [lag().replace(a=np.array([[[[-a, 0.25]]]])) for a in rng.normal(0.5, 0.2, size=200)]
    share = certified_share(certificate, draws)
    expected = np.mean([abs(m.a[0, 0, 0, 0]) < 0.75 for m in draws])
    assert share.probability == pytest.approx(expected, abs=1e-12) and share.exact
    assert share.interval[0] < expected < share.interval[1]


def test_what_cannot_be_asked():
    with pytest.raises(InputError, match="moves"):
        largest_range(lag(), range=(1.0, 1.0))
    with pytest.raises(InputError, match="no model"):
        certified_share(certify_stability(lag()), [])
    with pytest.raises(InputError, match="towards"):
        largest_range(lag(), towards="left")
