"""Levenberg-Marquardt on a prediction-error problem, from triangular factors alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lpvid.identification.pem_problem import Point, PredictionErrorProblem, PredictionErrors
from lpvid.model.transfer_function import LPVTransferFunction

MAX_DAMPING = 1e12
ROUNDING = 1e-14
"""a fall of the cost by less than this share cannot be separated from rounding."""
FROZEN_POINTS = 1000
"""trajectory points at which a trial step's frozen poles are checked."""
LONGEST_STEP = 1.0
"""a step changes no group of parameters by more than this many times its own norm (plus one for A, C and D)."""


@dataclass(frozen=True, eq=False)
class LeastSquaresEnd:
    """Where a search ended.

    Attributes
    ----------
    point : Point
    residuals : Residuals
    factors : list of arrays
        Of [J_past J_shared e] at the point, record by record.
    iterations : int
    why : str
        Why it stopped.
    first_cost : float
        Cost at its start.
    """

    point: Point
    residuals: PredictionErrors
    factors: list[np.ndarray]
    iterations: int
    why: str
    first_cost: float

    @property
    def cost(self) -> float:
        """Weighted sum of squared prediction errors."""
        return self.residuals.cost


def minimise(problem: PredictionErrorProblem, start: Point, *, max_iterations: int, tolerance: float,
             bounds: tuple[np.ndarray, np.ndarray], frozen_limit: float = 1.0,
             progress: Callable[[int, float], None] | None = None) -> LeastSquaresEnd | None:
    """Minimise the cost from `start`; None where the start itself diverges.

    Damping by the gain ratio (Nielsen 1999), columns scaled to their largest norm so far (Moré 1978). A trial is
    refused when it diverges, when its cost does not fall, or when its largest frozen pole along the training trajectory
    leaves a circle, or goes further out than it was at the start. The pasts of the records enter each step through
    their own factor (block-angular elimination), so that many records cost no more than one.

    Parameters
    ----------
    problem : Problem
    start : Point
    max_iterations : int
    tolerance : float
        Stop when the cost falls by less than this share of itself.
    bounds : pair of arrays
        Lowest and highest value of every shared parameter.
    frozen_limit : float
        Radius of that circle; infinite for no limit.
    progress : callable, optional
        ``progress(iteration, cost)`` after every step.

    Returns
    -------
    Search or None
    """
    lower, upper = bounds
    point = Point(np.clip(problem.projected(start.shared), lower, upper), start.past)
    now = problem.residuals(point)
    if now is None:
        return None
    first_cost, factors = now.cost, problem.factors(point, now)
    damping, growth, small = 1e-3, 2.0, 0
    scale = _scale(problem, factors, None)
    limit = frozen_limit if frozen_inside(problem, point, frozen_limit) else frozen_radius(problem, point) * (1 + 1e-9)
    why, iteration = "the limit of iterations", 0
    while iteration < max_iterations:
        if not all(np.isfinite(r).all() for r in factors):
            why = "sensitivities out of range"
            break
        trial, predicted = _step(problem, factors, point, damping, scale, bounds)
        if not predicted > ROUNDING * now.cost:
            why = "the cost no longer falls"
            break
        moved = problem.residuals(trial)
        better = moved is not None and moved.cost < now.cost
        gain = -1.0 if moved is None else (now.cost - moved.cost) / predicted
        if moved is not None and better and gain > 1e-4 and frozen_inside(problem, trial, limit):
            iteration += 1
            fall = (now.cost - moved.cost) / max(now.cost, 1e-300)
            point, now = trial, moved
            damping *= max(1 / 3, 1 - (2 * min(gain, 1.0) - 1) ** 3)
            growth = 2.0
            if progress is not None:
                progress(iteration, now.cost)
            factors = problem.factors(point, now)
            scale = _scale(problem, factors, scale)
            small = small + 1 if fall < tolerance else 0
            if small >= 2 or fall == 0:
                why = "the cost no longer falls"
                break
        else:
            damping *= growth
            growth *= 2.0
            if damping > MAX_DAMPING:
                why = "no shorter step helps"
                break
    return LeastSquaresEnd(point, now, factors, iteration, why, first_cost)


def reduce(problem: PredictionErrorProblem, factors: list[np.ndarray], damping: float = 0.0,
           scale: np.ndarray | None = None) -> tuple[np.ndarray, list[np.ndarray]]:
    """Eliminate every record's past: the factor of the shared part [J_shared e], and each record's own rows.

    With damping, √damping times the column norms in `scale` stands below each past's columns.
    """
    ni = problem.n_past
    tails, heads = [], []
    for r in factors:
        if ni and damping:
            below = np.zeros((ni, r.shape[1]))
            norms = np.linalg.norm(r[:, :ni], axis=0)
            below[:, :ni] = np.diag(np.sqrt(damping) * norms)
            r = _triangle(np.vstack([r, below]))
        heads.append(r[:ni])
        tails.append(r[ni:, ni:])
    shared = tails[0] if len(tails) == 1 else _triangle(np.vstack(tails))
    return shared, heads


def _triangle(rows: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _step(problem: PredictionErrorProblem, factors: list[np.ndarray], point: Point, damping: float, scale: np.ndarray,
          bounds: tuple[np.ndarray, np.ndarray]) -> tuple[Point, float]:
    """A trial point, and the fall of the cost that the linearisation predicts for it."""
    lower, upper = bounds
    shared, heads = reduce(problem, factors, damping)
    k = shared.shape[1] - 1
    jacobian, error = shared[:, :k], shared[:, k]
    gradient = jacobian.T @ error
    held = ((point.shared <= lower) & (gradient < 0)) | ((point.shared >= upper) & (gradient > 0))
    free = np.flatnonzero(~held & (scale > 0))
    d = scale[free]
    stacked = np.vstack([jacobian[:, free] / d, np.sqrt(damping) * np.eye(free.size)])
    solution = np.linalg.lstsq(stacked, np.concatenate([error, np.zeros(free.size)]), rcond=1e-14)[0]
    move = np.zeros(k)
    move[free] = solution / d
    move *= _shortening(problem, point.shared, move)
    target = problem.projected(np.clip(point.shared + move, lower, upper))
    move = target - point.shared
    pasts, predicted = [], 0.0
    for r, head, past in zip(factors, heads, point.past, strict=True):
        ni = problem.n_past
        own = np.linalg.lstsq(head[:, :ni], head[:, -1] - head[:, ni:-1] @ move, rcond=1e-14)[0] if ni else np.zeros(0)
        whole = np.concatenate([own, move])
        predicted += float(np.sum(r[:, -1] ** 2) - np.sum((r[:, -1] - r[:, :-1] @ whole) ** 2))
        pasts.append(past + own.reshape(past.shape) if ni else past)
    return Point(target, tuple(pasts)), predicted


def _shortening(problem: PredictionErrorProblem, shared: np.ndarray, move: np.ndarray) -> float:
    """Factor ≤ 1 that keeps a step within `LONGEST_STEP` in the recursive coefficients."""
    part = problem.layout.table[:, 0]
    recursive = np.concatenate([np.flatnonzero(part == 0), part.size + np.arange(problem.sizes[1])])
    size = np.linalg.norm(move[recursive])
    limit = LONGEST_STEP * (1.0 + np.linalg.norm(shared[recursive]))
    return 1.0 if size <= limit else float(limit / size)


def _scale(problem: PredictionErrorProblem, factors: list[np.ndarray], previous: np.ndarray | None) -> np.ndarray:
    """Norms of the shared columns; half their largest value so far stays a floor."""
    ni = problem.n_past
    norms = np.sqrt(sum(np.sum(r[:, ni:-1] ** 2, axis=0) for r in factors))
    return norms if previous is None else np.maximum(norms, 0.5 * previous)


# -- frozen poles ------------------------------------------------------------------------------------------------------
def frozen_radius(problem: PredictionErrorProblem, point: Point, points: int = FROZEN_POINTS) -> float:
    """Largest modulus of the frozen poles of what must be stable, at points spread over the training trajectory.

    That is A for output errors and Box-Jenkins models (and their C), and C for ARMAX models.
    """
    model = problem.model_at(point.shared)
    return float(np.max(frozen_moduli(problem, model, points), initial=0.0))


def frozen_inside(problem: PredictionErrorProblem, point: Point, limit: float, points: int = FROZEN_POINTS) -> bool:
    """Whether `frozen_radius` is below `limit`: by step-down (Schur-Cohn) for one output, without any eigenvalue."""
    if not np.isfinite(limit):
        return True
    if problem.n_outputs > 1:
        return frozen_radius(problem, point, points) < limit
    return all(_schur(a[:, :, 0, 0], limit) for a in _frozen(problem, problem.model_at(point.shared), points))


def _schur(a: np.ndarray, limit: float) -> bool:
    """Whether all polynomials z^n + a[k, 0] z^(n−1) + … have their roots within |z| < limit."""
    rows = a / limit ** np.arange(1, a.shape[1] + 1)
    for order in range(a.shape[1], 0, -1):
        last = rows[:, order - 1]
        if not np.all(np.abs(last) < 1):
            return False
        rest = rows[:, : order - 1]
        rows = (rest - last[:, None] * rest[:, ::-1]) / (1 - last**2)[:, None]
    return True


def frozen_moduli(problem: PredictionErrorProblem, model: LPVTransferFunction, points: int) -> np.ndarray:
    """(points,) largest frozen pole modulus at points spread evenly over all records."""
    return np.max([_largest_root(a) for a in _frozen(problem, model, points)], axis=0)


def _frozen(problem: PredictionErrorProblem, model: LPVTransferFunction, points: int) -> list[np.ndarray]:
    """Frozen coefficients (points, lags, ny, ny) of every polynomial that must be stable."""
    phi = [f for _, f in problem.drive(model)]
    total = sum(f.shape[1] for f in phi)
    step = max(1, total // points)
    sample = np.hstack([f[:, ::step] for f in phi])
    noise = model.noise
    assert noise.c is not None
    out = [np.zeros((sample.shape[1], 0, 1, 1))]
    if noise.kind != "armax":
        out.append(np.einsum("ioqm,mk->kioq", model.a, sample))
    if noise.nc:
        functions = np.ones((1, sample.shape[1])) if noise.c.shape[2] == 1 else sample
        for o in range(model.n_outputs):
            c = np.einsum("im,mk->ki", noise.c[:, o], functions)
            out.append(c[:, :, None, None])
    return out


def _largest_root(a: np.ndarray) -> np.ndarray:
    """(k,) spectral radii of the block companions of (k, lags, ny, ny) coefficients."""
    k, lags, ny, _ = a.shape
    if not lags:
        return np.zeros(k)
    companion = np.zeros((k, lags * ny, lags * ny))
    companion[:, :, :ny] = -a.reshape(k, lags * ny, ny)
    companion[:, : (lags - 1) * ny, ny:] = np.eye((lags - 1) * ny)
    return np.abs(np.linalg.eigvals(companion)).max(axis=1)
