"""What a closed loop does, by numpy alone: bounds from a given storage function, and gains that it reaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.lmi.certificate import diagonal
from lpvid.synthesis.scaling import Matrices

SAFETY = 1e-9
"""relative amount by which a computed bound is raised, well above the rounding errors of the eigenvalues behind it."""


@dataclass(frozen=True, eq=False)
class LoopStorage:
    """V = ξᵀ diag(first, second) ξ of a closed loop with [x; x_K] = mix·ξ, at N points and T corners of the rates.

    Two blocks apart, each scaled by its own Cholesky factor, keep their digits where one matrix of both would not.

    Parameters
    ----------
    first, second : (N, n, n) and (N, m, m) arrays
    first_slope, second_slope : (N, T, n, n) and (N, T, m, m) arrays
        Derivatives [1/s].
    mix : (n + m, n + m) array
    """

    first: np.ndarray
    second: np.ndarray
    first_slope: np.ndarray
    second_slope: np.ndarray
    mix: np.ndarray

    def matrices(self) -> np.ndarray:
        """(N, n + m, n + m) P in terms of [x; x_K].

        Returns
        -------
        (N, n + m, n + m) array
            Symmetric.
        """
        back = np.linalg.inv(self.mix)
        p = back.T @ self.blocks() @ back
        return 0.5 * (p + p.swapaxes(1, 2))

    def blocks(self) -> np.ndarray:
        """P over the states of its two blocks.

        Returns
        -------
        (N, n + m, n + m) array
            diag(first, second), in terms of ξ.
        """
        return diagonal(self.first, self.second)


def gain_bounds(loop: Matrices, v: LoopStorage, corner: int, *, discrete: bool = False) -> np.ndarray:
    """(N,) the smallest γ for which V proves the bounded-real inequality; infinite where V does not decrease.

    After the congruence that makes P the identity, γ > λmax(H + Gᵀ M⁻¹ G) with M = −He(A) − Ṗ, G = [B Cᵀ],
    H = [0 Dᵀ; D 0], or M = I − AᵀA, G = [−AᵀB Cᵀ], H = [BᵀB −Dᵀ; −D 0] in discrete time (Schur complement of
    equations sheet, 5.3).

    discrete : bool
        Discrete time; V is then constant, its slopes are not read.

    Parameters
    ----------
    loop : (A, B, C, D), each (N, …)
    v : LoopStorage
    corner : int
        Which corner of the rates.

    Returns
    -------
    (N,) array
        Raised by `SAFETY` above the computed value; infinite also for matrices that are not finite.
    """
    if not all(np.all(np.isfinite(m)) for m in (*loop, v.first, v.second)):
        return np.full(len(loop[0]), np.inf)
    n, size = v.first.shape[1], len(v.mix)
    try:
        roots = [np.linalg.cholesky(p) for p in (v.first, v.second)]
    except np.linalg.LinAlgError:
        return np.full(len(loop[0]), np.inf)
    into = diagonal(*(np.linalg.inv(r).swapaxes(1, 2) for r in roots))
    out = diagonal(*(r.swapaxes(1, 2) for r in roots))
    back = np.linalg.inv(v.mix)
    a, b = out @ (back @ loop[0] @ v.mix) @ into, out @ (back @ loop[1])
    c, d = loop[2] @ v.mix @ into, loop[3]
    at = a.swapaxes(1, 2)
    h = np.zeros((len(a), b.shape[2] + c.shape[1], b.shape[2] + c.shape[1]))
    if discrete:
        m, g = np.eye(size) - at @ a, np.concatenate([-at @ b, c.swapaxes(1, 2)], axis=2)
        h[:, : b.shape[2], : b.shape[2]], sign = b.swapaxes(1, 2) @ b, -1.0
    else:
        drift = diagonal(*(w.swapaxes(1, 2) @ slope[:, corner] @ w for w, slope in
                           ((into[:, :n, :n], v.first_slope), (into[:, n:, n:], v.second_slope))))
        m, g, sign = -(a + at) - drift, np.concatenate([b, c.swapaxes(1, 2)], axis=2), 1.0
    h[:, : b.shape[2], b.shape[2] :] = sign * d.swapaxes(1, 2)
    h[:, b.shape[2] :, : b.shape[2]] = sign * d
    m = 0.5 * (m + m.swapaxes(1, 2))
    smallest = np.linalg.eigvalsh(m)[:, 0] if size else np.ones(len(m))
    largest = np.linalg.norm(m, axis=(1, 2)) if size else np.ones(len(m))
    proven = smallest > 1e-12 * largest
    m = np.where(proven[:, None, None], m, np.eye(size))
    bound = np.linalg.eigvalsh(h + g.swapaxes(1, 2) @ np.linalg.solve(m, g))[:, -1]
    return np.where(proven, bound * (1 + SAFETY), np.inf)


def frozen_gain(loop: Matrices, *, discrete: bool = False) -> float:
    """Largest H-infinity norm of the frozen loops at N points; infinite where one is unstable.

    Parameters
    ----------
    loop : (A, B, C, D), each (N, …)
        Closed loop at N points.
    discrete : bool
        Discrete time.

    Returns
    -------
    float
        At the two points that look worst on a few frequencies.
    """
    from lpvid.analysis.frozen_norms import h_infinity_norm

    a, b, c, d = loop
    poles = np.linalg.eigvals(a) if a.shape[1] else np.zeros((len(a), 1)) - 1.0 * (not discrete)
    if (np.abs(poles) >= 1).any() if discrete else (poles.real >= 0).any():
        return np.inf
    at = np.array([_sampled((a[k], b[k], c[k], d[k]), poles[k], discrete) for k in range(len(a))])
    return max(h_infinity_norm((a[k], b[k], c[k], d[k]), discrete)[0] for k in np.argsort(at)[-2:])


def _sampled(system: tuple[np.ndarray, ...], poles: np.ndarray, discrete: bool) -> float:
    """Gain at a dozen frequencies, by the modes: enough to choose the points to look at."""
    a, b, c, d = system
    if not len(a):
        return float(np.linalg.norm(d))
    values, modes = np.linalg.eig(a)
    if discrete:
        at = np.exp(1j * np.concatenate([[0.0, np.pi], np.abs(np.angle(poles))]))
    else:
        size = np.abs(poles)
        at = 1j * np.concatenate([[0.0], size, np.geomspace(size.min() / 3, 3 * size.max(), 8)])
    left, right = c @ modes, np.linalg.lstsq(modes, b.astype(complex), rcond=None)[0]
    gain = np.einsum("in,wn,nj->wij", left, 1 / (at[:, None] - values), right) + d
    return float(np.sqrt((np.abs(gain) ** 2).sum(axis=(1, 2))).max())
