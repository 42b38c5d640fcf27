"""Covariance of a least-squares estimate whose equation error is coloured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid._threads import single_thread
from lpvid.identification.regression import CHUNK, Factor, RegressionData, rows_of
from lpvid.record import Record

BLOCKS = 100
"""fewest blocks for which the spread of block sums states anything."""
BLOCKS_PER_PARAMETER = 5
"""fewest blocks for each parameter."""
SHORTEST = 10
"""shortest block [samples]."""


def sandwich_covariance(records: Sequence[Record], data: RegressionData, factor: Factor, theta: np.ndarray,
                        memory: int) -> np.ndarray | None:
    r"""(XᵀX)⁻¹ S (XᵀX)⁻¹ with S the long-run covariance of the scores x(t) e(t).

    S = Σ_b s_b s_bᵀ B/(B − 1), where s_b sums the scores over blocks of three times the residual's `memory` (batch
    means; Carlstein 1986, and White 1980 for the sandwich). It corrects the standard errors for colour; it does not
    remove the bias that colour gives least squares.

    Parameters
    ----------
    records : sequence of Record
    data : RegressionData
    factor : Factor
        R of the same rows.
    theta : (columns, n_outputs) array
    memory : int
        Samples over which the residual is correlated.

    Returns
    -------
    (columns·n_outputs, columns·n_outputs) array or None
        None where the data are too short for enough blocks.
    """
    from scipy.linalg import solve_triangular

    k, ny = factor.columns, theta.shape[1]
    length = block_length(memory, factor.rows, k)
    if length is None:
        return None
    with single_thread():
        inverse = solve_triangular(factor.r[:k, :k], np.eye(k))
        gram = inverse @ inverse.T
        total, blocks = np.zeros((k * ny, k * ny)), 0
        work = np.zeros((k + ny, CHUNK))
        pending, held = np.zeros(k * ny), 0
        for record in records:
            for rows in rows_of(record, data, work, 0):
                x, y = work[:k, :rows], work[k:, :rows]
                scores = np.einsum("or,kr->okr", y - theta.T @ x, x).reshape(k * ny, rows)
                first = 0
                while first < rows:
                    take = min(length - held, rows - first)
                    pending += scores[:, first: first + take].sum(axis=1)
                    held, first = held + take, first + take
                    if held == length:
                        total += np.outer(pending, pending)
                        pending, held, blocks = np.zeros(k * ny), 0, blocks + 1
        outer = np.kron(np.eye(ny), gram)
        scale = factor.rows / (length * max(blocks - 1, 1)) * factor.rows / max(factor.rows - k, 1)
        return outer @ total @ outer * scale


def block_length(memory: int, samples: int, parameters: int) -> int | None:
    """Samples in a block of scores: three times the residual's memory; None where that leaves too few blocks."""
    length = min(max(3 * memory, SHORTEST), samples // max(BLOCKS, BLOCKS_PER_PARAMETER * parameters))
    return length if length >= max(memory, SHORTEST) else None


def residual_memory(residuals: Sequence[np.ndarray], longest: int = 200) -> int:
    """Lag from which on the residual's autocorrelation stays within its 95 % band (Bartlett's) for ten lags."""
    n = sum(len(e) for e in residuals)
    longest = min(longest, max(n // 50, 1))
    centred = [e - e.mean() for e in residuals if len(e) > longest + 1]
    if not centred:
        return 1
    covariance = np.sum([_autocovariance(e, longest) for e in centred], axis=0)
    if not covariance[0] > 0:
        return 1
    inside, squares = 0, 0.0
    for lag in range(1, longest):
        rho = covariance[lag] / covariance[0]
        inside = inside + 1 if abs(rho) < 2 * np.sqrt((1 + 2 * squares) / n) else 0
        squares += rho**2
        if inside == 10:
            return max(lag - 9, 1)
    return longest


def _autocovariance(e: np.ndarray, lags: int) -> np.ndarray:
    """(lags,) sums Σ e(t) e(t−τ), by fast Fourier transform."""
    size = 1 << (len(e) + lags - 1).bit_length()
    return np.fft.irfft(np.abs(np.fft.rfft(e, size)) ** 2, size)[:lags]
