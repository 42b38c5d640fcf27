"""Coordinates in which a semidefinite program about a system is well scaled: states, time and signals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lpvid.lmi.driven import Driven, Matrices

REGULAR = 1e-6  # share of their diagonals added to Gramians, so that unreachable states keep a finite scale


@dataclass(frozen=True, eq=False)
class Frame:
    """x = T x̃, t = time·t̃, z = gain·z̃: every state about as easy to reach as to observe, gains and rates near 1.

    Attributes
    ----------
    states : (n, n) array
        T.
    time : float
        [s]; 1 in discrete time.
    gain : float
    """

    states: np.ndarray
    time: float
    gain: float

    def inside(self, system: Matrices) -> Matrices:
        """A, B, C, D in the frame.

        Parameters
        ----------
        system : (A, B, C, D), each (N, …)
            In the system's own states, seconds and units.

        Returns
        -------
        (A, B, C, D), each (N, …)
            w and z share the gain, half each.
        """
        a, b, c, d = system
        inverse, root = np.linalg.inv(self.states), math.sqrt(self.gain)
        return (self.time * inverse @ a @ self.states, self.time * inverse @ b / root, c @ self.states / root,
                d / self.gain)

    def outside(self, matrices: np.ndarray) -> np.ndarray:
        """(K, n, n) matrices of a storage function for the system itself, from those in the frame.

        Parameters
        ----------
        matrices : (K, n, n) array
            In the frame.

        Returns
        -------
        (K, n, n) array
            Symmetric.
        """
        inverse = np.linalg.inv(self.states)
        matrices = self.time * inverse.T @ matrices @ inverse
        return 0.5 * (matrices + matrices.swapaxes(1, 2))


def frame_of(system: Driven, points: np.ndarray, floor: float = 0.0) -> Frame:
    """Balanced coordinates of the mean frozen Gramians; the frozen systems at `points` must be stable.

    Parameters
    ----------
    system : Driven
    points : (N, readings) array
    floor : float
        A gain that is known to be reached.

    Returns
    -------
    Frame
        Its gain is the largest of direct path, Hankel singular value and floor; 1 where all are zero.
    """
    a, b, c, d = system.matrices(points)
    direct = float(np.linalg.norm(d, 2, axis=(1, 2)).max(initial=0.0)) if d.size else 0.0
    if not system.order:
        return Frame(np.zeros((0, 0)), 1.0, max(direct, floor) or 1.0)
    reach, seen = _gramians(system, a, b, c)
    states, hankel = _balanced(reach, seen)
    time = 1.0
    if system.sample_time is None:
        inside = np.linalg.inv(states) @ a.mean(axis=0) @ states
        time = 1 / max(float(np.median(np.abs(np.linalg.eigvals(inside)))), 1e-300)
    return Frame(states, time, max(direct, hankel, floor) or 1.0)


def _gramians(system: Driven, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean over the frozen systems of their reachability and observability Gramians, made definite.

    What is added is a share of each state's own diagonal entry, so that the units of the states do not matter.
    """
    discrete = system.sample_time is not None
    sides = ((a, b), (a.swapaxes(1, 2), c.swapaxes(1, 2)))
    reach, seen = (np.mean([gramian(x, w @ w.T, discrete) for x, w in zip(f, g, strict=True)], axis=0)
                   for f, g in sides)
    r, s = np.maximum(np.diag(reach), 0.0), np.maximum(np.diag(seen), 0.0)
    typical = float((r * s).max(initial=0.0)) * REGULAR or 1.0
    r = np.where(r * s < REGULAR * typical, np.where(s > 0, typical / np.where(s > 0, s, 1), r), r)
    s = np.where(r * s < REGULAR * typical, np.where(r > 0, typical / np.where(r > 0, r, 1), s), s)
    return (reach + REGULAR * np.diag(np.where(r > 0, r, 1.0)), seen + REGULAR * np.diag(np.where(s > 0, s, 1.0)))


def gramian(a: np.ndarray, w: np.ndarray, discrete: bool) -> np.ndarray:
    """X with A X + X Aᵀ + W = 0, or A X Aᵀ − X + W = 0.

    Parameters
    ----------
    a : (n, n) array
        A, stable.
    w : (n, n) array
        W, symmetric.
    discrete : bool
        Discrete time: the second equation.

    Returns
    -------
    (n, n) array
        X, symmetric.

    Examples
    --------
    >>> gramian(np.array([[-2.0]]), np.array([[1.0]]), False)
    array([[0.25]])
    """
    from scipy.linalg import matrix_balance, solve_continuous_lyapunov, solve_discrete_lyapunov

    if not len(a):
        return np.zeros((0, 0))
    balanced, (scale, _) = matrix_balance(a, permute=False, separate=True)
    w = w / np.outer(scale, scale)
    x = (solve_discrete_lyapunov(balanced, w, method="bilinear") if discrete
         else solve_continuous_lyapunov(balanced, -w)) * np.outer(scale, scale)
    return 0.5 * (x + x.T)


def _balanced(reach: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, float]:
    """(T, largest Hankel singular value) with T⁻¹ W_c T⁻ᵀ = Tᵀ W_o T diagonal; T = I where that cannot be had."""
    n = len(reach)
    scale = np.sqrt(np.maximum(np.diag(reach), 1e-300))  # rows may differ by many powers of ten
    try:
        left = scale[:, None] * np.linalg.cholesky(reach / np.outer(scale, scale) + 1e-13 * np.eye(n))
        u, s, _ = np.linalg.svd(left.T @ seen @ left)
    except np.linalg.LinAlgError:
        return np.eye(n), 0.0
    hankel = np.sqrt(s)
    floor = np.maximum(hankel, 1e-7 * hankel[0])
    states = left @ u / np.sqrt(floor)
    if not np.all(np.isfinite(states)) or np.linalg.cond(states) > 1e13:
        return np.eye(n), float(hankel[0])
    return states, float(hankel[0])
