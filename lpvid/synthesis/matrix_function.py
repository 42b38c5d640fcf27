"""MatrixFunction: matrices that are linear in a basis of the scheduling, closed under sum, product and blocks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.scheduling import Basis
from lpvid.scheduling.algebra import ONE, atoms, common, products


@dataclass(frozen=True, eq=False)
class MatrixFunction:
    """M(p) = Σ_m coefficients[m] φ_m(p).

    Sums and products are exact: polynomials stay polynomials (of summed degree), other pairs of bases give a `Stacked`
    or a `Product`.

    Parameters
    ----------
    basis : Basis
    coefficients : (M, rows, columns) array

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> m = MatrixFunction(Polynomial("p", 1), np.array([[[1.0]], [[2.0]]]))              # 1 + 2 p
    >>> (m @ m + 1.0).at(np.array([[3.0]]))
    array([[[50.]]])
    """

    basis: Basis
    coefficients: np.ndarray

    def __post_init__(self) -> None:
        array = _checks.frozen_array(self.coefficients, "coefficients", ndim=3)
        object.__setattr__(self, "coefficients", _checks.shaped(array, (self.basis.size, None, None), "coefficients"))

    __array_ufunc__ = None  # numpy leaves `array @ function` to `__rmatmul__`

    @classmethod
    def constant(cls, matrix: np.ndarray) -> MatrixFunction:
        """A matrix that does not move.

        Parameters
        ----------
        matrix : (rows, columns) array
            Value at every p; a number counts as (1, 1).

        Returns
        -------
        MatrixFunction
            Over the basis {1}.
        """
        return cls(ONE, np.atleast_2d(np.asarray(matrix, dtype=float))[None])

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.coefficients.shape[1], self.coefficients.shape[2]

    @property
    def still(self) -> np.ndarray | None:
        """The matrix if it does not move, else None."""
        one = self.basis.unity
        if one is None:
            return None if self.coefficients.any() else np.zeros(self.shape)
        pivot = int(np.argmax(np.abs(one)))
        level = self.coefficients[pivot] / one[pivot]
        return level if np.array_equal(self.coefficients, one[:, None, None] * level) else None

    @property
    def pattern(self) -> np.ndarray:
        """(rows, columns) bool: which entries are not identically zero."""
        return np.any(self.coefficients != 0, axis=0)

    def at(self, points: np.ndarray) -> np.ndarray:
        """(N, rows, columns) values at points of shape (N, len(basis.names)).

        Parameters
        ----------
        points : (N, len(basis.names)) array
            Scheduling values, in the order of the basis's names.

        Returns
        -------
        (N, rows, columns) array
            M(p).
        """
        return np.tensordot(self.basis.evaluate(np.asarray(points, dtype=float)), self.coefficients, axes=1)

    def __getitem__(self, index: tuple) -> MatrixFunction:
        rows, columns = index
        return MatrixFunction(self.basis, self.coefficients[:, rows][:, :, columns])

    def __neg__(self) -> MatrixFunction:
        return MatrixFunction(self.basis, -self.coefficients)

    def __add__(self, other: MatrixFunction | np.ndarray | float) -> MatrixFunction:
        other = _as_function(other, self.shape)
        if other.shape != self.shape:
            raise InputError("matrices of different shapes cannot be added", got=f"{self.shape} and {other.shape}")
        basis, e, f = common(self.basis, other.basis)
        return MatrixFunction(basis, _over(self, e) + _over(other, f))

    __radd__ = __add__

    def __sub__(self, other: MatrixFunction | np.ndarray | float) -> MatrixFunction:
        return self + (-_as_function(other, self.shape))

    def __rsub__(self, other: np.ndarray | float) -> MatrixFunction:
        return -self + other

    def __matmul__(self, right: MatrixFunction | np.ndarray) -> MatrixFunction:
        if not isinstance(right, MatrixFunction):
            return MatrixFunction(self.basis, self.coefficients @ np.asarray(right, dtype=float))
        still_left, still_right = self.still, right.still
        if still_right is not None:
            return self @ still_right
        if still_left is not None:
            return still_left @ right
        total = MatrixFunction(self.basis, np.zeros((self.basis.size, self.shape[0], right.shape[1])))
        for left in self._parts():
            for other in right._parts():
                if (left.pattern.astype(int) @ other.pattern.astype(int)).any():
                    total = total + left._times_part(other)
        return total.trimmed()

    def _parts(self) -> list[MatrixFunction]:
        """The function split along a stack of bases, and into entries that move and entries that do not.

        What is zero is left out. An entry that does not move is a constant, whatever table it is written over: products
        of the functions of large tables would not fit into memory.
        """
        ends = np.cumsum([0, *(a.size for a in atoms(self.basis))])
        parts = [p for a, (i, j) in zip(atoms(self.basis), itertools.pairwise(ends), strict=True)
                 for p in MatrixFunction(a, self.coefficients[i:j])._split()]
        return [p.trimmed() for p in parts if p.coefficients.any()]

    def _split(self) -> tuple[MatrixFunction, MatrixFunction]:
        """The entries that do not move, as constants, and the others."""
        one = np.zeros(self.basis.size) if self.basis.unity is None else self.basis.unity
        pivot = int(np.argmax(np.abs(one)))
        level = self.coefficients[pivot] / (one[pivot] or 1.0)
        still = np.all(self.coefficients == one[:, None, None] * level, axis=0)
        return (MatrixFunction.constant(np.where(still, level, 0.0)),
                MatrixFunction(self.basis, np.where(still, 0.0, self.coefficients)))

    def _times_part(self, right: MatrixFunction) -> MatrixFunction:
        basis, table = products(self.basis, right.basis)
        pairs = np.einsum("aij,bjk->abik", self.coefficients, right.coefficients)
        flat = table.reshape(-1, basis.size).T @ pairs.reshape(table.shape[0] * table.shape[1], -1)
        return MatrixFunction(basis, flat.reshape(basis.size, self.shape[0], right.shape[1]))

    def __rmatmul__(self, left: np.ndarray) -> MatrixFunction:
        return MatrixFunction(self.basis, np.asarray(left, dtype=float) @ self.coefficients)

    def times(self, factor: float) -> MatrixFunction:
        """Every entry times a number.

        Parameters
        ----------
        factor : float
            Multiplies every coefficient.

        Returns
        -------
        MatrixFunction
            Over the same basis.
        """
        return MatrixFunction(self.basis, factor * self.coefficients)

    def trimmed(self) -> MatrixFunction:
        """The same function over no higher degree, and no more stacked bases, than it needs; variables stay named.

        Returns
        -------
        MatrixFunction
            Same values at every point.
        """
        basis, coefficients = self.basis.trimmed(self.coefficients)
        return MatrixFunction(basis, coefficients)


def block(rows: Sequence[Sequence[MatrixFunction | np.ndarray]]) -> MatrixFunction:
    """A matrix of blocks over one basis that spans all of theirs.

    Parameters
    ----------
    rows : sequence of sequences of MatrixFunction or 2-D array
        Blocks of a row have one height, those of a column one width.

    Returns
    -------
    MatrixFunction
        Over the common basis.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> m = MatrixFunction(Polynomial("p", 1), np.array([[[1.0]], [[2.0]]]))
    >>> block([[m, np.zeros((1, 1))], [np.eye(1), m @ m]]).at(np.array([[1.0]])).tolist()
    [[[3.0, 0.0], [1.0, 9.0]]]
    """
    parts = [[b if isinstance(b, MatrixFunction) else MatrixFunction.constant(b) for b in row] for row in rows]
    basis: Basis = ONE
    for part in (p for row in parts for p in row):
        basis, _, _ = common(basis, part.basis)
    zero = MatrixFunction(basis, np.zeros((basis.size, 1, 1)))
    spread = [[_over(p, common(zero.basis, p.basis)[2]) for p in row] for row in parts]
    return MatrixFunction(basis, np.block(spread))


def _over(function: MatrixFunction, into: np.ndarray) -> np.ndarray:
    return np.tensordot(into.T, function.coefficients, axes=1)


def _as_function(value: MatrixFunction | np.ndarray | float, shape: tuple[int, int]) -> MatrixFunction:
    if isinstance(value, MatrixFunction):
        return value
    array = np.asarray(value, dtype=float)
    return MatrixFunction.constant(array * np.eye(*shape) if array.ndim == 0 else array)
