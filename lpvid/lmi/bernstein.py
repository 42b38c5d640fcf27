"""Bernstein coefficients of matrix polynomials on boxes: statements that hold between grid points.

A polynomial lies in the convex hull of its Bernstein coefficients, and the coefficients at the corners are values of
the polynomial. A symmetric matrix polynomial whose coefficients are all positive definite is therefore positive
definite on the whole box; where that fails, the box is halved and the coefficients close in quadratically.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lpvid.lmi.certificate import EPS

FACTORED = 10
"""Rows from which a group of ten matrices takes less time to factor than its eigenvalues take: five times less at 12
rows, seven times at 25, as much at 4."""


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
    """Halve every box along one axis (1-based, after the box index); the left half of each before its right.

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
    before, size, after = math.prod(boxes.shape[1:axis]), boxes.shape[axis], math.prod(boxes.shape[axis + 1 :])
    made = np.concatenate(_halves(size - 1)) @ boxes.reshape(len(boxes) * before, size, after)
    made = made.reshape(len(boxes), before, 2, size, after).swapaxes(1, 2)
    return made.reshape(2 * len(boxes), *boxes.shape[1:])


@dataclass(frozen=True)
class Positivity:
    """Outcome of `positive`: proven (True), disproven (False) or undecided within the budget (None).

    Parameters
    ----------
    holds : bool or None
    bound : float
        Proven: a lower bound of the smallest eigenvalue over all boxes. Otherwise the smallest one seen at a corner.
    work : int
        Matrices that were examined.
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
    if len(boxes) * corner.size > budget:
        return Positivity(None, smallest, len(boxes) * corner.size)
    while len(boxes):
        work += len(boxes) * corner.size
        matrices = boxes.reshape(len(boxes), -1, n, n)
        if n < FACTORED:
            matrices = np.linalg.eigvalsh(matrices)[..., :1, None]
        smallest = _smallest(matrices[:, corner], smallest)
        if not smallest > above:
            return Positivity(False, smallest, work)
        affordable = 2 * len(boxes) * corner.size < budget // 8 - work
        level = max(above, above + sharpness * (smallest - above)) if affordable else above
        done = _exceed(matrices, level)
        proven = _smallest(matrices[done], proven)
        if corner.size == 1:  # constants, whose eigenvalues decide: halves of a cell would be no different
            return Positivity(True, smallest, work)
        left = 2 * int((~done).sum()) * corner.size
        if work + left > budget:
            return Positivity(None, smallest, work + left)
        boxes = _refine(boxes[~done], axes)
    return Positivity(True, proven, work)


def _exceed(groups: np.ndarray, level: float) -> np.ndarray:
    """Which of (M, k, n, n) groups of k symmetric matrices exceed level·I, all k of them.

    A Cholesky factorization of F − cI that comes to its end proves F ≻ cI less (n + 1)u tr(F − cI)/(1 − (n + 1)u) with
    u = ε/2, half the distance of 1 from the next number (Rump 2006, BIT 46, theorem 2.3).
    """
    n = groups.shape[-1]
    if n == 1:
        return np.asarray((groups > level).all(axis=(1, 2, 3)))
    if not math.isfinite(level):
        return np.full(len(groups), level < 0)
    diagonal, lowered = np.arange(n), groups.copy()
    sizes = np.abs(groups[..., diagonal, diagonal]).sum(axis=-1, keepdims=True) + n * abs(level)
    lowered[..., diagonal, diagonal] -= level + (n + 2) * EPS * sizes
    held = np.zeros(len(groups), dtype=bool)
    for i, group in enumerate(lowered):
        with contextlib.suppress(np.linalg.LinAlgError):
            np.linalg.cholesky(group)
            held[i] = True
    return held


def _smallest(groups: np.ndarray, known: float) -> float:
    """The smallest eigenvalue of (M, k, n, n) symmetric matrices where it lies below the known one, else that.

    Few groups lower it; only of these are eigenvalues taken.
    """
    if groups.shape[-1] == 1:
        return min(known, float(groups.min(initial=math.inf)))
    for group in groups[~_exceed(groups, known)]:
        if not _exceed(group[None], known)[0]:
            known = min(known, float(np.linalg.eigvalsh(group)[:, 0].min()))
    return known


def _refine(boxes: np.ndarray, axes: int) -> np.ndarray:
    """Halve each box along the axis with the largest second difference, which is what keeps the hull wide."""
    if not len(boxes):
        return boxes
    if axes == 1:
        return split(boxes, 1)
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
