"""What a Monte Carlo study of an estimator is asked: is it biased, and do its intervals cover."""

from __future__ import annotations

import numpy as np


def joint_bias_test(estimates: np.ndarray, truth: np.ndarray) -> float:
    """p-value of Hotelling's T² that the mean of `estimates` (runs, k) is `truth` (k,).

    T² = R dᵀS⁻¹d with d the mean error and S the sample covariance; T² (R−k)/(k(R−1)) is F with (k, R−k) degrees of
    freedom for normal estimates (Hotelling 1931). With many runs it is the χ² test with k degrees of freedom.
    """
    from scipy.stats import f

    runs, k = estimates.shape
    error = estimates.mean(axis=0) - truth
    statistic = runs * error @ np.linalg.solve(np.atleast_2d(np.cov(estimates.T)), error)
    return float(f.sf(statistic * (runs - k) / (k * (runs - 1)), k, runs - k))


def coverage(estimates: np.ndarray, standard_errors: np.ndarray, truth: np.ndarray, level: float = 0.95) -> float:
    """Share of all intervals, pooled over runs and parameters, that hold the true value."""
    from scipy.stats import norm

    reach = norm.ppf(0.5 + 0.5 * level) * standard_errors
    return float(np.mean(np.abs(estimates - truth) <= reach))


def known_bias_test(estimates: np.ndarray, truth: np.ndarray, covariance: np.ndarray) -> float:
    """p-value of the χ² test that the mean of estimates of known covariance (k, k) is `truth`."""
    from scipy.stats import chi2

    error = np.mean(estimates, axis=0) - truth
    return float(chi2.sf(len(estimates) * float(error @ np.linalg.solve(covariance, error)), len(truth)))
