"""Intervals: how sure the parameters of a fitted set are, beyond what its own sensitivities tell."""

from __future__ import annotations

import numpy as np

from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, covariance
from lpvid.diagnosis.screening import Direction, directions, move, moves
from lpvid.diagnosis.selection import ForwardSelection


def deviations(search: ForwardSelection) -> np.ndarray:
    """(P,) standard errors of the parameters of the present set; NaN at a bound, but for the strength of a lag.

    Three independent parts: the sandwich covariance of the fit; what a lag may be off because nobody knows what the
    signals do between their samples (`Effect.clock_errors`); and the pull of a filter of all channels, which every
    chain has and which is often too weak to be found. With J the sensitivities of the set, d what such a filter changes
    and γ = (d·e)/(d·d) the share of it, at most 1, that fits the error e beyond J, leaving it out moves the parameters
    by γ J⁺ d. γ is what fits best: where noise hides the filter altogether, it pulls nothing; but 1 where the inputs by
    themselves show the filter (`Effect.shown`), however badly noise lets it be undone.
    """
    fit, problem = search.fit, search.problem
    variance = np.diag(covariance(problem, fit)).copy()
    for effect, place in zip(fit.composition.effects, fit.composition.places, strict=True):
        if effect.stepwise:  # the error jumps where a lag passes a whole sample: no derivative tells how sure it is
            variance[place.start] = 0.0
        variance[place] += effect.clock_errors(fit.vector[place], problem.signals) ** 2
    return np.sqrt(np.maximum(variance + _pull(search) ** 2, 0.0))


def of_effect(search: ForwardSelection, found: np.ndarray, effect: Effect) -> np.ndarray:
    """(k,) those of one effect of the set."""
    return found[search.fit.composition.places[search.fit.composition.effects.index(effect)]]


def _pull(search: ForwardSelection) -> np.ndarray:
    """(P,) by how much filters of all channels that are not in the set would move its parameters, added in squares."""
    fit, problem = search.fit, search.problem
    total = np.zeros(fit.vector.size)
    free = np.flatnonzero(~fit.at_bounds() & (np.linalg.norm(fit.jacobian, axis=0) > 0))
    for effect in search.outside():
        if effect.path != "all" or not free.size:
            continue
        found = _at_work(problem, fit, effect)
        if found is None:
            continue
        share, change = found
        scale = np.linalg.norm(fit.jacobian[:, free], axis=0)
        step = np.linalg.lstsq(fit.jacobian[:, free] / scale, problem.stack(change), rcond=1e-6)[0] / scale
        total[free] += (share * step) ** 2
    return np.sqrt(total)


def _at_work(problem: DiagnosisProblem, fit: Refit, effect: Effect) -> tuple[float, tuple[np.ndarray, ...]] | None:
    """Share of an effect's change that is to be reckoned with, and that change per record, (n,) each."""
    values = effect.shown(problem.signals)
    known = None if values is None else move(problem, fit, effect, values)
    if known is not None:
        return 1.0, known.change
    moved = moves(problem, fit, (effect,))
    found = [(d, m) for d, m in zip(directions(problem, fit, moved), moved, strict=True) if d.visible]
    if not found:
        return None
    best, likely = max(found, key=lambda pair: _gain(pair[0], min(pair[0].share, 1.0)))
    return min(best.share, 1.0), likely.change


def _gain(direction: Direction, share: float) -> float:
    """Fall of the squared error by a share γ of a change d: 2 γ d·e − γ² d·d."""
    return share * (2 * direction.share - share) * direction.norm**2
