"""Gramians for a whole grid of frozen systems: means, and common upper bounds by matrix inequalities."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, solve_continuous_lyapunov, solve_discrete_lyapunov

from lpvid.analysis.frozen import basis_values
from lpvid.lmi.affine import Affine, he, trace
from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace, Matrices


def frozen_matrices(system: LPVStateSpace, grid: np.ndarray) -> Matrices:
    """(N, …) A, B, C, D at the points of a grid over the system's box."""
    phi = basis_values(system.basis, grid)
    a, b, c, d = (np.tensordot(phi, getattr(system, name), axes=1) for name in "ABCD")
    return a, b, c, d


def averaged_gramian(a: np.ndarray, b: np.ndarray, discrete: bool) -> np.ndarray:
    """Mean over the grid of P with A P + P Aᵀ + B Bᵀ = 0 (discrete: A P Aᵀ − P + B Bᵀ = 0).

    Examples
    --------
    >>> averaged_gramian(np.array([[[-1.0]], [[-2.0]]]), np.ones((2, 1, 1)), False).round(3).tolist()
    [[0.375]]
    """
    solve = solve_discrete_lyapunov if discrete else (lambda x, y: solve_continuous_lyapunov(x, -y))
    return np.mean([solve(x, y @ y.T) for x, y in zip(a, b, strict=True)], axis=0)


def bounding_gramian(a: np.ndarray, b: np.ndarray, weight: np.ndarray, discrete: bool) -> np.ndarray | None:
    """P ⪰ 0 with A P + P Aᵀ + B Bᵀ ⪯ 0 at every point and a small trace of weight·P; None if none was found.

    What a solver offers is scaled until the inequality holds in numpy; it is dropped where it cannot.
    """
    scale = np.sqrt(np.maximum(np.diag(averaged_gramian(a, b, discrete)), 1e-300))
    scale = np.where(scale > 1e-150, scale, 1.0)
    a, b = a * scale[None, None, :] / scale[None, :, None], b / scale[None, :, None]
    weight = weight * np.outer(scale, scale)
    n = a.shape[1]
    program = Program()
    p = program.unknowns.symmetric(n)
    program.require(p)
    for x, y in zip(a, b, strict=True):
        left: Affine = (p - x @ p @ x.T) if discrete else -he(x @ p)
        program.require(left - y @ y.T, margin=1e-9)
    program.minimise(trace(p, weight / max(np.trace(weight), 1e-300) + 1e-6 * np.eye(n)))
    for solution in program.solve():
        found = solution[p]
        factor = _smallest_factor(found, a, b, discrete)
        if factor is not None:
            return factor * found * np.outer(scale, scale)
    return None


def _smallest_factor(p: np.ndarray, a: np.ndarray, b: np.ndarray, discrete: bool) -> float | None:
    """The factor α ≥ 1 with which α·P satisfies every inequality, as far as P is a Lyapunov matrix."""
    factor = 1.0
    if np.linalg.eigvalsh(p)[0] <= 0:
        return None
    for x, y in zip(a, b, strict=True):
        decay = p - x @ p @ x.T if discrete else -(x @ p + p @ x.T)
        if np.linalg.eigvalsh(decay)[0] <= 1e-13 * np.abs(decay).max():
            return None
        factor = max(factor, float(eigh(y @ y.T, decay, eigvals_only=True)[-1]))
    return factor * (1 + 1e-9) if factor < 10 else None
