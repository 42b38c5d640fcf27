"""The triangular factor of a tall matrix, with one copy of it in memory and not four."""

from __future__ import annotations

import numpy as np


def factor_overwriting(matrix: np.ndarray) -> np.ndarray:
    """R of the QR decomposition of a matrix, whose memory the decomposition uses.

    The numbers are those of ``np.linalg.qr(matrix, mode="r")``, which copies the matrix twice and turns it round.

    Parameters
    ----------
    matrix : (m, k) array
        In Fortran order, of floats; its numbers are lost.

    Returns
    -------
    (min(m, k), k) array
        Upper triangular; no view of the matrix.

    Examples
    --------
    >>> abs(factor_overwriting(np.array([[3.0, 0.0], [4.0, 5.0]], order="F"))).tolist()
    [[5.0, 4.0], [0.0, 3.0]]
    """
    from scipy.linalg import lapack

    rows, columns = matrix.shape
    if not matrix.size:
        return np.asarray(np.linalg.qr(matrix, mode="r"))
    work, _ = lapack.dgeqrf_lwork(rows, columns)  # type: ignore[attr-defined]
    reduced, _, _, info = lapack.dgeqrf(matrix, lwork=int(work), overwrite_a=1)  # type: ignore[attr-defined]
    if info != 0:
        raise ArithmeticError(f"dgeqrf failed with info {info}")
    return np.triu(reduced[: min(rows, columns)])


def triangular_factor(columns: np.ndarray, scale: np.ndarray | None = None, last: np.ndarray | None = None
                      ) -> np.ndarray:
    """R of the columns, each divided by its scale, with one more beside them; what is given stays.

    Parameters
    ----------
    columns : (m, k) array
    scale : (k,) array, optional
        Left out, the columns as they are.
    last : (m,) array, optional
        Column beside them, not scaled.

    Returns
    -------
    (min(m, n), n) array
        n is k, or k + 1 with a last column.

    Examples
    --------
    >>> abs(triangular_factor(np.array([[6.0], [8.0]]), np.array([2.0]), np.array([0.0, 5.0]))).tolist()
    [[5.0, 4.0], [0.0, 3.0]]
    """
    rows, count = columns.shape
    stacked = np.empty((rows, count + (last is not None)), order="F")
    if scale is None:
        stacked[:, :count] = columns
    else:
        np.divide(columns, scale, out=stacked[:, :count])
    if last is not None:
        stacked[:, count] = last
    return factor_overwriting(stacked)
