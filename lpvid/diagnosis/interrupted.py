"""Interrupted diagnoses: the baseline, its error, and the best set so far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.diagnosis.diagnosis import Diagnosis, Errors, SetProbabilities
from lpvid.diagnosis.localise import localise
from lpvid.diagnosis.problem import DiagnosisProblem, problem_of
from lpvid.effects.composition import Composition
from lpvid.effects.extended import ExtendedModel
from lpvid.effects.preparing import PreparedRecords
from lpvid.rounding import TINY


@dataclass(frozen=True, eq=False)
class BestSoFar:
    """The best set of an interrupted search.

    Attributes
    ----------
    composition : Composition
        The most probable set so far.
    vector : (P,) array
    probability : float
        Its share among the sets that were visited.
    weights : SetProbabilities
        Of those sets.
    """

    composition: Composition
    vector: np.ndarray
    probability: float
    weights: SetProbabilities


@dataclass(eq=False)
class InterruptedSearch(KeyboardInterrupt):
    """An interruption (Ctrl-C) of a search after its first set.

    Attributes
    ----------
    best : BestSoFar
    """

    best: BestSoFar


def interrupted(baseline: Baseline, prepared: PreparedRecords, stage: str, best: BestSoFar | None = None) -> Diagnosis:
    """A partial diagnosis: no verdict on any cause, the baseline's error and where it lies, the best set so far.

    Parameters
    ----------
    baseline : Baseline
        Fitted, if the fit was complete.
    prepared : PreparedRecords
    stage : str
        That was interrupted.
    best : BestSoFar, optional
        Of a search that had begun; it becomes the extended model, and none of its causes is named.

    Returns
    -------
    Diagnosis
        Of verdict ``cannot-tell``, with ``complete`` False; its errors are all of training samples.
    """
    problem = problem_of(prepared.training, baseline)
    bare = Composition(baseline)
    before = _figures(problem, bare, baseline.vector)
    wrong = localise(problem, problem.errors(bare, baseline.vector))
    composition, vector, after = bare, baseline.vector, before
    reason = f"interrupted while {stage}: no cause is named"
    if best is not None and best.composition.effects:
        composition, vector = best.composition, best.vector
        after = _figures(problem, composition, vector)
        reason += f"; best set so far: {', '.join(sorted(composition.members))}, {best.probability:.2f} of the weight"
    unknown = np.full((vector.size, vector.size), np.nan)
    return Diagnosis("cannot-tell", reason, baseline.describe(), before, after, None, {"name": "not computed"}, wrong,
                     (), (), (), (), None, "training samples, nothing was held out",
                     ExtendedModel(composition, vector, unknown), baseline.output_unit, complete=False,
                     weights=None if best is None else best.weights)


def _figures(problem: DiagnosisProblem, composition: Composition, vector: np.ndarray) -> Errors:
    """Free-run errors on the training samples."""
    square = float(np.mean(problem.stacked_errors(composition, vector) ** 2))
    return Errors(esr := square / max(problem.spread**2, TINY), esr, float(np.sqrt(square)), "training")
