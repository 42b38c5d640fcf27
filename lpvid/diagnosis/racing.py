"""Racing: one refit from several starts, of which the worse half stays behind after every few iterations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, descent, hopped_on

HEATS, HEAT = 3, 2
"""how often the worse half is left behind, and the iterations in between: as many in all as a first refit has"""


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a law that explodes loses by its cost
def race(problem: DiagnosisProblem, composition: Composition, begun: Sequence[tuple[np.ndarray, Refit | None]],
         hopping: bool = True) -> Refit:
    """The best of a few rough steps from several starts.

    Parameters
    ----------
    problem : Problem
    composition : Composition
    begun : sequence of ((P,) array, Refit or None)
        At least one start, each with a refit of a related composition whose derivatives serve until they fail. The
        same start twice is run once.
    hopping : bool
        Whether lags of whole samples and lost motion are moved by trial at the end.

    Returns
    -------
    Refit
    """
    low, high = composition.bounds
    distinct = {np.clip(start, low, high).tobytes(): (start, near) for start, near in begun}
    ways = [descent(problem, composition, start, near=near, rough=True) for start, near in distinct.values()]
    running = [(next(way), way) for way in ways]
    for heat in range(HEATS):
        if heat:
            running = sorted(running, key=lambda r: r[0].cost)[: (len(running) + 1) // 2]
        running = [([fit, *islice(way, HEAT)][-1], way) for fit, way in running]
    best = min((fit for fit, _ in running), key=lambda f: f.cost)
    return hopped_on(best, HEATS * HEAT, rough=True) if hopping else best
