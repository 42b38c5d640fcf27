"""Is a symmetric matrix function positive definite on a whole box, and not only at points of it?

Along an axis the function is piecewise polynomial, which Bernstein coefficients decide, or trigonometric with highest
angular frequency Ω. On a cell of width h the interpolant at the m + 1 Chebyshev-Lobatto nodes then misses it by at most

    sup|F| · (Ω h / 2)^(m+1) · 2^(1−m) / (m + 1)!

for Bernstein's inequality bounds the derivatives, sup|F^(k)| ≤ Ω^k sup|F|; the interpolant is decided as above.

Along an axis with both, F is a sum of s(p)w(p) with a polynomial s of degree d on each piece and a wave w. With the
interpolant w' of w of degree m, sw' is a polynomial of degree d + m, which interpolation of that degree leaves as it
is: it misses F by at most 1 + Λ times the bound above, with Σ sup|s| sup|w| for sup|F| and its Lebesgue constant Λ.
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
WAVES = ((8, 1.0), (6, 0.16))
"""Degree m of the interpolant of a wave, and the widest cell [rad]. The first misses by 4e-11 sup|F|, on few cells; the
second by 1e-13, where a degree of two less also amplifies the rounding errors of the values four times less. Loops of
controllers in cubic splines need the second: at margins of 6e-8 and sup|F| of 15,000 (Wu et al. 1996)."""


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
        """Polynomial between breaks, trigonometric, or products of both."""
        return not self.opaque

    def nodes(self, wave: int = WAVES[0][0]) -> int:
        """Degree of the (interpolating) polynomial.

        Parameters
        ----------
        wave : int
            Degree of the interpolant of a wave.

        Returns
        -------
        int
        """
        return self.degree + (wave if self.frequency else 0)

    def cells(self, phase: float = WAVES[0][1]) -> list[tuple[float, float]]:
        """Intervals on each of which the function is one polynomial, or close to one.

        Parameters
        ----------
        phase : float
            Widest cell of a trigonometric axis [rad].

        Returns
        -------
        list of (float, float)
            Rising, from end to end.
        """
        tiny = 1e-12 * (self.high - self.low)
        edges = [self.low]
        edges += [b for b in sorted(self.breaks) if self.low + tiny < b < self.high - tiny]
        edges = [e for i, e in enumerate(edges) if i == 0 or e > edges[i - 1] + tiny] + [self.high]
        fine = [np.linspace(a, b, 1 + max(1, math.ceil(self.frequency * (b - a) / phase)))
                for a, b in itertools.pairwise(edges)]
        return [(float(a), float(b)) for part in fine for a, b in itertools.pairwise(part)]

    def miss(self, wave: int = WAVES[0][0], phase: float = WAVES[0][1]) -> float:
        """Largest |F − interpolant| on a cell, over sup|F|, or over Σ sup|s| sup|w| of products.

        Parameters
        ----------
        wave : int
            Degree of the interpolant of a wave.
        phase : float
            Widest cell of a trigonometric axis [rad].

        Returns
        -------
        float
            0 for a piecewise polynomial.
        """
        if not self.frequency:
            return 0.0
        width = max(b - a for a, b in self.cells(phase))
        missed = (self.frequency * width / 2) ** (wave + 1) * 2.0 ** (1 - wave) / math.factorial(wave + 1)
        return missed * (1 + lebesgue(self.nodes(wave))) if self.degree else missed


def lebesgue(degree: int) -> float:
    """Bound of the Lebesgue constant of Chebyshev-Lobatto nodes (Trefethen 2013, theorem 15.2).

    Parameters
    ----------
    degree : int
        Of the interpolant.

    Returns
    -------
    float
        1 + 2/π log(degree + 1).
    """
    return 1 + 2 / math.pi * math.log(degree + 1)


def everywhere(evaluate: Evaluate, points: Sequence[Axis], moves: Sequence[Axis], *, ceiling: float = math.inf,
               budget: int = 100_000, sharpness: float = 0.5) -> bernstein.Positivity:
    """Decide F ≻ 0 on the product of two boxes, one of points and one of moves.

    Parameters
    ----------
    evaluate : callable
        (N, s) points and (T, t) moves to ((N, T, n, n) values, bound of their rounding errors).
    points, moves : sequence of Axis
    ceiling : float
        Bound of the largest absolute row sum of F, where an axis is trigonometric: of the sum of the products of the
        bounds of its factors.
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
    if not all(a.decidable for a in (*points, *moves)):
        return bernstein.Positivity(None, math.nan, 0)
    found = bernstein.Positivity(None, math.nan, 0)
    for wave in WAVES if any(a.frequency for a in (*points, *moves)) else WAVES[:1]:
        found = _decided(evaluate, points, moves, wave, ceiling, budget, sharpness)
        if found.holds is not None:
            break
    return found


def _decided(evaluate: Evaluate, points: Sequence[Axis], moves: Sequence[Axis], wave: tuple[int, float],
             ceiling: float, budget: int, sharpness: float) -> bernstein.Positivity:
    """With interpolants of waves of one degree on cells of one width."""
    axes = [*points, *moves]
    cells, shifts = ([list(c) for c in itertools.product(*(a.cells(wave[1]) for a in group))]
                     for group in (points, moves))
    nodes = [a.nodes(wave[0]) for a in axes]
    if len(cells) * len(shifts) * math.prod(d + 1 for d in nodes) > budget:
        return bernstein.Positivity(None, math.nan, 0)
    unit, ticks = (tensor([bernstein.nodes(a.nodes(wave[0])) for a in group]) for group in (points, moves))
    where = _placed(cells, unit)
    parts, error = [], 0.0
    for shift in shifts:
        values, off = evaluate(where.reshape(len(cells) * len(unit), len(points)), _placed([shift], ticks)[0])
        n, error = values.shape[-1], max(error, off)
        parts.append(values.reshape(len(cells), *(d + 1 for d in nodes), n, n))
    rounding = error * bernstein.amplification(tuple(nodes))
    missed = sum(a.miss(*wave) for a in axes)
    if missed:
        constants = [lebesgue(d) for d in nodes]
        rounding += ceiling * missed * math.prod(constants) / min(constants)
    found = bernstein.positive(bernstein.coefficients(np.concatenate(parts), len(axes)), len(axes), above=rounding,
                               budget=budget, sharpness=sharpness)
    holds = found.holds
    if holds is False and found.bound > -rounding:
        # a corner of a halved cell is a value of the interpolant; one of F itself is off by its own rounding alone
        nodes_lowest = min(float(np.linalg.eigvalsh(part)[..., 0].min()) for part in parts)
        holds = None if nodes_lowest > error else False
    return bernstein.Positivity(holds, found.bound - rounding, found.work)


def _placed(cells: list, unit: np.ndarray) -> np.ndarray:
    """(cells, nodes, axes) nodes of the unit cube moved into each cell, and not past its end by rounding: there another
    piece begins, and the slope of a spline ends."""
    ends = np.array(cells, dtype=float).reshape(len(cells), unit.shape[1], 2)
    placed = ends[:, None, :, 0] + unit[None] * (ends[:, :, 1] - ends[:, :, 0])[:, None, :]
    return np.minimum(placed, ends[:, None, :, 1])
