"""Joint refits of a baseline and its effects: bounded Gauss-Newton on whitened free-run errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.problem import Problem

ITERATIONS = 25
TOLERANCE = 1e-6
"""relative fall of the cost below which a refit has converged"""
MAX_DAMPING = 1e10


@dataclass(frozen=True, eq=False)
class Refit:
    """Where a refit ended.

    Attributes
    ----------
    composition : Composition
    vector : (P,) array
    cost : float
        Sum of squared whitened errors over the samples it was fitted to.
    errors : (N,) array
        Whitened errors on all stacked samples.
    jacobian : (N, P) array
        Whitened derivative of the simulation, all stacked samples.
    n_samples : int
        Samples it was fitted to.
    """

    composition: Composition
    vector: np.ndarray
    cost: float
    errors: np.ndarray
    jacobian: np.ndarray
    n_samples: int

    @property
    def variance(self) -> float:
        """Mean squared whitened error, degrees of freedom taken off."""
        return self.cost / max(self.n_samples - self.vector.size, 1)

    def bic(self) -> float:
        """N ln(cost/N) + P ln N."""
        return self.n_samples * float(np.log(max(self.cost, 1e-300) / self.n_samples)) + \
            self.vector.size * float(np.log(self.n_samples))

    def at_bounds(self) -> np.ndarray:
        """(P,) bool: parameters that lie on a bound."""
        low, high = self.composition.bounds
        slack = 1e-6 * self.composition.scales
        return (self.vector <= low + slack) | (self.vector >= high - slack)


def refit(problem: Problem, composition: Composition, start: np.ndarray, fold: int | None = None,
          iterations: int = ITERATIONS) -> Refit:
    """Minimise the whitened squared error over the blocks (or one fold of them), from `start`, inside the bounds.

    Levenberg-Marquardt with columns scaled by their norms; parameters at a bound that want to leave it are held.

    Parameters
    ----------
    problem : Problem
    composition : Composition
    start : (P,) array
    fold : {None, 0, 1}
    iterations : int

    Returns
    -------
    Refit
    """
    low, high = composition.bounds
    inside = np.ones(problem.n_samples, dtype=bool) if fold is None else problem.in_fold(fold)
    vector = np.clip(np.asarray(start, dtype=float), low, high)
    errors = problem.errors(composition, vector)
    stacked = problem.stack(errors)
    cost = float(stacked[inside] @ stacked[inside])
    jacobian, damping, fresh = None, 1e-3, True
    for _ in range(iterations):
        if fresh or jacobian is None:
            jacobian = problem.stack([composition.sensitivities(s, vector, at=s.output - e)
                                      for s, e in zip(problem.signals, errors, strict=True)])
            jacobian = np.nan_to_num(jacobian, nan=0.0, posinf=0.0, neginf=0.0)
            inner = jacobian[inside]
            gradient, hessian = inner.T @ stacked[inside], inner.T @ inner
            norms = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
            fresh = False
        step = _step(vector, gradient, hessian, norms, damping, low, high)
        if step is None:
            break
        trial = np.clip(vector + step, low, high)
        moved = problem.errors(composition, trial)
        trial_stacked = problem.stack(moved)
        trial_cost = float(trial_stacked[inside] @ trial_stacked[inside])
        if trial_cost < cost:
            fall = (cost - trial_cost) / cost
            vector, errors, stacked, cost, fresh = trial, moved, trial_stacked, trial_cost, True
            damping = max(damping / 5, 1e-12)
            if fall < TOLERANCE:
                break
        else:
            damping *= 8
            if damping > MAX_DAMPING:
                break
    if fresh or jacobian is None:
        jacobian = problem.stack([composition.sensitivities(s, vector, at=s.output - e)
                                  for s, e in zip(problem.signals, errors, strict=True)])
        jacobian = np.nan_to_num(jacobian, nan=0.0, posinf=0.0, neginf=0.0)
    return Refit(composition, vector, cost, stacked, jacobian, int(inside.sum()))


def _step(vector: np.ndarray, gradient: np.ndarray, hessian: np.ndarray, norms: np.ndarray, damping: float,
          low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
    """Damped step in the free parameters, None where none is free; `gradient` is Jᵀ(measured − simulated)."""
    held = ((vector <= low) & (gradient < 0)) | ((vector >= high) & (gradient > 0)) | (norms <= 1e-140)
    free = np.flatnonzero(~held)
    if not free.size:
        return None
    scale = norms[free]
    matrix = hessian[np.ix_(free, free)] / np.outer(scale, scale) + damping * np.eye(free.size)
    step = np.zeros(vector.size)
    try:
        step[free] = np.linalg.solve(matrix, gradient[free] / scale) / scale
    except np.linalg.LinAlgError:
        step[free] = np.linalg.lstsq(matrix, gradient[free] / scale, rcond=1e-12)[0] / scale
    return step


def covariance(problem: Problem, fit: Refit) -> np.ndarray:
    """(P, P) covariance of a refit to all blocks, in sandwich form over the blocks; NaN for parameters at a bound.

    (JᵀJ)⁻¹ (Σ_b g_b g_bᵀ) (JᵀJ)⁻¹ with g_b the block sums of J e: right for errors whose size follows the force or
    whose colour the whitening has missed, if the blocks are longer than the memory. Not below σ²(JᵀJ)⁻¹.
    """
    size = fit.vector.size
    free = np.flatnonzero(~fit.at_bounds() & (np.linalg.norm(fit.jacobian, axis=0) > 0))
    out = np.full((size, size), np.nan)
    if not free.size:
        return out
    j = fit.jacobian[:, free]
    scale = np.linalg.norm(j, axis=0)
    j = j / scale
    inverse = np.linalg.pinv(j.T @ j, rcond=1e-12)
    scores = problem.block_sums(j * fit.errors[:, None])
    count = problem.blocks.count
    middle = scores.T @ scores * count / max(count - 1, 1)
    robust = inverse @ middle @ inverse
    plain = inverse * fit.variance
    grow = np.sqrt(np.maximum(1.0, np.diag(plain) / np.maximum(np.diag(robust), 1e-300)))
    out[np.ix_(free, free)] = robust * np.outer(grow, grow) / np.outer(scale, scale)
    return out
