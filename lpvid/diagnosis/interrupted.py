"""What an interrupted diagnosis still says: the baseline, where it is wrong, how far the search had come."""

from __future__ import annotations

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.diagnosis import Diagnosis, Errors
from lpvid.diagnosis.extended import ExtendedModel
from lpvid.diagnosis.localise import localise
from lpvid.diagnosis.noise import WHITE
from lpvid.diagnosis.preparing import Prepared
from lpvid.diagnosis.problem import Problem


def interrupted(baseline: Baseline, prepared: Prepared, stage: str) -> Diagnosis:
    """A partial diagnosis: no verdict on any cause, the baseline's error and where it lies.

    Parameters
    ----------
    baseline : Baseline
        Fitted, if the fit had ended.
    prepared : Prepared
    stage : str
        What was being done.
    """
    signals = tuple(baseline.signals(r) for r in prepared.training)
    problem = Problem(signals, Blocks.of(signals, baseline.start), WHITE)
    vector = baseline.vector
    errors = problem.errors(Composition(baseline), vector)
    stacked = problem.stack(errors, whiten=False)
    esr = float(np.mean(stacked**2)) / max(problem.spread**2, 1e-300)
    figures = Errors(esr, esr, float(np.sqrt(np.mean(stacked**2))))
    unknown = np.full((vector.size, vector.size), np.nan)
    return Diagnosis("cannot-tell", f"interrupted while {stage}: no cause was judged", baseline.describe(), figures,
                     figures, None, {"name": "not looked at"}, localise(problem, errors), (), (), (), (), None,
                     "training samples, nothing was held out", ExtendedModel(Composition(baseline), vector, unknown),
                     baseline.output_unit, complete=False)
