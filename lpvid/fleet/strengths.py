"""Strengths: refits of a fleet's law, and of the causes of one file, along the records of another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.effects.composition import ComposedBaseline, Composition
from lpvid.record import Record

if TYPE_CHECKING:
    from lpvid.effects.extended import ExtendedModel
    from lpvid.effects.fleet_law import FleetLaw


def refitted(law: FleetLaw, records: Sequence[Record]) -> np.ndarray:
    """(P,) parameters of a fleet's law along one specimen's records, within its bounds.

    Parameters
    ----------
    law : FleetLaw
    records : sequence of Record
        As read.

    Returns
    -------
    (P,) array
    """
    return _refit(Composition(law), [law.vector], records)


def strengths(found: ExtendedModel, healthy: Sequence[Sequence[Record]]) -> dict[str, dict[str, list]]:
    """Strengths of a file's causes in that file and in healthy files.

    Parameters
    ----------
    found : ExtendedModel
        Of the file, beside a fleet's law.
    healthy : sequence of sequences of Record
        As read, file by file.

    Returns
    -------
    dict of str to dict
        By cause: ``names`` and ``units`` of its strengths, ``here`` their values, ``healthy`` a list of them for each
        healthy file.
    """
    composition, absent = found.composition, found.vector.copy()
    own = {}
    if isinstance(composition.baseline, ComposedBaseline):
        inner = composition.baseline.inner
        own = inner.by_effect(found.vector)
    for e, p in zip(composition.effects, composition.places, strict=True):
        count = e.strengths
        absent[p][:count] = own[e.name][:count] if e.name in own else e.neutral[:count]
    fits = [_refit(composition, [found.vector, absent], records) for records in healthy]
    return {e.name: {"names": [q.name for q in e.parameters[: e.strengths]],
                     "units": [q.unit for q in e.parameters[: e.strengths]],
                     "here": found.vector[p][: e.strengths].tolist(),
                     "healthy": [f[p][: e.strengths].tolist() for f in fits]}
            for e, p in zip(composition.effects, composition.places, strict=True)}


def _refit(composition: Composition, starts: Sequence[np.ndarray], records: Sequence[Record]) -> np.ndarray:
    """Parameters of the best rough refit from these starts, on the thinned samples of a search."""
    from lpvid.diagnosis.evidence.thinning import search_problem
    from lpvid.diagnosis.refitting import refit
    from lpvid.diagnosis.task import prepare_task

    task = prepare_task(records, composition.baseline, composition.effects)
    problem, *_ = search_problem(task.prepared.training, composition.baseline)
    return min((refit(problem, composition, v, rough=True) for v in starts), key=lambda f: f.cost).vector
