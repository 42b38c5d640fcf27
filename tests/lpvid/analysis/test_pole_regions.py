"""Pole regions: half plane, disc and cone against the poles themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from helpers.gain_systems import time_invariant

import lpvid as lpv
from lpvid.analysis.pole_regions import certify_region
from lpvid.errors import InputError
from lpvid.scheduling import Polynomial, Scheduling


@dataclass(frozen=True)
class Plain:
    """A region by its matrices."""

    fixed: list
    varying: list

    def matrices(self):
        return np.array(self.fixed, dtype=float), np.array(self.varying, dtype=float)


def half_plane(alpha):
    return Plain([[2 * alpha]], [[1]])


def disc(centre, radius):
    return Plain([[-radius, -centre], [-centre, -radius]], [[0, 1], [0, 0]])


def cone(damping):
    c, s = damping, np.sqrt(1 - damping**2)
    return Plain(np.zeros((2, 2)), [[s, c], [-c, s]])


@pytest.fixture
def oscillator() -> lpv.LPVStateSpace:
    """ẍ + 2·3 ẋ + (9 + ω²) x = 0 with ω² = 16 + 9p: poles −3 ± j√(16 + 9p), p in [−1, 1]."""
    a = [[[0, 1], [-25, -6]], [[0, 0], [-9, 0]]]
    return lpv.LPVStateSpace(a, np.zeros((2, 2, 1)), np.zeros((2, 1, 2)), np.zeros((2, 1, 1)),
                             Polynomial("p", degree=1), None, Scheduling(("p",), (-1.0,), (1.0,)))


@pytest.mark.parametrize(("region", "inside"), [
    (half_plane(2.9), True), (half_plane(3.1), False), (disc(-3.0, 5.1), True), (disc(-3.0, 4.9), False),
    (cone(0.51), True), (cone(0.52), False)])
def test_a_varying_oscillator(oscillator, region, inside):
    """The fastest poles are −3 ± 5j: damping ratio 3/√34 = 0.5145."""
    found = certify_region(oscillator, region)
    assert found.certified == inside
    if inside:
        assert found.between_grid and lpv.verify(found.certificate, oscillator).holds
        assert not lpv.verify(replace(found.certificate, region=half_plane(3.1).matrices()), oscillator).holds
    else:
        assert "outside" in found.why and "p = " in found.why


def test_a_disc_in_discrete_time_is_a_decay_per_sample():
    model = time_invariant([[0.5, 0.4], [-0.4, 0.5]], np.zeros((2, 1)), np.zeros((1, 2)), [[0.0]], 0.1)
    assert certify_region(model, disc(0.0, 0.65)).certified  # |z| = √0.41 = 0.6403
    assert not certify_region(model, disc(0.0, 0.63)).certified


def test_a_malformed_region_is_refused(oscillator):
    with pytest.raises(InputError, match="symmetric"):
        certify_region(oscillator, Plain([[0, 1], [0, 0]], np.eye(2)))
