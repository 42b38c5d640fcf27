"""The projected inequalities with unknown matrices, against the same ones with numbers."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.lmi.affine import Unknowns
from lpvid.synthesis.projected_half import Half, Variation


@pytest.mark.parametrize("seed", range(6))
def test_inequalities_at_known_matrices_are_their_values(seed):
    """Moving matrices with slopes, other unknowns between them, coordinates of their own, either sign."""
    rng = np.random.default_rng(seed)
    n, w, u, z, points, functions, corners = (int(k) for k in rng.integers(1, 4, size=7))
    variation = Variation(rng.normal(size=(points, functions)), rng.normal(size=(points, corners, functions)))
    sizes = (n, n), (n, w), (n, u), (z, n), (z, w), (z, u)
    half = Half(*(rng.normal(size=(points, *s)) for s in sizes), variation, float(rng.choice([-1, 1])))
    unknowns, matrices = Unknowns(), []
    for _ in range(functions):
        unknowns.scalar()
        matrices.append(unknowns.symmetric(n))
    x, root = rng.normal(size=unknowns.size), rng.normal(size=(n, n)) + 3 * np.eye(n)
    known = np.array([root @ m.value(x) @ root.T for m in matrices])
    found = [1.7 * weight - matrix.value(x) for matrix, weight in half.inequalities(root, matrices)]
    assert len(found) == points * corners
    for one, other in zip(found, half.values(root, known, 1.7), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-11 * max(1.0, np.abs(other).max()))
