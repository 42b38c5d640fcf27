"""Matrices affine in unknowns, by sparse algebra: what matrix inequalities are written in.

An `Unknowns` hands out symmetric, full and diagonal matrix variables; sums, products with known matrices, transposes
and blocks of them stay affine in one vector x.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from lpvid.errors import InputError

Known = np.ndarray | float


@dataclass(frozen=True, eq=False)
class Affine:
    """An (m, n) matrix F(x) = constant + reshape(linear x), row by row.

    Parameters
    ----------
    constant : (m, n) array
    linear : (m·n, K) sparse array
        K may be smaller than the number of unknowns that are declared later.

    Examples
    --------
    >>> unknowns = Unknowns()
    >>> p = unknowns.symmetric(2)
    >>> a = np.array([[0.0, 1.0], [-1.0, -1.0]])
    >>> he(p @ a).value(np.array([1.5, 0.5, 1.0])).round(3).tolist()
    [[-1.0, 0.0], [0.0, -1.0]]
    """

    constant: np.ndarray
    linear: Any

    __array_ufunc__ = None  # numpy leaves `array @ affine` to `__rmatmul__`

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.constant.shape[0], self.constant.shape[1]

    @property
    def T(self) -> Affine:
        """Transposed."""
        m, n = self.shape
        order = np.arange(m * n).reshape(m, n).T.ravel()
        return Affine(self.constant.T, self.linear[order])

    def __neg__(self) -> Affine:
        return Affine(-self.constant, -self.linear)

    def __add__(self, other: Affine | Known) -> Affine:
        other = _as_affine(other, self.shape)
        if other.shape != self.shape:
            raise InputError("matrices of different shapes cannot be added", got=f"{self.shape} and {other.shape}")
        width = max(self.linear.shape[1], other.linear.shape[1])
        linear: Any = widened(self.linear, width) + widened(other.linear, width)
        return Affine(self.constant + other.constant, linear.tocsr())

    __radd__ = __add__

    def __sub__(self, other: Affine | Known) -> Affine:
        return self + (-_as_affine(other, self.shape))

    def __rsub__(self, other: Known) -> Affine:
        return -self + other

    def __mul__(self, factor: float) -> Affine:
        return Affine(factor * self.constant, (float(factor) * self.linear).tocsr())

    __rmul__ = __mul__

    def __matmul__(self, right: np.ndarray) -> Affine:
        right = np.asarray(right, dtype=float)
        spread: Any = sparse.kron(sparse.eye_array(self.shape[0]), sparse.csr_array(right.T))
        return Affine(self.constant @ right, (spread @ self.linear).tocsr())

    def __rmatmul__(self, left: np.ndarray) -> Affine:
        left = np.asarray(left, dtype=float)
        spread: Any = sparse.kron(sparse.csr_array(left), sparse.eye_array(self.shape[1]))
        return Affine(left @ self.constant, (spread @ self.linear).tocsr())

    def value(self, x: np.ndarray) -> np.ndarray:
        """(m, n) the matrix at x of shape (K,).

        Parameters
        ----------
        x : (K,) array
            All unknowns; entries behind the matrix's own are ignored.

        Returns
        -------
        (m, n) array
            F(x).
        """
        return self.constant + (self.linear @ x[: self.linear.shape[1]]).reshape(self.shape)

    def times(self, matrix: np.ndarray) -> Affine:
        """A scalar unknown times a known matrix.

        Parameters
        ----------
        matrix : (m, n) array
            Known numbers.

        Returns
        -------
        Affine
            (m, n).

        Raises
        ------
        InputError
            An unknown that is not (1, 1).
        """
        if self.shape != (1, 1):
            raise InputError("only a scalar unknown can multiply a matrix", got=f"shape {self.shape}")
        matrix = np.asarray(matrix, dtype=float)
        column = sparse.csr_array(matrix.reshape(-1, 1))
        return Affine(self.constant[0, 0] * matrix, (column @ self.linear).tocsr())


class Unknowns:
    """Declares matrix variables over one growing vector x."""

    def __init__(self) -> None:
        self.size = 0

    def symmetric(self, n: int) -> Affine:
        """(n, n) symmetric, n(n+1)/2 unknowns, the upper triangle row by row.

        Parameters
        ----------
        n : int
            Order.

        Returns
        -------
        Affine
            Its unknowns follow those declared before.
        """
        rows, columns = np.triu_indices(n)
        index = np.zeros((n, n), dtype=int)
        index[rows, columns] = index[columns, rows] = np.arange(len(rows))
        return self._declared(index.ravel(), (n, n), len(rows))

    def matrix(self, m: int, n: int) -> Affine:
        """(m, n) without structure.

        Parameters
        ----------
        m, n : int
            Rows and columns.

        Returns
        -------
        Affine
            m·n unknowns, row by row.
        """
        return self._declared(np.arange(m * n), (m, n), m * n)

    def antisymmetric(self, n: int) -> Affine:
        """(n, n) with T = −Tᵀ.

        Parameters
        ----------
        n : int
            Order.

        Returns
        -------
        Affine
            n(n − 1)/2 unknowns, the upper triangle row by row.
        """
        rows, columns = np.triu_indices(n, 1)
        count, k = len(rows), np.arange(len(rows))
        data = np.concatenate([np.ones(count), -np.ones(count)])
        at = np.concatenate([rows * n + columns, columns * n + rows])
        linear = sparse.csr_array((data, (at, self.size + np.concatenate([k, k]))), shape=(n * n, self.size + count))
        self.size += count
        return Affine(np.zeros((n, n)), linear)

    def scalar(self) -> Affine:
        """(1, 1).

        Returns
        -------
        Affine
            One unknown.
        """
        return self.matrix(1, 1)

    def _declared(self, index: np.ndarray, shape: tuple[int, int], count: int) -> Affine:
        n = index.size
        linear = sparse.csr_array((np.ones(n), (np.arange(n), self.size + index)), shape=(n, self.size + count))
        self.size += count
        return Affine(np.zeros(shape), linear)


def he(matrix: Affine) -> Affine:
    """M + Mᵀ.

    Parameters
    ----------
    matrix : (n, n) Affine
        M, square.

    Returns
    -------
    (n, n) Affine
        Symmetric.
    """
    return matrix + matrix.T


def block(rows: Sequence[Sequence[Affine | np.ndarray]]) -> Affine:
    """A matrix of blocks; known blocks are arrays, and at least one block is affine.

    Parameters
    ----------
    rows : sequence of sequences of Affine or 2-D array
        Rows of blocks, from the left.

    Returns
    -------
    Affine
        Over the unknowns of all blocks.

    Raises
    ------
    InputError
        A block whose shape does not fit its row and column.

    Examples
    --------
    >>> gamma = Unknowns().scalar()
    >>> block([[gamma, np.zeros((1, 2))], [np.zeros((2, 1)), np.eye(2)]]).shape
    (3, 3)
    """
    parts = [[b if isinstance(b, Affine) else given(b) for b in row] for row in rows]
    heights, widths = [row[0].shape[0] for row in parts], [b.shape[1] for b in parts[0]]
    for i, row in enumerate(parts):
        if [b.shape for b in row] != [(heights[i], w) for w in widths]:
            raise InputError("blocks do not fit together", got=f"row {i} has {[b.shape for b in row]}")
    size = max(b.linear.shape[1] for row in parts for b in row)
    top, left = np.cumsum([0, *heights]), np.cumsum([0, *widths])
    constant = np.zeros((top[-1], left[-1]))
    data, at, unknown = [np.zeros(0)], [np.zeros(0, dtype=int)], [np.zeros(0, dtype=int)]
    for i, row in enumerate(parts):
        for j, b in enumerate(row):
            constant[top[i] : top[i + 1], left[j] : left[j + 1]] = b.constant
            entries = b.linear.tocoo()
            r, c = np.divmod(entries.row, max(b.shape[1], 1))
            at.append((top[i] + r) * left[-1] + left[j] + c)
            data.append(entries.data)
            unknown.append(entries.col)
    index = (np.concatenate(at), np.concatenate(unknown))
    return Affine(constant, sparse.csr_array((np.concatenate(data), index), shape=(constant.size, size)))


def given(value: Known) -> Affine:
    """Known numbers where unknown ones could stand.

    Parameters
    ----------
    value : (m, n) array or float
        The numbers; one alone is (1, 1).

    Returns
    -------
    Affine
        Over no unknowns.
    """
    matrix = np.atleast_2d(np.asarray(value, dtype=float))
    return Affine(matrix, sparse.csr_array((matrix.size, 0)))


def combined(matrices: Sequence[Affine], weights: np.ndarray) -> Affine:
    """Σ_m weights[m] · matrices[m].

    Parameters
    ----------
    matrices : sequence of Affine
        M of them, of equal shape.
    weights : (M,) array
        Their weights.

    Returns
    -------
    Affine
        The sum.
    """
    total = float(weights[0]) * matrices[0]
    for matrix, weight in zip(matrices[1:], weights[1:], strict=True):
        if weight:
            total = total + float(weight) * matrix
    return total


def trace(matrix: Affine, weight: np.ndarray | None = None) -> Affine:
    """tr W M.

    Parameters
    ----------
    matrix : (n, n) Affine
        M.
    weight : (n, n) array, optional
        W; the identity where it is left out.

    Returns
    -------
    (1, 1) Affine
        The trace.
    """
    across = (np.eye(matrix.shape[0]) if weight is None else weight).T
    row = sparse.csr_array(across.reshape(1, -1))
    return Affine(np.array([[np.sum(across * matrix.constant)]]), (row @ matrix.linear).tocsr())


def block_diagonal(parts: Sequence[Affine]) -> Affine:
    """Square matrices along a diagonal.

    Parameters
    ----------
    parts : sequence of Affine
        From the upper left.

    Returns
    -------
    Affine
        Zero beside them; (0, 0) for none.
    """
    if not parts:
        return given(np.zeros((0, 0)))
    sizes = [part.shape[0] for part in parts]
    return block([[part if i == k else np.zeros((sizes[i], sizes[k])) for k in range(len(parts))]
                  for i, part in enumerate(parts)])


def widened(linear: Any, unknowns: int) -> Any:
    """A linear part with zero columns for unknowns that it does not have.

    Parameters
    ----------
    linear : (m, k) sparse array
        By rows.
    unknowns : int
        K ≥ k.

    Returns
    -------
    (m, K) sparse array
        The same entries.
    """
    return sparse.csr_array((linear.data, linear.indices, linear.indptr), shape=(linear.shape[0], unknowns))


def _as_affine(value: Affine | Known, shape: tuple[int, ...]) -> Affine:
    if isinstance(value, Affine):
        return value
    return given(float(value) * np.eye(shape[0], shape[1]) if np.ndim(value) == 0 else value)
