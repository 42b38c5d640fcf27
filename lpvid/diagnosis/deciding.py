"""Deciding: the gates that a cause must pass, and how much of the excess error is explained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid._threads import in_parallel
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.input_noise import gain_without_input_noise
from lpvid.diagnosis.nameless import static_in_place
from lpvid.diagnosis.noise import WHITE, NoiseLevel
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import LENT, Refit, refit
from lpvid.diagnosis.rivals import SEPARATED, Alternative, alternatives, separation, taken_over
from lpvid.diagnosis.screening import DETECT
from lpvid.diagnosis.selection import BIC_GAIN, ForwardSelection
from lpvid.diagnosis.steadiness import steadiness, surely_there

BLOCKS_BETTER, MAJORITY = 0.8, 0.6
"""share of held-out blocks in which a cause must help, and the least where one of its size would not show in more"""
LUCK = 1.64
"""standard errors below what is expected that are left to chance"""
ACTING = 0.25
"""share of the mean change over the blocks from which on a cause acts in a block"""
LARGEST_BLOCK, PLENTY = 0.5, 5.0
"""share of the gain that one block may carry; a cause may have more from one block if the others by themselves would
show it (one without memory, which may act beyond a level only) or show it so many times over"""
EXPLAINED = 0.95
"""share of the excess error that the causes must explain"""
MOST_EXPLAINED = 2.0
"""share of the excess error beyond which a larger one says no more than that the excess drowns in the noise"""
SHADOW, DEEP_SHADOW = 0.011, 0.05
"""share of what the strongest cause wins in BIC below which another may be no more than that one's imperfect law; the
second number for a catch-all, and beside one: a form is no law, and leaves more"""
QUIET = 0.25
"""share of what a faint cause changes that must lie in the half of the samples where the strongest is quiet"""
APART = 0.35
"""by how much the strength of a faint cause may be off where the strongest is quiet, its uncertainty included"""
KIN = 0.05
"""share of the squared error that a cause takes away below which another one on the same path is its small print: two
lags of one signal are one lag of another form"""
DWARFED = 1.0
"""share of the structure in what is left that a cause must change in the output to be more than a patch of it"""
OF_MOTION = 0.2
"""share of the gain of a lag, a delay or a filter that must be left without the noise of the recorded motion"""
UNSTEADY = 0.13
"""share by which the strength of a cause may differ, beyond three standard errors, between strata of the inputs"""


@dataclass(frozen=True, eq=False)
class JudgedEffect:
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
    """Out-of-fold errors of one composition: each sample by the fit to the other fold, in which it weighs `LENT`.

    Attributes
    ----------
    errors : (N,) array
        Whitened.
    plain : (N,) array
        In the output's unit.
    """

    errors: np.ndarray
    plain: np.ndarray


def out_of_fold(problem: DiagnosisProblem, fit: Refit) -> Folds:
    """Refit to each fold from the fit to both, and take the errors on the other."""
    errors, plain = np.empty(problem.n_samples), np.empty(problem.n_samples)
    for fold in (0, 1):
        half = refit(problem, fit.composition, fit.vector, fold=fold, iterations=8, near=fit, rough=True)
        test = problem.in_fold(1 - fold)
        errors[test] = half.errors[test]
        plain[test] = problem.stack(problem.errors(fit.composition, half.vector), whiten=False)[test]
    return Folds(errors, plain)


def judge(search: ForwardSelection, effect: Effect, whole: Folds, channels: Sequence[str]) -> JudgedEffect:
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
    before = rest.cached("out of fold", lambda: out_of_fold(problem, rest))
    gains = problem.block_sums(before.errors**2 - whole.errors**2)
    gains[_untold(problem, fit, effect)] = 0.0
    total = float(gains.sum())
    acting = _acting(problem, fit, rest)
    better = float(np.mean(gains[acting] > 0))
    change = rest.errors - fit.errors
    enough = _enough(problem.block_sums(change**2)[acting] / (fit.variance * dispersion(problem, change, fit.errors)))
    largest = float(gains.max() / total) if total > 0 else 1.0
    values = fit.vector[fit.composition.places[fit.composition.effects.index(effect)]]
    contribution = _contribution(problem, fit, rest)
    small, objections = _small(problem, effect, values, contribution), []
    if delta > -BIC_GAIN:
        objections.append(f"BIC falls by {-delta:.1f} only")
    if total <= 0 or better < enough:
        objections.append(f"it helps in {better:.0%} of the held-out blocks only in which it acts")
    others = (total - float(gains.max())) / fit.variance
    wanted = (1.0 if effect.is_static(values) else PLENTY) * (DETECT + np.log(problem.n_samples))
    if largest > LARGEST_BLOCK and others < wanted:
        objections.append(f"one block carries {largest:.0%} of the gain")
    objections += effect.implausible(values)
    if not surely_there(problem, fit, effect):
        objections.append("its strength is not surely different from none")
    if not objections and not small:
        steady = steadiness(problem, fit, effect, channels)
        if steady.excess > UNSTEADY:
            objections.append(f"its strength differs by {steady.excess:.0%} at {steady.where}")
        if effect.path and not effect.is_static(values) and gain_without_input_noise(problem, fit, rest) < OF_MOTION:
            objections.append("what it takes away is the noise in the recorded motion")
    minor = bool(small) and not effect.implausible(values)
    instead = () if objections or small else alternatives(search, effect, rest)
    rivals = tuple(a for a in instead if a.apart < SEPARATED)
    best = rivals[0] if rivals and rivals[0].apart < -separation(rest, fit) else None
    return JudgedEffect(effect, values, search.p_values.get(effect.name, 1.0), delta, rest.cost - fit.cost,
                  100 * total / max(float(before.errors @ before.errors), 1e-300), better, largest, contribution,
                  rivals, best, tuple(small + objections), minor, rest)


def shadowed(search: ForwardSelection, judged: Sequence[JudgedEffect], structure: float) -> list[JudgedEffect]:
    """The same, with an objection to those that are faint beside the strongest of them or beside what is left.

    Parameters
    ----------
    search : Search
    judged : sequence of Judged
    structure : float
        Root mean square of that part of the remaining error which still follows the inputs, in the output's unit.
    """
    strongest = min(judged, key=lambda j: j.delta_bic)
    out = []
    for j in judged:
        share = DEEP_SHADOW if j.effect.catch_all or strongest.effect.catch_all else SHADOW
        stated = ""
        if j.delta_bic > share * strongest.delta_bic and not stands_apart(search, j, strongest):
            stated = "beside the strongest cause too faint to be more than that one's imperfect law"
        elif j.contribution < DWARFED * structure:
            stated = "it changes less than what is left unexplained"
        elif forms := [k.effect.name for k in judged if k.delta_bic < j.delta_bic and missed_by(search, j, k.effect)]:
            stated = f"it does no more than {' or '.join(forms)} may have missed of the same inputs"
        if j.objections or not stated:
            out.append(j)
        else:
            out.append(replace(j, objections=(stated,), minor=True, rivals=(), better=None))
    return out


def missed_by(search: ForwardSelection, judged: JudgedEffect, form: Effect) -> bool:
    """Whether a cause may be what a static form of its own inputs has missed of them.

    The law of a component is wrong by a part of what it does; a form is fitted, and wrong by another function of its
    inputs, also where it does nothing itself. On a staircase of the current, up and up, a play shifts all levels but
    the first alike, and a function of the level shifts each as it likes: no memory shows.
    """
    own = judged.effect.needs
    return form.catch_all and form.memoryless and bool(own) and set(own) <= set(form.needs) and \
        static_in_place(search.problem, search.fit, judged.without, form.needs)


def stands_apart(search: ForwardSelection, faint: JudgedEffect, strongest: JudgedEffect) -> bool:
    """Whether a faint cause shows, with its whole strength, where the strongest one changes little.

    The imperfection of a law acts where the law does. At least `QUIET` of what a faint cause changes must lie in that
    half of the samples in which the strongest changes least. Over these, with d the change by the faint one beyond what
    the others take up and e the errors left, its strength there relative to the fit is dᵀ(e + d)/dᵀd, uncertain by
    √(Σ_b u_b²)/dᵀd with u_b the block sums of d e.
    """
    problem, fit = search.problem, search.fit
    loud = np.abs(strongest.without.errors - fit.errors)
    quiet = loud <= np.median(loud)
    d, left = faint.without.errors - fit.errors, fit.errors
    everywhere, d = float(d @ d), d * quiet
    total = float(d @ d)
    if not total > QUIET * everywhere:
        return False
    strength = 1.0 + float(d @ left) / total
    sums = problem.block_sums(d * left)
    uncertain = float(np.sqrt(sums @ sums)) / total
    seen = strength**2 * total / fit.variance
    return seen > DETECT + np.log(problem.n_samples) and abs(strength - 1.0) + uncertain < APART


def with_small_print(search: ForwardSelection, judged: Sequence[JudgedEffect]) -> list[JudgedEffect]:
    """The same, where of causes on one path the lesser is small print if the others do nearly as well without it.

    It may stay in the simulation. The greatest gets the credit of all: beside each other either seems superfluous.
    """
    out = {j.effect.name: j for j in judged}
    for path in sorted({j.effect.path for j in judged if j.effect.path}):
        kin = sorted((j for j in judged if j.effect.path == path), key=lambda j: j.won)
        if len(kin) < 2:
            continue
        rest = search.without(*(k.effect for k in kin))
        least, most = kin[0], kin[-1]
        if least.won < KIN * (rest.cost - search.fit.cost):
            stated = f"{most.effect.name} on the same path does nearly as well without it"
            out[least.effect.name] = replace(least, objections=(*least.objections, stated), minor=True, rivals=(),
                                             better=None)
            out[most.effect.name] = replace(most, delta_bic=search.fit.bic() - rest.bic(),
                                            won=rest.cost - search.fit.cost)
    return [out[j.effect.name] for j in judged]


def weighty(judged: Sequence[JudgedEffect]) -> list[JudgedEffect]:
    """The same, where what is held to be small is not, if it changes more than every cause that would be named.

    What stays in the simulation without a name must not be what makes the others fit: a clipped force beside a ringing
    that is too fast for the samples, say, which together imitate a delay.
    """
    largest = max((j.contribution for j in judged if not j.objections), default=np.inf)
    return [replace(j, minor=False) if j.minor and j.contribution > largest else j for j in judged]


def with_takeovers(search: ForwardSelection, judged: Sequence[JudgedEffect]) -> list[JudgedEffect]:
    """The same, where those of the set that are no more than small have been tried at full size in the others' place.

    A cause that came in too late finds its work done by a wrong one, and stays small beside it.
    """
    small = [j for j in judged if j.minor]
    out = []
    for j in judged:
        if not j.objections:
            tried = in_parallel(lambda s, j=j: taken_over(search, j.effect, j.without, s.effect), small)
            rivals = tuple(sorted([*j.rivals, *(a for a in tried if a is not None and a.apart < SEPARATED)],
                                  key=lambda a: a.apart))
            best = rivals[0] if rivals and rivals[0].apart < -separation(j.without, search.fit) else None
            j = replace(j, rivals=rivals, better=best)
        out.append(j)
    return out


def _small(problem: DiagnosisProblem, effect: Effect, values: np.ndarray, contribution: float) -> list[str]:
    """What says that an effect, if it is there, is too small to be named."""
    found = []
    if contribution < effect.negligible * problem.spread:
        found.append(f"present but negligible: {contribution / problem.spread:.2%} of the output's spread")
    return found + effect.unresolved(values, problem.signals[0].sample_time)


def surer_share(problem: DiagnosisProblem, before: Folds, after: Folds, level: NoiseLevel, whitened: NoiseLevel,
                predictable: float) -> tuple[float, float]:
    """`explained_share` in the output's unit, or of the whitened errors where that is surer.

    An effect of a hundredth of the noise's power drowns in what repeats leave open of that power, if the noise is slow:
    its level then rests on few independent samples. Whitened, it rests on all of them.

    Parameters
    ----------
    problem : Problem
    before, after : Folds
    level, whitened : NoiseLevel
        From repeats, of the output and of the whitened errors that are left.
    predictable : float
    """
    plain = _share(problem, before.plain, after.plain, level.variance, predictable)
    if level.variance is None or whitened.variance is None:
        return max(plain[0], 0.0), plain[1]
    white = _share(problem, before.errors, after.errors, whitened.variance, 0.0)

    def spread(share: tuple[float, float], errors: np.ndarray, floor: float, error: float) -> float:
        return float(np.hypot(share[1], share[0] * error / max(float(np.mean(errors**2)) - floor, 1e-300)))

    unsure = spread(plain, before.plain, level.variance, level.error(problem.whitening))
    surely = spread(white, before.errors, whitened.variance, whitened.error(WHITE))
    # each in proportion: a share told too small has a small error, and one below 0 that is unsure says nothing
    share, error = plain if unsure * abs(white[0]) <= surely * abs(plain[0]) else (white[0], surely)
    return max(share, 0.0), error


def explained_share(problem: DiagnosisProblem, before: Folds, after: Folds, floor: float | None,
                    predictable: float) -> tuple[float, float]:
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
    share, error = _share(problem, before.plain, after.plain, floor, predictable)
    return max(share, 0.0), error


def _share(problem: DiagnosisProblem, before: np.ndarray, after: np.ndarray, floor: float | None,
           predictable: float) -> tuple[float, float]:
    """The same of any errors; below 0 where the extended model does worse."""
    b, a = (problem.block_sums(e**2) for e in (before, after))
    n = problem.blocks.sizes().astype(float)
    rest = max(predictable, 0.0)

    def share(blocks: np.ndarray) -> float:
        base, extended = b[blocks].sum() / n[blocks].sum(), a[blocks].sum() / n[blocks].sum()
        noise = extended * (1 - rest) if floor is None else floor
        return float(np.clip((base - extended) / max(base - noise, 1e-12 * base), -MOST_EXPLAINED, MOST_EXPLAINED))

    every = np.arange(b.size)
    leave = np.array([share(np.delete(every, k)) for k in every])
    error = float(np.sqrt((b.size - 1) / b.size * np.sum((leave - leave.mean()) ** 2)))
    return share(every), error


def _untold(problem: DiagnosisProblem, fit: Refit, effect: Effect) -> np.ndarray:
    """(blocks,) bool: those that were fitted to themselves, being all that tells of the effect.

    In a fit to one fold the samples of the other are lent a weight (`refitting.LENT`); where the one has less to say of
    the effect than these, they would be judged by themselves.
    """
    fold, absent = problem.blocks.fold, fit.vector.copy()
    absent[fit.composition.places[fit.composition.effects.index(effect)]] = effect.neutral
    changed = problem.block_sums((problem.stack(problem.errors(fit.composition, absent)) - fit.errors) ** 2)
    described = np.array([changed[fold == k].sum() for k in (0, 1)])
    return LENT * described[fold] > described[1 - fold]


def _acting(problem: DiagnosisProblem, fit: Refit, rest: Refit) -> np.ndarray:
    """(blocks,) bool: blocks that hold their share of what an effect changes, or a tenth of it."""
    energy = problem.block_sums((rest.errors - fit.errors) ** 2)
    return energy >= ACTING * energy.mean()


def _enough(energy: np.ndarray) -> float:
    """Share of the blocks in which an effect must help on held-out data.

    With E what it changes in a block, whitened and in units of the noise's variance, the gain there is that of
    2 (d·e) + E around its mean E with variance 4 E: positive with probability Φ(√E/2). A faint effect that is there
    helps in as many blocks as that says, give or take chance.

    Parameters
    ----------
    energy : (blocks,) array
        E of the blocks in which it acts, over the `dispersion` of the noise.
    """
    from scipy.special import ndtr

    chances = ndtr(np.sqrt(energy) / 2)
    expected, uncertain = chances.mean(), np.sqrt(np.sum(chances * (1 - chances))) / chances.size
    return float(np.clip(expected - LUCK * uncertain, MAJORITY, BLOCKS_BETTER))


def dispersion(problem: DiagnosisProblem, change: np.ndarray, errors: np.ndarray) -> float:
    """By how much the block sums d·e scatter more than they would in white noise of one level; at least 1.

    What whitening leaves of slow noise adds up along a slow change; and noise that is large where the change is large
    weighs more than its mean says. With d_b the change in block b and e_k the errors in another, which know nothing of
    each other, the first is the mean of (d_b·e_k)² over b ≠ k, over σ² |d|²; the second Σ d² e² relative to that.

    Parameters
    ----------
    problem : Problem
    change, errors : (N,) array
        Stacked.
    """
    d, e = (np.asarray(v).reshape(problem.blocks.count, -1) for v in (change, errors))
    level = float(np.mean(e**2) * np.mean(np.sum(d**2, axis=1)))
    if not level > 0:
        return 1.0
    products = (d @ e.T) ** 2
    apart = ~np.eye(products.shape[0], dtype=bool)
    slow = float(np.mean(products[apart])) / level
    uneven = float(np.mean(np.sum(d**2 * e**2, axis=1))) / level
    return max(slow, 1.0) * max(uneven, 1.0)


def _contribution(problem: DiagnosisProblem, fit: Refit, rest: Refit) -> float:
    """Root mean square of what an effect changes in the simulation once the others have been refitted without it."""
    change = [fit.composition.predict(s, fit.vector) - rest.composition.predict(s, rest.vector)
              for s in problem.signals]
    return float(np.sqrt(np.mean(problem.stack(change, whiten=False) ** 2)))
