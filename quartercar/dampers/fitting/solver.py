"""The search over a damper's parameters: damped least squares in the coordinates of a view, inside their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from lpvid.least_squares import DenseResiduals, GainRatio, SearchEnd, StopRule, Trial, minimise_dense
from quartercar.dampers.parameter import Parameter


class SearchCoordinates:
    """Parameters in the coordinates of a search.

    Attributes
    ----------
    log : (k,) bool array
        Those that move by their logarithm.
    lower, upper : (k,) array
        Bounds, in these coordinates.

    Examples
    --------
    >>> place = SearchCoordinates([Parameter("slope", "s/m", "A_3", 20.0, 0.1, 1000.0, log=True)])
    >>> place.values(place.of(np.array([20.0]))).round(9).tolist(), place.slope(np.array([20.0])).tolist()
    ([20.0], [20.0])
    """

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.log = np.array([p.log for p in parameters], dtype=bool)
        self._least = np.array([p.lower for p in parameters], dtype=float)
        self._most = np.array([p.upper for p in parameters], dtype=float)
        self.lower, self.upper = self._moved(self._least), self._moved(self._most)

    def _moved(self, theta: np.ndarray) -> np.ndarray:
        out = np.array(theta, dtype=float)
        out[self.log] = np.log(out[self.log])
        return out

    def of(self, theta: np.ndarray) -> np.ndarray:
        """Coordinates of parameters, brought inside the bounds.

        Parameters
        ----------
        theta : (k,) array
            Parameters, SI.

        Returns
        -------
        (k,) array
            Logarithms where `log` is true.
        """
        return self._moved(np.clip(theta, self._least, self._most))

    def values(self, point: np.ndarray) -> np.ndarray:
        """Parameters at a point, inside the bounds to the last digit.

        Parameters
        ----------
        point : (k,) array
            Coordinates; at or beyond a bound the bound itself is returned.

        Returns
        -------
        (k,) array
            Parameters, SI.
        """
        out = np.array(point, dtype=float)
        out[self.log] = np.exp(np.minimum(out[self.log], 700.0))
        out[point <= self.lower] = self._least[point <= self.lower]
        out[point >= self.upper] = self._most[point >= self.upper]
        return np.clip(out, self._least, self._most)

    def slope(self, theta: np.ndarray) -> np.ndarray:
        """(k,) derivative of the parameters in their coordinates.

        Parameters
        ----------
        theta : (k,) array
            Parameters, SI.

        Returns
        -------
        (k,) array
            The parameter itself where `log` is true, else 1.
        """
        return np.where(self.log, theta, 1.0)


ROUNDING = 1e-13
"""a predicted decrease below this share of the cost cannot be separated from rounding."""

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
    stop = StopRule(tolerance, evaluations=evaluations, least_decrease=max(ROUNDING, 0.01 * tolerance),
                    refused=tolerance)
    place = problem.coordinates
    reach = np.where(place.log, -np.log(np.finfo(float).eps), np.inf)  # farther, a number adds nothing to its equals
    bounds = np.maximum(place.lower, start - reach), np.minimum(place.upper, start + reach)
    return minimise_dense(problem, start, stop, bounds, GainRatio(least=1e-14))
