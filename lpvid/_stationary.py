"""Stationary noise: the eigenvectors of its covariance, and variances of given spectra beside it."""

from __future__ import annotations

import numpy as np

from lpvid.rounding import EPS, TINY


def toeplitz_basis(autocovariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and eigenvectors of the covariance of n samples of stationary noise.

    Parameters
    ----------
    autocovariance : (n,) array
        At lags 0 to n − 1, in the squared unit of the noise.

    Returns
    -------
    (n,) array
        Positive: variances of the coordinates along the eigenvectors.
    (n, n) array
        Orthonormal columns.

    Examples
    --------
    >>> values, basis = toeplitz_basis(np.array([1.0, 0.5]))
    >>> values.round(9).tolist()
    [0.5, 1.5]
    """
    from scipy.linalg import toeplitz

    values, basis = np.linalg.eigh(toeplitz(autocovariance))
    return np.maximum(values, max(EPS * values.size * float(values[-1]), TINY)), basis


def variance_components(squares: np.ndarray, known: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """The most probable variances of independent normal terms of given spectra, beside noise of known variances.

    Coordinate i of variance v_i = known_i + Σ_k θ_k shapes_ki is normal: the mean of ln v_i + squares_i/v_i is least.

    Parameters
    ----------
    squares : (n,) array
        Mean squares of the coordinates.
    known : (n,) array
        Positive.
    shapes : (k, n) array
        Not negative.

    Returns
    -------
    (k,) array
        θ, not negative.

    Examples
    --------
    >>> variance_components(np.full(50, 3.0), np.ones(50), np.ones((1, 50))).round(3).tolist()
    [2.0]
    >>> variance_components(np.full(50, 0.9), np.ones(50), np.ones((1, 50))).round(6).tolist()
    [0.0]
    """
    from scipy.optimize import minimize

    scale = max(float(squares.mean()), TINY)
    known, squares = known / scale, squares / scale

    def cost(theta: np.ndarray) -> tuple[float, np.ndarray]:
        v = known + theta @ shapes
        return float(np.mean(np.log(v) + squares / v)), (shapes @ (1 / v - squares / v**2)) / v.size

    start = np.full(len(shapes), max(1.0 - float(known.mean()), np.sqrt(EPS)) / len(shapes))
    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=[(0.0, None)] * len(shapes))
    return scale * found.x
