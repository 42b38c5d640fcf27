"""Rivals: what other effects do in the place of one of the set, by the whitened error and in the output's unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid._memory import give_back
from lpvid._threads import in_parallel
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.input_noise import without_input_noise
from lpvid.diagnosis.noise import WHITE
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.racing import race
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.screening import Direction, Evidence, directions, moves, placed, screen, similarity
from lpvid.diagnosis.selection import REFINED, TASTE, ForwardSelection
from lpvid.diagnosis.starting import own_values, starts

SEPARATED, DISTINCT = 10.0, 40.0
"""whitened log-likelihood by which a rival must trail, and the most by which it must lead to take a cause's place"""
SMALL_PRINT = 0.0015
"""share of what a cause wins by which it must lead: so little may be small print of the law or the measurement"""
RIVALS = 5
"""rivals refitted for each cause"""
CLOSE, CLOSE_SHARE = 100.0, 0.4
"""log-likelihood by which a first rough refit of a rival may trail, flat and as a share of what the cause wins"""
FORM = 0.25
"""share of what a component wins by which a catch-all must do better to be its rival"""
COMPONENT = 0.05
"""share of what a form wins by which a component may do worse and still be the better name"""
DOUBTFUL, DOUBTFUL_SHARE = 100.0, 0.15
"""whitened log-likelihood that must lie between a form and a component on the same path, and the share of what the
cause wins that is enough: a saturation and a quadratic law of the current differ by small print, which the small print
of the measurement may outweigh; a fourth of all that a faint cause wins is no small print"""
PLAIN, HINTED, HINTED_KIN = 0.1, 0.03, 0.005
"""share of the squared error in the output's unit by which a rival must surely do better there to be the better name
whatever the whitened error says, and by which it must seem to for the whitened error alone not to decide; the last for
two on one path, which differ by little else than bands that whitening weighs most"""
CHAINED = 1000.0
"""log-likelihood by which a lag of the motion may trail another for a filter of all channels to be put beside both: a
low-pass and a delay that lags differ by as little as a filter that is too weak to be found"""
GENERAL, GENERAL_LEAST = 0.015, 30.0
"""share of what a cause wins, and the least log-likelihood, by which a more general one must lead to be its rival"""
SURE = 3.0
"""standard errors over the blocks from which on a difference is sure"""


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


def alternatives(search: ForwardSelection, effect: Effect, rest: Refit) -> tuple[Alternative, ...]:
    """Plausible effects, half as likely or more, put in the place of one of the set and refitted; best first.

    A more general one is no rival, unless these signals cannot tell it from the effect, or it does better by more than
    the small print of a law is worth: an effect that gave way to its special case may then be the true one.

    An effect that comes to no more than a simpler one, in another form, gives way to that where it does better.

    Those on the same path are tried however likely they seem: a lag of many samples looks like no other from afar.
    """
    problem, now = search.problem, search.fit
    chosen = {x.name for x in now.composition.effects}
    kept = [x for x in now.composition.effects if x is not effect]
    alike = effect.inseparable(problem.signals)
    others = [e for e in search.candidates if e.name not in chosen
              and not any((e.name in x.contains and e.name not in x.beside) or x.name in e.contains for x in kept)]
    found = directions(problem, rest, moves(problem, rest, [effect, *others]))
    evidence = {e.effect.name: e for e in screen(problem, rest, found, np.random.default_rng(0))}
    own = evidence[effect.name]
    wanted = max(own.likelihood_ratio, 1.0)
    near = [e for e in evidence.values() if e.effect.name != effect.name and e.best is not None
            and own.best is not None]
    likely = sorted((e for e in near if e.likelihood_ratio > 0.5 * wanted), key=lambda e: -e.likelihood_ratio)
    general = {e.effect.name for e in likely if effect.name in e.effect.contains and e.effect.name not in alike}
    tried = [e for e in likely if e.effect.name not in general][:RIVALS]
    tried += [e for e in near if e not in tried and (e.effect.name in general or _kin(e.effect, effect))]
    put = in_parallel(lambda e: _in_place(search, effect, rest, e, found), tried)
    give_back()
    out = []
    for e, fit in zip(tried, put, strict=True):
        if fit is None or own.best is None or e.best is None or e.effect.implausible(own_values(fit[1], e.effect)):
            continue
        apart, won = fit[0], (rest.cost - now.cost) / now.variance
        if e.effect.name in effect.contains:
            apart -= REFINED * won
        elif e.effect.name in general:
            if apart > -max(GENERAL_LEAST, GENERAL * won):
                continue
            apart = min(apart + REFINED * won, 0.0)
        if apart < -SEPARATED and e.effect.name in effect.comes_to(own_values(now, effect)):
            apart -= DISTINCT  # the simpler of the two, and the better
        out.append(Alternative(e.effect, fit[1], abs(similarity(own.best, e.best)), float(apart)))
    return tuple(sorted(out, key=lambda a: a.apart))


def _in_place(search: ForwardSelection, effect: Effect, rest: Refit, e: Evidence,
              found: Sequence[Direction]) -> tuple[float, Refit] | None:
    """Another in the place of an effect: the log-likelihood by which it trails, and its fit; None where far off."""
    problem, now = search.problem, search.fit
    composition = Composition(rest.composition.baseline, (*rest.composition.effects, e.effect))
    fit = search.known[composition.members] = _first(search, effect, rest, e, composition, found)
    won = rest.cost - now.cost
    if fit.cost - now.cost > max(CLOSE * now.variance, CLOSE_SHARE * won):
        return None
    near = now.cost + max(CHAINED * now.variance, COMPONENT * won)  # what trails by more is no rival
    further = refit(problem, composition, fit.vector, near=rest, rough=True, target=near)
    fit = search.known[composition.members] = further if further.cost < fit.cost else fit
    spared = min(fit.vector.size - now.vector.size, 0) * np.log(problem.n_samples)
    apart = (fit.cost - now.cost) / now.variance + spared
    if e.effect.catch_all != effect.catch_all and _kin(e.effect, effect):
        return 0.0 if abs(apart) < doubtful(won / now.variance) else apart, fit
    if e.effect.catch_all and not effect.catch_all:  # a form takes the place of a component only if far better
        return apart + FORM * won / now.variance, fit
    if effect.catch_all and not e.effect.catch_all:
        return apart - COMPONENT * won / now.variance, fit
    if e.effect.path == effect.path == "motion":
        return _of_motion(search, fit, spared, separation(rest, now))
    return _weighed(problem, apart, now, fit, separation(rest, now), _kin(e.effect, effect)), fit


def _first(search: ForwardSelection, effect: Effect, rest: Refit, e: Evidence, composition: Composition,
           found: Sequence[Direction]) -> Refit:
    """A first refit with another in the place of an effect, from beside the others of the set.

    And from what is known of that set, or else from where it fits what the rest leaves: in a race of its own, as a
    start near the rest is ahead of one that has far to go, wherever they lead.
    """
    problem, now = search.problem, search.fit
    known = search.known.get(composition.members, search.rests.get(composition.members))
    points = [placed(composition, now, {e.effect.name: v}) for v in e.effect.points(problem.signals)]
    points = sorted(points, key=lambda v: _cost(problem, composition, v))[:2]
    beside = race(problem, composition, [(v, now) for v in points])
    if known is None:
        points = [placed(composition, rest, {e.effect.name: v}) for v in starts(e.effect, found)[:2]]
        if _kin(e.effect, effect):
            points += _without_chain(problem, now, composition, e.effect)
        known = race(problem, composition, [(v, rest) for v in points])
    return min((known, beside), key=lambda f: f.cost)


def doubtful(won: float) -> float:
    """Log-likelihood up to which a form and a component on one path cannot be told apart, of a cause that wins so much.

    Examples
    --------
    >>> doubtful(180.0), doubtful(5000.0), doubtful(50.0)
    (27.0, 100.0, 20.0)
    """
    return float(np.clip(DOUBTFUL_SHARE * won, 2 * SEPARATED, DOUBTFUL))


def _kin(one: Effect, other: Effect) -> bool:
    """Whether two effects lie on the same path."""
    return bool(one.path) and one.path == other.path


def _of_motion(search: ForwardSelection, fit: Refit, spared: float, margin: float) -> tuple[float, Refit]:
    """By how much a rival that acts on the motion trails a cause that does, and its best fit.

    Told by inputs without their sensors' noise, which a filter that is undone raises and a delay does not: among sines
    that both bring to where they were, it is all by which they differ.
    """
    quiet = without_input_noise(search.problem)
    now, other = (f.cached("without the noise of inputs", lambda f=f: refit(quiet, f.composition, f.vector, rough=True))
                  for f in (search.fit, fit))
    apart = _weighed(quiet, float(other.cost - now.cost) / now.variance + spared, now, other, margin, True)
    return _behind_a_filter(search, apart, fit) if SEPARATED < apart < CHAINED else (apart, fit)


def _behind_a_filter(search: ForwardSelection, apart: float, fit: Refit) -> tuple[float, Refit]:
    """By how much a rival trails if either may have a filter of all channels beside it, and its best fit.

    Every measurement has such filters, so that none of them counts as a further parameter.
    """
    problem, now = search.problem, search.fit
    filters = [e for e in search.outside() if e.path == "all"]
    if not filters or any(e.path == "all" for e in now.composition.effects):
        return apart, fit
    best = []
    for alone in (now, fit):
        found = [alone]
        for e in filters:
            composition = Composition(alone.composition.baseline, (*alone.composition.effects, e))
            begun = [placed(composition, alone, {e.name: v}) for v in e.points(problem.signals)]
            begun = sorted(begun, key=lambda v: _cost(problem, composition, v))[:2]
            first = race(problem, composition, [(v, alone) for v in begun])
            found.append(refit(problem, composition, first.vector, near=alone, rough=True))
        best.append(min(found, key=lambda f: f.cost))
    behind = (best[1].cost - best[0].cost) / now.variance
    return (float(behind), best[1]) if behind < apart else (apart, fit)


def _without_chain(problem: DiagnosisProblem, now: Refit, composition: Composition, effect: Effect) -> list[np.ndarray]:
    """A start for an effect that was fitted without what the measurement does to all channels, which is put back then.

    A filter of all channels and one of the motion alone trade places while both are far off.
    """
    chain = {x.name: own_values(now, x) for x in composition.effects if x.stage == "measurement" and x is not effect}
    if not chain:
        return []
    few = Composition(composition.baseline, tuple(x for x in composition.effects if x.name not in chain))
    begun = [placed(few, now, {effect.name: v}) for v in effect.points(problem.signals)]
    begun = sorted(begun, key=lambda v: _cost(problem, few, v))[:2]
    fit = min((refit(problem, few, v, iterations=2 * TASTE, rough=True) for v in begun), key=lambda f: f.cost)
    return [placed(composition, fit, chain)]


def taken_over(search: ForwardSelection, effect: Effect, rest: Refit, small: Effect) -> Alternative | None:
    """The set without one effect, a small one of the set grown in its place; None where it would not be plausible."""
    problem, now, composition = search.problem, search.fit, rest.composition
    if small.catch_all and not effect.catch_all:
        return None
    begun = [placed(composition, around, {small.name: v}) for v in small.points(problem.signals)
             for around in (rest, now)]
    begun = sorted(begun, key=lambda v: _cost(problem, composition, v))[:2]
    tasted = [refit(problem, composition, v, iterations=TASTE, near=rest, rough=True) for v in begun]
    near = now.cost + max(CHAINED * now.variance, COMPONENT * (rest.cost - now.cost))  # what trails by more is no rival
    fit = refit(problem, composition, min(tasted, key=lambda f: f.cost).vector, near=rest, target=near)
    if small.implausible(own_values(fit, small)):
        return None
    apart = (fit.cost - now.cost) / now.variance - len(effect.parameters) * np.log(problem.n_samples)
    apart = _weighed(problem, apart, now, fit, separation(rest, now), _kin(small, effect))
    return Alternative(small, fit, 1.0, float(apart))


def plainly(problem: DiagnosisProblem, now: Refit, other: Refit) -> tuple[float, float]:
    """By how much less error another fit leaves in the output's unit: (share of the smaller, standard errors).

    The whitened error weighs bands in which the noise of the inputs, which no filter of the output's noise knows,
    may be all that there is: there a cause that has to undo a filter is punished for the noise that it raises.
    """
    a, b = (problem.stack(problem.errors(f.composition, f.vector), whiten=False) for f in (now, other))
    gains = problem.block_sums(a**2 - b**2)
    total = float(gains.sum())
    return total / max(min(float(a @ a), float(b @ b)), 1e-300), total / max(float(np.sqrt(gains @ gains)), 1e-300)


def _unwhitened(problem: DiagnosisProblem, fit: Refit) -> Refit:
    """The same set fitted to the error in the output's unit.

    Two lags on one path differ by little else than the bands that whitening weighs most, so that the parameters of the
    right one, fitted there to the noise that it raises, would lose by the error in the output's unit as well.
    """
    return fit.cached(("unwhitened", problem.signals),
                      lambda: refit(problem.with_whitening(WHITE), fit.composition, fit.vector, rough=True))


def _weighed(problem: DiagnosisProblem, apart: float, now: Refit, other: Refit, margin: float, kin: bool) -> float:
    """Log-likelihood by which another fit trails, with what the error in the output's unit says of it."""
    if not kin:
        return in_both(apart, *plainly(problem, now, other), margin)
    share, certain = plainly(problem, _unwhitened(problem, now), _unwhitened(problem, other))
    return in_both(apart, share, certain, margin, HINTED_KIN)


def in_both(apart: float, share: float, certain: float, margin: float = SEPARATED, hinted: float = HINTED) -> float:
    """Log-likelihood by which a rival trails, overruled where the error in the output's unit surely says otherwise."""
    if abs(share) > PLAIN and abs(certain) > SURE:
        return min(apart, -2 * margin) if share > 0 else max(apart, 2 * margin)
    if share * apart > 0 and abs(share) > hinted and abs(certain) > 1:
        return 0.0
    return apart


def separation(rest: Refit, now: Refit) -> float:
    """Log-likelihood by which a rival must lead to take the place of a cause of the set, which wins over the rest."""
    return float(np.clip(SMALL_PRINT * (rest.cost - now.cost) / now.variance, SEPARATED, DISTINCT))


def _cost(problem: DiagnosisProblem, composition: Composition, vector: np.ndarray) -> float:
    """Squared whitened error as it stands."""
    errors = problem.stack(problem.errors(composition, vector))
    return float(errors @ errors)
