"""One of the two projected inequalities of output feedback at every point, and how its Lyapunov matrix varies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from lpvid.lmi.affine import Affine, widened


@dataclass(frozen=True, eq=False)
class Variation:
    """How a Lyapunov matrix varies: Σ_j values[k, j] X_j at point k, and its derivative at corner t of the rates.

    Parameters
    ----------
    values : (N, K) array
    slopes : (N, T, K) array
    """

    values: np.ndarray
    slopes: np.ndarray

    @classmethod
    def constant(cls, points: int) -> Variation:
        """One matrix for all points.

        Parameters
        ----------
        points : int
            Number of points N.

        Returns
        -------
        Variation
            One function, one corner, no slope.
        """
        return cls(np.ones((points, 1)), np.zeros((points, 1, 1)))

    def part(self, points: Sequence[int]) -> Variation:
        """At some of the points.

        Parameters
        ----------
        points : sequence of int
            Which of the N points.

        Returns
        -------
        Variation
            Of the same functions.
        """
        return Variation(self.values[points], self.slopes[points])

    @property
    def moves(self) -> bool:
        """The matrix depends on the scheduling."""
        return self.values.shape[1] > 1

    def at(self, matrices: np.ndarray) -> np.ndarray:
        """(N, n, n) of (K, n, n) matrices.

        Parameters
        ----------
        matrices : (K, n, n) array
            Coefficients X_j.

        Returns
        -------
        (N, n, n) array
            The matrix at every point.
        """
        return np.tensordot(self.values, matrices, axes=1)

    def slope(self, matrices: np.ndarray) -> np.ndarray:
        """(N, T, n, n) derivatives.

        Parameters
        ----------
        matrices : (K, n, n) array
            Coefficients X_j.

        Returns
        -------
        (N, T, n, n) array
            At every point and corner, per unit of time of the plant.
        """
        return np.tensordot(self.slopes, matrices, axes=1)


@dataclass(frozen=True, eq=False)
class Half:
    """One of the two sides, as a problem of full information; `sign` is that of the Lyapunov matrix's derivative.

    Parameters
    ----------
    A, B1, B2 : (N, n, n), (N, n, n_w) and (N, n, n_u) arrays
        Dynamics, disturbances and controls; of the measurements' side those of the dual plant.
    C1, D11, D12 : (N, n_z, n), (N, n_z, n_w) and (N, n_z, n_u) arrays
        Performance signals.
    variation : Variation
        Of X, or of Y.
    sign : float
        1 or −1.
    """

    A: np.ndarray
    B1: np.ndarray
    B2: np.ndarray
    C1: np.ndarray
    D11: np.ndarray
    D12: np.ndarray
    variation: Variation
    sign: float

    def pieces(self, root: np.ndarray, k: int) -> HalfPoint:
        """What the inequalities at point k are made of, in coordinates x = `root`·x'.

        Parameters
        ----------
        root : (n, n) array
            Regular.
        k : int
            Which of the N points.

        Returns
        -------
        HalfPoint
            For a bound that is a number or an unknown.
        """
        inverse = np.linalg.inv(root)
        n, w = self.A.shape[1], self.D11.shape[2]
        a, b, c = inverse @ self.A[k] @ root, inverse @ self.B1[k], self.C1[k] @ root
        null = null_space(np.hstack([(inverse @ self.B2[k]).T, self.D12[k].T]))
        weight = np.zeros((null.shape[1] + w,) * 2)
        weight[: null.shape[1], : null.shape[1]] = null[n:].T @ null[n:]
        weight[null.shape[1] :, null.shape[1] :] = np.eye(w)
        return HalfPoint(null[:n].T @ a + null[n:].T @ c, null[:n], null.T @ np.vstack([b, self.D11[k]]), weight)

    def inequalities(self, root: np.ndarray, matrices: list[Affine]) -> Iterator[tuple[Affine, np.ndarray]]:
        """F and E with γE − F ⪰ 0, for every point and corner.

        Parameters
        ----------
        root : (n, n) array
            Of x = `root`·x'.
        matrices : list of Affine
            (n, n) unknowns, one for each function of the variation, in coordinates x'.

        Yields
        ------
        Affine
            F, affine in the unknowns.
        2-D array
            E, of the size of F.
        """
        width = max(m.linear.shape[1] for m in matrices)
        entries = sparse.vstack([widened(m.linear, width) for m in matrices], format="csr").T
        for k in range(len(self.A)):
            p = self.pieces(root, k)
            size, drives = p.null.shape[1], p.drive.shape[1]
            constant = np.zeros((size + drives,) * 2)
            constant[:size, size:], constant[size:, :size] = p.drive, p.drive.T
            own, moved = p.slopes()
            inside = np.zeros((len(constant), len(constant), width))
            for slope in self.variation.slopes[k]:
                weights = self.variation.values[k][:, None, None, None] * own
                if slope.any():
                    weights = weights + self.sign * slope[:, None, None, None] * moved
                inside[:size, :size] = (entries @ weights.transpose(0, 3, 1, 2).reshape(entries.shape[1], -1)
                                        ).T.reshape(size, size, width)
                yield Affine(constant, sparse.csr_array(inside.reshape(-1, width))), p.weight

    def sizes(self, root: np.ndarray, matrices: np.ndarray, gamma: float) -> list[np.ndarray]:
        """Norms of the rows of γE − F for known matrices (K, n, n) in the plant's own coordinates.

        Parameters
        ----------
        root : (n, n) array
            Of x = `root`·x'.
        matrices : (K, n, n) array
            X or Y over its basis.
        gamma : float
            Bound of the gain.

        Returns
        -------
        list of array
            One for each point and corner.
        """
        return [np.linalg.norm(value, axis=1) for value in self.values(root, matrices, gamma)]

    def values(self, root: np.ndarray, matrices: np.ndarray, gamma: float) -> Iterator[np.ndarray]:
        """γE − F for known matrices (K, n, n) in the plant's own coordinates, for every point and corner.

        Parameters
        ----------
        root : (n, n) array
            Change of coordinates from the plant's own to those of the pieces.
        matrices : (K, n, n) array
            X or Y over its basis.
        gamma : float
            The gain.

        Yields
        ------
        (m, m) array
            Positive semidefinite where the inequality holds.
        """
        inverse = np.linalg.inv(root)
        own = inverse @ matrices @ inverse.T
        for k in range(len(self.A)):
            p = self.pieces(root, k)
            half = p.left @ np.tensordot(self.variation.values[k], own, axes=1) @ p.null
            for slope in self.variation.slopes[k]:
                drift = self.sign * (p.null.T @ np.tensordot(slope, own, axes=1) @ p.null)
                m, value = len(half), gamma * p.weight
                value[:m, :m] -= half + half.T + drift
                value[:m, m:] -= p.drive
                value[m:, :m] -= p.drive.T
                yield value


@dataclass(frozen=True, eq=False)
class HalfPoint:
    """One point of a side: F = [He(left·X·null) + nullᵀẊnull, drive; ⋆, 0] and its weight E.

    Parameters
    ----------
    left : (m, n) array
        NᵀA with the performance signals, in the coordinates of the side.
    null : (n, m) array
        States' part of the null space of [B2ᵀ D12ᵀ]; F uses its transpose on the left.
    drive : (m, n_w) array
        Disturbances on the null space.
    weight : (m + n_w, m + n_w) array
        E, what γ multiplies.
    """

    left: np.ndarray
    null: np.ndarray
    drive: np.ndarray
    weight: np.ndarray

    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by the entries of X of He(left·X·null), and of nullᵀX null.

        Returns
        -------
        (m, m, n²) array
        (m, m, n²) array
            The entries of X row by row.
        """
        m, n = self.left.shape
        half = np.einsum("ai,jb->abij", self.left, self.null).reshape(m, m, n * n)
        return half + half.swapaxes(0, 1), np.einsum("ia,jb->abij", self.null, self.null).reshape(m, m, n * n)


def null_space(matrix: np.ndarray) -> np.ndarray:
    """Orthonormal columns spanning the null space; directions below 1e-10 of the largest count as null.

    Parameters
    ----------
    matrix : (m, n) array
        Any matrix.

    Returns
    -------
    (n, n − rank) array
        The identity's size for a matrix of zeros.
    """
    _, s, vt = np.linalg.svd(matrix)
    rank = int((s > 1e-10 * max(s.max(initial=0.0), 1e-300)).sum())
    return vt[rank:].T


def congruent(matrix: Affine, scale: np.ndarray) -> Affine:
    """The matrix between diagonal matrices: diag(s) M diag(s).

    Parameters
    ----------
    matrix : Affine
        (n, n), with its unknowns.
    scale : (n,) array
        The diagonal s.

    Returns
    -------
    Affine
        (n, n), with the same unknowns.
    """
    both = np.outer(scale, scale)
    return Affine(both * matrix.constant, sparse.csr_array(sparse.diags_array(both.ravel()) @ matrix.linear))
