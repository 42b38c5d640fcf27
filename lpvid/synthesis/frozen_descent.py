"""Descent of the largest frozen H-infinity norm over a grid: a nonsmooth function of the free gains of a structure.

With the closed loop A + B2GC2, B1 + B2GD21, C1 + D12GC2, D11 + D12GD21 at each of N points and T(jω) = C(jω − A)⁻¹B + D
its response, at the peak ω of a simple largest singular value σ with vectors u, v

    ∂σ/∂G = Re [ (D12 + C R B2)ᵀ ū ] [ (D21 + C2 R B) v ]ᵀ,        R = (jω − A)⁻¹

(Apkarian & Noll, IEEE TAC 51 (2006) 71-86). Where the loop is not stable yet, the largest real part of its poles (the
logarithm of the largest modulus, in discrete time) is reduced first, with ∂λ/∂G from the left and right eigenvectors.
BFGS with a weak Wolfe line search needs no smoothness at the minimiser (Lewis & Overton, Math. Program. 141 (2013)
135-163).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.scaling import Matrices

Objective = Callable[[np.ndarray], tuple[float, np.ndarray]]
ENOUGH = 1e-5
"""relative decrease over `PATIENCE` steps below which a descent ends"""
PATIENCE = 12
GLANCE, LONG, PURSUED = 40, 300, 6
"""steps of a descent from every start, and from the best few that are pursued to the end"""
LOUDEST = 3
"""points of the grid at which norms are computed in every step; all at the end, by `lpv.l2_gain`"""
SLOW = 1e-5
"""share of the typical rate: a slower pole that no norm shows counts as unstable, for a proof would need its digits"""
RESERVE = 1e-3
"""share of the typical rate by which poles must have left the limit before norms are looked at"""


@dataclass(frozen=True, eq=False)
class FrozenLoops:
    """The frozen closed loops of a structure at N points, as a function of the free entries of its gain.

    Parameters
    ----------
    plant : PlantMatrices
        At N points, in scaled units; no D22.
    psi : (N, K) array
        Functions of the gain at the points.
    free : (n_v, n_ξ) bool array
    discrete : bool
    """

    plant: PlantMatrices
    psi: np.ndarray
    free: np.ndarray
    discrete: bool

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return int(self.free.sum()) * self.psi.shape[1]

    def coefficients(self, theta: np.ndarray) -> np.ndarray:
        """(K, n_v, n_ξ) gains of the basis.

        Parameters
        ----------
        theta : (P,) array
            Free entries of all basis functions.

        Returns
        -------
        (K, n_v, n_ξ) array
            Zero where an entry is not free.
        """
        gains = np.zeros((self.psi.shape[1], *self.free.shape))
        gains[:, self.free] = theta.reshape(len(gains), -1)
        return gains

    def parameters(self, gains: np.ndarray) -> np.ndarray:
        """Inverse of `coefficients`.

        Parameters
        ----------
        gains : (K, n_v, n_ξ) array
            Gains of the basis.

        Returns
        -------
        (P,) array
            Their free entries.
        """
        return gains[:, self.free].ravel()

    def loops(self, theta: np.ndarray) -> tuple[np.ndarray, Matrices]:
        """Gains and closed loops at the points, each (N, …).

        Parameters
        ----------
        theta : (P,) array
            Free entries of all basis functions.

        Returns
        -------
        (N, n_v, n_ξ) array, tuple of (N, …) arrays
            G at the points; A, B, C, D from w to z of the closed loops.
        """
        m, g = self.plant, np.tensordot(self.psi, self.coefficients(theta), axes=1)
        return g, (m.A + m.B2 @ g @ m.C2, m.B1 + m.B2 @ g @ m.D21, m.C1 + m.D12 @ g @ m.C2, m.D11 + m.D12 @ g @ m.D21)

    def abscissa(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Largest real part of the poles (log modulus, in discrete time) over the points, and its gradient.

        Parameters
        ----------
        theta : (P,) array
            Free entries of all basis functions.

        Returns
        -------
        float, (P,) array
            [1/s] in continuous time, without unit in discrete time; its gradient.
        """
        a = self.loops(theta)[1][0]
        if not a.shape[1]:
            return -np.inf, np.zeros_like(theta)
        poles = np.linalg.eigvals(a)
        level = np.log(np.maximum(np.abs(poles), 1e-12)) if self.discrete else np.real(poles)
        k = int(level.max(axis=1).argmax())
        from scipy.linalg import eig

        values, left, right = (np.asarray(x) for x in eig(a[k], left=True, right=True))
        j = int((np.abs(values) if self.discrete else np.real(values)).argmax())
        u, v = left[:, j].conj(), right[:, j]
        near = u @ v
        slope = np.outer(u @ self.plant.B2[k], self.plant.C2[k] @ v) / (near if abs(near) > 1e-12 else 1e-12)
        return float(level[k].max()), self._chained(k, np.real(slope / values[j] if self.discrete else slope))

    def norm(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Largest H-infinity norm over the points, and its gradient; infinite where a loop is not stable by `SLOW`.

        Parameters
        ----------
        theta : (P,) array
            Free entries of all basis functions.

        Returns
        -------
        float, (P,) array
            The norm and its gradient; the gradient is zero where the norm is infinite.
        """
        _, (a, b, c, d) = self.loops(theta)
        if a.shape[1]:
            poles = np.linalg.eigvals(a)
            if (np.abs(poles).max() >= 1 - SLOW) if self.discrete else (poles.real.max() >= -SLOW):
                return np.inf, np.zeros_like(theta)
        level, omega, k = max((*h_infinity_norm((a[k], b[k], c[k], d[k]), self.discrete), int(k))
                              for k in self._loudest((a, b, c, d)))
        if not np.isfinite(level):
            return np.inf, np.zeros_like(theta)
        m, eye = self.plant.point(k), np.eye(a.shape[1])
        if np.isinf(omega):
            response, left, right = d[k].astype(complex), m.D12, m.D21
        else:
            at = np.exp(1j * omega) if self.discrete else 1j * omega
            try:
                resolvent = np.linalg.inv(at * eye - a[k])
            except np.linalg.LinAlgError:  # a pole on the limit
                return np.inf, np.zeros_like(theta)
            response = c[k] @ resolvent @ b[k] + d[k]
            left, right = m.D12 + c[k] @ resolvent @ m.B2, m.D21 + m.C2 @ resolvent @ b[k]
        u, _, vh = np.linalg.svd(response)
        slope = np.real(np.outer(u[:, 0].conj() @ left, right @ vh[0].conj()))
        return float(level), self._chained(k, slope)

    def _loudest(self, loops: Matrices) -> np.ndarray:
        """Points whose gain is among the largest at a few frequencies: there the norm is computed."""
        a, b, c, d = loops
        if len(a) <= LOUDEST or not a.shape[1]:
            return np.arange(len(a))
        poles = np.linalg.eigvals(a)
        size = np.abs(np.angle(poles)) if self.discrete else np.abs(poles)
        omega = np.concatenate([np.zeros((len(a), 1)), size, np.full((len(a), 1), np.pi) if self.discrete
                                else 1e3 * size.max(axis=1, keepdims=True)], axis=1)
        s = np.exp(1j * omega) if self.discrete else 1j * omega
        pencil = s[..., None, None] * np.eye(a.shape[1]) - a[:, None]
        try:
            response = c[:, None] @ np.linalg.solve(pencil, np.broadcast_to(
                b[:, None].astype(complex), (*s.shape, *b.shape[1:]))) + d[:, None]
        except np.linalg.LinAlgError:
            return np.arange(len(a))
        return np.argsort(np.linalg.norm(response, axis=(2, 3)).max(axis=1))[-LOUDEST:]

    def _chained(self, k: int, slope: np.ndarray) -> np.ndarray:
        return (self.psi[k][:, None] * slope[self.free][None]).ravel()


def descended(loops: FrozenLoops, theta: np.ndarray, steps: int = LONG) -> tuple[np.ndarray, float]:
    """Gains of a locally least frozen norm from a start; the norm is infinite where no stable loop was reached.

    Parameters
    ----------
    loops : FrozenLoops
        Closed loops over the gains.
    theta : (P,) array
        Where to start.
    steps : int
        Steps at most, of each of the two searches.

    Returns
    -------
    (P,) array, float
        Gains and their norm.
    """
    if loops.abscissa(theta)[0] > -RESERVE:
        theta, level = bfgs(loops.abscissa, theta, steps, stop=-10 * RESERVE)
        if level >= 0:
            return theta, np.inf
    return bfgs(loops.norm, theta, steps)


def shortlist(loops: FrozenLoops, starts: Iterable[np.ndarray]) -> list[tuple[np.ndarray, float]]:
    """Local minimisers and their norms, lowest first: all starts are followed for a while, the best to their end.

    Parameters
    ----------
    loops : FrozenLoops
        Closed loops over the gains.
    starts : iterable of (P,) arrays
        Where to start.

    Returns
    -------
    list of ((P,) array, float)
        Gains and norms.
    """
    begun = sorted((descended(loops, theta, GLANCE) for theta in starts), key=lambda x: x[1])
    ended = [bfgs(loops.norm, x[0], LONG) for x in begun[:PURSUED] if np.isfinite(x[1])]
    return sorted([*ended, *begun[len(ended):]], key=lambda x: x[1])


def bfgs(objective: Objective, x: np.ndarray, steps: int, stop: float = -np.inf) -> tuple[np.ndarray, float]:
    """A local minimiser of a function that need not be smooth, and its value.

    Parameters
    ----------
    objective : callable
        Value and gradient at an x.
    x : (P,) array
        Where to start.
    steps : int
        Steps at most.
    stop : float
        A value at which the search ends.

    Returns
    -------
    (P,) array, float
        The last point and its value.

    Examples
    --------
    >>> kink = lambda x: (float(abs(x[0]) + x[1] ** 2), np.array([np.sign(x[0]), 2 * x[1]]))
    >>> bfgs(kink, np.array([3.0, -2.0]), 100)[1] < 1e-5
    True
    """
    f, g = objective(x)
    h, history = np.eye(len(x)), [f]
    for _ in range(steps):
        p = -h @ g
        if not np.all(np.isfinite(p)) or p @ g >= 0:
            h, p = np.eye(len(x)), -g
        found = _wolfe(objective, x, f, g, p)
        if found is None:
            if np.array_equal(h, np.eye(len(x))):
                break
            h = np.eye(len(x))
            continue
        x_new, f_new, g_new = found
        s, y = x_new - x, g_new - g
        if s @ y > 1e-14 * np.linalg.norm(s) * np.linalg.norm(y):
            if len(history) == 1:
                h = (s @ y) / (y @ y) * h
            rho = 1 / (s @ y)
            v = np.eye(len(x)) - rho * np.outer(s, y)
            h = v @ h @ v.T + rho * np.outer(s, s)
        x, f, g = x_new, f_new, g_new
        history.append(f)
        if f <= stop or not np.any(g):
            break
        if len(history) > PATIENCE and history[-PATIENCE] - f < ENOUGH * abs(f):
            break
    return x, f


def _wolfe(objective: Objective, x: np.ndarray, f: float, g: np.ndarray, p: np.ndarray
           ) -> tuple[np.ndarray, float, np.ndarray] | None:
    """A step with sufficient decrease and a slope that has risen, by bisection and doubling; None for none."""
    low, high, t, slope = 0.0, np.inf, 1.0, g @ p
    best = None
    for _ in range(40):
        trial = x + t * p
        f_new, g_new = objective(trial)
        if not f_new <= f + 1e-4 * t * slope:
            high = t
        elif g_new @ p < 0.9 * slope:
            low, best = t, (trial, f_new, g_new)
        else:
            return trial, f_new, g_new
        t = 0.5 * (low + high) if np.isfinite(high) else 2 * t
    return best
