"""Covariance of least-squares estimates: inverses in unit columns, and the middle of a sandwich for coloured errors.

For white errors σ² (JᵀJ)⁻¹. For others the sandwich (JᵀJ)⁻¹ S (JᵀJ)⁻¹ (White 1980) with S the long-run covariance of
the scores J(t) e(t): from sums over blocks (`blocks`; Carlstein 1986), from lagged products with Bartlett weights
(`bartlett`; Newey & West 1987), or from sums over groups of samples that share an error (`clusters`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate, chain, pairwise

import numpy as np

from lpvid._tall import triangular_factor
from lpvid._threads import single_thread
from lpvid.identification.regression import CHUNK, Factor, RegressionData, rows_of
from lpvid.record import Record
from lpvid.validation.residuals import residual_tests
from lpvid.validation.trust import autocovariance

BLOCKS = 100
"""fewest blocks for which the spread of block sums is an estimate at all."""
BLOCKS_PER_PARAMETER = 5
"""fewest blocks for each parameter."""
SHORTEST = 10
"""shortest block [samples]."""
PART = 65_536
"""rows whose sums over windows are in memory at a time"""
LARGEST_LAG = 200
"""largest lag of a residual's memory that is looked at [samples], and at most a fiftieth of the samples."""


SINGULAR = 1e-12
"""share of the largest singular value, columns of unit length, below which one is rounding."""
VAGUE = 1e-10
"""share of the largest singular value that counts at least where a direction is not to lose its variance."""


# -- inverses ----------------------------------------------------------------------------------------------------------
def pseudo_inverse(matrix: np.ndarray) -> np.ndarray:
    """A⁺ by the singular values of A with unit columns; a column without effect gives a row of zeros.

    Parameters
    ----------
    matrix : (m, k) array

    Returns
    -------
    (k, m) array
    """
    scale = np.linalg.norm(matrix, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    return np.linalg.pinv(matrix / scale, rcond=SINGULAR) / scale[:, None]


def inverse_gram(jacobian: np.ndarray) -> np.ndarray:
    """(JᵀJ)⁺; parameters without effect, and directions of none, get no covariance rather than an infinite one.

    Parameters
    ----------
    jacobian : (m, k) array
        Or its triangular factor.

    Returns
    -------
    (k, k) array
    """
    root = pseudo_inverse(triangular_factor(jacobian) if len(jacobian) > len(jacobian.T) else jacobian)
    return root @ root.T


def normal_inverse(gram: np.ndarray) -> np.ndarray:
    """The same of JᵀJ itself, where J is not at hand.

    Parameters
    ----------
    gram : (k, k) array

    Returns
    -------
    (k, k) array
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    unit = np.outer(scale, scale)
    return np.linalg.pinv(gram / unit, rcond=SINGULAR, hermitian=True) / unit


def vague_inverse(jacobian: np.ndarray) -> np.ndarray:
    """(JᵀJ)⁻¹ in which a direction without effect has the large variance of a singular value of `VAGUE`.

    Parameters
    ----------
    jacobian : (m, k) array

    Returns
    -------
    (k, k) array
    """
    norms = np.linalg.norm(jacobian, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    _, s, vt = np.linalg.svd(triangular_factor(jacobian, scale), full_matrices=False)
    weights = vt.T / np.maximum(s, VAGUE * s[0] if s[0] > 0 else 1.0)
    return (weights @ weights.T) / np.outer(scale, scale)


# -- the middle of a sandwich ------------------------------------------------------------------------------------------
def blocks(scores: Sequence[np.ndarray], length: int) -> np.ndarray:
    """N/(L(B − 1)) Σ_b s_b s_bᵀ, s_b the sum of the scores over a block.

    Parameters
    ----------
    scores : sequence of (n, k) arrays
        J(t) e(t) of each record.
    length : int
        L, samples of a block.

    Returns
    -------
    (k, k) array
    """
    sums = np.concatenate([s[: len(s) // length * length].reshape(-1, length, s.shape[1]).sum(axis=1) for s in scores])
    rows = sum(len(s) for s in scores)
    return sums.T @ sums * (rows / (length * max(len(sums) - 1, 1)))


def bartlett(scores: Sequence[np.ndarray], lags: int) -> np.ndarray:
    """Σ_τ (1 − |τ|/(lags + 1)) Σ_t s(t) s(t−τ)ᵀ, for records too short for blocks.

    Parameters
    ----------
    scores : sequence of (n, k) arrays
    lags : int

    Returns
    -------
    (k, k) array
    """
    cut = ((s[first: first + PART] for first in range(0, len(s), PART)) for s in scores)
    return bartlett_of_parts(cut, scores[0].shape[1], lags)


def bartlett_of_parts(scores: Iterable[Iterable[np.ndarray]], columns: int, lags: int) -> np.ndarray:
    """The same of scores that come part by part, so that those of a long record are never in memory together.

    Parameters
    ----------
    scores : iterable of iterables of (n, columns) arrays
        Of each record its parts, in order; read once.
    columns : int
        k, number of parameters.
    lags : int

    Returns
    -------
    (k, k) array
    """
    window = lags + 1
    out = np.zeros((columns, columns))
    for parts in scores:  # (1 − |τ|/window) of s(t) s(t−τ)ᵀ is the mean share of the windows that hold both samples
        before = np.zeros((window, columns))  # cumulative sums up to the part at hand
        for part in chain(parts, [np.zeros((lags, columns))]):
            if not len(part):
                continue
            sums = np.array(part)
            sums[0] += before[-1]
            np.cumsum(sums, axis=0, out=sums)
            before = np.vstack([before, sums])
            sums -= before[: len(sums)]
            before = before[len(before) - window:].copy()
            out += sums.T @ sums / window
    return out


def clusters(scores: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Σ_g s_g s_gᵀ, s_g the sum of the scores over a group.

    Parameters
    ----------
    scores : (n, k) array
    group : (n,) int array
        Label of each sample's group.

    Returns
    -------
    (k, k) array
    """
    _, place = np.unique(group, return_inverse=True)
    sums = np.zeros((int(place.max(initial=-1)) + 1, scores.shape[1]))
    np.add.at(sums, place, scores)
    return sums.T @ sums


# -- estimates ---------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Spread:
    """What is known of the scatter of an estimate.

    Attributes
    ----------
    covariance : (P, P) array
        NaN for parameters that were held; infinite variance for those without any effect.
    notes : tuple of str
    """

    covariance: np.ndarray
    notes: tuple[str, ...] = ()


def estimate_covariance(jacobian: np.ndarray, residual: np.ndarray, lengths: Sequence[int], free: np.ndarray
                        ) -> Spread:
    """σ²(JᵀJ)⁻¹ where the residual is white; where it is coloured the sandwich, over blocks of three times its memory.

    Parameters
    ----------
    jacobian : (m, P) array
    residual : (m,) array
        Record after record.
    lengths : sequence of int
        Samples of each record.
    free : (P,) bool array
        Parameters that were not held.

    Returns
    -------
    Spread
    """
    rows, k = residual.size, int(free.sum())
    out = np.full((free.size, free.size), np.nan)
    if not k:
        return Spread(out)
    inverse, lost = vague_inverse(jacobian[:, free]), ~jacobian[:, free].any(axis=0)
    ends = list(pairwise(accumulate(lengths, initial=0)))
    pieces = [residual[a:b] for a, b in ends]
    notes: tuple[str, ...] = ()
    if all(t.passed for t in residual_tests(pieces, [None] * len(pieces)) if t.name == "whiteness"):
        found = float(residual @ residual) / max(rows - k, 1) * inverse
    else:
        memory = residual_memory(pieces)
        length = block_length(memory, rows, k)
        scores = [jacobian[a:b, free] for a, b in ends]  # a copy, which becomes J(t) e(t)
        for s, (a, b) in zip(scores, ends, strict=True):
            s *= residual[a:b, None]
        middle, how = ((bartlett(scores, 3 * memory), "Bartlett weights") if length is None
                       else (blocks(scores, length), "block scores"))
        found = inverse @ middle @ inverse * (rows / max(rows - k, 1))
        notes = (f"the residual is correlated over {memory} samples: standard errors in sandwich form ({how})",)
    found[lost] = found[:, lost] = 0.0
    found[lost, lost] = np.inf
    out[np.ix_(free, free)] = found
    return Spread(out, notes)


def sandwich_covariance(records: Sequence[Record], data: RegressionData, factor: Factor, theta: np.ndarray,
                        memory: int) -> np.ndarray:
    r"""(XᵀX)⁻¹ S (XᵀX)⁻¹ with S the long-run covariance of the scores x(t) e(t).

    S = Σ_b s_b s_bᵀ B/(B − 1), where s_b sums the scores over blocks of three times the residual's `memory` (batch
    means; Carlstein 1986, and White 1980 for the sandwich). Data too short for enough blocks take lagged products with
    Bartlett weights (`bartlett`). It corrects the standard errors for colour; it does not remove the bias that colour
    gives least squares.

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
    (columns·n_outputs, columns·n_outputs) array
    """
    from scipy.linalg import solve_triangular

    k, ny = factor.columns, theta.shape[1]
    length = block_length(memory, factor.rows, k)
    with single_thread():
        inverse = solve_triangular(factor.r[:k, :k], np.eye(k))
        gram = inverse @ inverse.T
        freedom = factor.rows / max(factor.rows - k, 1)
        if length is None:
            middle = bartlett([_scores(r, data, theta) for r in records], 3 * memory)
            outer = np.kron(np.eye(ny), gram)
            return outer @ middle @ outer * freedom
        total, blocks = np.zeros((k * ny, k * ny)), 0
        work = np.zeros((k + ny, CHUNK))
        pending, held = np.zeros(k * ny), 0
        for record in records:
            for rows in rows_of(record, data, work):
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
        return outer @ total @ outer * (factor.rows / (length * max(blocks - 1, 1)) * freedom)


def _scores(record: Record, data: RegressionData, theta: np.ndarray) -> np.ndarray:
    """(n, columns·n_outputs) x(t) e(t) of one record."""
    k, ny = theta.shape
    work, out = np.zeros((k + ny, CHUNK)), []
    for rows in rows_of(record, data, work):
        x, y = work[:k, :rows], work[k:, :rows]
        out.append(np.einsum("or,kr->rok", y - theta.T @ x, x).reshape(rows, k * ny))
    return np.vstack(out)


def block_length(memory: int, samples: int, parameters: int) -> int | None:
    """Samples in a block of scores: three times the residual's memory; None where that leaves too few blocks.

    Parameters
    ----------
    memory : int
        Lag from which on the residual is uncorrelated [samples].
    samples : int
        Samples of all records together.
    parameters : int
        Estimated parameters.

    Returns
    -------
    int or None
        [samples].
    """
    length = min(max(3 * memory, SHORTEST), samples // max(BLOCKS, BLOCKS_PER_PARAMETER * parameters))
    return length if length >= max(memory, SHORTEST) else None


def residual_memory(residuals: Sequence[np.ndarray]) -> int:
    """Lag from which on the residual's autocorrelation stays within its 95 % band (Bartlett's) for ten lags.

    Parameters
    ----------
    residuals : sequence of (n,) arrays
        One per record; their means are taken off.

    Returns
    -------
    int
        [samples]; 1 for residuals that are zero or too short, the largest lag where the band is never kept.
    """
    n = sum(len(e) for e in residuals)
    longest = min(LARGEST_LAG, max(n // 50, 1))
    centred = [e - e.mean() for e in residuals if len(e) > longest + 1]
    if not centred:
        return 1
    covariance = np.sum([autocovariance(e, longest) for e in centred], axis=0)
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
