"""Discrepancy: the misfit of the law, a smooth function of the inputs that is integrated out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.rounding import HALF_DIGITS, STEP, TINY

FEATURES = 80
"""random Fourier features; with twice as many no evidence of measured records changed beyond rounding"""
TYPICAL_MISFIT = 0.015
"""root mean square of the misfit of a good physical law over that of the force: half-normal scale of its prior. Fits of
twenty measured record groups left 1 to 3 %"""
ACCEPTABLE_MISFIT = 2 * TYPICAL_MISFIT
"""root mean square of an error, over the output's, that a good law may leave: twice the typical one"""
MISFIT_SIZES = TYPICAL_MISFIT * np.array([0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0])
"""values of τ, of which the most probable is taken"""
GRID_SIZE = 17
"""points of each grid about the most probable noise, refined until its steps change the likelihood within rounding"""
FEATURE_RATES = (0.4, 1.0, 2.5)
"""angular rates of the features [rad per standard deviation of the inputs]: smooth, not a table"""


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """δ = Φw with w ~ N(0, (τF)²/K): Φ in principal directions.

    Attributes
    ----------
    columns : (N, K) array
        Orthogonal; Φ/√K, so that the weights' variance is (τF)².
    power : (K,) array
        Their squared norms.
    output_rms : float
        F, root mean square of the output.
    """

    columns: np.ndarray
    power: np.ndarray
    output_rms: float

    @classmethod
    def of(cls, problem: DiagnosisProblem, baseline: Baseline) -> Discrepancy:
        """Functions of the velocity and the scheduling variables jointly, and of every other input alone.

        Additive: products of speed and position reproduce every loop of a periodic record.
        Rahimi and Recht (2007), random Fourier features.

        Parameters
        ----------
        problem : DiagnosisProblem
        baseline : Baseline
            Its channels that every record has are the inputs, except the output; without any there is one column of
            zeros.

        Returns
        -------
        Discrepancy
        """
        rng = np.random.default_rng(0)
        driving = [c for c in baseline.channels if c != baseline.output and all(s.has(c) for s in problem.signals)]
        joint = [c for c in driving if c == "velocity" or c in baseline.schedule]
        groups = [g for g in (joint, *([c] for c in driving if c not in joint)) if g]
        parts = []
        for group in groups:
            z = problem.stack([np.column_stack([s[c] for c in group]) for s in problem.signals])
            spread = z.std(axis=0)
            z = (z - z.mean(axis=0))[:, spread > 0] / spread[spread > 0]
            count = FEATURES // len(groups)
            rates = rng.standard_normal((z.shape[1], count)) * np.resize(FEATURE_RATES, count)
            parts.append(np.sqrt(2.0) * np.cos(z @ rates + rng.uniform(0, 2 * np.pi, count)))
        features = problem.weighed(np.hstack(parts)) if parts else np.zeros((problem.n_samples, 1))
        power, directions = np.linalg.eigh(features.T @ features)
        keep = power > HALF_DIGITS * max(float(power[-1]), TINY)
        output_rms = float(np.sqrt(np.mean(problem.stack([s.output - s.output.mean() for s in problem.signals]) ** 2)))
        count = features.shape[1]
        return cls(features @ directions[:, keep] / np.sqrt(count), power[keep] / count, output_rms)


@dataclass(frozen=True, eq=False)
class MarginalLikelihood:
    """Marginal likelihood of a fit at its most probable noise and discrepancy.

    Attributes
    ----------
    likelihood : float
        Log-likelihood with the discrepancy integrated out, its size and the noise's at their most probable values.
    noise : float
        Variance of the noise.
    size : float
        τ.
    woodbury_weights : (K,) array
        Weights of the columns in the inverse covariance, by Woodbury's identity: C⁻¹ = κ/σ² (I − Φ diag(w) Φᵀ).
    """

    likelihood: float
    noise: float
    size: float
    woodbury_weights: np.ndarray


def marginal(squared: float, projected_error: np.ndarray, d: Discrepancy, count: int, kappa: float
             ) -> MarginalLikelihood:
    """The most probable split of an error into noise and discrepancy.

    −κN/2 ln 2πσ² − ½ Σ ln(1 + κ s²λ/σ²) − κ/2σ² (e'e − Σ κ s²/(σ² + κ s²λ) a²) − τ²/2τ₀², s = τF: the data's part is
    tempered to κN independent samples, the prior of the discrepancy is not.

    Parameters
    ----------
    squared : float
        e'e.
    projected_error : (K,) array
        Φ'e.
    d : Discrepancy
    count : int
        N.
    kappa : float
        κ.

    Returns
    -------
    MarginalLikelihood
        Of the sizes in `MISFIT_SIZES`, the one that is most probable.
    """
    mean = max(squared / count, TINY)
    low, high = np.full(MISFIT_SIZES.size, np.log(mean * STEP)), np.full(MISFIT_SIZES.size, np.log(mean) + 1.0)
    variance = (MISFIT_SIZES * d.output_rms) ** 2
    rows, span = np.arange(MISFIT_SIZES.size), np.inf
    while span > np.sqrt(STEP):  # about the maximum the logarithm is a parabola
        grid = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, GRID_SIZE)
        values = _log_likelihood(np.exp(grid), variance[:, None], squared, projected_error, d.power, count, kappa)
        k = values.argmax(axis=1)
        low, high = grid[rows, np.maximum(k - 1, 0)], grid[rows, np.minimum(k + 1, GRID_SIZE - 1)]
        span = float((high - low).max())
    total = values.max(axis=1) - (MISFIT_SIZES / TYPICAL_MISFIT) ** 2 / 2
    best = int(np.argmax(total))
    noise = float(np.exp(grid[best, k[best]]))
    return MarginalLikelihood(float(total[best]), noise, float(MISFIT_SIZES[best]),
                              kappa * variance[best] / (noise + kappa * variance[best] * d.power))


def _log_likelihood(noise: np.ndarray, variance: np.ndarray, squared: float, projected_error: np.ndarray,
                    power: np.ndarray, count: int, kappa: float) -> np.ndarray:
    """(sizes, points) at several variances of the noise and of the discrepancy's weights."""
    share = kappa * variance / noise
    ratio = share[..., None] * power
    left = squared - (share[..., None] / (1 + ratio)) @ projected_error**2
    return -0.5 * kappa * count * np.log(2 * np.pi * noise) - 0.5 * np.log1p(ratio).sum(axis=-1) - \
        0.5 * kappa * left / noise
