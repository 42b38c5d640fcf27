"""Levenberg-Marquardt on a prediction-error problem, from triangular factors alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.identification.pem_problem import Point, PredictionErrorProblem, PredictionErrors
from lpvid.least_squares import SearchEnd, StopRule, bounded_step, descend
from lpvid.model.transfer_function import LPVTransferFunction

FROZEN_POINTS = 1000
"""trajectory points at which a trial step's frozen poles are computed, with several outputs."""
STEP_DOWN_POINTS = 20_000
"""trajectory points at which they are checked by step-down, with one output: as many as a choice of structures looks at
(`unstable_share`). At every fourth sample only, the search ended with poles outside at four of 4096 others."""
LONGEST_STEP = 1.0
"""a step changes no group of parameters by more than this many times its own norm (plus one for A, C and D)."""


@dataclass(frozen=True, eq=False)
class _PredictionTrial:
    """A point of a search and its prediction errors."""

    point: Point
    residuals: PredictionErrors

    @property
    def cost(self) -> float:
        """Weighted sum of squared prediction errors."""
        return self.residuals.cost


@dataclass(frozen=True, eq=False)
class _BlockAngularStep:
    """The linearised problem, whose records share all parameters but their own pasts.

    Attributes
    ----------
    problem : PredictionErrorProblem
    point : Point
    factors : list of arrays
        Of [J_past J_shared e] at the point, record by record.
    bounds : pair of arrays
        Of the shared parameters.
    scale : (k,) array
        Norms of the shared columns, not below half the largest so far.
    """

    problem: PredictionErrorProblem
    point: Point
    factors: list[np.ndarray]
    bounds: tuple[np.ndarray, np.ndarray]
    scale: np.ndarray

    @property
    def finite(self) -> bool:
        return all(np.isfinite(r).all() for r in self.factors)

    def step(self, damping: float) -> tuple[Point, float]:
        """A trial point, and the decrease of the cost that the linearisation predicts for it."""
        problem, point, (lower, upper) = self.problem, self.point, self.bounds
        shared, heads = reduce(problem, self.factors, damping)
        k = shared.shape[1] - 1
        scale = np.where(self.scale > 0, self.scale, 1.0)
        move = bounded_step(shared[:, :k], -shared[:, k], damping, scale, lower - point.shared, upper - point.shared)
        move *= _shortening(problem, point.shared, move)
        target = problem.projected(np.clip(point.shared + move, lower, upper))
        move = target - point.shared
        pasts, predicted, ni = [], 0.0, problem.n_past
        for r, head, past in zip(self.factors, heads, point.past, strict=True):
            right = head[:, -1] - head[:, ni:-1] @ move
            own = np.linalg.lstsq(head[:, :ni], right, rcond=1e-14)[0] if ni else np.zeros(0)
            whole = np.concatenate([own, move])
            predicted += float(np.sum(r[:, -1] ** 2) - np.sum((r[:, -1] - r[:, :-1] @ whole) ** 2))
            pasts.append(past + own.reshape(past.shape) if ni else past)
        return Point(target, tuple(pasts)), predicted


@dataclass(frozen=True, eq=False)
class _PredictionErrorSearch:
    """A prediction-error problem as a problem of `lpvid.least_squares.descend`."""

    problem: PredictionErrorProblem
    start: Point
    bounds: tuple[np.ndarray, np.ndarray]
    frozen_limit: float

    def evaluate(self, point: Point) -> _PredictionTrial | None:
        found = self.problem.residuals(point)
        return None if found is None else _PredictionTrial(point, found)

    def linearise(self, trial: _PredictionTrial, before: _BlockAngularStep | None) -> _BlockAngularStep:
        factors = self.problem.factors(trial.point, trial.residuals)
        norms = np.linalg.norm(np.vstack([r[:, self.problem.n_past:-1] for r in factors]), axis=0)
        scale = norms if before is None else np.maximum(norms, 0.5 * before.scale)
        return _BlockAngularStep(self.problem, trial.point, factors, self.bounds, scale)

    @cached_property
    def limit(self) -> float:
        """`frozen_limit`, or the start's own radius where that lies further out."""
        if frozen_inside(self.problem, self.start, self.frozen_limit):
            return self.frozen_limit
        return frozen_radius(self.problem, self.start) * (1 + 1e-9)

    def admissible(self, trial: _PredictionTrial, now: _PredictionTrial) -> bool:
        return frozen_inside(self.problem, trial.point, self.limit)


LeastSquaresEnd = SearchEnd[_PredictionTrial, _BlockAngularStep]


def minimise(problem: PredictionErrorProblem, start: Point, *, max_iterations: int, tolerance: float,
             bounds: tuple[np.ndarray, np.ndarray], frozen_limit: float = 1.0,
             progress: Callable[[int, float], None] | None = None) -> LeastSquaresEnd | None:
    """Minimise the cost from `start`; None where the start itself diverges.

    A trial is refused when it diverges, when its cost does not fall, or when its largest frozen pole along the training
    trajectory leaves a circle, or goes further out than it was at the start. The pasts of the records enter each step
    through their own factor (block-angular elimination), so that many records cost no more than one.

    Parameters
    ----------
    problem : PredictionErrorProblem
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
    SearchEnd or None
    """
    begin = Point(np.clip(problem.projected(start.shared), *bounds), start.past)
    return descend(_PredictionErrorSearch(problem, begin, bounds, frozen_limit), begin,
                   StopRule(tolerance, iterations=max_iterations), progress=progress)


def reduce(problem: PredictionErrorProblem, factors: list[np.ndarray],
           damping: float = 0.0) -> tuple[np.ndarray, list[np.ndarray]]:
    """Eliminate every record's past: the factor of the shared part [J_shared e], and each record's own rows.

    With damping, √damping times the column norms stands below each past's columns.

    Parameters
    ----------
    problem : PredictionErrorProblem
        For the number of initial conditions per record.
    factors : list of arrays
        Per record the triangular factor of [J_past J_shared e].
    damping : float
        λ of the step; 0 for none.

    Returns
    -------
    (k + 1, k + 1) array
        Triangular factor of [J_shared e] with all pasts eliminated.
    list of arrays
        Per record the rows that belong to its past.
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


def _shortening(problem: PredictionErrorProblem, shared: np.ndarray, move: np.ndarray) -> float:
    """Factor ≤ 1 that keeps a step within `LONGEST_STEP` in the recursive coefficients."""
    part = problem.layout.table[:, 0]
    recursive = np.concatenate([np.flatnonzero(part == 0), part.size + np.arange(problem.sizes[1])])
    size = np.linalg.norm(move[recursive])
    limit = LONGEST_STEP * (1.0 + np.linalg.norm(shared[recursive]))
    return 1.0 if size <= limit else float(limit / size)


# -- frozen poles ------------------------------------------------------------------------------------------------------
def frozen_radius(problem: PredictionErrorProblem, point: Point) -> float:
    """Largest modulus of the frozen poles of what must be stable, at points spread over the training trajectory.

    That is A for output errors and Box-Jenkins models (and their C), and C for ARMAX models.

    Parameters
    ----------
    problem : PredictionErrorProblem
        For its data and its kind of noise.
    point : Point
        Parameters.

    Returns
    -------
    float
        0 where nothing has poles.
    """
    model = problem.model_at(point.shared)
    points = FROZEN_POINTS if problem.n_outputs > 1 else STEP_DOWN_POINTS
    return float(np.max(frozen_moduli(problem, model, points), initial=0.0))


def frozen_inside(problem: PredictionErrorProblem, point: Point, limit: float) -> bool:
    """Whether `frozen_radius` is below `limit`: by step-down (Schur-Cohn) for one output, without any eigenvalue.

    Parameters
    ----------
    problem : PredictionErrorProblem
        For its data and its kind of noise.
    point : Point
        Parameters.
    limit : float
        Modulus; infinite for no limit.

    Returns
    -------
    bool
    """
    if not np.isfinite(limit):
        return True
    if problem.n_outputs > 1:
        return frozen_radius(problem, point) < limit
    model = problem.model_at(point.shared)
    return all(_schur(a[:, :, 0, 0], limit) for a in _frozen(problem, model, STEP_DOWN_POINTS))


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
    """(points,) largest frozen pole modulus at points spread evenly over all records.

    Parameters
    ----------
    problem : PredictionErrorProblem
        For its data and its kind of noise.
    model : LPVTransferFunction
        Whose poles are wanted.
    points : int
        How many, about.

    Returns
    -------
    (points,) array
        Of several polynomials (A and a varying C) the larger modulus.
    """
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
