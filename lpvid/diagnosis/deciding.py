"""Deciding: the gates that a cause must pass, its rivals, and how much of the excess error is explained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.problem import Problem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.screening import directions, moves, placed, screen, similarity
from lpvid.diagnosis.selection import BIC_GAIN, REFINED, TASTE, Search, starts
from lpvid.diagnosis.steadiness import steadiness

BLOCKS_BETTER = 0.8
"""share of held-out blocks in which a cause must help"""
ACTING = 0.25
"""share of the mean change over the blocks from which on a cause acts in a block"""
LARGEST_BLOCK = 0.5
"""share of the gain that one block may carry"""
SEPARATED = 10.0
"""whitened log-likelihood that must lie between a cause and a rival"""
RIVALS = 5
"""rivals refitted for each cause"""
CLOSE, CLOSE_SHARE = 100.0, 0.4
"""log-likelihood by which a first rough refit of a rival may trail, flat and as a share of what the cause wins"""
EXPLAINED = 0.95
"""share of the excess error that the causes must explain"""
MOST_EXPLAINED = 2.0
"""share of the excess error beyond which a larger one says no more than that the excess drowns in the noise"""
SHADOW, DEEP_SHADOW = 0.011, 0.05
"""share of what the strongest cause wins in BIC below which another may be no more than that one's imperfect law; the
second number for a catch-all"""
FORM = 0.25
"""share of what a component wins by which a catch-all must do better to be its rival"""
DOUBTFUL = 100.0
"""whitened log-likelihood that must lie between a form and a component on the same path: a saturation and a quadratic
law of the current differ by small print, which the small print of the measurement may outweigh"""
KIN = 0.05
"""share of the squared error that a cause takes away below which another one on the same path is its small print: two
lags of one signal are one lag of another form"""
PLAIN, HINTED = 0.1, 0.03
"""share of the squared error in the output's unit by which a rival must surely do better there to be the better name
whatever the whitened error says, and by which it must seem to for the whitened error alone not to decide"""
SURE = 3.0
"""standard errors over the blocks from which on a difference is sure"""
DWARFED = 1.0
"""share of the structure in what is left that a cause must change in the output to be more than a patch of it"""
UNSTEADY = 0.13
"""share by which the strength of a cause may differ, beyond three standard errors, between strata of the inputs"""


@dataclass(frozen=True, eq=False)
class Alternative:
    """What an admissible effect does in the place of another.

    Attributes
    ----------
    effect : Effect
    fit : Refit
        The set with it instead.
    similarity : float
        |cos| of the angle between the two directions.
    apart : float
        Whitened log-likelihood ratio by which it does worse; negative where it does better.
    """

    effect: Effect
    fit: Refit
    similarity: float
    apart: float


@dataclass(frozen=True, eq=False)
class Judged:
    """One effect of the chosen set, with everything that was asked of it.

    Attributes
    ----------
    effect : Effect
    values : (k,) array
    p_value, delta_bic, won, held_out_gain, blocks_better, largest_block, contribution : float
    rivals : tuple of Alternative
        Admissible ones that do as well.
    better : Alternative or None
        The one that does clearly better, if any.
    objections : tuple of str
        Why it is not to be named; empty where it is.
    minor : bool
        Whether all that is held against it is that it is small: it may stay in the simulation, unnamed.
    without : Refit
        The set without it.
    """

    effect: Effect
    values: np.ndarray
    p_value: float
    delta_bic: float
    won: float
    held_out_gain: float
    blocks_better: float
    largest_block: float
    contribution: float
    rivals: tuple[Alternative, ...]
    better: Alternative | None
    objections: tuple[str, ...]
    minor: bool
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


def judge(search: Search, effect: Effect, whole: Folds, channels: Sequence[str]) -> Judged:
    """Ask everything of one effect in the chosen set.

    Parameters
    ----------
    search : Search
    effect : Effect
    whole : Folds
        Of the chosen set.
    channels : sequence of str
        Inputs by whose strata its steadiness is asked.
    """
    problem, fit = search.problem, search.fit
    rest = search.without(effect)
    delta = fit.bic() - rest.bic()
    before = out_of_fold(problem, rest)
    gains = problem.block_sums(before.errors**2 - whole.errors**2)
    total = float(gains.sum())
    acting = _acting(problem, fit, rest)
    better = float(np.mean(gains[acting] > 0))
    largest = float(gains.max() / total) if total > 0 else 1.0
    values = fit.vector[fit.composition.places[fit.composition.effects.index(effect)]]
    contribution = _contribution(problem, fit, rest)
    small, objections = _small(problem, effect, values, contribution), []
    if delta > -BIC_GAIN:
        objections.append(f"BIC falls by {-delta:.1f} only")
    if total <= 0 or better < BLOCKS_BETTER:
        objections.append(f"it helps in {better:.0%} of the held-out blocks only in which it acts")
    if largest > LARGEST_BLOCK:
        objections.append(f"one block carries {largest:.0%} of the gain")
    objections += effect.implausible(values)
    if not objections and not small:
        steady = steadiness(problem, fit, effect, channels)
        if steady.excess > UNSTEADY:
            objections.append(f"its strength differs by {steady.excess:.0%} at {steady.where}")
    minor = bool(small) and not effect.implausible(values)
    others = () if objections or small else alternatives(search, effect, rest)
    rivals = tuple(a for a in others if a.apart < SEPARATED)
    best = rivals[0] if rivals and rivals[0].apart < -SEPARATED else None
    return Judged(effect, values, search.p_values.get(effect.name, 1.0), delta, rest.cost - fit.cost,
                  100 * total / max(float(before.errors @ before.errors), 1e-300), better, largest, contribution,
                  rivals, best, tuple(small + objections), minor, rest)


def shadowed(search: Search, judged: Sequence[Judged], structure: float) -> list[Judged]:
    """The same, with an objection to those that are faint beside the strongest of them or beside what is left.

    Parameters
    ----------
    search : Search
    judged : sequence of Judged
    structure : float
        Root mean square of that part of the remaining error which still follows the inputs, in the output's unit.
    """
    most = max((-j.delta_bic for j in judged), default=0.0)
    out = []
    for j in judged:
        share = DEEP_SHADOW if j.effect.catch_all else SHADOW
        kin = _won_together(search, [k for k in judged if k.effect.path and k.effect.path == j.effect.path])
        said = ""
        if -j.delta_bic < share * most or j.won < KIN * kin:
            said = "beside the strongest cause too faint to be more than that one's imperfect law"
        elif j.contribution < DWARFED * structure:
            said = "it changes less than what is left unexplained"
        if j.objections or not said:
            out.append(j)
        else:
            out.append(replace(j, objections=(said,), minor=True, rivals=(), better=None))
    return out


def _won_together(search: Search, kin: Sequence[Judged]) -> float:
    """Squared error that several causes take away together; 0 for less than two."""
    return search.without(*(k.effect for k in kin)).cost - search.fit.cost if len(kin) > 1 else 0.0


def with_takeovers(search: Search, judged: Sequence[Judged]) -> list[Judged]:
    """The same, where those of the set that are no more than small have been tried at full size in the others' place.

    A cause that came in too late finds its work done by a wrong one, and stays small beside it.
    """
    small = [j for j in judged if j.minor]
    out = []
    for j in judged:
        if not j.objections:
            tried = [_taken_over(search, j, s) for s in small]
            rivals = tuple(sorted([*j.rivals, *(a for a in tried if a is not None and a.apart < SEPARATED)],
                                  key=lambda a: a.apart))
            best = rivals[0] if rivals and rivals[0].apart < -SEPARATED else None
            j = replace(j, rivals=rivals, better=best)
        out.append(j)
    return out


def _taken_over(search: Search, j: Judged, small: Judged) -> Alternative | None:
    """The set without one cause, a small one grown in its place."""
    problem, now, composition = search.problem, search.fit, j.without.composition
    if small.effect.catch_all and not j.effect.catch_all:
        return None
    begun = [placed(composition, around, {small.effect.name: v}) for v in small.effect.points(problem.signals)
             for around in (j.without, now)]
    begun = sorted(begun, key=lambda v: _cost(problem, composition, v))[:2]
    tasted = [refit(problem, composition, v, iterations=TASTE, near=j.without, rough=True) for v in begun]
    fit = refit(problem, composition, min(tasted, key=lambda f: f.cost).vector, near=j.without)
    values = fit.vector[composition.places[composition.effects.index(small.effect)]]
    if small.effect.implausible(values):
        return None
    apart = (fit.cost - now.cost) / now.variance - j.values.size * np.log(problem.n_samples)
    return Alternative(small.effect, fit, 1.0, float(_in_both(apart, *_plainly(problem, now, fit))))


def _small(problem: Problem, effect: Effect, values: np.ndarray, contribution: float) -> list[str]:
    """What says that an effect, if it is there, is too small to be named."""
    found = []
    if contribution < effect.negligible * problem.spread:
        found.append(f"present but negligible: {contribution / problem.spread:.2%} of the output's spread")
    return found + effect.unresolved(values, problem.signals[0].sample_time)


def alternatives(search: Search, effect: Effect, rest: Refit) -> tuple[Alternative, ...]:
    """Plausible effects, half as likely or more, put in the place of one of the set and refitted; best first."""
    problem, now = search.problem, search.fit
    chosen = {x.name for x in now.composition.effects}
    beside = {x for x in now.composition.effects if x is not effect}
    others = [e for e in search.candidates if e.name not in chosen and effect.name not in e.contains
              and not any(e.name in x.contains or x.name in e.contains for x in beside)]
    found = directions(problem, rest, moves(problem, rest, [effect, *others]))
    evidence = {e.effect.name: e for e in screen(problem, rest, found, np.random.default_rng(0))}
    own = evidence[effect.name]
    wanted = max(own.likelihood_ratio, 1.0)
    near = [e for e in evidence.values() if e.effect.name != effect.name and e.best is not None
            and own.best is not None and e.likelihood_ratio > 0.5 * wanted]
    out = []
    for e in sorted(near, key=lambda e: -e.likelihood_ratio)[:RIVALS]:
        assert e.best is not None and own.best is not None
        composition = Composition(rest.composition.baseline, (*rest.composition.effects, e.effect))
        begun = [placed(composition, rest, {e.effect.name: v}) for v in starts(e.effect, found)[:2]]
        beside = [placed(composition, now, {e.effect.name: v}) for v in e.effect.points(problem.signals)]
        begun += sorted(beside, key=lambda v: _cost(problem, composition, v))[:2]
        fit = min((refit(problem, composition, start, iterations=TASTE, near=rest, rough=True) for start in begun),
                  key=lambda f: f.cost)
        if fit.cost - now.cost > max(CLOSE * now.variance, CLOSE_SHARE * (rest.cost - now.cost)):
            continue
        fit = refit(problem, composition, fit.vector, near=rest, rough=True)
        spared = min(fit.vector.size - now.vector.size, 0) * np.log(problem.n_samples)
        apart = (fit.cost - now.cost) / now.variance + spared
        if e.effect.catch_all != effect.catch_all and e.effect.path and e.effect.path == effect.path:
            apart = 0.0 if abs(apart) < DOUBTFUL else apart
        elif e.effect.catch_all and not effect.catch_all:  # a form takes the place of a component only if far better
            apart += FORM * (rest.cost - now.cost) / now.variance
        elif e.effect.catch_all == effect.catch_all:
            apart = _in_both(apart, *_plainly(problem, now, fit))
        if e.effect.name in effect.contains:
            apart -= REFINED * (rest.cost - now.cost) / now.variance
        values = fit.vector[composition.places[composition.effects.index(e.effect)]]
        if not e.effect.implausible(values):
            out.append(Alternative(e.effect, fit, abs(similarity(own.best, e.best)), float(apart)))
    return tuple(sorted(out, key=lambda a: a.apart))


def _plainly(problem: Problem, now: Refit, other: Refit) -> tuple[float, float]:
    """By how much less error another fit leaves in the output's unit: (share of the smaller, standard errors).

    The whitened error weighs bands in which the noise of the inputs, which no filter of the output's noise knows,
    may be all that there is: there a cause that has to undo a filter is punished for the noise that it raises.
    """
    a, b = (problem.stack(problem.errors(f.composition, f.vector), whiten=False) for f in (now, other))
    gains = problem.block_sums(a**2 - b**2)
    total = float(gains.sum())
    return total / max(min(float(a @ a), float(b @ b)), 1e-300), total / max(float(np.sqrt(gains @ gains)), 1e-300)


def _in_both(apart: float, share: float, certain: float) -> float:
    """Log-likelihood by which a rival trails, overruled where the error in the output's unit surely says otherwise."""
    if abs(share) > PLAIN and abs(certain) > SURE:
        return min(apart, -2 * SEPARATED) if share > 0 else max(apart, 2 * SEPARATED)
    if share * apart > 0 and abs(share) > HINTED and abs(certain) > 1 and abs(apart) > SEPARATED:
        return 0.0
    return apart


def _cost(problem: Problem, composition: Composition, vector: np.ndarray) -> float:
    """Squared whitened error as it stands."""
    errors = problem.stack(problem.errors(composition, vector))
    return float(errors @ errors)


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
        if base <= extended:
            return 0.0
        return min((base - extended) / max(base - noise, 1e-12 * base), MOST_EXPLAINED)

    every = np.arange(b.size)
    leave = np.array([share(np.delete(every, k)) for k in every])
    error = float(np.sqrt((b.size - 1) / b.size * np.sum((leave - leave.mean()) ** 2)))
    return share(every), error


def _acting(problem: Problem, fit: Refit, rest: Refit) -> np.ndarray:
    """(blocks,) bool: blocks that hold their share of what an effect changes, or a tenth of it."""
    energy = problem.block_sums((rest.errors - fit.errors) ** 2)
    return energy >= ACTING * energy.mean()


def _contribution(problem: Problem, fit: Refit, rest: Refit) -> float:
    """Root mean square of what an effect changes in the simulation once the others have been refitted without it."""
    change = [fit.composition.predict(s, fit.vector) - rest.composition.predict(s, rest.vector)
              for s in problem.signals]
    return float(np.sqrt(np.mean(problem.stack(change, whiten=False) ** 2)))
