"""Bernstein coefficients of matrix polynomials on boxes: statements that hold between grid points.

A polynomial lies in the convex hull of its Bernstein coefficients, and the coefficients at the corners are values of
the polynomial. A symmetric matrix polynomial whose coefficients are all positive definite is therefore positive
definite on the whole box; where that fails, the box is halved and the coefficients close in quadratically.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np


@lru_cache(maxsize=64)
def nodes(degree: int) -> np.ndarray:
    """(degree + 1,) Chebyshev-Lobatto points of [0, 1], both ends included; the middle alone for degree 0.

    Parameters
    ----------
    degree : int
        Of the polynomial, at least 0.

    Returns
    -------
    (degree + 1,) array
        Rising, read-only.

    Examples
    --------
    >>> nodes(2)
    array([0. , 0.5, 1. ])
    """
    points = 0.5 * (1 - np.cos(np.pi * np.arange(degree + 1) / degree)) if degree else np.array([0.5])
    points.setflags(write=False)
    return points


@lru_cache(maxsize=64)
def from_nodes(degree: int) -> np.ndarray:
    """(degree + 1, degree + 1) matrix that turns values at `nodes` into Bernstein coefficients.

    Parameters
    ----------
    degree : int
        Of the polynomial, at least 0.

    Returns
    -------
    (degree + 1, degree + 1) array
        Read-only.

    Examples
    --------
    >>> from_nodes(2) @ nodes(2) ** 2
    array([0., 0., 1.])
    """
    t = nodes(degree)[:, None]
    j = np.arange(degree + 1)
    binomials = np.array([math.comb(degree, int(i)) for i in j], dtype=float)
    matrix = np.linalg.inv(binomials * t**j * (1 - t) ** (degree - j))
    matrix.setflags(write=False)
    return matrix


@lru_cache(maxsize=64)
def _halves(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """De Casteljau at 1/2 as two matrices: coefficients on the left and on the right half."""
    left = np.zeros((degree + 1, degree + 1))
    for i in range(degree + 1):
        left[i, : i + 1] = [math.comb(i, j) / 2.0**i for j in range(i + 1)]
    return left, left[::-1, ::-1].copy()


def coefficients(values: np.ndarray, axes: int) -> np.ndarray:
    """Bernstein coefficients from values at the tensor of `nodes`.

    Parameters
    ----------
    values : (boxes, d_1 + 1, …, d_axes + 1, …) array

    Returns
    -------
    array of the same shape
    """
    for axis in range(1, axes + 1):
        values = _along(from_nodes(values.shape[axis] - 1), values, axis)
    return values


def amplification(degrees: tuple[int, ...]) -> float:
    """How much `coefficients` can enlarge an error of the values: product of the matrices' infinity norms.

    Parameters
    ----------
    degrees : tuple of int
        Along every axis.

    Returns
    -------
    float
        At least 1.
    """
    return math.prod(float(np.abs(from_nodes(d)).sum(axis=1).max()) for d in degrees)


def split(boxes: np.ndarray, axis: int) -> np.ndarray:
    """Halve every box along one axis (1-based, after the box index); left halves first.

    Parameters
    ----------
    boxes : (boxes, d_1 + 1, …, d_axes + 1, …) array
        Bernstein coefficients.
    axis : int
        From 1.

    Returns
    -------
    (2·boxes, d_1 + 1, …, d_axes + 1, …) array
        Coefficients on the halves.
    """
    return np.concatenate([_along(half, boxes, axis) for half in _halves(boxes.shape[axis] - 1)])


@dataclass(frozen=True)
class Positivity:
    """Outcome of `positive`: proven (True), disproven (False) or undecided within the budget (None).

    Parameters
    ----------
    holds : bool or None
    bound : float
        Proven: a lower bound of the smallest eigenvalue over all boxes. Otherwise the smallest one seen at a corner.
    work : int
        Matrices whose eigenvalues were taken.
    """

    holds: bool | None
    bound: float
    work: int


def positive(boxes: np.ndarray, axes: int, *, above: float = 0.0, budget: int = 100_000,
             sharpness: float = 0.5) -> Positivity:
    """Decide whether symmetric matrix polynomials exceed `above`·I on their whole boxes, by adaptive halving.

    Parameters
    ----------
    boxes : (boxes, d_1 + 1, …, d_axes + 1, n, n) array
        Bernstein coefficients.
    above : float
        What the smallest eigenvalue must exceed.
    budget : int
        How many matrices may be examined.
    sharpness : float
        A proven bound is tightened, while the budget lasts, to this share of the smallest eigenvalue at a corner.

    Returns
    -------
    Positivity
        Undecided where the budget ran out.

    Examples
    --------
    >>> values = (nodes(2) - 0.5)[None, :, None, None] ** 2 + 0.1        # (t - 1/2)^2 + 0.1 on [0, 1]
    >>> positive(coefficients(values, 1), 1).holds
    True
    """
    n = boxes.shape[-1]
    corner = np.zeros(boxes.shape[1 : axes + 1], dtype=bool)
    for index in itertools.product(*({0, d - 1} for d in corner.shape)):
        corner[index] = True
    corner = corner.ravel()
    smallest, proven, work = math.inf, math.inf, 0
    while len(boxes):
        work += len(boxes) * corner.size
        if work > budget:
            return Positivity(None, smallest, work)
        eigenvalues = np.linalg.eigvalsh(boxes.reshape(-1, n, n))[:, 0].reshape(len(boxes), -1)
        smallest = min(smallest, float(eigenvalues[:, corner].min()))
        if not smallest > above:
            return Positivity(False, smallest, work)
        lowest = eigenvalues.min(axis=1)
        patient = 2 * len(boxes) * corner.size < budget // 8 - work
        done = lowest > (max(above, above + sharpness * (smallest - above)) if patient else above)
        proven = min(proven, float(lowest[done].min(initial=math.inf)))
        boxes = _refine(boxes[~done], axes)
    return Positivity(True, proven, work)


def _refine(boxes: np.ndarray, axes: int) -> np.ndarray:
    """Halve each box along the axis with the largest second difference, which is what keeps the hull wide."""
    if not len(boxes):
        return boxes
    bend = np.zeros((len(boxes), axes))
    for axis in range(axes):
        if boxes.shape[axis + 1] > 2:
            second = np.diff(boxes, n=2, axis=axis + 1).reshape(len(boxes), -1)
            bend[:, axis] = np.abs(second).max(axis=1) * (boxes.shape[axis + 1] - 1) ** 2
    chosen = bend.argmax(axis=1)
    return np.concatenate([split(boxes[chosen == axis], axis + 1) for axis in np.unique(chosen)])


def _along(matrix: np.ndarray, values: np.ndarray, axis: int) -> np.ndarray:
    """The matrix applied along one axis, by products of blocks as they lie in memory: nothing is transposed."""
    before, after = math.prod(values.shape[:axis]), math.prod(values.shape[axis + 1 :])
    made = matrix @ values.reshape(before, values.shape[axis], after)
    return made.reshape(*values.shape[:axis], len(matrix), *values.shape[axis + 1 :])
