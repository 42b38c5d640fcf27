"""R of rows that arrive in chunks, against numpy's QR of all rows at once."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid._kernels import ChunkedQR


def folded(qr: ChunkedQR, rows: np.ndarray) -> np.ndarray:
    for first in range(0, len(rows), qr.chunk):
        part = rows[first: first + qr.chunk]
        qr.block[:, : len(part)] = part.T
        qr.absorb(len(part))
    return qr.r


@pytest.mark.parametrize("chunk", [1, 5, 64])
@pytest.mark.parametrize("columns", [1, 7, 33, 70])
def test_r_has_the_gram_matrix_of_all_rows(columns, chunk):
    """Fewer rows than columns, a last chunk that is not full, and a column that repeats another."""
    rng = np.random.default_rng(columns)
    for count in (3, 130):
        rows = rng.normal(size=(count, columns))
        rows[:, -1] = rows[:, 0]
        r = folded(ChunkedQR(columns, chunk), rows)
        assert r.flags.c_contiguous and not np.tril(r, -1).any()
        np.testing.assert_allclose(r.T @ r, rows.T @ rows, atol=1e-12 * count)


def test_it_goes_on_from_a_factor():
    rows = np.random.default_rng(0).normal(size=(90, 6))
    other = ChunkedQR(6, 32)
    other.resume(folded(ChunkedQR(6, 32), rows[:50]), 50)
    r = folded(other, rows[50:])
    np.testing.assert_allclose(r.T @ r, rows.T @ rows, atol=1e-12)
    assert other.rows_seen == 90
