"""Nameless functions of the inputs: what they explain in the place of a cause, and beyond it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.problem import Problem, projector, without
from lpvid.diagnosis.refitting import Refit
from lpvid.diagnosis.signals import Signals

PLAYS = (0.05, 0.1, 0.2, 0.3)
"""half widths of the plays, as shares of an input's range"""
WITHIN = 0.1
"""share of what a cause wins that nameless functions may miss and still count as doing what it does"""
BEYOND = 0.06
"""share of what all causes win that nameless functions must explain beyond them for those that they replace to lose
their names: an entry that misses a twentieth of the likelihood is no name for it"""
CHANCE = 3.0
"""standard deviations above its mean of what nameless functions explain of noise"""


class Nameless:
    """Plays and low powers of the inputs: hysteresis and bent characteristics, whatever makes them.

    With x, y any two inputs about their means: x, x y, x² y, and plays of x of several widths, which remember where it
    turned (Prandtl's and Ishlinskii's model: Krasnoselskii, Pokrovskii 1989). An effect whose work these do better has
    the right direction and the wrong name: a spring does most of what a mass does that is dragged along by friction.

    Parameters
    ----------
    problem : Problem
    channels : sequence of str
        Inputs.
    """

    def __init__(self, problem: Problem, channels: Sequence[str]) -> None:
        spans = {c: float(np.ptp(np.concatenate([s[c] for s in problem.signals]))) for c in channels}
        self._spans = {c: span for c, span in spans.items() if span > 0}
        self._problem = problem
        self._columns = problem.stack([self._functions(s) for s in problem.signals])

    def _functions(self, s: Signals) -> np.ndarray:
        """(n, k) values along a record."""
        from lpvid.diagnosis._play_kernel import play

        columns = []
        for c, span in self._spans.items():
            x = np.ascontiguousarray(s[c], dtype=float)
            for share in PLAYS:
                columns.append(np.empty(x.size))
                play(x, share * span, columns[-1])
        z = [(s[c] - s[c].mean()) / span for c, span in self._spans.items()]
        columns += z
        columns += [x * y for k, x in enumerate(z) for y in z[k:]]
        columns += [x * x * y for x in z for y in z]
        return np.column_stack(columns) if columns else np.zeros((s.n_samples, 0))

    def gain(self, fit: Refit) -> tuple[float, float]:
        """By how much they lower the cost of a fit, to first order, and what of that noise may account for.

        With U an orthonormal basis of what the fit's parameters leave of them and e its errors: |Uᵀe|², and its
        expectation for noise whose blocks are independent, Σ_b |U_bᵀe_b|², not below the number of functions, plus
        `CHANCE` standard deviations.
        """
        if not self._columns.shape[1]:
            return 0.0, 0.0
        basis = projector(without(projector(fit.jacobian), self._columns))
        scores = self._problem.block_sums(basis * fit.errors[:, None])
        size = basis.shape[1]
        by_chance = max(float(np.sum(scores**2)), size * fit.variance) + CHANCE * np.sqrt(2 * size) * fit.variance
        total = scores.sum(axis=0)
        return float(total @ total), by_chance

    def share(self, bare: Refit, fit: Refit) -> float:
        """What they surely explain beyond all causes, as a share of what these win over the baseline."""
        gained, by_chance = self.gain(fit)
        return max(gained - by_chance, 0.0) / max(bare.cost - fit.cost, fit.variance)

    def replaces(self, fit: Refit, rest: Refit) -> bool:
        """Whether they do what a cause does, beyond which they explain more: `rest` is the set without it."""
        missed = rest.cost - fit.cost + self.gain(fit)[0] - self.gain(rest)[0]
        return missed < WITHIN * (rest.cost - fit.cost)
