"""The outcome of a re-check with numpy alone, and the grids on which it falls back."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
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


def tensor(axes: Sequence[np.ndarray]) -> np.ndarray:
    """(N, axes) all combinations of the values on several axes.

    Parameters
    ----------
    axes : sequence of arrays
        Values on each axis.

    Returns
    -------
    (N, axes) array
        The last axis runs fastest.
    """
    return np.array(list(itertools.product(*axes)), dtype=float).reshape(math.prod(map(len, axes)), len(axes))


def diagonal(*parts: np.ndarray) -> np.ndarray:
    """Matrices, or stacks of them, along a diagonal; those without rows or columns keep their place.

    Parameters
    ----------
    *parts : (…, m, n) arrays
        Of any shape; leading axes that can be broadcast.

    Returns
    -------
    (…, M, N) array
        M rows and N columns in all.

    Examples
    --------
    >>> diagonal(np.ones((1, 2)), np.ones((2, 0))).shape
    (3, 2)
    """
    rows, columns = (np.cumsum([0, *(p.shape[axis] for p in parts)]) for axis in (-2, -1))
    leading = np.broadcast_shapes(*(p.shape[:-2] for p in parts))
    found = np.zeros((*leading, rows[-1], columns[-1]), dtype=np.result_type(float, *parts))
    for part, i, j in zip(parts, rows, columns, strict=False):
        found[..., i : i + part.shape[-2], j : j + part.shape[-1]] = part
    return found
