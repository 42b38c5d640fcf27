"""Nameless functions of the inputs: what they explain in the place of a cause, and beyond all causes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from lpvid import _checks
from lpvid.diagnosis.problem import DiagnosisProblem, projector, without
from lpvid.diagnosis.refitting import Refit
from lpvid.diagnosis.remainder import hats, knots_of
from lpvid.diagnosis.signals import Signals

PLAYS = (0.05, 0.1, 0.2, 0.3)
"""half widths of the plays, as shares of an input's range"""
SOFT = 0.02
"""width of the soft sign, as a share of an input's range"""
WITHIN = 0.1
"""share of what a cause wins that functions may miss and still count as doing its work"""
BEYOND = 0.05
"""share of what all causes win that the same functions must explain beyond them for the cause to lose its name: what
misses a twentieth of the likelihood is no name for it"""
CHANCE = 3.0
"""standard deviations above its mean of what functions explain of noise"""
NEW = 1e-9
"""share of a function beyond what parameters can do, below which it is rounding"""


class Nameless:
    """Plays and low powers of one input or of two: a hysteresis or a bent characteristic, whatever makes it.

    Of one input x, measured from its mean in parts of its range: x, x², x³, its soft sign, and plays of several widths,
    which remember where it turned (Prandtl's and Ishlinskii's model: Krasnoselskii, Pokrovskii 1989). Of two, x and y:
    those of each, x y, x² y, x y², and the soft sign of either times the first three powers of the other. An effect
    that they replace, and that leaves them much to explain, has the right direction and the wrong name: a spring does
    most of what a mass does that is dragged along by friction. They cannot tell whether what is left belongs to the
    same thing; a spring beside something unknown that depends on position, too, is a spring of no known form.

    Parameters
    ----------
    problem : Problem
    channels : sequence of str
        Inputs.
    """

    def __init__(self, problem: DiagnosisProblem, channels: Sequence[str]) -> None:
        joined = {c: np.concatenate([s[c] for s in problem.signals]) for c in channels}
        self._problem = problem
        self._scales = {c: (float(x.mean()), float(np.ptp(x))) for c, x in joined.items()
                        if np.ptp(x) > NEW * np.abs(x).max()}
        self.families = [(c,) for c in self._scales] + list(combinations(self._scales, 2))
        self._known: dict[Refit, np.ndarray] = {}
        self._gains: dict[tuple[Refit, tuple[str, ...]], tuple[float, float]] = {}

    def gain(self, fit: Refit, family: tuple[str, ...]) -> tuple[float, float]:
        """By how much those of one input or two lower the cost of a fit, to first order, and what of that may be noise.

        With U an orthonormal basis of what the fit's parameters leave of them and e its errors: |Uᵀe|². For noise whose
        blocks are independent its mean is Σ_b |U_bᵀe_b|², taken to be not below the number of functions times the
        variance, and its distribution about that of χ², whose `CHANCE` standard deviations are added.
        """
        if (fit, family) not in self._gains:
            if fit not in self._known:
                self._known[fit] = projector(fit.jacobian)
            columns = self._problem.stack([self._functions(s, family) for s in self._problem.signals])
            self._gains[fit, family] = _gain(self._problem, fit, self._known[fit], columns)
        return self._gains[fit, family]

    def do_the_work(self, fit: Refit, rest: Refit) -> tuple[tuple[str, ...], ...]:
        """Families that do the work of a cause: the set without it and they come within `WITHIN` of what it wins."""
        won = rest.cost - fit.cost
        return tuple(family for family in self.families
                     if won + self.gain(fit, family)[0] - self.gain(rest, family)[0] < WITHIN * won)

    def beyond(self, bare: Refit, fit: Refit, rest: Refit) -> float:
        """What functions that do the work of a cause surely explain beyond the whole set; 0 where none do its work.

        Parameters
        ----------
        bare, fit, rest : Refit
            The baseline; the set; the set without the cause.

        Returns
        -------
        float
            As a share of what the set wins over the baseline.
        """
        surely = [gained - by_chance for gained, by_chance in (self.gain(fit, f) for f in self.do_the_work(fit, rest))]
        return max([0.0, *surely]) / max(bare.cost - fit.cost, fit.variance)

    def _functions(self, s: Signals, family: tuple[str, ...]) -> np.ndarray:
        """(n, k) values along a record."""
        from lpvid.diagnosis.play_kernel import play

        columns, scaled = [], []
        for c in family:
            mean, span = self._scales[c]
            x = np.ascontiguousarray((s[c] - mean) / span)
            scaled.append(x)
            columns += [x, x**2, x**3, np.tanh(x / SOFT)]
            for half_width in PLAYS:
                columns.append(np.empty(x.size))
                play(_checks.read_only(x), half_width, columns[-1])
        for x, y in combinations(scaled, 2):
            columns += [x * y, x**2 * y, x * y**2]
            columns += [np.tanh(a / SOFT) * b**k for a, b in ((x, y), (y, x)) for k in (1, 2, 3)]
        return np.column_stack(columns)


def static_in_place(problem: DiagnosisProblem, fit: Refit, rest: Refit, channels: Sequence[str]) -> bool:
    """Whether functions of the present value of each of some inputs do the work of a cause, to within `WITHIN`.

    Piecewise linear ones, added to the force, turned round with the velocity, where there is one, and times it: what a
    form of those inputs may have missed.
    """
    knots = {c: knots_of(np.concatenate([s[c] for s in problem.signals])) for c in channels}
    columns = problem.stack([_static(s, knots) for s in problem.signals])
    won = rest.cost - fit.cost
    gained, instead = (_gain(problem, f, projector(f.jacobian), columns)[0] for f in (fit, rest))
    return columns.size > 0 and won > 0 and won + gained - instead < WITHIN * won


def _static(s: Signals, knots: Mapping[str, np.ndarray]) -> np.ndarray:
    """(n, k) hats along a record."""
    columns = np.hstack([np.empty((s.n_samples, 0)), *(hats(s[c], at) for c, at in knots.items())])
    if not s.has("velocity"):
        return columns
    v = s["velocity"] / max(float(np.ptp(s["velocity"])), 1e-300)
    return np.hstack([columns, columns * np.tanh(v / SOFT)[:, None], columns * v[:, None]])


def _gain(problem: DiagnosisProblem, fit: Refit, known: np.ndarray, columns: np.ndarray) -> tuple[float, float]:
    """By how much columns lower the cost of a fit beyond its own derivatives `known`, and what of that may be noise."""
    norms = np.linalg.norm(columns, axis=0)
    left = without(known, columns)
    basis = projector(left[:, np.linalg.norm(left, axis=0) > NEW * norms])
    scores, size = problem.block_sums(basis * fit.errors[:, None]), max(basis.shape[1], 1)
    mean, total = max(float(np.sum(scores**2)), size * fit.variance), scores.sum(axis=0)
    return float(total @ total), mean * (1 + CHANCE * np.sqrt(2 / size))
