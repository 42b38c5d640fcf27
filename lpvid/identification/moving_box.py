"""A regression in one pass although the range of its scheduling is not known yet: R follows the box exactly."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lpvid.identification.arx import ARX
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Scheduling


def can_follow(arx: ARX) -> bool:
    """Whether the regressors of one box are a linear map of those of another.

    So they are for monomials of bounded total degree, which any change of origin and scale leaves in their own space.

    Parameters
    ----------
    arx : ARX

    Returns
    -------
    bool
    """
    return type(arx.basis) is Polynomial and bool(arx.basis.names)


def carried_over(r: np.ndarray, places: np.ndarray, old: Polynomial, new: Polynomial) -> np.ndarray:
    """R of the rows behind `r`, had they been written in the other normalisation.

    X' = X·M, with the change of basis G in the columns of each lag and signal, so that R' is the R of R·M: the rows are
    not needed again. Where the box grew, M amplifies nothing (`Polynomial.change_to`), and R' is as exact as R.

    Parameters
    ----------
    r : (columns + outputs, columns + outputs) array
        R of [X Y].
    places : (columns, 4) array
        Part, lag, signal and basis function of each column, as `ARX.places` gives them.
    old, new : Polynomial

    Returns
    -------
    (columns + outputs, columns + outputs) array
    """
    change = np.eye(r.shape[0])
    of_functions = old.change_to(new)
    column = {tuple(place): q for q, place in enumerate(places.tolist())}
    for (part, lag, signal, function), q in column.items():
        change[: len(column), q] = 0.0
        for f in range(old.size):
            # later affine terms leave the constant to the first one, whose column it is
            at = column.get((part, lag, signal, f), column.get((part, 0, signal, f)))
            assert at is not None
            change[at, q] += of_functions[f, function]
    return np.asarray(np.linalg.qr(r @ change, mode="r"))


@dataclass
class MovingBox:
    """The range of the scheduling seen so far, and the structure bound to it.

    Attributes
    ----------
    arx : ARX
        With the basis not bound.
    low, high : (n_variables,) arrays
    units : tuple of str
    """

    arx: ARX
    low: np.ndarray
    high: np.ndarray
    units: tuple[str, ...] = ()

    @classmethod
    def of(cls, arx: ARX) -> MovingBox:
        """Nothing seen yet.

        Parameters
        ----------
        arx : ARX

        Returns
        -------
        MovingBox
        """
        count = len(arx.basis.names)
        return cls(arx, np.full(count, np.inf), np.full(count, -np.inf))

    def grown(self, piece: Record) -> bool:
        """Take a piece's range in.

        Parameters
        ----------
        piece : Record

        Returns
        -------
        bool
            Whether the box changed.
        """
        names = self.arx.basis.names
        self.units = self.units or tuple(piece.unit(n) for n in names)
        low = np.minimum(self.low, [piece[n].min() for n in names])
        high = np.maximum(self.high, [piece[n].max() for n in names])
        changed = bool((low < self.low).any() or (high > self.high).any())
        self.low, self.high = low, high
        return changed

    @property
    def box(self) -> Scheduling:
        """Around all that was seen."""
        return Scheduling(self.arx.basis.names, tuple(self.low.tolist()), tuple(self.high.tolist()), units=self.units)

    @property
    def bound(self) -> ARX:
        """The structure with its basis normalised to the box."""
        return replace(self.arx, basis=self.arx.basis.bound(self.box))
