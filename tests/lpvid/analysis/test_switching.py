"""Arbitrary switching: known joint spectral radii, enclosures that contain products, poly-quadratic certificates."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import lpvid as lpv
from lpvid.analysis.switching import certify_switching, joint_spectral_radius, vertices
from lpvid.errors import InputError
from lpvid.scheduling import Polynomial, Scheduling

NILPOTENT = np.array([[[0, 2.0], [0, 0]], [[0, 0], [2.0, 0]]])
SHEARS = np.array([[[1.0, 1.0], [0, 1.0]], [[1.0, 0], [1.0, 1.0]]])
GOLDEN = (1 + np.sqrt(5)) / 2
"""Joint spectral radius of the two unit shears: the product A₀A₁ has the eigenvalue golden²."""


def test_the_alternating_nilpotent_pair_has_radius_two():
    found = joint_spectral_radius(NILPOTENT)
    assert found.stable is False and found.lower == pytest.approx(2.0) and found.upper == pytest.approx(2.0, rel=2e-3)
    assert sorted(found.word) == [0, 1]
    assert certify_switching(NILPOTENT) is None


def test_two_shears_grow_like_the_golden_ratio():
    found = joint_spectral_radius(SHEARS)
    assert found.lower == pytest.approx(GOLDEN, rel=1e-9) and found.upper <= GOLDEN * 1.0011
    assert joint_spectral_radius(0.99 * SHEARS / GOLDEN, 1e-3).stable
    assert joint_spectral_radius(1.01 * SHEARS / GOLDEN).stable is False


def test_a_commuting_family_has_the_largest_radius_of_its_members(rng):
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    family = np.array([turn @ np.diag(d) @ turn.T for d in ([0.9, 0.2, 0.1], [0.3, -0.8, 0.2], [0.1, 0.1, 0.5])])
    found = joint_spectral_radius(family)
    assert found.lower == pytest.approx(0.9) and found.upper == pytest.approx(0.9, rel=2e-3) and found.stable


def test_no_product_leaves_the_enclosure(rng):
    for _ in range(5):
        family = rng.normal(size=(3, 4, 4))
        found = joint_spectral_radius(family, 0.01)
        assert found.lower <= found.upper
        for length in (1, 2, 3, 4):
            for word in itertools.product(range(3), repeat=length):
                product = np.linalg.multi_dot([np.eye(4), *(family[i] for i in word), np.eye(4)])
                assert np.abs(np.linalg.eigvals(product)).max() ** (1 / length) <= found.upper * (1 + 1e-12)


def test_scaling_and_coordinates_do_not_matter(rng):
    family, t = rng.normal(size=(2, 3, 3)), np.diag([1.0, 1e3, 1e-3])
    plain = joint_spectral_radius(family)
    moved = joint_spectral_radius(7.0 * np.array([t @ a @ np.linalg.inv(t) for a in family]))
    assert moved.lower == pytest.approx(7 * plain.lower, rel=2e-3)


def pair(size: float) -> lpv.LPVStateSpace:
    a = size * np.array([0.5 * (NILPOTENT[0] + NILPOTENT[1]), 0.5 * (NILPOTENT[1] - NILPOTENT[0])])
    return lpv.LPVStateSpace(a, np.zeros((2, 2, 1)), np.zeros((2, 1, 2)), np.zeros((2, 1, 1)),
                             Polynomial("p", degree=1), 1.0, Scheduling(("p",), (-1.0,), (1.0,)))


@pytest.mark.parametrize(("size", "stable"), [(0.45, True), (0.49, True), (0.51, False), (0.9, False)])
def test_an_affine_model_stands_for_its_vertices(size, stable):
    model = pair(size)
    assert joint_spectral_radius(model).stable is stable
    certificate = certify_switching(model)
    assert (certificate is not None) == stable
    if certificate is not None:
        assert lpv.verify(certificate, model).holds and not lpv.verify(certificate, pair(1.001 * size)).holds
        assert not lpv.verify(replace(certificate, matrices=certificate.matrices[::-1] * [[[1]], [[9]]]), model).holds


def test_a_stretched_quarter_turn_with_a_contraction():
    """Norms above 1, radii √0.88 and 0.6: only Lyapunov functions in other coordinates than the given ones do."""
    family = np.array([[[0.0, 1.6], [-0.55, 0.0]], [[0.6, 0.0], [0.0, 0.6]]])
    assert certify_switching(family) is not None and joint_spectral_radius(family).stable


def test_a_certificate_is_saved(tmp_path):
    certificate = certify_switching(pair(0.45))
    again = lpv.load(lpv.save(certificate, tmp_path / "switching.json"))
    assert lpv.verify(again, pair(0.45)).holds and str(again) == str(certificate)


def test_curved_or_continuous_models_are_refused():
    a = np.array([0.0, 0.0, 0.1]).reshape(3, 1, 1)
    curved = lpv.LPVStateSpace(a, np.zeros((3, 1, 1)), np.zeros((3, 1, 1)), np.zeros((3, 1, 1)),
                               Polynomial("p", degree=2), 1.0)
    with pytest.raises(InputError, match="not affine"):
        vertices(curved)
    with pytest.raises(InputError, match="discrete"):
        joint_spectral_radius(curved.replace(sample_time=None))
    with pytest.raises(InputError, match="square"):
        joint_spectral_radius(np.zeros((2, 2, 3)))
