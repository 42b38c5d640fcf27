"""What a basis reads: each scheduling variable at each delay, its degree, and where its pieces meet."""

from __future__ import annotations

import numpy as np

from lpvid.scheduling import Basis, Scheduling
from lpvid.scheduling.reading import Reading


def reading_weights(basis: Basis, readings: tuple[Reading, ...], points: np.ndarray) -> np.ndarray:
    """(K, M + 1) values of a basis, and 1, where the readings have the values `points` of shape (K, len(readings)).

    Parameters
    ----------
    basis : Basis
        M functions.
    readings : tuple of Reading
        Each variable at each delay; those that the basis does not read do not count.
    points : (K, len(readings)) array
        In the variables' units.

    Returns
    -------
    (K, M + 1) array
        The last column is 1.
    """
    names = basis.names
    lags = [r.lag for r in readings]
    ahead, back = max([0, *(-lag for lag in lags)]), max([0, *lags])
    path = np.zeros((len(points), back + 1 + ahead, len(names)))
    for column, reading in enumerate(readings):
        if reading.name in names:
            path[:, back - reading.lag, names.index(reading.name)] = points[:, column]
    phi = basis.evaluate(path.reshape(len(points) * (back + 1 + ahead), len(names)))[back :: back + 1 + ahead]
    return np.hstack([phi, np.ones((len(points), 1))])


def box_of(readings: tuple[Reading, ...], scheduling: Scheduling) -> Scheduling:
    """Box and rate bounds of what is read, one entry for each reading; a delayed copy has those of its variable.

    Parameters
    ----------
    readings : tuple of Reading
        Of variables in the scheduling.
    scheduling : Scheduling
        With ranges, rates and units.

    Returns
    -------
    Scheduling
        In the order of the readings, named by their labels.
    """
    index = [scheduling.names.index(r.name) for r in readings]
    return Scheduling(tuple(r.label for r in readings), *(tuple(getattr(scheduling, field)[i] for i in index)
                                                          for field in ("lower", "upper", "rate", "units")))
