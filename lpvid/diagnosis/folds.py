"""Folds: errors of a composition on blocks that its fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit

FOLD_ITERATIONS = 8
"""iterations of a refit to one fold, which begins at the fit to both"""


@dataclass(frozen=True, eq=False)
class Folds:
    """Errors out of fold: each sample by the fit to the other fold, in which it has the weight `OTHER_FOLD_WEIGHT`.

    Attributes
    ----------
    errors : (N,) array
        In the output's unit.
    """

    errors: np.ndarray


def out_of_fold(problem: DiagnosisProblem, fit: Refit) -> Folds:
    """Refit to each fold from the fit to both, and take the errors on the other.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
        To both folds.

    Returns
    -------
    Folds
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
    half = refit(problem, fit.composition, fit.vector, fold=fold, iterations=FOLD_ITERATIONS, near=fit, rough=True)
    return half.errors[problem.in_fold(1 - fold)]


def join_folds(problem: DiagnosisProblem, parts: Sequence[np.ndarray]) -> Folds:
    """Errors out of fold of all samples.

    Parameters
    ----------
    problem : DiagnosisProblem
    parts : sequence of (n,) array
        `errors_on_other_fold` fold 0 and fold 1.

    Returns
    -------
    Folds
    """
    errors = np.empty(problem.n_samples)
    for fold, part in enumerate(parts):
        errors[problem.in_fold(1 - fold)] = part
    return Folds(errors)
