"""The search over a damper's parameters: damped least squares in the coordinates of a view, inside their bounds."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from lpvid.least_squares import DenseResiduals, GainRatio, SearchEnd, StopRule, Trial, minimise_dense
from quartercar.dampers.fitting.coordinates import SearchCoordinates

ROUNDING = 1e-13
"""a promised decrease below this share of the cost cannot be separated from rounding."""

DamperSearchEnd = SearchEnd[Trial, Any]


class SearchResiduals(DenseResiduals, Protocol):
    """What a search minimises: residuals [N] in coordinates that have bounds."""

    coordinates: SearchCoordinates


def search_law(problem: SearchResiduals, start: np.ndarray, evaluations: int, tolerance: float
               ) -> DamperSearchEnd | None:
    """Least squares within bounds; None where the start itself diverges.

    Parameters
    ----------
    problem : SearchResiduals
    start : (k,) array
        Inside the bounds.
    evaluations : int
        Residuals computed, at most.
    tolerance : float
        Stop when two steps running lower the cost by less than this share.

    Returns
    -------
    SearchEnd or None
    """
    stop = StopRule(tolerance, evaluations=evaluations, promise=max(ROUNDING, 0.01 * tolerance), refused=tolerance)
    place = problem.coordinates
    return minimise_dense(problem, start, stop, (place.lower, place.upper), GainRatio(least=1e-14))
