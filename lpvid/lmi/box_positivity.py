"""Is a symmetric matrix function positive definite on a whole box, and not only at points of it?

Along an axis the function is piecewise polynomial, which Bernstein coefficients decide, or trigonometric with highest
angular frequency Ω. On a cell of width h the interpolant at the m + 1 Chebyshev-Lobatto nodes then misses it by at most

    sup|F| · (Ω h / 2)^(m+1) · 2^(1−m) / (m + 1)!

for Bernstein's inequality bounds the derivatives, sup|F^(k)| ≤ Ω^k sup|F|; the interpolant is decided as above.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.lmi import bernstein
from lpvid.lmi.certificate import tensor

Evaluate = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, float]]
WAVE_DEGREE = 8
PHASE = 1.0  # widest cell of a trigonometric axis [rad]


@dataclass(frozen=True)
class Axis:
    """One variable: its interval, and the degree between breaks or the highest angular frequency of the dependence.

    `opaque` marks a dependence of which neither is known.

    Parameters
    ----------
    low, high : float
        Ends of the interval, in the variable's unit.
    degree : int
        Highest power between breaks.
    breaks : tuple of float
        Where pieces meet; those outside the interval do not count.
    frequency : float
        Highest angular frequency [rad per unit of the variable]; 0 for a piecewise polynomial.
    opaque : bool
        Neither degree nor frequency holds.
    """

    low: float
    high: float
    degree: int = 0
    breaks: tuple[float, ...] = ()
    frequency: float = 0.0
    opaque: bool = False

    @property
    def decidable(self) -> bool:
        """Polynomial or trigonometric; a product of both along one axis is neither."""
        return not (self.opaque or (self.degree and self.frequency))

    @property
    def nodes(self) -> int:
        """Degree of the (interpolating) polynomial."""
        return WAVE_DEGREE if self.frequency else self.degree

    def cells(self) -> list[tuple[float, float]]:
        """Intervals on each of which the function is one polynomial, or close to one.

        Returns
        -------
        list of (float, float)
            Rising, from end to end; of a trigonometric axis no wider than `PHASE`.
        """
        tiny = 1e-12 * (self.high - self.low)
        edges = [self.low]
        edges += [b for b in sorted(self.breaks) if self.low + tiny < b < self.high - tiny]
        edges = [e for i, e in enumerate(edges) if i == 0 or e > edges[i - 1] + tiny] + [self.high]
        fine = [np.linspace(a, b, 1 + max(1, math.ceil(self.frequency * (b - a) / PHASE)))
                for a, b in itertools.pairwise(edges)]
        return [(float(a), float(b)) for part in fine for a, b in itertools.pairwise(part)]

    @property
    def miss(self) -> float:
        """Largest |F − interpolant| on a cell, over sup|F|."""
        if not self.frequency:
            return 0.0
        width = max(b - a for a, b in self.cells())
        m = WAVE_DEGREE
        return (self.frequency * width / 2) ** (m + 1) * 2.0 ** (1 - m) / math.factorial(m + 1)


def everywhere(evaluate: Evaluate, points: Sequence[Axis], moves: Sequence[Axis], *, ceiling: float = math.inf,
               budget: int = 100_000, sharpness: float = 0.5) -> bernstein.Positivity:
    """Decide F ≻ 0 on the product of two boxes, one of points and one of moves.

    Parameters
    ----------
    evaluate : callable
        (N, s) points and (T, t) moves to ((N, T, n, n) values, bound of their rounding errors).
    points, moves : sequence of Axis
    ceiling : float
        Bound of the largest absolute row sum of F, where an axis is trigonometric.
    budget : int
        Matrices that may be examined.
    sharpness : float
        As in `bernstein.positive`.

    Returns
    -------
    bernstein.Positivity
        Its bound is already less the errors of rounding and interpolation.

    Examples
    --------
    >>> def wave(p, moves):
    ...     return (1.1 + np.cos(p))[:, :, None, None], 1e-15
    >>> circle = Axis(0.0, 6.3, frequency=1.0)
    >>> everywhere(wave, [circle], [], ceiling=2.1).holds
    True
    >>> everywhere(lambda p, moves: (0.99 + np.cos(p[:, :, None, None]), 1e-15), [circle], [], ceiling=2.1).holds
    False
    """
    axes = [*points, *moves]
    if not all(a.decidable for a in axes):
        return bernstein.Positivity(None, math.nan, 0)
    cells, shifts = ([list(c) for c in itertools.product(*(a.cells() for a in group))] for group in (points, moves))
    nodes = [a.nodes for a in axes]
    if len(cells) * len(shifts) * math.prod(d + 1 for d in nodes) > budget:
        return bernstein.Positivity(None, math.nan, 0)
    unit, ticks = (tensor([bernstein.nodes(a.nodes) for a in group]) for group in (points, moves))
    where = _placed(cells, unit)
    parts, rounding = [], 0.0
    for shift in shifts:
        values, error = evaluate(where.reshape(len(cells) * len(unit), len(points)), _placed([shift], ticks)[0])
        n, rounding = values.shape[-1], max(rounding, error)
        parts.append(values.reshape(len(cells), *(d + 1 for d in nodes), n, n))
    rounding *= bernstein.amplification(tuple(nodes))
    missed = sum(a.miss for a in axes)
    if missed:
        rounding += ceiling * missed * 3.0 ** (len(axes) - 1)  # Lebesgue constant of 9 Lobatto nodes: below 3
    found = bernstein.positive(bernstein.coefficients(np.concatenate(parts), len(axes)), len(axes), above=rounding,
                               budget=budget, sharpness=sharpness)
    return bernstein.Positivity(found.holds, found.bound - rounding, found.work)


def _placed(cells: list, unit: np.ndarray) -> np.ndarray:
    """(cells, nodes, axes) nodes of the unit cube moved into each cell."""
    ends = np.array(cells, dtype=float).reshape(len(cells), unit.shape[1], 2)
    return ends[:, None, :, 0] + unit[None] * (ends[:, :, 1] - ends[:, :, 0])[:, None, :]
