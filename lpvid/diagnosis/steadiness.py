"""Steadiness: whether a cause has one strength wherever one looks, or whether it stands in for something else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.problem import DiagnosisProblem, projector, without
from lpvid.diagnosis.refitting import Refit, covariance

LEVELS = ("least", "low", "middle", "high", "largest")
PARTS = len(LEVELS)
"""strata for each input, for its size and for time"""
WEIGHT = 0.05
"""share of a cause's squared change that a stratum must hold to be asked"""
CERTAIN = 3.0
"""standard errors taken off a difference"""
THERE = 0.95
"""probability with which chance alone must not take a strength so far from neutral"""


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


def surely_there(problem: DiagnosisProblem, fit: Refit, effect: Effect) -> bool:
    """Whether an effect is more than chance: asked beside another that jumps, elsewhere BIC has said so."""
    return not any(e.abrupt for e in fit.composition.effects if e is not effect) or is_there(problem, fit, effect)


def is_there(problem: DiagnosisProblem, fit: Refit, effect: Effect) -> bool:
    """Whether the strengths s of an effect are surely not neutral, by their covariance C over the B blocks.

    A few large errors, those of samples at which something jumps nobody knows when, let much win a likelihood in which
    all samples are alike: the cost has many valleys, and every further parameter finds a deeper one. Elsewhere a wide
    interval says only that the parameters of an effect and of the law move against each other, as those of two networks
    of losses do.

    Hotelling's test: with T² = sᵀ C⁻¹ s of k strengths and d = B − 1, (d − k + 1) T²/(d k) is compared with a quantile
    of F(k, d − k + 1); for a single strength about two standard errors. Blocks too few for so many strengths show
    nothing. One on a bound has no C and is there where that bound is not neutral.
    """
    from scipy.special import fdtri

    place = fit.composition.places[fit.composition.effects.index(effect)]
    away = (fit.vector[place] - effect.neutral)[: effect.strengths]
    spread = covariance(problem, fit)[place, place][: effect.strengths, : effect.strengths]
    known = np.isfinite(np.diag(spread)) & (np.diag(spread) > 0)
    if np.any(away[~known] != 0):
        return True
    size, free = int(known.sum()), problem.blocks.count - int(known.sum())
    if not size or free < 1:
        return False
    scale = np.sqrt(np.diag(spread)[known])
    s, correlation = away[known] / scale, spread[np.ix_(known, known)] / np.outer(scale, scale)
    square = float(s @ np.linalg.pinv(correlation, rcond=1e-12, hermitian=True) @ s)
    return bool(free / ((problem.blocks.count - 1) * size) * square > fdtri(size, free, THERE))


def steadiness(problem: DiagnosisProblem, fit: Refit, effect: Effect, channels: Sequence[str]) -> Steadiness:
    """Least-squares strength of a fitted cause within strata of the inputs, of their sizes and of time.

    With d the change that the cause makes beyond what all other parameters can, and e what the fit leaves,
    δ_k = d_kᵀe_k/d_kᵀd_k is by how much, relative to the fit, its strength is wrong in stratum k. For the true cause it
    is the same everywhere, within √(Σ_b u_b²)/d_kᵀd_k with u_b the block sums of d (e − δd), which holds for coloured
    errors too; a sum of wrong causes is too strong here and too weak there. Asked of the whitened signals and of those
    in the output's unit, of which the better counts: whitening weighs bands in which a little error of the measurement
    chain is all that there is.

    Parameters
    ----------
    problem : Problem
    fit : Refit
        With the effect in its composition.
    effect : Effect
    channels : sequence of str
        Inputs by which strata are formed.
    """
    composition, vector = fit.composition, fit.vector
    place = composition.places[composition.effects.index(effect)]
    absent = vector.copy()
    absent[place] = effect.neutral
    others = [k for k in range(vector.size) if not place.start <= k < place.stop]
    now = [composition.predict(s, vector) for s in problem.signals]
    change = [f - composition.predict(s, absent) for s, f in zip(problem.signals, now, strict=True)]
    whitened = _worst(problem, without(projector(fit.jacobian[:, others]), problem.stack(change)), fit.errors, channels)
    if not whitened.excess:
        return whitened
    jacobian = problem.stack([composition.sensitivities(s, vector, free=others, at=f)
                              for s, f in zip(problem.signals, now, strict=True)], whiten=False)
    errors = problem.stack([s.output - f for s, f in zip(problem.signals, now, strict=True)], whiten=False)
    plain = _worst(problem, without(projector(np.nan_to_num(jacobian)), problem.stack(change, whiten=False)), errors,
                   channels)
    return min(whitened, plain, key=lambda found: found.excess)


def _worst(problem: DiagnosisProblem, change: np.ndarray, errors: np.ndarray, channels: Sequence[str]) -> Steadiness:
    """The stratum that differs most, for stacked changes and errors."""
    total = float(change @ change)
    worst = Steadiness(0.0, "")
    if not total > 0:
        return worst
    overall = float(change @ errors) / total
    product = change * (errors - overall * change)
    for name, values in _scales(problem, channels):
        edges = np.quantile(values, np.arange(1, PARTS) / PARTS)
        number = np.searchsorted(edges, values, side="right")
        for k in range(PARTS):
            inside = number == k
            weight = float(change[inside] @ change[inside])
            if weight < WEIGHT * total:
                continue
            sums = problem.block_sums(np.where(inside, product, 0.0))
            excess = (abs(float(sums.sum())) - CERTAIN * float(np.sqrt(sums @ sums))) / weight
            if excess > worst.excess:
                worst = Steadiness(excess, f"{LEVELS[k]} {name}")
    return worst


def _scales(problem: DiagnosisProblem, channels: Sequence[str]) -> list[tuple[str, np.ndarray]]:
    """What strata are formed of: (name, stacked values)."""
    found = [("time", problem.stack([s.times for s in problem.signals], whiten=False))]
    for name in channels:
        values = problem.stack([s[name] for s in problem.signals], whiten=False)
        if np.ptp(values) > 0:
            found += [(name, values), (f"|{name}|", np.abs(values))]
    return found
