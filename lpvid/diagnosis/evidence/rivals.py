"""Rivals: the name of a member of a set, and the effects that these data do not distinguish from it."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from lpvid.diagnosis.evidence.calibration import Matcher, Support, match_component
from lpvid.diagnosis.evidence.effective_samples import sensor_noise_share
from lpvid.diagnosis.evidence.laplace import EvaluatedSet, WeighedSets
from lpvid.diagnosis.evidence.relations import LAGGING, related
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.effects.effect import Effect
from lpvid.rounding import EPS, TINY
from lpvid.validation.trust import LEVEL

NAMED_PROBABILITY = 0.75
"""calibrated probability from which a cause, or a family, is named: three times as probable as not, where a wrong name
costs three times what a missing one does (docs/diagnosis_boards.md: right and wrong names by this number)"""
SIGNIFICANT = 1 - LEVEL
"""one in twenty, as outside of every interval: p-value of the largest block statistic over all candidates, above which
nothing is named; weight, and likelihood by the error alone, from which a rival is listed"""


def reported_name(effect: Effect, component: str, sets: WeighedSets) -> tuple[str, Matcher, Support]:
    """The name under which an effect is reported, its matcher and its support.

    A special form is named where it is probable enough, else its component, where that is: where a current rises and
    falls unequally in all probable sets, the lag may be sure and the difference of its edges not.

    Parameters
    ----------
    effect : Effect
    component : str
        Component of which it is a form at its fitted parameters.
    sets : sequence of (EvaluatedSet, float)

    Returns
    -------
    name : str
    match : Matcher
    support : Support
    """
    whole = Support.of(sets, match_component(component))
    if effect.component == component:
        return effect.name, match_component(component), whole
    if component != effect.form_of:  # it reduces to that at these parameters; in other sets they may differ a little
        either = match_names(component, effect.name)
        return component, either, Support.of(sets, either)
    form = Support.of(sets, match_form(effect))
    if form.probability < NAMED_PROBABILITY <= whole.probability:
        return component, match_component(component), whole
    return effect.name, match_form(effect), form


def name_in(search: SetSearch, sets: WeighedSets, w: EvaluatedSet, effect: Effect) -> tuple[str, Matcher, Support]:
    """The name under which an effect of a set is reported: `reported_name`, unless the error contradicts that.

    An effect reduces to a simpler one (`Effect.comes_to`) where other parameters compensate the rest: an orifice that
    opens at low speed is a quadratic loss if the viscous share of the law can decrease by 2 c_o v_o. Where the visited
    set with the simpler effect in its place has a likelihood below `SIGNIFICANT`, by the error alone, they cannot,
    and it keeps its own name. A number at its bound needs no compensation. Flexible effects have no name of their own.

    Parameters
    ----------
    search : SetSearch
    sets : sequence of (EvaluatedSet, float)
    w : EvaluatedSet
    effect : Effect
        Of its members.

    Returns
    -------
    name : str
    match : Matcher
    support : Support
    """
    k = w.effects.index(effect)
    component, place = w.components[k], w.fit.composition.places[k]
    simpler = search.visited.get(w.members - {effect.name} | {component})
    low, high = (bound[place] for bound in w.fit.composition.bounds)
    at_bound = bool(np.any((w.fit.vector[place] <= low) | (w.fit.vector[place] >= high)))
    certain = effect.flexible or at_bound or component in (effect.component, effect.form_of)
    if simpler is not None and not certain:
        deficit = 0.5 * search.kappa * search.problem.n_samples * np.log(_cost(simpler) / _cost(w))
        if deficit > -np.log(SIGNIFICANT):
            return effect.name, match_form(effect), Support.of(sets, match_form(effect))
    return reported_name(effect, component, sets)


def match_form(effect: Effect) -> Matcher:
    """Matches an effect in the same form, at any place.

    Parameters
    ----------
    effect : Effect

    Returns
    -------
    Matcher
    """
    return lambda w: next((e for e in w.effects if e.component == effect.component), None)


def rivals_beside(search: SetSearch, sets: WeighedSets, best: EvaluatedSet, effect: Effect, values: np.ndarray
                  ) -> tuple[tuple[str, float], ...]:
    """Effects listed with a member of a set, or in its place, with their probabilities.

    Parameters
    ----------
    search : SetSearch
    sets : sequence of (EvaluatedSet, float)
        With their probabilities.
    best : EvaluatedSet
        The set.
    effect : Effect
        Of its members.
    values : (k,) array
        Its parameters.

    Returns
    -------
    tuple of (str, float)
    """
    name, match, support = name_in(search, sets, best, effect)
    sure = support.probability >= NAMED_PROBABILITY
    found = _equally_likely(search, sets, best, effect) if sure else _alternatives(sets, best, effect, match)
    if name == effect.name and (sure or found):
        found += _described_components(search, sets, best, effect, values, {n for n, _ in found})
    return found


def _equally_likely(search: SetSearch, sets: WeighedSets, best: EvaluatedSet, effect: Effect
                    ) -> tuple[tuple[str, float], ...]:
    """Effects that can replace one at nearly the same error, whatever the weight of the sets that hold them.

    With the errors e_r of the rival and e of the effect, all else refitted, the rival has the likelihood
    (e_r'e_r/e'e)^(−κN/2). It is listed where that is more than `SIGNIFICANT`: the misfit of the law may favour either
    of two effects whose difference is smaller than this misfit. So may the further terms of the evidence, which are
    left out here. For lags the part of either error due to the sensors' noise is subtracted: to undo a filter raises
    the noise of the motion, to undo a delay does not.

    It must be related. What contains the effect (`Effect.contains`), or a flexible form that describes it too
    (`Effect.stands_for`), is no rival: it leaves no more error whatever the truth, so that its error decides nothing.
    The evidence compares the two by their parameters' volume.
    """
    found: dict[str, float] = {}
    samples, component = search.kappa * search.problem.n_samples, best.components[best.effects.index(effect)]
    for other, k, w in _replacements(sets, best, component):
        if not related(effect, other) or _contains(w, other, {effect.name, component}):
            continue
        cost = _cost_without_sensor_noise(best, w) if other.path in LAGGING else _cost
        if 0.5 * samples * np.log(cost(w) / cost(best)) < -np.log(SIGNIFICANT):
            found[other.name] = Support.of(sets, match_component(k)).probability
    return tuple(found.items())


def _replacements(sets: WeighedSets, best: EvaluatedSet, component: str) -> list[tuple[Effect, str, EvaluatedSet]]:
    """Effects in the place of a component in other sets, with their components and these sets."""
    found, rest = [], sorted(k for k in best.components if k != component)
    for w, _ in sets:
        others = [(e, k) for e, k in zip(w.effects, w.components, strict=True)
                  if k not in best.components and e.name not in best.members]
        common = sorted(k for k in w.components if k in best.components)
        if component not in w.components and common == rest and not w.at_bounds and len(others) == 1:
            found.append((*others[0], w))
    return found


def _contains(w: EvaluatedSet, larger: Effect, names: Collection[str]) -> bool:
    """Whether a member of a set contains one of some effects, or is a form that describes it at its fitted values."""
    values = w.fit.vector[w.fit.composition.places[w.effects.index(larger)]]
    described = larger.stands_for(values, w.data.problem.signals) if larger.flexible else ()
    return not set(names).isdisjoint((*larger.contains, *described))


def _cost(w: EvaluatedSet) -> float:
    return max(w.fit.cost, TINY)


def _described_components(search: SetSearch, sets: WeighedSets, best: EvaluatedSet,
                          form: Effect, values: np.ndarray, listed: Collection[str]) -> tuple[tuple[str, float], ...]:
    """Candidates that a form describes too (`Effect.stands_for`), except those that are listed already."""
    known = {e.name for e in search.candidates} - {*best.components, *best.members, *listed}
    return tuple((n, Support.of(sets, match_component(n)).probability)
                 for n in form.stands_for(values, search.problem.signals) if n in known)


def _cost_without_sensor_noise(*sets: EvaluatedSet) -> Callable[[EvaluatedSet], float]:
    """Cost of a set less what is noise of the motion sensors, at the level that the errors of some sets may hold."""
    problem = sets[0].data.problem
    share = sensor_noise_share(problem, [problem.unweighed(w.fit.errors) for w in sets],
                               [w.carried_noise for w in sets])
    return lambda w: max(w.fit.cost - share * float(np.sum(problem.weighed(w.carried_noise) ** 2)), EPS * w.fit.cost,
                         TINY)


def match_names(*names: str) -> Matcher:
    """Matches a component, or an effect, of one of the names.

    Parameters
    ----------
    *names : str

    Returns
    -------
    Matcher
    """
    return lambda w: next((e for e, k in zip(w.effects, w.components, strict=True) if {k, e.name} & {*names}), None)


def _alternatives(sets: WeighedSets, best: EvaluatedSet, effect: Effect, match: Matcher
                  ) -> tuple[tuple[str, float], ...]:
    """Alternatives to an effect, with their probabilities; none where all together are not probable enough.

    In a set without the effect, its alternative is the member that the best set does not have and that contains it
    (`Effect.contains`), else the one that changes the output most. The alternatives are listed if the effect or one of
    them is present with `NAMED_PROBABILITY`. Otherwise those of its family are, if the effect or one of these is: those
    with `SIGNIFICANT` of the weight of the sets without it.
    """
    component = best.components[best.effects.index(effect)]
    weights: dict[str, float] = {}
    form: dict[str, str] = {}
    of_family: dict[str, None] = {}
    for w, p in sets:
        if match(w) is None:
            others = [(component in e.contains, c, k, e.name)
                      for e, k, c in zip(w.effects, w.components, w.changes, strict=True) if e.name not in best.members
                      and (k == component or k not in best.components or component in e.contains)]
            if others:
                contains, _, k, name = max(others)
                k = name if contains else k
                weights[k] = weights.get(k, 0.0) + p
                form.setdefault(k, name)
                if any(e.name == name and e.family == effect.family for e in w.effects):
                    of_family[k] = None
    for among in ([k for k, p in weights.items() if p > SIGNIFICANT],
                  [k for k in of_family if weights[k] > SIGNIFICANT * sum(weights.values())]):
        matches = match, *map(match_names, among)
        either = Support.of(sets, lambda w, matches=matches: next((e for m in matches if (e := m(w))), None))
        if either.probability >= NAMED_PROBABILITY:
            return tuple((form[k], Support.of(sets, match_names(k)).probability)
                         for k in sorted(among, key=lambda k: -weights[k]))
    return ()
