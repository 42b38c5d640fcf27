"""How large the variance of a varying system's outputs can be under white noise: the H2 norm, bounded."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial
from lpvid.synthesis.criteria import H2
from lpvid.synthesis.design_grid import columns, is_affine, tensor
from lpvid.synthesis.shaped_loop import ShapedLoop, combined, moves

POINTS = {0: 1, 1: 9, 2: 5, 3: 3}
"""Points per scheduling variable at which X is looked for; 2 for more variables."""
FINE = 4
"""Cells into which those intervals are divided for the check."""
RISE = 1e-9
"""Relative amount by which a bound is raised against rounding errors."""


@dataclass(frozen=True)
class Variance:
    """Bounds of the H2 norm: `upper` for every trajectory, `lower` reached at a frozen point."""

    upper: float
    lower: float
    between_grid: bool


def h2_bounds(system: LPVStateSpace, lyapunov: Basis | None = None) -> Variance:
    """Bounds of the rms of the outputs at any instant, while the inputs are white noise of unit intensity.

    The covariance stays below X(p) where He(AX) − Ẋ + BBᵀ ≼ 0, or AXAᵀ + BBᵀ ≼ X⁺; then ν² = max trace CXCᵀ.
    A solver proposes X; the factor by which it must grow to satisfy this is computed at the points of a finer grid.
    Where X is constant and the system affine along each variable, what holds at the corners of the box holds inside.

    Parameters
    ----------
    system : LPVStateSpace
        Stable; without feedthrough in continuous time.
    lyapunov : Basis, optional
        Functions of X(p); left out, one X.

    Examples
    --------
    >>> lag = LPVStateSpace([[[-2.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), None)
    >>> found = h2_bounds(lag)
    >>> round(found.upper, 6), round(found.lower, 6), found.between_grid
    (0.5, 0.5, True)
    """
    box, discrete = system.box, system.sample_time is not None
    basis = (lyapunov or Polynomial((), 0)).bound(box)
    corners = not basis.names and is_affine(system.basis)
    count = 2 if corners else POINTS.get(len(box.names), 2)
    axes = tuple(np.unique(np.linspace(a, b, count)) for a, b in zip(box.lower, box.upper, strict=True))
    lower = max(_frozen(a, b, c, d, discrete) for a, b, c, d in zip(*_at(system, tensor(axes)), strict=True))
    if not math.isfinite(lower) or (np.any(system.D) and not discrete):
        return Variance(math.inf, math.inf, False)
    if not box.names:
        return Variance(lower * (1 + RISE), lower, True)
    fine = axes if corners else tuple(np.unique(np.linspace(a[0], a[-1], FINE * (len(a) - 1) + 1)) for a in axes)
    x = _proposed(system, basis, axes)
    upper = math.inf if x is None else _checked(system, basis, x, tensor(fine), discrete)
    return Variance(upper * (1 + RISE), lower, corners and math.isfinite(upper))


def _at(system: LPVStateSpace, points: np.ndarray) -> list[np.ndarray]:
    phi = columns(system.box, system.basis, points)
    return [np.tensordot(phi, m, axes=1) for m in (system.A, system.B, system.C, system.D)]


def _frozen(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray, discrete: bool) -> float:
    """H2 norm of one frozen system; infinite if it is unstable."""
    poles = np.linalg.eigvals(a) if len(a) else np.empty(0)
    fastest = float(np.abs(poles).max(initial=0.0))
    if fastest >= 1 - 1e-9 if discrete else np.any(poles.real >= -1e-9 * fastest):
        return math.inf
    x = solve_discrete_lyapunov(a, b @ b.T) if discrete else solve_continuous_lyapunov(a, -b @ b.T)
    return math.sqrt(max(float(np.trace(c @ x @ c.T)), 0.0) + float(np.sum(d**2)))


def _proposed(system: LPVStateSpace, basis: Basis, axes: tuple[np.ndarray, ...]) -> np.ndarray | None:
    """(M, n, n) coefficients of X, in coordinates that make the mean Gramian the identity."""
    discrete, points = system.sample_time is not None, tensor(axes)
    a, b, c, d = _at(system, points)
    grams = [solve_discrete_lyapunov(m, k @ k.T) if discrete else solve_continuous_lyapunov(m, -k @ k.T)
             for m, k in zip(a, b, strict=True)]
    mean = np.mean(grams, axis=0)
    t = np.linalg.cholesky(mean + 1e-9 * np.trace(mean) / len(mean) * np.eye(len(mean)))
    inverse, program = np.linalg.inv(t), Program()
    x = [program.unknowns.symmetric(len(mean)) for _ in range(basis.size)]
    pace = 1.0 if discrete else float(np.abs(np.linalg.eigvals(a)).max())
    psi, loops = columns(system.box, basis, points), []
    for k, point in enumerate(points):
        here = combined(x, psi[k])
        away = [combined(x, s if discrete else -s) for s in moves(system.box, basis, point, system.sample_time)]
        loops += [ShapedLoop(here, move, (inverse @ a[k] @ t) @ here, inverse @ b[k], (c[k] @ t) @ here, d[k],
                             discrete, pace) for move in away or [None]]
    level, pick = program.unknowns.scalar(), (np.eye(b.shape[2]), np.eye(c.shape[1]))
    H2().require(program, loops, level, pick)
    program.minimise(level)
    found = next(program.solve(), None)
    return None if found is None else np.array([t @ found[m] @ t.T for m in x])


def _checked(system: LPVStateSpace, basis: Basis, x: np.ndarray, points: np.ndarray, discrete: bool) -> float:
    """ν with the smallest multiple of X that bounds the covariance at all points and moves; infinite if none does."""
    a, b, c, d = _at(system, points)
    psi = columns(system.box, basis, points)
    grown, largest = 0.0, 0.0
    for k, point in enumerate(points):
        here = np.tensordot(psi[k], x, axes=1)
        steps = moves(system.box, basis, point, system.sample_time) or [psi[k] if discrete else 0 * psi[k]]
        for step in steps:
            away = np.tensordot(step, x, axes=1)
            room = away - a[k] @ here @ a[k].T if discrete else away - a[k] @ here - here @ a[k].T
            try:
                root = np.linalg.cholesky(0.5 * (room + room.T))
            except np.linalg.LinAlgError:
                return math.inf
            grown = max(grown, float(np.linalg.norm(np.linalg.solve(root, b[k]), 2)) ** 2)
        if np.linalg.eigvalsh(here)[0] <= 0:
            return math.inf
        largest = max(largest, float(np.trace(c[k] @ here @ c[k].T)))
    return math.sqrt(grown * largest + float(np.sum(d**2, axis=(1, 2)).max()))
