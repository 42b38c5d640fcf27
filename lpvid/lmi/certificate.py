"""The outcome of a re-check with numpy alone, and the grids on which it falls back."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from lpvid.scheduling import Scheduling

EPS = float(np.finfo(float).eps)
GRID = {0: 1, 1: 201, 2: 31, 3: 11}  # points for each variable where a proof between them is out of reach


@dataclass(frozen=True)
class Recheck:
    """What numpy finds about a claim.

    Parameters
    ----------
    holds : bool
    between_grid : bool
        Proven on the whole box; otherwise on the points of a grid only.
    margin : float
        Smallest eigenvalue, after the congruence that makes P(centre) the identity and less a bound of the rounding
        error; a pure number in discrete time, 1/s in continuous time.
    why : str
        What failed, or how it was shown.
    """

    holds: bool
    between_grid: bool
    margin: float
    why: str


def grid(box: Scheduling, points: int) -> np.ndarray:
    """(N, variables) tensor grid over a box; a variable without width counts once.

    Parameters
    ----------
    box : Scheduling
        Ranges of the variables.
    points : int
        Values of each variable that has width, ends included.

    Returns
    -------
    (N, variables) array
        One row without columns for a box without variables.
    """
    return tensor([np.linspace(lo, up, points) if up > lo else np.array([lo])
                    for lo, up in zip(box.lower, box.upper, strict=True)])


def tensor(axes: list[np.ndarray]) -> np.ndarray:
    """(N, axes) all combinations of the values on several axes.

    Parameters
    ----------
    axes : list of arrays
        Values on each axis.

    Returns
    -------
    (N, axes) array
        The last axis runs fastest.
    """
    return np.array(list(itertools.product(*axes)), dtype=float).reshape(math.prod(map(len, axes)), len(axes))
