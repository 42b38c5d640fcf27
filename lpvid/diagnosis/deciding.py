"""Deciding: the gates that a cause must pass, its rivals, and how much of the excess error is explained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.problem import Problem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.screening import directions, moves, placed, screen, similarity
from lpvid.diagnosis.selection import BIC_GAIN, Search

BLOCKS_BETTER = 0.8
"""share of held-out blocks in which a cause must help"""
LARGEST_BLOCK = 0.5
"""share of the gain that one block may carry"""
SEPARATED = 10.0
"""whitened log-likelihood that must lie between a cause and a rival"""
RIVALS = 4
"""rivals refitted for each cause"""
EXPLAINED = 0.95
"""share of the excess error that the causes must explain"""


@dataclass(frozen=True, eq=False)
class Judged:
    """One effect of the chosen set, with everything that was asked of it.

    Attributes
    ----------
    effect : Effect
    values : (k,) array
    p_value, delta_bic, held_out_gain, blocks_better, largest_block, contribution : float
    rivals : tuple of (Effect, Refit, similarity)
        Admissible ones that do as well.
    objections : tuple of str
        Why it is not to be named; empty where it is.
    without : Refit
        The set without it.
    """

    effect: Effect
    values: np.ndarray
    p_value: float
    delta_bic: float
    held_out_gain: float
    blocks_better: float
    largest_block: float
    contribution: float
    rivals: tuple[tuple[Effect, Refit, float], ...]
    objections: tuple[str, ...]
    without: Refit


@dataclass(frozen=True, eq=False)
class Folds:
    """Out-of-fold errors of one composition: each sample by the fit to the other fold.

    Attributes
    ----------
    errors : (N,) array
        Whitened.
    plain : (N,) array
        In the output's unit.
    """

    errors: np.ndarray
    plain: np.ndarray


def out_of_fold(problem: Problem, fit: Refit) -> Folds:
    """Refit to each fold from the fit to both, and take the errors on the other."""
    errors, plain = np.empty(problem.n_samples), np.empty(problem.n_samples)
    for fold in (0, 1):
        half = refit(problem, fit.composition, fit.vector, fold=fold, iterations=8, near=fit, rough=True)
        test = problem.in_fold(1 - fold)
        errors[test] = half.errors[test]
        plain[test] = problem.stack(problem.errors(fit.composition, half.vector), whiten=False)[test]
    return Folds(errors, plain)


def judge(search: Search, effect: Effect, whole: Folds) -> Judged:
    """Ask everything of one effect in the chosen set.

    Parameters
    ----------
    search : Search
    effect : Effect
    whole : Folds
        Of the chosen set.
    """
    problem, fit = search.problem, search.fit
    rest = search.without(effect)
    delta = fit.bic() - rest.bic()
    before = out_of_fold(problem, rest)
    gains = problem.block_sums(before.errors**2 - whole.errors**2)
    total = float(gains.sum())
    better = float(np.mean(gains > 0))
    largest = float(gains.max() / total) if total > 0 else 1.0
    values = fit.vector[fit.composition.places[fit.composition.effects.index(effect)]]
    contribution = _contribution(problem, fit, rest)
    objections = []
    p = search.p_values.get(effect.name, 1.0)
    if delta > -BIC_GAIN:
        objections.append(f"BIC falls by {-delta:.1f} only")
    if total <= 0 or better < BLOCKS_BETTER:
        objections.append(f"it helps in {better:.0%} of the held-out blocks only")
    if largest > LARGEST_BLOCK:
        objections.append(f"one block carries {largest:.0%} of the gain")
    if contribution < effect.negligible * problem.spread:
        objections.append(f"present but negligible: {contribution / problem.spread:.2%} of the output's spread")
    clock = effect.resolution * problem.signals[0].sample_time
    if abs(values[0] - effect.neutral[0]) < clock:
        objections.append(f"{effect.parameters[0].name} {values[0]:.3g} s is less than the samples can resolve")
    objections += effect.implausible(values)
    rivals = () if objections else rivals_of(search, effect, rest)
    return Judged(effect, values, p, delta, 100 * total / max(float(before.errors @ before.errors), 1e-300), better,
                  largest, contribution, rivals, tuple(objections), rest)


def rivals_of(search: Search, effect: Effect, rest: Refit) -> tuple[tuple[Effect, Refit, float], ...]:
    """Admissible effects that, put in its place, do as well within `SEPARATED`."""
    problem = search.problem
    chosen = {x.name for x in search.fit.composition.effects}
    others = [e for e in search.candidates if e.name not in chosen and effect.name not in e.contains]
    moved = moves(problem, rest, [effect, *others])
    found = directions(problem, rest, moved)
    evidence = {e.effect.name: e for e in screen(problem, rest, found, np.random.default_rng(0))}
    own = evidence[effect.name]
    variance = search.fit.variance
    wanted = max(own.likelihood_ratio, 1.0)
    near = [e for e in evidence.values() if e.effect.name != effect.name and e.best is not None
            and own.best is not None and e.likelihood_ratio > 0.5 * wanted]
    near = sorted(near, key=lambda e: -e.likelihood_ratio)[:RIVALS]
    out = []
    for e in near:
        assert e.best is not None and own.best is not None
        composition = Composition(rest.composition.baseline, (*rest.composition.effects, e.effect))
        starts = [placed(composition, f, {e.effect.name: e.best.values}) for f in (rest, search.fit)]
        fit = min((refit(problem, composition, start, near=rest) for start in starts), key=lambda f: f.cost)
        extra = (fit.vector.size - search.fit.vector.size) * np.log(problem.n_samples)
        apart = (fit.cost - search.fit.cost) / variance + extra
        values = fit.vector[composition.places[composition.effects.index(e.effect)]]
        if apart < SEPARATED and not e.effect.implausible(values):
            out.append((e.effect, fit, abs(similarity(own.best, e.best))))
    return tuple(out)


def explained_share(problem: Problem, before: Folds, after: Folds, floor: float | None, predictable: float
                    ) -> tuple[float, float]:
    """φ = (σ²_base − σ²_ext)/(σ²_base − σ₀²) out of fold, and its standard error over blocks.

    Parameters
    ----------
    before, after : Folds
        Of the baseline and of the extended model.
    floor : float or None
        σ₀² from repeats; without them the part of the remaining error that no regression on the inputs predicts.
    predictable : float
        Share of the remaining error that one does predict.
    """
    b, a = problem.block_sums(before.plain**2), problem.block_sums(after.plain**2)
    n = problem.blocks.sizes().astype(float)
    rest = max(predictable, 0.0)

    def share(blocks: np.ndarray) -> float:
        base, extended = b[blocks].sum() / n[blocks].sum(), a[blocks].sum() / n[blocks].sum()
        noise = extended * (1 - rest) if floor is None else floor
        return (base - extended) / max(base - noise, 1e-12 * max(base, 1e-300))

    every = np.arange(b.size)
    leave = np.array([share(np.delete(every, k)) for k in every])
    error = float(np.sqrt((b.size - 1) / b.size * np.sum((leave - leave.mean()) ** 2)))
    return share(every), error


def _contribution(problem: Problem, fit: Refit, rest: Refit) -> float:
    """Root mean square of what an effect changes in the simulation once the others have been refitted without it."""
    change = [fit.composition.predict(s, fit.vector) - rest.composition.predict(s, rest.vector)
              for s in problem.signals]
    return float(np.sqrt(np.mean(problem.stack(change, whiten=False) ** 2)))
