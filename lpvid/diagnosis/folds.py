"""Folds: errors of a composition on blocks that its fit has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit

STEPS = 8
"""iterations of a refit to one fold, which begins at the fit to both"""


@dataclass(frozen=True, eq=False)
class Folds:
    """Errors out of fold of one composition: each sample by the fit to the other fold, in which it weighs `LENT`.

    Attributes
    ----------
    plain : (N,) array
        In the output's unit.
    """

    plain: np.ndarray


def out_of_fold(problem: DiagnosisProblem, fit: Refit) -> Folds:
    """Refit to each fold from the fit to both, and take the errors on the other."""
    errors = np.empty(problem.n_samples)
    for fold in (0, 1):
        half = refit(problem, fit.composition, fit.vector, fold=fold, iterations=STEPS, near=fit, rough=True)
        test = problem.in_fold(1 - fold)
        errors[test] = half.errors[test]
    return Folds(errors)
