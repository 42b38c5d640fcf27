"""Rivals: what a member of a set may be named, and what else would do its work."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.evidence.calibration import Matcher, Support, match_component
from lpvid.diagnosis.evidence.laplace import EvaluatedSet
from lpvid.diagnosis.evidence.relations import LAGGING, related
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.diagnosis.problem import EXPLODED
from lpvid.diagnosis.spectra import noisier

NAMED_PROBABILITY = 2 / 3
"""calibrated probability from which a cause, or a family, is named: twice as probable as not, where a wrong name costs
twice what a missing one does (docs/diagnosis_boards.md: right and wrong names by this number)"""
LISTED_WEIGHT = 0.05
"""weight of the sets without a cause that hold a rival, from which it is listed"""


def reported_name(effect: Effect, component: str, sets: Sequence[tuple[EvaluatedSet, float]], structured: float
             ) -> tuple[str, Matcher, Support]:
    """What an effect is named, what finds that in a set, and what speaks for it.

    A special form is named where it is probable enough; else its component, where that is: of a current that
    rises and falls unequally in all likely sets, the lag may be sure and that its edges differ not.

    Parameters
    ----------
    effect : Effect
    component : str
        Component of which it is a form, as its numbers stand.
    sets : sequence of (Weighed, float)
    structured : float
        As for `Support.of`.

    Returns
    -------
    name : str
    match : callable
    support : Support
    """
    whole = Support.of(sets, match_component(component), structured)
    if effect.component == component:
        return effect.name, match_component(component), whole
    if component != effect.form_of:  # its numbers leave no more than that, here; in other sets they may be a little off it
        either = _match_names(component, effect.name)
        return component, either, Support.of(sets, either, structured)
    form = Support.of(sets, match_form(effect), structured)
    if form.probability < NAMED_PROBABILITY <= whole.probability:
        return component, match_component(component), whole
    return effect.name, match_form(effect), form


def match_form(effect: Effect) -> Matcher:
    """What finds an effect in this very form, wherever it sits.

    Parameters
    ----------
    effect : Effect

    Returns
    -------
    callable
    """
    return lambda w: next((e for e in w.effects if e.component == effect.component), None)


def rivals_beside(search: SetSearch, sets: Sequence[tuple[EvaluatedSet, float]], best: EvaluatedSet, effect: Effect,
              values: np.ndarray) -> tuple[tuple[str, float], ...]:
    """What is listed with a member of a set, or in its place, each with its probability.

    Parameters
    ----------
    search : SetSearch
    sets : sequence of (Weighed, float)
        With their probabilities.
    best : Weighed
        The set.
    effect : Effect
        Of its members.
    values : (k,) array
        Its parameters.

    Returns
    -------
    tuple of (str, float)
    """
    component = best.components[best.effects.index(effect)]
    name, match, support = reported_name(effect, component, sets, search.structured)
    if support.probability < NAMED_PROBABILITY:
        return _alternatives(sets, best, effect, match, search.structured)
    found = _equally_likely(search, sets, best, effect)
    if name == effect.name:
        found += _described_components(search, sets, best, effect, values, {n for n, _ in found})
    return found


def _equally_likely(search: SetSearch, sets: Sequence[tuple[EvaluatedSet, float]], best: EvaluatedSet, effect: Effect
             ) -> tuple[tuple[str, float], ...]:
    """What the error does not speak against in the place of an effect, whatever the sets that hold it weigh.

    By the error alone, as it is left of either all else refitted, a rival has the likelihood (e_r'e_r/e'e)^(−κN/2). It
    is listed where that is more than `LISTED_WEIGHT`: a misfit of the law favours one of two that differ by less than it, and
    so does what evidence adds, the number of shapes and how much of the error looks like a discrepancy. Of lags, what
    the sensors' noise makes of either error is taken off: to undo a filter raises the noise of the motion, to undo a
    delay does not, and the error of the filter is larger even where it is the truth.

    One effect in the place of one is next of kin. Of any family is what has help: two that physics links (an entry of
    the catalogue that does their work alone, for the price of one, is no evidence: a dead zone of the force against a
    play and a spring), or one with the filter of all channels that every record has passed, which rounds the kinks of
    a play as a spring would. With more freedom it has no allowance: it leaves less error, with the filter less than the
    best set beside the same filter. What leaves more of the work
    of the effect than it does, in the logarithm, is no rival; nor is a pair of which one alone is.
    """
    found: dict[str, float] = {}
    samples, component = search.kappa * search.problem.n_samples, best.components[best.effects.index(effect)]
    reduced = search.visited.get(best.members - {effect.name})
    for others, w in _replacements(sets, best, component):
        names = {e.name for e, _ in others}
        larger = len(w.members) > len(best.members)
        if (not names.isdisjoint(found) if larger else not related(effect, others[0][0])) or \
                any(e.flexible and k == e.name and not related(effect, e) for e, k in others):
            continue
        lagging = any(e.path in LAGGING for e, _ in others)
        cost = _cost_without_sensor_noise if lagging else _cost
        reference = _with_same_filter(search, best, w, cost) if larger else best
        deficit = 0.5 * samples * np.log(cost(w) / cost(reference))
        works = reduced is None or cost(w) ** 2 < cost(reduced) * cost(best)
        if deficit < (0.0 if larger else -np.log(LISTED_WEIGHT)) and works:
            found |= {e.name: Support.of(sets, match_component(k), search.structured).probability for e, k in others}
    return tuple(found.items())


def _replacements(sets: Sequence[tuple[EvaluatedSet, float]], best: EvaluatedSet, component: str
                 ) -> list[tuple[list[tuple[Effect, str]], EvaluatedSet]]:
    """What stands in the place of a kind in other sets, with these: one effect, or two that physics links.

    The sets of fewest members come first. A filter of all channels counts only where nothing else does.
    """
    found, rest = [], sorted(k for k in best.components if k != component)
    for w, _ in sets:
        others = [(e, k) for e, k in zip(w.effects, w.components, strict=True)
                  if k not in best.components and e.name not in best.members]
        others = [(e, k) for e, k in others if e.path != "all"] or others
        if component not in w.components and sorted(k for k in w.components if k in best.components) == rest and not w.at_bounds \
                and _acts_as_one([e for e, _ in others]):
            found.append((others, w))
    return sorted(found, key=lambda pair: len(pair[1].members))


def _with_same_filter(search: SetSearch, best: EvaluatedSet, w: EvaluatedSet, cost: Callable[[EvaluatedSet], float]) -> EvaluatedSet:
    """The best set with the filter of all channels that another one has and it has not; itself where that is no less.

    A filter rounds what either leaves: beside it friction is compared with a spring beside it, not alone.
    """
    places = w.fit.composition.places
    filters = [(e, w.fit.vector[p]) for e, p in zip(w.effects, places, strict=True)
               if e.path == "all" and e.name not in best.members]
    return min([best, *(search.refitted_with(best, e, v) for e, v in filters)], key=cost)


def _cost(w: EvaluatedSet) -> float:
    return max(w.fit.cost, 1e-300)


def _acts_as_one(effects: Sequence[Effect]) -> bool:
    """Whether effects stand in the place of one: one itself, or two partners."""
    return len(effects) == 1 or (len(effects) == 2 and (effects[0].name in effects[1].partners
                                                       or effects[1].name in effects[0].partners))


def _described_components(search: SetSearch, sets: Sequence[tuple[EvaluatedSet, float]], best: EvaluatedSet, form: Effect,
                   values: np.ndarray, listed: Collection[str]) -> tuple[tuple[str, float], ...]:
    """Components of these data that a form describes too (`Effect.stands_for`), but for those listed by now."""
    known = {e.name for e in search.candidates} - {*best.components, *best.members, *listed}
    return tuple((n, Support.of(sets, match_component(n), search.structured).probability)
                 for n in form.stands_for(values, search.problem.signals) if n in known)


def _cost_without_sensor_noise(w: EvaluatedSet) -> float:
    """Squared error of a set less what the noise of the sensors of motion makes of it: what as much again changes."""
    problem, composition, vector = w.data.problem, w.fit.composition, w.fit.vector

    def find() -> float:
        rng = np.random.default_rng(0)
        changes = [composition.predict(noisier(s, rng), vector) - composition.predict(s, vector)
                   for s in problem.signals]
        carried = float(np.sum(np.minimum(problem.stack(changes) ** 2, EXPLODED)))
        return max(w.fit.cost - carried, 1e-12 * w.fit.cost, 1e-300)

    return w.fit.cached("without noise", find)


def _match_names(*names: str) -> Matcher:
    """Finds a component, or an effect, of one of the names."""
    return lambda w: next((e for e, k in zip(w.effects, w.components, strict=True) if {k, e.name} & {*names}), None)


def _match_any(*findings: Matcher) -> Matcher:
    """Finds what the first of several finds that finds anything."""
    return lambda w: next((e for f in findings if (e := f(w)) is not None), None)


def _alternatives(sets: Sequence[tuple[EvaluatedSet, float]], best: EvaluatedSet, effect: Effect, match: Matcher,
             structured: float) -> tuple[tuple[str, float], ...]:
    """Effects that take the place of one, with their probability; none where it is not probable that one of them does.

    Of what a set holds in its absence, and the best set does not, that which contains it does its work, else that which
    changes the output most; and only where it or one of them is there with `NAMED_PROBABILITY` do they answer for it together.
    Where they do not, those of its family do if the family is there with `NAMED_PROBABILITY`: of these that hold `LISTED_WEIGHT` of the
    weight that the sets without it have.
    """
    component = best.components[best.effects.index(effect)]
    weights: dict[str, float] = {}
    form: dict[str, str] = {}
    of_family: dict[str, None] = {}
    for w, p in sets:
        if match(w) is None:
            other = [(component in e.contains, c, k, e.name) for e, k, c in zip(w.effects, w.components, w.changes, strict=True)
                     if e.name not in best.members and (k == component or k not in best.components or component in e.contains)]
            if other:
                contains, _, k, name = max(other)
                k = name if contains else k
                weights[k] = weights.get(k, 0.0) + p
                form.setdefault(k, name)
                if any(e.name == name and e.family == effect.family for e in w.effects):
                    of_family[k] = None
    without = sum(weights.values())
    for among in ([k for k, p in weights.items() if p > LISTED_WEIGHT], [k for k in of_family if weights[k] > LISTED_WEIGHT * without]):
        either = Support.of(sets, _match_any(match, *map(_match_names, among)), structured)
        if either.probability >= NAMED_PROBABILITY:
            return tuple((form[k], Support.of(sets, _match_names(k), structured).probability)
                         for k in sorted(among, key=lambda k: -weights[k]))
    return ()
