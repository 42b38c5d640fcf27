"""Nonlinear least squares: one descent for every search, its bounded steps, its rules of damping and of stopping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from lpvid._tall import triangular_factor

MAX_DAMPING = 1e12
"""of unit columns: a step is then a part in 1e12 of the way down the gradient."""
ROUNDING = 1e-14
"""a fall of the cost by less than this share is within rounding."""
CONVERGED = "the cost no longer falls"
LIMIT = "the limit of iterations"
STUCK = "no shorter step helps"
OUT_OF_RANGE = "sensitivities out of range"
INTERRUPTED = "the caller ended it"


class _Judged(Protocol):
    """A point of a search with its cost, a sum of squares."""

    @property
    def cost(self) -> float: ...


class _Linearised(Protocol):
    """The least-squares problem linearised at a trial."""

    @property
    def finite(self) -> bool:
        """Whether its numbers are."""
        ...

    def step(self, damping: float) -> tuple[Any, float]:
        """The point to try, and the decrease of the cost that the linearisation predicts there."""
        ...


T = TypeVar("T", bound=_Judged)
L = TypeVar("L", bound=_Linearised)


class LeastSquaresProblem(Protocol[T, L]):
    """What a search minimises; how residuals and sensitivities are held is left to the problem."""

    def evaluate(self, point: Any) -> T | None:
        """The trial at a point.

        Parameters
        ----------
        point : object
            Whatever the problem's linearisations give as points.

        Returns
        -------
        trial or None
            With its ``cost``; None where the model cannot be run there.
        """
        ...

    def linearise(self, trial: T, before: L | None) -> L:
        """The linearisation at a trial.

        Parameters
        ----------
        trial : trial
        before : linearisation or None
            The last one, whose column norms a scaling may remember.

        Returns
        -------
        linearisation
            ``step(damping)`` gives the next point and the predicted decrease of the cost; ``finite`` is False where
            its numbers are not.
        """
        ...

    def admissible(self, trial: T, now: T) -> bool:
        """Whether the search may go from `now` to a trial of lower cost.

        Parameters
        ----------
        trial, now : trial

        Returns
        -------
        bool
        """
        ...


# -- rules -------------------------------------------------------------------------------------------------------------
class _DampingRule(Protocol):
    """The number λ that each step takes: how it begins, and what a success and the n-th refusal in a row do to it."""

    @property
    def first(self) -> float: ...

    def accepted(self, damping: float, gain: float) -> float: ...

    def refused(self, damping: float, times: int) -> float | None:
        """None where no shorter step is worth a trial."""
        ...


@dataclass(frozen=True)
class GainRatio:
    """Damping by the ratio of the decrease of the cost to the predicted one (Nielsen 1999, IMM-REP-1999-05, (2.6)).

    Attributes
    ----------
    first, least : float
        Damping at the start, and its lower limit.
    """

    first: float = 1e-3
    least: float = 0.0

    def accepted(self, damping: float, gain: float) -> float:
        """The number for the next step, after one whose cost fell by `gain` times the predicted decrease.

        Parameters
        ----------
        damping, gain : float

        Returns
        -------
        float
        """
        return max(damping * max(1 / 3, 1 - (2 * min(gain, 1.0) - 1) ** 3), self.least)

    def refused(self, damping: float, times: int) -> float | None:
        """The number for a shorter step from the same point.

        Parameters
        ----------
        damping : float
        times : int
            Refusals in a row.

        Returns
        -------
        float or None
            None where no shorter step is worth a trial.
        """
        grown = damping * 2.0**times
        return grown if grown <= MAX_DAMPING else None


@dataclass(frozen=True)
class Factors:
    """Damping by fixed factors (Marquardt 1963).

    Attributes
    ----------
    first, least : float
        Damping at the start, and its lower limit.
    down, up : float
        Divisor after a step whose gain is above `good`, and factor after a refusal.
    good, poor : float
        Gains: between them the damping stays, below `poor` it doubles.
    refusals : float
        In a row after which no shorter step is tried.
    """

    first: float = 1e-2
    down: float = 5.0
    up: float = 4.0
    good: float = -np.inf
    poor: float = -np.inf
    least: float = 1e-10
    refusals: float = np.inf

    def accepted(self, damping: float, gain: float) -> float:
        """The number for the next step, after one whose cost fell by `gain` times the predicted decrease.

        Parameters
        ----------
        damping, gain : float

        Returns
        -------
        float
        """
        if gain > self.good:
            return max(damping / self.down, self.least)
        return 2.0 * damping if gain < self.poor else damping

    def refused(self, damping: float, times: int) -> float | None:
        """The number for a shorter step from the same point.

        Parameters
        ----------
        damping : float
        times : int
            Refusals in a row.

        Returns
        -------
        float or None
            None where no shorter step is worth a trial.
        """
        grown = damping * self.up
        return grown if grown <= MAX_DAMPING and times < self.refusals else None


@dataclass(frozen=True)
class Shares:
    """Gauss-Newton: not a damping but the share of the undamped step.

    Attributes
    ----------
    factor, least : float
        On the share after a refusal, and the share below which none is tried.
    first : float
        Share that is tried first.
    """

    factor: float = 0.5
    least: float = 1e-3
    first: float = 1.0

    def accepted(self, damping: float, gain: float) -> float:
        """The number for the next step, after one whose cost fell by `gain` times the predicted decrease.

        Parameters
        ----------
        damping, gain : float

        Returns
        -------
        float
        """
        return self.first

    def refused(self, damping: float, times: int) -> float | None:
        """The number for a shorter step from the same point.

        Parameters
        ----------
        damping : float
        times : int
            Refusals in a row.

        Returns
        -------
        float or None
            None where no shorter step is worth a trial.
        """
        shorter = damping * self.factor
        return shorter if shorter > self.least else None


@dataclass(frozen=True)
class StopRule:
    """When a search ends.

    Attributes
    ----------
    tolerance : float
        Share of the cost by less than which it must fall in `calm` steps in a row.
    calm : int
    iterations, evaluations : float
        Steps and trials at most, the start among the trials.
    least_decrease : float
        Share of the cost that the predicted decrease of a step must exceed for it to be tried.
    refused : float
        Share of the cost: a rejected step of a smaller predicted decrease ends the search.
    decided : float
        Share of the cost: one step of damping below one that lowers it by less ends the search.
    worth : float
        Share of its predicted decrease that a step must reach to be taken.
    """

    tolerance: float = 1e-10
    calm: int = 2
    iterations: float = np.inf
    evaluations: float = np.inf
    least_decrease: float = ROUNDING
    refused: float = 0.0
    decided: float = 0.0
    worth: float = 1e-4


@dataclass(frozen=True, eq=False)
class SearchEnd(Generic[T, L]):
    """Where a search ended.

    Attributes
    ----------
    problem : LeastSquaresProblem
    trial : _Judged
    iterations, evaluations : int
        Steps taken, and trials.
    why : str
        Why it stopped.
    first_cost : float
        Cost at its start.
    """

    problem: LeastSquaresProblem[T, L]
    trial: T
    iterations: int
    evaluations: int
    why: str
    first_cost: float
    last: L | None

    @cached_property
    def linearised(self) -> L:
        """The linearisation at its end."""
        return self.problem.linearise(self.trial, None) if self.last is None else self.last

    @property
    def cost(self) -> float:
        """Sum of squares at its end."""
        return self.trial.cost

    @property
    def converged(self) -> bool:
        """False where a limit or its caller ended it."""
        return self.why not in (LIMIT, INTERRUPTED)


def descend(problem: LeastSquaresProblem[T, L], start: Any, stop: StopRule, damping_rule: _DampingRule | None = None,
            progress: Callable[[int, float], bool | None] | None = None) -> SearchEnd[T, L] | None:
    """Minimise a sum of squares by damped steps; None where the start cannot be run.

    A trial is taken when it runs, reaches `stop.worth` of the predicted decrease and is admissible; else the damping
    grows, and the same linearisation gives a shorter step. The cost therefore never rises.

    Parameters
    ----------
    problem : LeastSquaresProblem
    start : point of the problem
    stop : StopRule
    damping_rule : _DampingRule, optional
        `GainRatio` by default.
    progress : callable, optional
        ``progress(iteration, cost)`` after every step taken; where it returns True the search ends there.

    Returns
    -------
    SearchEnd or None

    References
    ----------
    Levenberg (1944), Quart. Appl. Math. 2, 164; Marquardt (1963), SIAM J. 11, 431; Madsen, Nielsen, Tingleff (2004),
    Methods for non-linear least squares problems, algorithm 3.16.
    """
    rule = GainRatio() if damping_rule is None else damping_rule
    now = problem.evaluate(start)
    if now is None:
        return None
    first_cost, damping, calm, refused, iterations, evaluations = now.cost, rule.first, 0, 0, 0, 1
    last: L | None = None
    before: L | None = None
    why = LIMIT
    while iterations < stop.iterations and evaluations < stop.evaluations:
        last = before = problem.linearise(now, before) if last is None else last
        if not last.finite:
            why = OUT_OF_RANGE
            break
        point, predicted = last.step(damping)
        if not predicted > stop.least_decrease * now.cost:
            why = CONVERGED
            break
        moved, evaluations = problem.evaluate(point), evaluations + 1
        gain = -np.inf if moved is None else (now.cost - moved.cost) / predicted
        if moved is not None and gain > stop.worth and problem.admissible(moved, now):
            iterations, refused, last = iterations + 1, 0, None
            fall, now = (now.cost - moved.cost) / now.cost, moved
            damping = rule.accepted(damping, gain)
            calm = calm + 1 if fall < stop.tolerance else 0
            if progress is not None and progress(iterations, now.cost):
                why = INTERRUPTED
                break
            if calm >= stop.calm or (fall < stop.decided and damping < 1):
                why = CONVERGED
                break
        else:
            refused += 1
            grown = rule.refused(damping, refused)
            if grown is None or predicted < stop.refused * now.cost:
                why = STUCK if grown is None else CONVERGED
                break
            damping = grown
    return SearchEnd(problem, now, iterations, evaluations, why, first_cost, last)


# -- linear least squares within bounds --------------------------------------------------------------------------------
def bounded_least_squares(columns: np.ndarray, target: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Minimise ‖target − columns·a‖ with lower ≤ a ≤ upper, by QR and then active sets where bounds are active.

    Parameters
    ----------
    columns : (m, k) array
    target : (m,) array
    lower, upper : (k,) array

    Returns
    -------
    (k,) array
        Of columns without effect the value nearest to zero inside their bounds.
    """
    k = columns.shape[1]
    scale = np.linalg.norm(columns, axis=0)
    moves = scale > 1e-300
    out = np.clip(np.zeros(k), lower, upper)
    if not moves.any():
        return out
    scale = scale[moves]
    low, high = lower[moves] * scale, upper[moves] * scale
    r = triangular_factor(columns if moves.all() else columns[:, moves], scale, target)
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


def bounded_step(jacobian: np.ndarray, residual: np.ndarray, damping: float, scale: np.ndarray, low: np.ndarray,
                 high: np.ndarray) -> np.ndarray:
    """Minimise ‖r + Jd‖² + λ‖Dd‖² over low ≤ d ≤ high; J and r may be a triangular factor and Qᵀr.

    Parameters
    ----------
    jacobian : (m, k) array
    residual : (m,) array
    damping : float
        λ.
    scale : (k,) array
        Diagonal of D, positive.
    low, high : (k,) array

    Returns
    -------
    (k,) array
    """
    k = scale.size
    stacked = np.vstack([jacobian / scale, np.sqrt(damping) * np.eye(k)])
    return bounded_least_squares(stacked, np.concatenate([-residual, np.zeros(k)]), low * scale, high * scale) / scale


def column_scale(factor: np.ndarray, before: np.ndarray | float = 0.0) -> np.ndarray:
    """Column norms, not below `before` (Moré 1978); one where a column is zero.

    Parameters
    ----------
    factor : (m, k) array
    before : (k,) array or float

    Returns
    -------
    (k,) array
    """
    peak = np.abs(factor).max(axis=0, initial=0.0)  # squares of what is above 1e154 overflow
    peak = np.where(peak > 0, peak, 1.0)
    norms = np.maximum(peak * np.linalg.norm(factor / peak, axis=0), before)
    return np.where(norms > 0, norms, 1.0)


# -- residuals in memory -----------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class Trial:
    """A point of a search whose residuals are one vector.

    Attributes
    ----------
    point : (k,) array
        Coordinates.
    theta : (P,) array
        All parameters.
    residual : (m,) array
    columns : (m, l) array or None
        Sensitivities to the linear parameters inside their bounds, where those are eliminated.
    """

    point: np.ndarray
    theta: np.ndarray
    residual: np.ndarray
    columns: np.ndarray | None = None

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return self._cost

    @cached_property
    def _cost(self) -> float:
        return float(self.residual @ self.residual)


@dataclass(frozen=True, eq=False)
class _DenseStep:
    """J and r of one trial as a triangular factor, between bounds.

    Attributes
    ----------
    point, lower, upper : (k,) array
    factor : (k, k) array
        R of J = QR.
    right : (k,) array
        Qᵀr.
    scale : (k,) array
        Unit of each parameter in the damping.
    shares : bool
        Whether `step` takes a share of the undamped step instead of a damping.
    """

    point: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    factor: np.ndarray
    right: np.ndarray
    scale: np.ndarray
    shares: bool = False

    @classmethod
    def of(cls, jacobian: np.ndarray, trial: Trial, lower: np.ndarray, upper: np.ndarray, before: _DenseStep | None,
           shares: bool = False) -> _DenseStep:
        """The linearisation of a trial with this Jacobian (m, k)."""
        k = jacobian.shape[1]
        r = triangular_factor(jacobian, last=trial.residual)
        scale = column_scale(r[:k, :k], 0.0 if before is None else before.scale)
        return cls(trial.point, lower, upper, r[:k, :k], r[:k, k], scale, shares)

    @property
    def finite(self) -> bool:
        """Whether the squares of all derivatives are numbers."""
        return bool(np.abs(self.factor).max(initial=0.0) < np.sqrt(np.finfo(float).max))

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        """The point to try, inside the bounds, and the predicted decrease of the cost."""
        low, high = self.lower - self.point, self.upper - self.point
        move = bounded_step(self.factor, self.right, 0.0 if self.shares else damping, self.scale, low, high)
        move = damping * move if self.shares else move
        predicted = -float(move @ (self.factor.T @ (2 * self.right + self.factor @ move)))
        return np.clip(self.point + move, self.lower, self.upper), predicted


class DenseResiduals(Protocol):
    """Residuals as one vector, with their Jacobian as one matrix."""

    def trial(self, point: np.ndarray) -> Trial | None:
        """The trial at a point.

        Parameters
        ----------
        point : (k,) array

        Returns
        -------
        Trial or None
            None where the model cannot be run there.
        """
        ...

    def jacobian(self, trial: Trial) -> np.ndarray:
        """Derivative of the residuals.

        Parameters
        ----------
        trial : Trial

        Returns
        -------
        (m, k) array
        """
        ...


@dataclass(frozen=True, eq=False)
class FunctionResiduals:
    """Residuals and Jacobian given as functions of the parameters.

    Attributes
    ----------
    residual : callable
        (k,) → (m,); where it is not finite the model cannot be run.
    derivative : callable
        (k,) → (m, k).
    """

    residual: Callable[[np.ndarray], np.ndarray]
    derivative: Callable[[np.ndarray], np.ndarray]

    def trial(self, point: np.ndarray) -> Trial | None:
        """`DenseResiduals.trial`.

        Parameters
        ----------
        point : (k,) array

        Returns
        -------
        Trial or None
        """
        found = self.residual(point)
        return Trial(point, point, found) if np.isfinite(found).all() else None

    def jacobian(self, trial: Trial) -> np.ndarray:
        """`DenseResiduals.jacobian`.

        Parameters
        ----------
        trial : Trial

        Returns
        -------
        (m, k) array
        """
        return self.derivative(trial.point)


@dataclass(frozen=True, eq=False)
class _DenseProblem:
    """Dense residuals as a problem of `descend`."""

    residuals: DenseResiduals
    lower: np.ndarray
    upper: np.ndarray
    shares: bool = False

    def evaluate(self, point: np.ndarray) -> Trial | None:
        return self.residuals.trial(point)

    def linearise(self, trial: Trial, before: _DenseStep | None) -> _DenseStep:
        return _DenseStep.of(self.residuals.jacobian(trial), trial, self.lower, self.upper, before, self.shares)

    def admissible(self, trial: Trial, now: Trial) -> bool:
        return True


def minimise_dense(residuals: DenseResiduals, start: np.ndarray, stop: StopRule,
                   bounds: tuple[np.ndarray | float, np.ndarray | float] = (-np.inf, np.inf),
                   damping_rule: _DampingRule | None = None,
                   progress: Callable[[int, float], bool | None] | None = None) -> SearchEnd[Trial, _DenseStep] | None:
    """`descend` on residuals in memory, inside their bounds, on which parameters may rest exactly.

    Parameters
    ----------
    residuals : DenseResiduals
    start : (k,) array
        Inside the bounds.
    stop : StopRule
    bounds : pair of (k,) arrays or floats, optional
    damping_rule : _DampingRule, optional
        Of `Shares` the steps are Gauss-Newton's.
    progress : callable, optional

    Returns
    -------
    SearchEnd or None

    Examples
    --------
    >>> rosenbrock = FunctionResiduals(lambda x: np.array([10 * (x[1] - x[0]**2), 1 - x[0]]),
    ...                                lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]))
    >>> minimise_dense(rosenbrock, np.array([-1.2, 1.0]), StopRule()).trial.point.round(6).tolist()
    [1.0, 1.0]
    """
    lower, upper = (np.broadcast_to(np.asarray(b, dtype=float), start.shape) for b in bounds)
    return descend(_DenseProblem(residuals, lower, upper, isinstance(damping_rule, Shares)), start, stop, damping_rule,
                   progress)
