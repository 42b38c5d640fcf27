"""Joint refits of a baseline and its effects: bounded Gauss-Newton on free-run errors."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from gc import collect
from itertools import islice
from typing import Any

import numpy as np

from lpvid._bounded_steps import broyden_update, damped_step, geodesic_correction
from lpvid._memory import give_back
from lpvid._tall import column_norms
from lpvid.baselines.budgets import LONG
from lpvid.diagnosis.budgets import ITERATIONS
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.trial_steps import step_by_trial, trial_parameters
from lpvid.effects.composition import Composition
from lpvid.rounding import EPS, EXPLODED, HALF_DIGITS, STEP, TINY

LEAST_DECREASE, ROUGH_DECREASE = 0.02, 0.3
"""predicted increase of the log-likelihood below which a refit ends, and below which a rough refit does"""
DECREASE_RATIO = 0.25
"""share of the predicted decrease that a step by an updated Jacobian must reach, else that is computed anew"""
STEP_SHARES = (1.0, 0.3, 0.1)
"""shares of a step that are tried one after the other before it is damped"""
FIRST_DAMPING = 1e-3
LEAST_DAMPING = STEP * STEP
"""of normal equations scaled to a diagonal of one: their digits beyond are errors of the differences in the Jacobian"""
OTHER_FOLD_WEIGHT = 0.01
"""weight of the other fold in a fit to one: it determines what the samples of the one leave open, and little else"""
SECANT_STEPS = 4
"""steps for which a Jacobian is updated by secants (Broyden 1965) before it is computed anew"""


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

    def on(self, problem: DiagnosisProblem) -> Refit:
        """The same fit with the weights of another problem of the same samples.

        Parameters
        ----------
        problem : DiagnosisProblem

        Returns
        -------
        Refit
            Without weights, it keeps the covariance that it has with them.
        """
        if problem is self.problem:
            return self

        def weighed(values: np.ndarray) -> np.ndarray:
            return problem.weighed(self.problem.unweighed(values))

        errors = weighed(self.errors)
        kept = {"jacobian": weighed(self.jacobian)} if "jacobian" in self.cache else {}
        if problem.whitening is None:
            kept["covariance"] = covariance(self.problem, self)
        return replace(self, problem=problem, errors=errors, cost=float(errors @ errors), cache=kept)

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
    return problem.weighed(_finite(problem.stack(found, overwriting=True)))


def settled_start(problem: DiagnosisProblem, composition: Composition, start: np.ndarray, near: Refit) -> np.ndarray:
    """A start vector with the parameters that a related fit has moved by one step, where that has a lower cost.

    What an added effect does is partly what the law did before, as friction and a yield force. The parameters in common
    are moved to the least squared error to first order, by their derivatives at the related fit, inside the bounds:
    otherwise the first step of a descent moves the effect's shape for what the law does too much.

    Parameters
    ----------
    problem : DiagnosisProblem
    composition : Composition
    start : (P,) array
    near : Refit
        Of a composition that has some of the parameters.

    Returns
    -------
    (P,) array
    """
    vector = np.clip(start, *composition.bounds)
    errors = problem.stacked_errors(composition, vector)
    jacobian, _ = _known_columns(problem, composition, near)
    moved = vector + damped_step(jacobian, errors, np.ones(errors.size), vector, FIRST_DAMPING, *composition.bounds)[0]
    after = problem.stacked_errors(composition, moved)
    return moved if float(after @ after) < float(errors @ errors) else vector


def _reused_jacobian(problem: DiagnosisProblem, composition: Composition, vector: np.ndarray,
                     errors: list[np.ndarray], near: Refit) -> np.ndarray:
    """(N, P) derivative with the columns that a fit of a related composition has, the others taken at `vector`."""
    out, new = _known_columns(problem, composition, near)
    if new:
        found = (composition.sensitivities(s, vector, free=new, at=s.output - e)
                 for s, e in zip(problem.signals, errors, strict=True))
        out[:, new] = problem.weighed(_finite(problem.stack(found)))
    return out


def _known_columns(problem: DiagnosisProblem, composition: Composition, near: Refit) -> tuple[np.ndarray, list[int]]:
    """(N, P) derivative of a related fit in the parameters in common, zero in the others; and these others."""
    have = {name: k for k, name in enumerate(near.composition.names)}
    common = {k: have[name] for k, name in enumerate(composition.names) if name in have}
    out = np.zeros((problem.n_samples, len(composition.names)))
    out[:, list(common)] = near.jacobian[:, list(common.values())]
    return out, [k for k in range(out.shape[1]) if k not in common]


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
    """Minimise the squared error by derivatives: where `descent` is after so many iterations.

    Parameters
    ----------
    problem : DiagnosisProblem
    composition : Composition
    start : (P,) array
    fold : {None, 0, 1}
    iterations : int
        At most; 0 for the errors at the start.
    near : Refit, optional
    rough : bool
    sample_weight : float
        As these of `descent`.

    Returns
    -------
    Refit
    """
    iterates = descent(problem, composition, start, fold, near, rough, sample_weight)
    return deque(islice(iterates, iterations + 1), maxlen=1)[0]  # the errors of each are as long as the record


def descent(problem: DiagnosisProblem, composition: Composition, start: np.ndarray, fold: int | None = None,
            near: Refit | None = None, rough: bool = False, sample_weight: float = 1.0) -> Iterator[Refit]:
    """The iterates of a minimisation by derivatives, from its start until no step has a further predicted decrease.

    Levenberg-Marquardt with columns scaled by their norms; a parameter at a bound is held if its step would cross it.
    After a successful step the Jacobian is updated by a secant. A step that fails or has no predicted decrease counts
    as such only with a Jacobian that was computed anew.

    Parameters
    ----------
    problem : DiagnosisProblem
    composition : Composition
    start : (P,) array
    fold : {None, 0, 1}
        Whose samples count, those of the other by `OTHER_FOLD_WEIGHT` only: a level of the current that occurs in
        a single block belongs to one fold, and without its samples the law is undetermined there.
    near : Refit, optional
        Of a related composition, whose derivatives are used until a step by them fails.
    rough : bool
        Whether to end where an updated Jacobian predicts no further decrease.
    sample_weight : float
        Independent samples that each sample counts as: for a structured error, a fall of the log-likelihood by
        `LEAST_DECREASE` requires a larger decrease of the cost.

    Yields
    ------
    Refit
    """
    low, high = composition.bounds
    own = np.ones(problem.n_samples, dtype=bool) if fold is None else problem.in_fold(fold)
    count, weights = int(own.sum()), np.where(own, 1.0, OTHER_FOLD_WEIGHT)

    def at(vector: np.ndarray) -> tuple[Refit, list[np.ndarray]]:
        vector = np.clip(vector, low, high)
        errors = problem.errors(composition, vector)
        stacked = problem.weighed(problem.stack(errors))
        return Refit(problem, composition, vector, float(weights @ stacked**2), stacked, count), errors

    def derivative() -> np.ndarray:
        return _jacobian(problem, composition, now.vector, errors)

    now, errors = at(np.asarray(start, dtype=float))
    yield now
    if near is None:
        jacobian, age = derivative(), 0
    else:
        jacobian, age = _reused_jacobian(problem, composition, now.vector, errors, near), 1
    damping, failed = FIRST_DAMPING, False
    while damping * LEAST_DAMPING <= 1:
        if age > SECANT_STEPS:
            del jacobian  # before another one of its size is taken
            jacobian, age = derivative(), 0
        step, predicted = damped_step(jacobian, now.errors, weights, now.vector, damping, low, high)
        little = predicted < (ROUGH_DECREASE if rough else LEAST_DECREASE) * now.cost / (sample_weight * count)
        if little:
            if damping > LEAST_DAMPING and not failed:  # along a curved valley a damped step predicts little
                damping = max(damping / 100, LEAST_DAMPING)
                continue
            if age == 0 or rough:
                return
            del jacobian
            jacobian, age = derivative(), 0
            yield now
            continue
        for share in (STEP_SHARES if age == 0 else STEP_SHARES[:1]):
            there = at(now.vector + share * step)
            if age == 0 and now.cost - there[0].cost < DECREASE_RATIO * share * predicted:
                deviation = now.errors - there[0].errors - share * (jacobian @ step)
                correction = geodesic_correction(jacobian, deviation / share**2, step, weights, now.vector, damping,
                                                 low, high)
                corrected = there if correction is None else at(now.vector + step + correction)
                there = corrected if corrected[0].cost < there[0].cost else there
            if now.cost - there[0].cost > (DECREASE_RATIO * predicted if age else 0.0):
                broyden_update(jacobian, there[0].vector - now.vector, now.errors - there[0].errors)
                (now, errors), age, damping, failed = there, age + 1, max(damping / 5, LEAST_DAMPING), False
                break
        else:
            if age:
                del jacobian
                jacobian, age = derivative(), 0
            else:
                damping, failed = damping * 8, True
        yield now


def covariance(problem: DiagnosisProblem, fit: Refit) -> np.ndarray:
    """(P, P) covariance of a refit to all blocks, in sandwich form over the blocks; NaN for parameters at a bound.

    (JᵀJ)⁻¹ (Σ_b g_b g_bᵀ) (JᵀJ)⁻¹ over the blocks, g_b = J_bᵀ (I − H_b)^(−½) e_b, H_b = J_b (JᵀJ)⁻¹ J_bᵀ: right for
    errors whose size follows the force or which are coloured, if the blocks are longer than the memory. A fit draws its
    own errors towards zero, most where few blocks determine a parameter; with H_b the covariance is without bias in
    white noise (Bell and McCaffrey 2002, CR2). Not below σ²(JᵀJ)⁻¹.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit

    Returns
    -------
    (P, P) array
        In the units of the parameters, squared; NaN also for a parameter that changes nothing.
    """
    free = np.flatnonzero(~fit.at_bounds() & (column_norms(fit.jacobian) > 0))
    out = np.full((fit.vector.size, fit.vector.size), np.nan)
    j = fit.jacobian[:, free]
    scale = column_norms(j)
    j /= scale
    values, directions = np.linalg.eigh(j.T @ j)
    seen = values > STEP**2 * values.max(initial=0.0)
    basis = directions[:, seen] / np.sqrt(values[seen])
    beyond = basis.T @ (j.T @ fit.errors)  # of a refit that ended before its minimum
    scores = []
    for rows in np.split(np.arange(len(j)), np.flatnonzero(np.diff(problem.block)) + 1):
        q = j[rows] @ basis
        held, axes = np.linalg.eigh(q.T @ q)
        scores.append(axes @ (axes.T @ q.T @ (fit.errors[rows] - q @ beyond) / np.sqrt(np.maximum(1 - held, EPS))))
    robust = (moves := basis @ np.transpose(scores)) @ moves.T
    grow = np.sqrt(np.maximum(1.0, fit.variance * np.sum(basis**2, axis=1) / np.maximum(np.diag(robust), TINY))) / scale
    out[np.ix_(free, free)] = robust * np.outer(grow, grow)
    return out
