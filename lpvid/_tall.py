"""Tall matrices, such as Jacobians of a long record: what numpy computes of them, with fewer copies in memory.

All numbers are numpy's to the last bit: the same routines of LAPACK, the same order of sums.
"""

from __future__ import annotations

import numpy as np

ROWS = 4096
"""rows whose squares are in memory at a time"""


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


def least_squares_overwriting(matrix: np.ndarray, right: np.ndarray, rcond: float) -> np.ndarray:
    """Minimiser of ‖right − matrix·x‖ of least norm, as of ``np.linalg.lstsq``; the matrix is used as memory.

    Parameters
    ----------
    matrix : (m, k) array
        In Fortran order, of floats; its numbers are lost.
    right : (m,) array
    rcond : float
        Share of the largest singular value below which one counts as zero.

    Returns
    -------
    (k,) array

    Raises
    ------
    numpy.linalg.LinAlgError
        The singular values cannot be computed.

    Examples
    --------
    >>> least_squares_overwriting(np.array([[2.0], [0.0]], order="F"), np.array([3.0, 1.0]), 1e-8).round(9).tolist()
    [1.5]
    """
    from scipy.linalg import lapack

    rows, columns = matrix.shape
    if rows < columns or not matrix.size:
        return np.linalg.lstsq(matrix, right, rcond=rcond)[0]
    work, integers, _ = lapack.dgelsd_lwork(rows, columns, 1)  # type: ignore[attr-defined]
    found, _, _, info = lapack.dgelsd(matrix, right[:, None], int(work), int(integers),  # type: ignore[attr-defined]
                                      cond=rcond, overwrite_a=1)
    if info != 0:
        raise np.linalg.LinAlgError("SVD did not converge in linear least squares")
    return found[:columns, 0].copy()


def column_norms(matrix: np.ndarray) -> np.ndarray:
    """Norms of the columns, as of ``np.linalg.norm(matrix, axis=0)``.

    Parameters
    ----------
    matrix : (m, k) array

    Returns
    -------
    (k,) array

    Examples
    --------
    >>> column_norms(np.array([[3.0, 1.0], [4.0, 0.0]])).tolist()
    [5.0, 1.0]
    """
    if matrix.flags.f_contiguous:
        return np.array([np.sqrt(np.add.reduce(column * column)) for column in matrix.T])
    total = np.zeros((1, matrix.shape[1]))
    for first in range(0, len(matrix), ROWS):
        part = matrix[first: first + ROWS]
        total = np.add.reduce(np.concatenate([total, part * part]), axis=0)[None]
    return np.sqrt(total[0])


def move_together(values: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """The rows to keep as the first rows of the same array; numpy copies what a move overlaps, a few at a time.

    Parameters
    ----------
    values : (m,) or (m, k) array
        Its other rows are lost.
    keep : (m,) bool array

    Returns
    -------
    (n,) or (n, k) array
        A view of `values`.

    Examples
    --------
    >>> move_together(np.array([1.0, 2.0, 3.0]), np.array([False, True, True])).tolist()
    [2.0, 3.0]
    """
    last = 0
    for first in range(0, len(values), ROWS):
        kept = values[first: first + ROWS][keep[first: first + ROWS]]
        values[last: last + len(kept)] = kept
        last += len(kept)
    return values[:last]
