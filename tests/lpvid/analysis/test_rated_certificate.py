"""Certificates of loops that read ṗ: against closed forms, and what a certificate with ṗ free of p cannot show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lpvid as lpv
from lpvid.analysis.rated_certificate import RatedGainCertificate


def turned(rate: float = 1.0, wrong: float = 1.0) -> lpv.LPVStateSpace:
    """x = exp(0.5 p) ξ of ξ̇ = −ξ + w, z = ξ: ẋ = (−1 + 0.5 ṗ) x + exp(0.5 p) w, z = exp(−0.5 p) x; degree 3 in p."""
    p = lpv.Polynomial("p", 3)
    box = lpv.Scheduling(("p", "p_rate"), (-1.0, -rate), (1.0, rate), (rate, None))
    grow = np.polynomial.polynomial.polyfit(x := np.linspace(-1, 1, 50), np.exp(0.5 * x), 3)
    fall = np.polynomial.polynomial.polyfit(x, np.exp(-0.5 * x), 3)
    basis = lpv.Product(p, lpv.Polynomial("p_rate", 1))
    a, b, c = np.zeros((8, 1, 1)), np.zeros((8, 1, 1)), np.zeros((8, 1, 1))
    a[0], a[1] = -1.0, 0.5 * wrong
    b[::2, 0, 0], c[::2, 0, 0] = grow, fall
    return lpv.LPVStateSpace(a, b, c, np.zeros((8, 1, 1)), basis, None, box, inputs=("w",), outputs=("z",))


def storage() -> tuple[lpv.Polynomial, np.ndarray]:
    """V = ξ² = exp(−p) x², which the motion of p leaves alone."""
    x = np.linspace(-1, 1, 100)
    return lpv.Polynomial("p", 4), np.polynomial.polynomial.polyfit(x, np.exp(-x), 4)[:, None, None]


def test_a_change_of_coordinates_that_moves_keeps_the_gain_of_one():
    basis, matrices = storage()
    found = RatedGainCertificate.of(turned(), matrices, basis, 1.02)
    assert found is not None and not found.between_grid and "which the loop reads" in found.claim
    assert lpv.verify(found, turned()).holds
    assert RatedGainCertificate.of(turned(), matrices, basis, 0.98) is None


def test_the_tie_between_p_and_its_rate_is_what_proves_it():
    """With the rate read with the wrong sign the same storage function proves nothing."""
    basis, matrices = storage()
    assert RatedGainCertificate.of(turned(wrong=-1.0), matrices, basis, 1.02) is None


def test_a_changed_certificate_does_not_hold(tmp_path):
    basis, matrices = storage()
    found, loop = RatedGainCertificate.of(turned(), matrices, basis, 1.02), turned()
    lpv.save(found, tmp_path / "c.json")
    kept = lpv.load(tmp_path / "c.json")
    assert lpv.verify(kept, loop).holds and kept.gamma == found.gamma
    assert not lpv.verify(replace(found, gamma=0.9), loop).holds
    assert not lpv.verify(replace(found, margin=0.5), loop).holds
    with pytest.raises(lpv.InputError, match="reads rates"):
        RatedGainCertificate.from_dict({"schema": "other"})
