"""Folds: errors of a composition on blocks that its fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.budgets import NEAR_ITERATIONS
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit


def out_of_fold(problem: DiagnosisProblem, fit: Refit) -> np.ndarray:
    """Errors out of fold: each sample by the fit to the other fold, in which it has the weight `OTHER_FOLD_WEIGHT`.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
        To both folds, from which each is refitted.

    Returns
    -------
    (N,) array
        In the output's unit.
    """
    return join_folds(problem, [errors_on_other_fold(problem, fit, fold) for fold in (0, 1)])


def errors_on_other_fold(problem: DiagnosisProblem, fit: Refit, fold: int) -> np.ndarray:
    """Errors on the samples of the other fold, by a refit to this one from the fit to both.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
        To both folds.
    fold : {0, 1}
        To which is refitted.

    Returns
    -------
    (n,) array
        In the output's unit.
    """
    half = refit(problem, fit.composition, fit.vector, fold=fold, iterations=NEAR_ITERATIONS, near=fit, rough=True)
    return half.errors[problem.in_fold(1 - fold)]


def join_folds(problem: DiagnosisProblem, parts: Sequence[np.ndarray]) -> np.ndarray:
    """Errors out of fold of all samples.

    Parameters
    ----------
    problem : DiagnosisProblem
    parts : sequence of (n,) array
        `errors_on_other_fold` fold 0 and fold 1.

    Returns
    -------
    (N,) array
    """
    errors = np.empty(problem.n_samples)
    for fold, part in enumerate(parts):
        errors[problem.in_fold(1 - fold)] = part
    return errors
