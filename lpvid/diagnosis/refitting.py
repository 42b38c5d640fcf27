"""Joint refits of a baseline and its effects: bounded Gauss-Newton on free-run errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from gc import collect
from typing import Any

import numpy as np

from lpvid import least_squares
from lpvid._memory import give_back
from lpvid._tall import column_norms
from lpvid.diagnosis.budgets import ITERATIONS, LONG
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.trial_steps import step_by_trial, trial_parameters
from lpvid.least_squares import StopRule, bounded_step
from lpvid.rounding import EPS, EXPLODED, HALF_DIGITS, STEP, TINY, VANISHING

LEAST_DECREASE, ROUGH_DECREASE = 0.02, 0.3
"""predicted increase of twice the log-likelihood below which a refit ends, and below which a rough refit does"""
OTHER_FOLD_WEIGHT = 0.01
"""weight of the other fold in a fit to one: it determines what the samples of the one leave open, and little else"""


@dataclass(frozen=True, eq=False)
class Refit:
    """Result of a refit.

    Attributes
    ----------
    problem : DiagnosisProblem
    composition : Composition
    vector : (P,) array
    cost : float
        Sum of squared errors over the samples it was fitted to; of a fit to one fold with the lent ones.
    errors : (N,) array
        Errors on all stacked samples.
    n_samples : int
        Samples it was fitted to, without lent ones.
    """

    problem: DiagnosisProblem
    composition: Composition
    vector: np.ndarray
    cost: float
    errors: np.ndarray
    n_samples: int
    cache: dict = field(default_factory=dict, repr=False)

    def cached(self, key: object, make: Callable[[], Any]) -> Any:
        """What `make` returns, computed once for this fit; several threads may ask, for this fit and others.

        Parameters
        ----------
        key : hashable
        make : callable
            Without arguments; called where nothing is kept under the key.

        Returns
        -------
        object
        """
        if key not in self.cache:
            self.cache[key] = make()
        return self.cache[key]

    @property
    def jacobian(self) -> np.ndarray:
        """(N, P) derivative of the simulation, all stacked samples; computed at first use."""
        return self.cached("jacobian", lambda: _jacobian(self.problem, self.composition, self.vector))

    @property
    def free_jacobian(self) -> np.ndarray:
        """(N, k) derivative in the parameters that are free to reduce an error.

        All parameters, except those of a fleet's law at a bound of the fleet's range.
        """
        if self.composition.flat is None:
            return self.jacobian
        fixed = self.at_bounds() & (np.arange(self.vector.size) < self.composition.own)
        return self.jacobian[:, ~fixed]

    @property
    def variance(self) -> float:
        """Mean squared error per degree of freedom."""
        return self.cost / max(self.n_samples - self.vector.size, 1)

    def at_bounds(self) -> np.ndarray:
        """(P,) bool: parameters that lie on a bound.

        Returns
        -------
        (P,) bool array
        """
        low, high = self.composition.bounds
        slack = HALF_DIGITS * self.composition.scales
        return (self.vector <= low + slack) | (self.vector >= high - slack)


def _jacobian(problem: DiagnosisProblem, composition: Composition, vector: np.ndarray,
              errors: list[np.ndarray] | None = None) -> np.ndarray:
    """(N, P) derivative, stacked, computed anew."""
    if problem.n_samples > LONG:  # it takes most; what was freed in pieces counts as used
        collect()
        give_back()
    at = [None] * len(problem.signals) if errors is None else [s.output - e for s, e in
                                                               zip(problem.signals, errors, strict=True)]
    found = (composition.sensitivities(s, vector, at=a) for s, a in zip(problem.signals, at, strict=True))
    return _finite(problem.stack(found, overwriting=True))


def _reused_jacobian(problem: DiagnosisProblem, composition: Composition, vector: np.ndarray,
                     errors: list[np.ndarray], near: Refit) -> np.ndarray:
    """(N, P) derivative with the columns that a fit of a related composition has, the others taken at `vector`."""
    have = {name: k for k, name in enumerate(near.composition.names)}
    new = [k for k, name in enumerate(composition.names) if name not in have]
    out = np.empty((problem.n_samples, vector.size))
    for k, name in enumerate(composition.names):
        if name in have:
            out[:, k] = near.jacobian[:, have[name]]
    if new:
        out[:, new] = _finite(problem.stack([composition.sensitivities(s, vector, free=new, at=s.output - e)
                                              for s, e in zip(problem.signals, errors, strict=True)]))
    return out


def _finite(derivatives: np.ndarray) -> np.ndarray:
    """The same array, 0 where a law diverges; column by column, as all below, for little memory."""
    for column in derivatives.T:
        column[~(np.abs(column) < EXPLODED)] = 0.0
    return derivatives


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a law that diverges has a large cost
def refit(problem: DiagnosisProblem, composition: Composition, start: np.ndarray, fold: int | None = None,
          iterations: int = ITERATIONS, near: Refit | None = None, rough: bool = False) -> Refit:
    """Minimise the squared error over the blocks, or those of one fold, from `start`, inside the bounds.

    By `descend`; parameters without a useful derivative are also changed by trial, unless only one fold is fitted.

    Parameters
    ----------
    problem : DiagnosisProblem
    composition : Composition
    start : (P,) array
        What lies beyond the bounds is set on them.
    fold : {None, 0, 1}
        Whose samples count, those of the other by `OTHER_FOLD_WEIGHT` only; None for all alike.
    iterations : int
        Of a descent at most; 0 for the errors at the start.
    near : Refit, optional
        Of a related composition, whose derivatives are used until a step by them fails.
    rough : bool
        Whether to end where an updated Jacobian predicts no further decrease.

    Returns
    -------
    Refit
    """
    found = descend(problem, composition, start, fold, iterations, near, rough)
    return found if fold is not None else refined_by_trial(found, iterations, rough)


def refined_by_trial(found: Refit, iterations: int = ITERATIONS, rough: bool = False) -> Refit:
    """A refit with some parameters changed by trial (`trial_steps`), and refitted where that lowers the cost.

    Parameters
    ----------
    found : Refit
        To both folds.
    iterations : int
        Of the second descent at most.
    rough : bool
        As of `refit`.

    Returns
    -------
    Refit
        The same one where there is no such parameter, or no trial lowers the cost.
    """
    problem, composition = found.problem, found.composition
    if not trial_parameters(composition):
        return found
    vector, cost = step_by_trial(problem, composition, found.vector, found.cost, found.jacobian)
    if not cost < found.cost:
        return found
    after = descend(problem, composition, vector, None, iterations, None, rough)
    return after if after.cost < found.cost else found


def descend(problem: DiagnosisProblem, composition: Composition, start: np.ndarray, fold: int | None = None,
            iterations: int = ITERATIONS, near: Refit | None = None, rough: bool = False, sample_weight: float = 1.0
            ) -> Refit:
    """Minimise the squared error by derivatives, from `start`, until no step has a further predicted decrease.

    By `lpvid.least_squares`: Levenberg-Marquardt inside the bounds, damping by the gain ratio. After a step that
    reaches half of its predicted decrease the Jacobian is updated by a secant (Broyden 1965), else it is computed anew;
    so it is before a step that was rejected is shortened.

    Parameters
    ----------
    problem : DiagnosisProblem
    composition : Composition
    start : (P,) array
    fold : {None, 0, 1}
        Whose samples count, those of the other by `OTHER_FOLD_WEIGHT` only: a level of the current that occurs in
        a single block belongs to one fold, and without its samples the law is undetermined there.
    iterations : int
        Steps at most; 0 for the errors at the start.
    near : Refit, optional
        Of a related composition, whose derivatives are used until a step by them fails.
    rough : bool
        Whether to end where an updated Jacobian predicts no further decrease.
    sample_weight : float
        Independent samples that each sample counts as: for a structured error, a fall of the log-likelihood by
        `LEAST_DECREASE` requires a larger decrease of the cost.

    Returns
    -------
    Refit
    """
    own = np.ones(problem.n_samples, dtype=bool) if fold is None else problem.in_fold(fold)
    weights = np.where(own, 1.0, OTHER_FOLD_WEIGHT)
    count = int(own.sum())
    least = (ROUGH_DECREASE if rough else LEAST_DECREASE) / (sample_weight * count)
    search = _RefitSearch(problem, composition, weights, count, near, rough, least)
    stop = StopRule(tolerance=0.0, iterations=iterations, least_decrease=least)
    found = least_squares.descend(search, np.asarray(start, dtype=float), stop)
    assert found is not None  # what diverges has a large cost
    return found.trial.fit


@dataclass(frozen=True, eq=False)
class _Iterate:
    """A refit, and its errors per record on all samples."""

    fit: Refit
    errors: list[np.ndarray]

    @property
    def cost(self) -> float:
        return self.fit.cost


@dataclass(frozen=True, eq=False)
class _RefitSearch:
    """A refit as a problem of `least_squares.descend`; it ends at a predicted decrease of `least` of the cost."""

    problem: DiagnosisProblem
    composition: Composition
    weights: np.ndarray
    count: int
    near: Refit | None
    rough: bool
    least: float

    def evaluate(self, point: np.ndarray) -> _Iterate:
        vector = np.clip(point, *self.composition.bounds)
        errors = self.problem.errors(self.composition, vector)
        stacked = self.problem.stack(errors)
        cost = float(self.weights @ stacked**2)
        return _Iterate(Refit(self.problem, self.composition, vector, cost, stacked, self.count), errors)

    def linearise(self, trial: _Iterate, before: _LinearisedRefit | None) -> _LinearisedRefit:
        return _LinearisedRefit(self, trial, self.near) if before is None else before.moved_to(trial)

    def admissible(self, trial: _Iterate, now: _Iterate) -> bool:
        return True


class _LinearisedRefit:
    """The simulation at an iterate, linearised by derivatives taken there or, `updated`, by secants from nearby ones.

    Parameters
    ----------
    search : _RefitSearch
    now : _Iterate
    near : Refit, optional
        Whose derivatives are used first.
    """

    finite = True  # `_finite`

    def __init__(self, search: _RefitSearch, now: _Iterate, near: Refit | None = None) -> None:
        self.search, self.now, self.updated = search, now, near is not None
        self.tried, self.predicted = False, 0.0
        self.jacobian = self._derivative() if near is None else _reused_jacobian(
            search.problem, search.composition, now.fit.vector, now.errors, near)

    def moved_to(self, there: _Iterate) -> _LinearisedRefit:
        """The same after a step: updated by a secant if it reached half of its predicted decrease, else anew."""
        here, self.now, self.tried = self.now, there, False
        if here.cost - there.cost > 0.5 * self.predicted:
            _broyden_update(self.jacobian, there.fit.vector - here.fit.vector, here.fit.errors - there.fit.errors)
            self.updated = True
        else:
            self._renew()
        return self

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        """The point to try, and the decrease of the cost that the linearisation predicts there.

        Where that of the first damped step is too little, the step without damping: along a curved valley a damped one
        predicts little. After a step by secants that was rejected, and before the end of a refit that is not rough, the
        derivatives are computed anew.

        Parameters
        ----------
        damping : float

        Returns
        -------
        (P,) array, float
        """
        if self.tried and self.updated:
            self._renew()
        move, predicted = self._damped(damping)
        little = self.search.least * self.now.cost
        if predicted <= little and not self.tried:
            move, predicted = self._damped(0.0)
            if predicted <= little and self.updated and not self.search.rough:
                self._renew()
                return self.step(damping)
        self.tried, self.predicted = True, predicted
        return self.now.fit.vector + move, predicted

    def _damped(self, damping: float) -> tuple[np.ndarray, float]:
        fit, bounds = self.now.fit, self.search.composition.bounds
        return _step(self.jacobian, fit.errors, self.search.weights, fit.vector, damping, *bounds)

    def _derivative(self) -> np.ndarray:
        fit = self.now.fit
        return _jacobian(fit.problem, fit.composition, fit.vector, self.now.errors)

    def _renew(self) -> None:
        del self.jacobian  # before another one of its size is taken
        self.jacobian, self.updated, self.tried = self._derivative(), False, False


def _broyden_update(jacobian: np.ndarray, step: np.ndarray, change: np.ndarray) -> None:
    """Broyden's update in place, in parameters scaled by the columns' norms: J step = change afterwards."""
    norms = np.maximum(column_norms(jacobian), TINY)
    scaled = step * norms
    length = float(scaled @ scaled)
    if length > 0 and np.isfinite(change).all():
        deviation = change - jacobian @ step
        for k, share in enumerate(scaled * norms / length):
            jacobian[:, k] += deviation * share


def _step(jacobian: np.ndarray, errors: np.ndarray, weights: np.ndarray, vector: np.ndarray, damping: float,
          low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
    """Damped step in the free parameters, and its predicted decrease of the cost (0 where there is none to take).

    Where that would carry some beyond their bounds, the best step inside them (bounded least squares).
    """
    weighted = jacobian if (weights == 1.0).all() else jacobian * weights[:, None]
    gradient, hessian = weighted.T @ errors, weighted.T @ jacobian
    norms = np.sqrt(np.maximum(np.diag(hessian), TINY))
    held = ((vector <= low) & (gradient < 0)) | ((vector >= high) & (gradient > 0)) | (norms <= VANISHING)
    free = np.flatnonzero(~held)
    step = np.zeros(vector.size)
    if not free.size or not np.isfinite(hessian).all():
        return step, 0.0
    scale = norms[free]
    values, vectors = np.linalg.eigh(hessian[np.ix_(free, free)] / np.outer(scale, scale))
    root = np.sqrt(np.maximum(values, EPS * values[-1]))
    step[free] = bounded_step(root[:, None] * vectors.T * scale, vectors.T @ (-gradient[free] / scale) / root, damping,
                              scale, (low - vector)[free], (high - vector)[free])
    step = np.clip(vector + step, low, high) - vector
    return step, float(2 * step @ gradient - step @ hessian @ step)


def covariance(problem: DiagnosisProblem, fit: Refit) -> np.ndarray:
    """(P, P) covariance of a refit to all blocks, in sandwich form over the blocks; NaN for parameters at a bound.

    (JᵀJ)⁻¹ (Σ_b g_b g_bᵀ) (JᵀJ)⁻¹ with g_b the block sums of J e: right for errors whose size follows the force or
    which are coloured, if the blocks are longer than the memory. Not below σ²(JᵀJ)⁻¹.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit

    Returns
    -------
    (P, P) array
        In the units of the parameters, squared; NaN also for a parameter that changes nothing.
    """
    size = fit.vector.size
    free = np.flatnonzero(~fit.at_bounds() & (column_norms(fit.jacobian) > 0))
    out = np.full((size, size), np.nan)
    if not free.size:
        return out
    j = fit.jacobian[:, free]
    scale = column_norms(j)
    j /= scale
    inverse = np.linalg.pinv(j.T @ j, rcond=STEP**2)
    j *= fit.errors[:, None]
    scores = problem.block_sums(j)
    count = problem.blocks.count
    middle = scores.T @ scores * count / max(count - 1, 1)
    robust = inverse @ middle @ inverse
    plain = inverse * fit.variance
    grow = np.sqrt(np.maximum(1.0, np.diag(plain) / np.maximum(np.diag(robust), TINY)))
    out[np.ix_(free, free)] = robust * np.outer(grow, grow) / np.outer(scale, scale)
    return out
