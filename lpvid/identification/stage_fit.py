"""Fit the static input stage of an LPV-Hammerstein model to its free run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lpvid.errors import InputError
from lpvid.identification.result import Identification
from lpvid.model.input_stage import STAGES, InputStage
from lpvid.record import Record
from lpvid.scheduling import Scheduling
from lpvid.simulation import simulate

if TYPE_CHECKING:
    from lpvid.identification.arx import ARX

SAMPLES = 40_000
"""samples on which the stage is searched; the final regression uses all."""
DIVERGED_COST = 1e3
"""cost of a stage whose model diverges in free run, plus its one-step cost."""


def fit_stage(records: Sequence[Record], structure: ARX, box: Scheduling) -> Identification:
    """Search the stage's few parameters for the least free-run error; the linear part is a regression each time.

    The separation (variable projection) keeps the search in two to six dimensions. Several starts from the data's own
    spread are tried, and the best two are refined by Nelder & Mead 1965.

    Parameters
    ----------
    records : sequence of Record
        Uniform and finite.
    structure : ARX
        With a bound basis and a stage's name.
    box : Scheduling

    Returns
    -------
    Identification
        With the fitted stage in its model and structure.
    """
    from scipy.optimize import minimize

    sample = shorten(records, SAMPLES, structure.start + 50)
    u = np.vstack([r.matrix(structure.input) for r in sample])
    p = np.vstack([r.matrix(box.names) for r in sample])
    assert isinstance(structure.stage, str)
    starts = STAGES[structure.stage]().starts(u, p)
    reach = float(box.half_width[0]) if box.names else 0.0
    costs = [free_run_cost(sample, replace(structure, stage=s), box) for s in starts]
    best: tuple[float, InputStage] = (np.inf, starts[0])
    for index in np.argsort(costs)[:2]:
        start = starts[index]
        scales = start.scales(reach)
        free = np.flatnonzero(scales > 0)

        def stage_at(z: np.ndarray, start=start, scales=scales, free=free) -> InputStage:
            vector = start.vector.copy()
            vector[free] += scales[free] * z
            return start.with_vector(vector)

        found = minimize(lambda z, at=stage_at: free_run_cost(sample, replace(structure, stage=at(z)), box),
                         np.zeros(free.size), method="Nelder-Mead",
                         options={"maxfev": 60 + 40 * free.size, "xatol": 1e-3, "fatol": 1e-5,
                                  "initial_simplex": _simplex(free.size)})
        if found.fun < best[0]:
            best = (float(found.fun), stage_at(found.x))
    fitted = replace(structure, stage=best[1])
    note = f"input stage fitted to the free run on training data: {describe(best[1])}; covariance holds it fixed"
    result = fitted.regress(records, box)
    return result.replace(notes=(*result.notes, note))


def free_run_cost(records: Sequence[Record], structure: ARX, box: Scheduling) -> float:
    """Pooled free-run ESR of the regression with a fixed stage; large and finite where it diverges."""
    try:
        model = structure.regress(records, box).model
    except InputError:
        return 2 * DIVERGED_COST
    error = power = 0.0
    for record in records:
        y = record.matrix(structure.output)
        run = simulate(model, record)
        if run.diverged_at is not None:
            return DIVERGED_COST * (1 + 1 / (1 + run.diverged_at))
        scale = np.maximum(y[run.start:].var(axis=0), 1e-300)
        error += float(np.sum((y - run.output)[run.start:] ** 2 / scale)) / y.shape[1]
        power += len(y) - run.start
    return error / power


def shorten(records: Sequence[Record], samples: int, minimum: int) -> list[Record]:
    """The head of every record, so that together they hold at most `samples` samples."""
    total = sum(r.n_samples for r in records)
    if total <= samples:
        return list(records)
    return [r.slice(0, max(minimum, int(r.n_samples * samples / total))) for r in records]


def describe(stage: InputStage) -> str:
    """The stage's parameters in one line."""
    data = stage.to_dict()
    values = ", ".join(f"{k} {v:.4g}" for k, v in data.items() if isinstance(v, float))
    return f"{data['kind']} ({values})"


def _simplex(n: int) -> np.ndarray:
    return np.vstack([np.zeros(n), np.eye(n) * 0.6])
