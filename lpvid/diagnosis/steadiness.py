"""Steadiness: whether a cause has one strength wherever one looks, or whether it stands in for something else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.problem import Problem, projector, without
from lpvid.diagnosis.refitting import Refit

PARTS = 3
"""strata for each input, for its size and for time"""
WEIGHT = 0.05
"""share of a cause's squared change that a stratum must hold to be asked"""
CERTAIN = 3.0
"""standard errors taken off a difference"""


@dataclass(frozen=True)
class Steadiness:
    """Where the strength of a cause differs most from its fitted value.

    Attributes
    ----------
    excess : float
        Share of the strength by which it differs there, beyond three standard errors; 0 where none is sure to.
    where : str
    """

    excess: float
    where: str


def steadiness(problem: Problem, fit: Refit, effect: Effect, channels: Sequence[str]) -> Steadiness:
    """Least-squares strength of a fitted cause within strata of the inputs, of their sizes and of time.

    With d the whitened change that the cause makes beyond what all other parameters can, and e what the fit leaves,
    δ_k = d_kᵀe_k/d_kᵀd_k is by how much, relative to the fit, its strength is wrong in stratum k. It is zero within
    √(σ_k²/d_kᵀd_k) for the true cause; a sum of wrong ones is too strong here and too weak there.

    Parameters
    ----------
    problem : Problem
    fit : Refit
        With the effect in its composition.
    effect : Effect
    channels : sequence of str
        Inputs by which strata are formed.
    """
    place = fit.composition.places[fit.composition.effects.index(effect)]
    absent = fit.vector.copy()
    absent[place] = effect.neutral
    others = np.ones(absent.size, dtype=bool)
    others[place] = False
    change = problem.stack([fit.composition.predict(s, fit.vector) - fit.composition.predict(s, absent)
                            for s in problem.signals])
    change = without(projector(fit.jacobian[:, others]), change)
    total = float(change @ change)
    worst = Steadiness(0.0, "")
    if not total > 0:
        return worst
    for name, values in _scales(problem, channels):
        edges = np.quantile(values, np.arange(1, PARTS) / PARTS)
        number = np.searchsorted(edges, values, side="right")
        for k in range(PARTS):
            inside = number == k
            weight = float(change[inside] @ change[inside])
            if weight < WEIGHT * total:
                continue
            errors = fit.errors[inside]
            off = abs(float(change[inside] @ errors)) / weight
            excess = off - CERTAIN * float(np.sqrt(np.mean(errors**2) / weight))
            if excess > worst.excess:
                worst = Steadiness(excess, f"{('low', 'middle', 'high')[k]} {name}")
    return worst


def _scales(problem: Problem, channels: Sequence[str]) -> list[tuple[str, np.ndarray]]:
    """What strata are formed of: (name, stacked values)."""
    found = [("time", problem.stack([s.times for s in problem.signals], whiten=False))]
    for name in channels:
        values = problem.stack([s[name] for s in problem.signals], whiten=False)
        if np.ptp(values) > 0:
            found += [(name, values), (f"|{name}|", np.abs(values))]
    return found
