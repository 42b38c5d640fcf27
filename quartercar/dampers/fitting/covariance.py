"""Covariance of fitted parameters, for white residuals and for coloured ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np

from lpvid.identification.sandwich import block_length, residual_memory
from lpvid.validation.residuals import residual_tests

SINGULAR = 1e-10
"""singular values of the column-scaled sensitivities below this share of the largest count as zero."""


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


def covariance_of(jacobian: np.ndarray, residual: np.ndarray, lengths: Sequence[int], free: np.ndarray) -> Spread:
    """σ²(JᵀJ)⁻¹ where the residual is white, (JᵀJ)⁻¹ S (JᵀJ)⁻¹ with block sums of the scores where it is coloured.

    S = Σ_b s_b s_bᵀ·N/(L(B−1)), s_b the sum of J(t)e(t) over a block of L samples, three times the residual's memory
    (batch means; White 1980, Carlstein 1986), as in `lpvid.identification.sandwich`.

    Parameters
    ----------
    jacobian : (m, P) array
    residual : (m,) array
        Record after record.
    lengths : sequence of int
        Samples of each record.
    free : (P,) bool array
        Parameters that were not held.
    """
    rows, k = residual.size, int(free.sum())
    out = np.full((free.size, free.size), np.nan)
    if not k:
        return Spread(out)
    inverse, lost = _inverse_gram(jacobian[:, free])
    pieces = [residual[a:b] for a, b in pairwise(accumulate(lengths, initial=0))]
    white = all(t.passed for t in residual_tests(pieces, [None] * len(pieces)) if t.name == "whiteness")
    notes: tuple[str, ...] = ()
    if white:
        found = float(residual @ residual) / max(rows - k, 1) * inverse
    else:
        memory = residual_memory(pieces)
        length = block_length(memory, rows, k)
        scores = jacobian[:, free] * residual[:, None]
        ends = list(pairwise(accumulate(lengths, initial=0)))
        if length is None:
            spread, how = _bartlett([scores[a:b] for a, b in ends], 3 * memory), "Bartlett weights"
        else:
            spread, how = _blocks([scores[a:b] for a, b in ends], length), "block scores"
        found = inverse @ spread @ inverse * (rows / max(rows - k, 1))
        notes = (f"the residual is correlated over {memory} samples: standard errors in sandwich form ({how})",)
    found[lost] = found[:, lost] = 0.0
    found[lost, lost] = np.inf
    out[np.ix_(free, free)] = found
    return Spread(out, notes)


def _inverse_gram(jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(JᵀJ)⁺ by the singular values of the column-scaled J, and the columns that have no effect at all."""
    norms = np.linalg.norm(jacobian, axis=0)
    lost = ~(norms > 0)
    scale = np.where(lost, 1.0, norms)
    _, s, vt = np.linalg.svd(np.linalg.qr(jacobian / scale, mode="r"), full_matrices=False)
    weights = vt.T / np.maximum(s, SINGULAR * s[0] if s[0] > 0 else 1.0)
    return (weights @ weights.T) / np.outer(scale, scale), lost


def _blocks(scores: Sequence[np.ndarray], length: int) -> np.ndarray:
    """N/(L(B − 1)) Σ_b s_b s_bᵀ."""
    sums = np.concatenate([s[: len(s) // length * length].reshape(-1, length, s.shape[1]).sum(axis=1) for s in scores])
    rows = sum(len(s) for s in scores)
    return sums.T @ sums * (rows / (length * max(len(sums) - 1, 1)))


def _bartlett(scores: Sequence[np.ndarray], lags: int) -> np.ndarray:
    """Σ_τ (1 − |τ|/(lags+1)) Σ_t s(t)s(t−τ)ᵀ (Newey & West 1987), for records too short for blocks."""
    out = sum(s.T @ s for s in scores)
    for lag in range(1, lags + 1):
        part = sum(s[lag:].T @ s[:-lag] for s in scores if len(s) > lag)
        if isinstance(part, np.ndarray):
            out = out + (1 - lag / (lags + 1)) * (part + part.T)
    return np.asarray(out)
