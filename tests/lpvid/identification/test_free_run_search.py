"""Steps of the free-run searches."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.identification.free_run_search import SINGULAR, _solved


@pytest.mark.parametrize("condition", [1e2, 1e8, 1e18])
def test_a_step_is_that_of_singular_values_whatever_the_condition(condition):
    """Beyond 1e14 what the data do not determine is left out, as it is there."""
    rng = np.random.default_rng(0)
    turned = np.linalg.qr(rng.standard_normal((12, 12)))[0]
    matrix = turned @ np.diag(np.geomspace(1.0, 1.0 / condition, 12)) @ turned.T
    matrix = (matrix + matrix.T) / 2
    right = matrix @ rng.standard_normal(12)
    expected = np.linalg.lstsq(matrix, right, rcond=SINGULAR)[0]
    assert np.allclose(_solved(matrix, right), expected, rtol=1e-16 * min(condition, 1e14) * 100, atol=1e-12)


def test_an_indefinite_or_empty_direction_moves_nothing():
    assert np.array_equal(_solved(np.diag([1.0, 0.0]), np.array([2.0, 1.0])), [2.0, 0.0])
