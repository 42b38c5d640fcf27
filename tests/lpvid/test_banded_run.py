"""The free run by forward substitution against the recursion written out, and against the compiled kernel."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid import _kernels
from lpvid._banded_run import SHORT, free_run_banded
from lpvid._checks import read_only
from lpvid.simulation import _recursion

SHAPES = [(4, 6, 0, 2, True), (4, 5, 1, 3, False), (2, 3, 1, 1, True), (0, 4, 1, 2, True), (6, 3, 0, 4, False)]


def coefficients(rng: np.random.Generator, na: int, nb: int, nc: int, m: int, size: float) -> tuple[np.ndarray, ...]:
    """Read-only, as those of a model are: the kernel of every other run."""
    drawn = size * rng.normal(size=(na, 1, 1, m)), rng.normal(size=(nb, 1, 2, m)), rng.normal(size=(nc, 1, m))
    return tuple(read_only(array) for array in drawn)


@pytest.mark.parametrize(("na", "nb", "nc", "m", "lagged"), SHAPES)
def test_is_the_recursion(na: int, nb: int, nc: int, m: int, lagged: bool) -> None:
    rng = np.random.default_rng(1)
    a, b, c = coefficients(rng, na, nb, nc, m, 0.05)
    n, begin = 700, max(na, nb)
    phi, u = np.vander(rng.uniform(-1, 1, n), m, increasing=True).T.copy(), rng.normal(size=(2, n))
    y = rng.normal(size=(n, 1))
    found, compiled = y.copy(), y.copy()
    for k in range(begin, n):
        y[k, 0] = sum(b[j, 0, q] @ phi[:, k - (j if lagged else 0)] * u[q, k - j] for j in range(1, nb) for q in (0, 1))
        y[k, 0] += sum(c[j, 0] @ phi[:, k - j] for j in range(nc))
        y[k, 0] -= sum(a[i, 0, 0] @ phi[:, k - (i + 1 if lagged else 0)] * y[k - i - 1, 0] for i in range(na))
    words = (a, b, c, 1, lagged, phi, 0, read_only(u))
    assert free_run_banded(*words, found, begin, n, 1e9) == -1
    assert _kernels.free_run_io(*words, compiled, begin, n, 1e9) == -1
    scale = np.abs(y).max()
    assert np.abs(found - y).max() < 1e-13 * scale
    assert np.abs(found - compiled).max() < 1e-13 * scale


@pytest.mark.parametrize("limit", [1e3, 1e9])
def test_ends_at_the_sample_at_which_the_kernel_ends(limit: float) -> None:
    rng = np.random.default_rng(2)
    a, b, c = coefficients(rng, 3, 4, 0, 2, 3.0)
    n = 3000
    phi, u = np.vstack([np.ones(n), rng.uniform(-1, 1, n)]), rng.normal(size=(2, n))
    found, compiled = np.zeros((n, 1)), np.zeros((n, 1))
    words = (a, b, c, 1, True, phi, 0, read_only(u))
    stop = free_run_banded(*words, found, 4, n, limit)
    assert stop == _kernels.free_run_io(*words, compiled, 4, n, limit) > 4
    assert not found[stop:].any() and np.abs(found[:stop]).max() < limit


def test_long_records_and_several_outputs_are_compiled() -> None:
    assert _recursion(1, SHORT) is free_run_banded
    assert _recursion(1, SHORT + 1) is _recursion(2, 10) is _kernels.free_run_io
