"""Bounded least squares: linear by active sets, nonlinear by Levenberg-Marquardt whose steps respect the bounds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from quartercar.dampers.fitting.coordinates import SearchCoordinates

MAX_DAMPING = 1e12
ROUNDING = 1e-13
"""a promised decrease below this share of the cost cannot be separated from rounding."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A point of a search.

    Attributes
    ----------
    point : (k,) array
        Coordinates.
    theta : (P,) array
        All parameters.
    residual : (m,) array
        [N].
    columns : (m, l) array or None
        Sensitivities to the linear parameters inside their bounds, where those are eliminated.
    """

    point: np.ndarray
    theta: np.ndarray
    residual: np.ndarray
    columns: np.ndarray | None = None

    @cached_property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)


class SearchResiduals(Protocol):
    """What a search minimises."""

    coordinates: SearchCoordinates

    def trial(self, point: np.ndarray) -> Trial | None: ...

    def jacobian(self, trial: Trial) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class DamperSearchEnd:
    """Where a search ended.

    Attributes
    ----------
    trial : Trial
    evaluations : int
    converged : bool
        False where the limit of evaluations ended it.
    """

    trial: Trial
    evaluations: int
    converged: bool


def bounded_least_squares(columns: np.ndarray, target: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """(k,) minimiser of ‖target − columns·a‖ with lower ≤ a ≤ upper, by QR and then active sets where bounds bite.

    Columns without effect get the value nearest to zero inside their bounds.
    """
    k = columns.shape[1]
    scale = np.linalg.norm(columns, axis=0)
    moves = scale > 1e-300
    out = np.clip(np.zeros(k), lower, upper)
    if not moves.any():
        return out
    scale = scale[moves]
    low, high = lower[moves] * scale, upper[moves] * scale
    r = np.asarray(np.linalg.qr(np.column_stack([columns[:, moves] / scale, target]), mode="r"))
    n = scale.size
    square, right = r[:n, :n], r[:n, n]
    best = np.linalg.lstsq(square, right, rcond=1e-11)[0]
    if (best < low).any() or (best > high).any():
        best = _active_sets(square, right, low, high)
    inside = np.clip(best / scale, lower[moves], upper[moves])
    out[moves] = np.where(best <= low, lower[moves], np.where(best >= high, upper[moves], inside))
    return out


def _active_sets(square: np.ndarray, right: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    from scipy.optimize import lsq_linear

    fixed = high <= low
    if fixed.any():
        out = low.copy()
        if not fixed.all():
            out[~fixed] = _active_sets(square[:, ~fixed], right - square[:, fixed] @ low[fixed], low[~fixed],
                                       high[~fixed])
        return out
    with np.errstate(all="ignore"):
        return lsq_linear(square, right, (low, high), method="bvls", tol=1e-14).x


def levenberg_marquardt(
    problem: SearchResiduals, start: np.ndarray, evaluations: int, tolerance: float
) -> DamperSearchEnd | None:
    """Least squares within bounds; None where the start itself diverges.

    Damping by the gain ratio (Nielsen 1999), columns scaled to their largest norm so far (Moré 1978). Each step
    minimises ‖r + Jd‖² + λ‖Dd‖² over lower ≤ point + d ≤ upper, so that parameters rest exactly on their bounds. Runs
    that diverge count as steps too long.

    Parameters
    ----------
    problem : Residuals
    start : (k,) array
        Inside the bounds.
    evaluations : int
        Residuals computed, at most.
    tolerance : float
        Stop when two steps running lower the cost by less than this share.
    """
    lower, upper = problem.coordinates.lower, problem.coordinates.upper
    now, used = problem.trial(start), 1
    if now is None:
        return None
    if not start.size:
        return DamperSearchEnd(now, used, True)
    triangle, gradient = _factor(problem.jacobian(now), now.residual)
    scale = _scale(triangle, np.zeros(start.size))
    damping, growth, small = 1e-3, 2.0, 0
    while used < evaluations:
        step = bounded_step(triangle, gradient, damping, scale, lower - now.point, upper - now.point)
        promised = -float(step @ (triangle.T @ (2 * gradient + triangle @ step)))
        if not promised > max(ROUNDING, 0.01 * tolerance) * now.cost:
            return DamperSearchEnd(now, used, True)
        moved, used = problem.trial(np.clip(now.point + step, lower, upper)), used + 1
        gain = -1.0 if moved is None else (now.cost - moved.cost) / promised
        if moved is not None and gain > 1e-4:
            small = small + 1 if now.cost - moved.cost < tolerance * now.cost else 0
            now = moved
            if small >= 2:
                return DamperSearchEnd(now, used, True)
            damping, growth = max(damping * max(1 / 3, 1 - (2 * min(gain, 1.0) - 1) ** 3), 1e-14), 2.0
            triangle, gradient = _factor(problem.jacobian(now), now.residual)
            scale = _scale(triangle, scale)
        else:
            damping, growth = damping * growth, growth * 2
            if damping > MAX_DAMPING or promised < tolerance * now.cost:
                return DamperSearchEnd(now, used, True)
    return DamperSearchEnd(now, used, False)


def _factor(jacobian: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(R, Qᵀr) of J = QR."""
    k = jacobian.shape[1]
    r = np.asarray(np.linalg.qr(np.column_stack([jacobian, residual]), mode="r"))
    return r[:k, :k], r[:k, k]


def _scale(triangle: np.ndarray, before: np.ndarray) -> np.ndarray:
    norms = np.maximum(np.linalg.norm(triangle, axis=0), before)
    return np.where(norms > 0, norms, 1.0)


def bounded_step(triangle: np.ndarray, gradient: np.ndarray, damping: float, scale: np.ndarray, low: np.ndarray,
                 high: np.ndarray) -> np.ndarray:
    """(k,) minimiser of ‖Qᵀr + Rd‖² + λ‖Dd‖² with low ≤ d ≤ high."""
    k = scale.size
    stacked = np.vstack([triangle / scale, np.sqrt(damping) * np.eye(k)])
    right = np.concatenate([-gradient, np.zeros(k)])
    return bounded_least_squares(stacked, right, low * scale, high * scale) / scale
