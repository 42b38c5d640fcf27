"""Statistics of repeated estimates: is the bias zero, and do the intervals cover."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, norm


def joint_bias_test(estimates: np.ndarray, truth: np.ndarray) -> float:
    """p-value of Hotelling's test that estimates (runs, k) scatter around `truth` (k,).

    T² = R (mean − truth)ᵀ S⁻¹ (mean − truth) with the scatter S of R runs; (R − k)/(k (R − 1)) T² is F(k, R − k).
    For R → ∞ this is the χ² test with k degrees of freedom.
    """
    from scipy.stats import f

    estimates = np.asarray(estimates, dtype=float)
    runs, k = estimates.shape
    bias = estimates.mean(axis=0) - truth
    scatter = np.cov(estimates, rowvar=False).reshape(k, k)
    t2 = runs * float(bias @ np.linalg.solve(scatter, bias))
    return float(f.sf((runs - k) / (k * (runs - 1)) * t2, k, runs - k))


def known_bias_test(estimates: np.ndarray, truth: np.ndarray, covariance: np.ndarray) -> float:
    """p-value of the χ² test that estimates with known covariance (k, k) scatter around `truth`."""
    bias = np.mean(estimates, axis=0) - truth
    statistic = len(estimates) * float(bias @ np.linalg.solve(covariance, bias))
    return float(chi2.sf(statistic, len(truth)))


def coverage(estimates: np.ndarray, standard_errors: np.ndarray, truth: np.ndarray, level: float = 0.95) -> float:
    """Share of intervals estimate ± z·(standard error), pooled over runs and parameters, that hold the truth."""
    reach = norm.ppf(0.5 + level / 2) * np.asarray(standard_errors)
    return float(np.mean(np.abs(np.asarray(estimates) - truth) <= reach))
