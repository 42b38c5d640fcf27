"""Estimate: what a model's own way of estimating hands back to `fit`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

D = TypeVar("D")
"""the kind of damper"""


@dataclass(frozen=True)
class Starts:
    """How a multi-start search went.

    Attributes
    ----------
    searched : int
        Starts tried on shortened data.
    polished : int
        Different minima among them that were followed to their end on all data.
    agreed : int
        Starts that led to the least cost.
    """

    searched: int
    polished: int
    agreed: int

    def __str__(self) -> str:
        return f"{self.agreed} of {self.searched} starts agree on the best cost ({self.polished} followed on all data)"


@dataclass(frozen=True, eq=False)
class Estimate(Generic[D]):
    """A damper with its parameters estimated, and what is known of them.

    Attributes
    ----------
    damper : D
        With the estimated values.
    covariance : (P, P) array or None
        Of the parameters in the order of `damper.names`, SI; NaN in the rows and columns of parameters held at a bound;
        None where there is none.
    at_bounds : tuple of str
        Parameters that ended at a bound and were held there.
    undetermined : tuple of str
        A sentence for each combination of parameters that the data do not determine.
    unidentified : tuple of str
        Parameters not identifiable from the data: neither value nor standard error is a statement on the damper.
    notes : tuple of str
    starts : Starts or None
        None where the estimate needs no starting values.
    condition : float or None
        Condition number of the scaled sensitivities.
    """

    damper: D
    covariance: np.ndarray | None = None
    at_bounds: tuple[str, ...] = ()
    undetermined: tuple[str, ...] = ()
    unidentified: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    starts: Starts | None = None
    condition: float | None = None
