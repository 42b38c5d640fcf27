"""Independence: how many of the samples of an error are worth one each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.problem import Problem
from lpvid.diagnosis.remainder import predictable_share

WORTH = 60.0
"""independent samples that an error which is all structure is worth: a misfit of 1 % more or less says little, one of a
factor of two 20 units of log-likelihood (diagnosis_real)"""
SEGMENTS = 16
"""averaged spectra from which the memory of an error is told"""


def independent(problem: Problem, errors: Sequence[np.ndarray], channels: Sequence[str]) -> tuple[float, float]:
    """κ, the share of the samples that is independent, and p, the share of the error that the inputs predict.

    1/κ = (1 − p)/κ₀ + p N/α: noise has κ₀ = 1/Σρ_k² from its autocorrelation (Bartlett 1946), the misfit of a law is
    worth α samples in all.
    """
    share, spread = predictable_share(problem, errors, channels)
    share = float(np.clip(share if share > 2 * spread else 0.0, 0.0, 1.0))
    memory = _memory(problem, errors)
    return 1 / max((1 - share) * memory + share * problem.n_samples / WORTH, 1.0), share


def _memory(problem: Problem, errors: Sequence[np.ndarray]) -> float:
    """Σ_k ρ_k² = mean(S²)/mean(S)² by averaged spectra, whose own scatter is taken off."""
    from scipy.signal import welch

    total, count = None, 0
    size = max(min(min(e.size for e in errors), sum(e.size for e in errors) // SEGMENTS), 16)
    for e, inside in zip(errors, problem.blocks.mask(), strict=True):
        x = np.where(inside, e, 0.0)
        _, power = welch(x - x.mean(), nperseg=size, detrend="constant")
        pieces = max(2 * x.size // size - 1, 1)
        total = pieces * power if total is None else total + pieces * power
        count += pieces
    assert total is not None
    power = total[1:-1] / count
    return max(float(np.mean(power**2) / max(np.mean(power) ** 2, 1e-300)) / (1 + 1.5 / count), 1.0)
