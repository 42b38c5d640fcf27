"""Projections: an orthonormal basis of the columns of a matrix, and values less their part along it."""

from __future__ import annotations

import numpy as np

from lpvid.rounding import HALF_DIGITS


def projector(jacobian: np.ndarray) -> np.ndarray:
    """(N, r) orthonormal basis of the columns, those without weight left out.

    Parameters
    ----------
    jacobian : (N, P) array
        Finite.

    Returns
    -------
    (N, r) array
        Of singular values above `HALF_DIGITS` of the largest, each column first scaled to length one; (N, 0) where
        all are zero.
    """
    norms = np.linalg.norm(jacobian, axis=0)
    columns = jacobian[:, norms > 0] / norms[norms > 0]
    if not columns.shape[1]:
        return np.zeros((jacobian.shape[0], 0))
    from scipy.linalg import svd

    left, values, _ = svd(columns, full_matrices=False, lapack_driver="gesdd")
    return left[:, values > HALF_DIGITS * values[0]]


def without(basis: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values less their projection on an orthonormal basis, twice for the digits.

    Parameters
    ----------
    basis : (N, r) array
    values : (N,) or (N, k) array

    Returns
    -------
    (N,) or (N, k) array
    """
    if not basis.shape[1]:
        return values
    values = values - basis @ (basis.T @ values)
    return values - basis @ (basis.T @ values)
