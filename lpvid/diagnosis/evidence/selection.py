"""Selection: the most probable set that is confirmed out of fold, and which of its members are named."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from lpvid.baselines.budgets import LONG
from lpvid.diagnosis.evidence.calibration import Support, match_family
from lpvid.diagnosis.evidence.discrepancy import ACCEPTABLE_MISFIT
from lpvid.diagnosis.evidence.laplace import EvaluatedSet
from lpvid.diagnosis.evidence.rivals import NAMED_PROBABILITY, SIGNIFICANT, match_form, name_in, rivals_beside
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.diagnosis.evidence.visited import posterior
from lpvid.diagnosis.folds import errors_on_other_fold, join_folds, out_of_fold
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.remainder import predicted_share
from lpvid.diagnosis.screening import start_vector
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from lpvid.rounding import TINY
from lpvid.validation.figures import gain_percent
from lpvid.validation.trust import LEVEL

T = TypeVar("T")
R = TypeVar("R")
NAMED_CHANGE, NAMED_SHARE_OF_ERROR = 0.02, 0.1
"""change of the output, as a share of its rms, from which a cause is named; and as a share of the error left, where
that is less (tests/benchmarks/real_causes.py)"""
LEAST_NAMED_CHANGE = 0.005
"""change of the output, as a share of its rms, below which no cause is named"""
OUT_OF_FOLD = "out of fold"
"""key under which the folds of a fit are cached"""


@dataclass(frozen=True, eq=False)
class SetMember:
    """One effect of the selected set: its name, probability, rivals and contribution.

    Attributes
    ----------
    effect : Effect
    name : str
        Of the effect, or of its component where that is probable enough and the form is not.
    values : (k,) array
    probability, of_family : float
        Calibrated, of the name at any place, and of any effect of its family.
    weight : float
        Of the sets that hold it.
    rivals : tuple of (str, float)
        Effects from which these data do not distinguish it, and their probabilities.
    cost : float
        Reduction of the squared error by it, the others refitted.
    gain : float
        Reduction of the squared error out of fold by it, over that without it [%].
    better : float
        Share of the blocks in which the error out of fold is lower with it.
    change : float
        Of the output when it is removed and the others are refitted, as a share of the output's rms. Of several that
        change too little to be named the others are removed first: of two with the same effect, neither alone would
        change enough.
    evidence : float or None
        Log-evidence with it less that without it; None where the set without it has none (a strength at its bound).
    """

    effect: Effect
    name: str
    values: np.ndarray
    probability: float
    of_family: float
    weight: float
    rivals: tuple[tuple[str, float], ...]
    cost: float
    gain: float
    better: float
    change: float
    evidence: float | None

    def reason_not_named(self, relative_error: float, law_error: float) -> str | None:
        """Why it is not named; None where it is, or has rivals.

        Parameters
        ----------
        relative_error : float
            Error left, over the output: root mean squares.
        law_error : float
            The part of it that the inputs predict: the error of the law itself. A cause that changes less may be a
            part of it.

        Returns
        -------
        str or None
        """
        least = least_change(relative_error, law_error)
        if self.change < least:
            return f"it changes the output by {self.change:.2%}, less than {least:.2%}: too little to be named"
        if self.probability < NAMED_PROBABILITY and not self.rivals:
            return f"probability {self.probability:.2f} only, and no alternative is probable enough"
        return None


def least_change(relative_error: float, law_error: float) -> float:
    """Change of the output, over its rms, below which a cause is not named.

    Parameters
    ----------
    relative_error, law_error : float
        As of `SetMember.reason_not_named`.

    Returns
    -------
    float
    """
    return max(min(NAMED_CHANGE, NAMED_SHARE_OF_ERROR * relative_error), LEAST_NAMED_CHANGE, law_error)


@dataclass(frozen=True, eq=False)
class SelectedSet:
    """The set to report, with its members and its errors out of fold.

    Attributes
    ----------
    problem : DiagnosisProblem
    root, fit : Refit
        The baseline alone and the set.
    cost_reduction : float
        Of the squared error by the set against the baseline alone, on the samples of the search.
    before, after : (N,) arrays
        Their errors out of fold, in the output's unit.
    members : tuple of SetMember
        Largest change first.
    relative_error : float
        Error out of fold of the set, over the output: root mean squares.
    predictable : float
        Share of its squared error that the inputs predict.
    dropped : tuple of (str, str)
        Effects that did not lower the error out of fold, and the reason given.
    sets : list of (EvaluatedSet, float)
        Visited sets and their weights, without those that were not confirmed.
    least_error_set : (tuple of str, float), optional
        Where the selected set is empty: the causes of the visited set of least error, and the error out of fold with
        them, over the output, if that is lower by more than a good law's misfit: the error is no noise then.
    """

    problem: DiagnosisProblem
    root: Refit
    fit: Refit
    cost_reduction: float
    before: np.ndarray
    after: np.ndarray
    members: tuple[SetMember, ...]
    relative_error: float
    predictable: float
    dropped: tuple[tuple[str, str], ...]
    sets: list[tuple[EvaluatedSet, float]]
    least_error_set: tuple[tuple[str, ...], float] | None = None

    @property
    def law_error(self) -> float:
        """The part of the error that the inputs predict, over the output: root mean squares."""
        return float(np.sqrt(self.predictable)) * self.relative_error

    @property
    def gains(self) -> np.ndarray:
        """(blocks,) reduction of the squared error out of fold by the set."""
        return self.problem.block_sums(self.before**2 - self.after**2)

    def reason_not_named(self, m: SetMember) -> str | None:
        """Why a member is not named; None where it is, or has rivals.

        Nor is one named beside a flexible form that is not resolved and changes the output more. What the form stands
        for is not known, and it describes that only roughly: of a spring that the candidates lack, `model-order` is the
        lag, and friction the rest.

        Parameters
        ----------
        m : SetMember

        Returns
        -------
        str or None
        """
        reason = self._reason(m)
        form = next((f for f in self.members if f.effect.flexible and f.change > m.change
                     and (f.rivals or self._reason(f))), None)
        if reason or m.rivals or form is None:
            return reason
        return f"it changes the output by {m.change:.2%}, less than {form.effect.name}, which may stand for any of " \
               "several components: it may be a part of one of these"

    def _reason(self, m: SetMember) -> str | None:
        return m.reason_not_named(self.relative_error, self.law_error)


def select_set(search: SetSearch, report_progress: Callable[[str], None],
               rejected_sets: Collection[frozenset[str]] = ()) -> SelectedSet:
    """The most probable set, or one nearly as probable that predicts better and keeps its names, with its members.

    Every member of either lowers the error out of fold.

    Parameters
    ----------
    search : SetSearch
    report_progress : callable
    rejected_sets : collection of frozenset of str
        Sets with no lower error on further records than the baseline.

    Returns
    -------
    SelectedSet
    """
    root = search.root.fit
    smaller: dict[frozenset[str], frozenset[str]] = {}
    dropped: dict[str, str] = {}
    fits = {frozenset(): root}
    while True:
        sets = _confirmed_sets(search, rejected_sets, smaller)
        best = reported_set(sets)
        report_progress(f"out-of-fold check of {', '.join(sorted(best.members)) or 'the baseline alone'}")
        ablations, unhelpful = _ablated(search, fits, best)
        if not unhelpful:
            break
        smaller[best.members] = best.members - unhelpful
        dropped |= dict.fromkeys(unhelpful, "the error out of fold is no lower with it")
    found = _assessed(search, fits, sets, best, best, ablations, dropped)
    if not best.members:
        return replace(found, least_error_set=_least_error_set(search, fits))
    for w in _better_predicting(search, fits, sets, best):
        ablations, unhelpful = _ablated(search, fits, w)
        other = None if unhelpful else _assessed(search, fits, sets, best, w, ablations, dropped)
        if other is not None and _names_preserved(_named(other), _named(found)) and not _too_little(other):
            return _named_alike(other, found)
    return found


def _named_alike(other: SelectedSet, found: SelectedSet) -> SelectedSet:
    """A set with the names of the most probable one: names come from the weights, places from the set to report."""
    names = {m.effect.component: m.name for m in found.members if not m.effect.flexible}
    members = [m if m.effect.flexible else replace(m, name=names.get(m.effect.component, m.name))
               for m in other.members]
    return replace(other, members=tuple(named_once(members, other.sets)))


def _ablated(search: SetSearch, fits: dict[frozenset[str], Refit], w: EvaluatedSet) -> tuple[list[Refit], set[str]]:
    """Refits of a set without each of its members, and the members without which its error out of fold is no higher."""
    fit = fits[w.members] = fits.get(w.members) or _refitted(search, w.fit.composition, w.fit, search.in_parallel)
    without = [Composition(fit.composition.baseline, tuple(e for e in w.effects if e is not one)) for one in w.effects]
    _cross_validate(search, fits, fit, (fit.composition, *without, search.root.fit.composition))
    after, ablations = folds_of(search.problem, fit), [fits[c.members] for c in without]
    return ablations, {e.name for e, ablation in zip(w.effects, ablations, strict=True)
                       if not _lowers_error(search.problem, ablation, after)}


def _assessed(search: SetSearch, fits: dict[frozenset[str], Refit], sets: list[tuple[EvaluatedSet, float]],
              best: EvaluatedSet, w: EvaluatedSet, ablations: Sequence[Refit], dropped: Mapping[str, str]
              ) -> SelectedSet:
    """A set with its members assessed; `best` is the most probable set, of which the neighbours were visited."""
    problem, root, fit = search.problem, search.root.fit, fits[w.members]
    after = folds_of(problem, fit)
    members = [_member(search, sets, best, w, fit, after, e, r) for e, r in zip(w.effects, ablations, strict=True)]
    members.sort(key=lambda m: -m.change)
    members = named_once(members, sets)
    relative_error = search.relative_rms(problem.unweighed(after))
    share = predicted_share(problem, problem.errors(fit.composition, fit.vector), search.channels)
    selected = SelectedSet(problem, root, fit, root.cost - fit.cost, folds_of(problem, root), after, tuple(members),
                           relative_error, share, tuple(t for t in dropped.items() if t[0] not in w.members), sets)
    little = _too_little(selected, selected.law_error)
    if len(little) < 2:
        return selected
    alone = _changes_alone(search, fits, fit, [m.effect for m in little])
    members = [replace(m, change=max(m.change, alone.get(m.effect.name, 0.0))) for m in members]
    return replace(selected, members=tuple(sorted(members, key=lambda m: -m.change)))


def named_once(members: list[SetMember], sets: list[tuple[EvaluatedSet, float]]) -> list[SetMember]:
    """Members whose names differ: a component's name is that of its own effect, or else of the form that changes most.

    Parameters
    ----------
    members : list of SetMember
        Largest change first.
    sets : list of (EvaluatedSet, float)

    Returns
    -------
    list of SetMember
        The other forms under their own names, with the support of these.
    """
    taken, found = {m.effect.name for m in members}, []
    for m in members:
        if m.name != m.effect.name and m.name in taken:
            form = Support.of(sets, match_form(m.effect))
            m = replace(m, name=m.effect.name, probability=form.probability, weight=form.weight)
        found, taken = [*found, m], {*taken, m.name}
    return found


def _changes_alone(search: SetSearch, fits: dict[frozenset[str], Refit], fit: Refit, effects: Sequence[Effect]
                   ) -> dict[str, float]:
    """Change of the output by each of some members with the others of them removed, as a share of the output's rms."""
    others = tuple(e for e in fit.composition.effects if e not in effects)
    wanted = [Composition(fit.composition.baseline, others),
              *(Composition(fit.composition.baseline, tuple(e for e in fit.composition.effects if e in (*others, one)))
                for one in effects)]
    _cross_validate(search, fits, fit, wanted)
    without, *ones = (fits[c.members].errors for c in wanted)
    return {e.name: search.relative_rms(search.problem.unweighed(without - one))
            for e, one in zip(effects, ones, strict=True)}


def _named(selected: SelectedSet) -> dict[str, float]:
    """Components named without rivals in a set, in whatever place, and the reduction of the logarithm of the error by
    each. A flexible form in a component's place is not that component."""
    error = max(selected.root.cost - selected.cost_reduction, TINY)
    named = [m for m in selected.members if selected.reason_not_named(m) is None and not m.rivals]
    keys = [m.name if m.effect.flexible or m.name != m.effect.name else m.effect.component for m in named]
    return {key: float(np.log1p(max(m.cost, 0.0) / error)) for key, m in zip(keys, named, strict=True)}


def _names_preserved(here: Mapping[str, float], most_probable: Mapping[str, float]) -> bool:
    """Whether each component named in the most probable set is named here and achieves half of its reduction too."""
    return all(2 * here.get(name, 0.0) >= reduction for name, reduction in most_probable.items())


def _too_little(selected: SelectedSet, law_error: float = 0.0) -> list[SetMember]:
    """Members that change too little to be named; the error of the law itself is left aside where it is given as 0."""
    return [m for m in selected.members if m.change < least_change(selected.relative_error, law_error)]


def _better_predicting(search: SetSearch, fits: dict[frozenset[str], Refit],
                       sets: Sequence[tuple[EvaluatedSet, float]], best: EvaluatedSet) -> list[EvaluatedSet]:
    """Sets nearly as probable as the most probable one that have less error out of fold, the least first.

    Evidence counts a structured error as few samples, so that two sets may share the weight where one leaves half of
    the other's error. Of the most probable sets that hold all but `SIGNIFICANT` of the weight these have an error out
    of fold that is lower than that of the most probable set `best` by more than one standard error of the blocks'
    gains. A set whose error on the samples of its fit is above that cannot be one, and is not refitted; nor is one with
    a special form that is not sure.
    """
    problem, near = search.problem, fits[best.members]
    least = _out_of_fold_cost(problem, near)
    before, weights = np.cumsum([0.0, *(p for _, p in sets[:-1])]), _component_weights(sets)
    others = [w for (w, _), held in zip(sets, before, strict=True)
              if held < 1.0 - SIGNIFICANT and w.fit.cost < least and w is not best and _forms_sure(w, sets, weights)]
    _cross_validate(search, fits, near, [w.fit.composition for w in others])
    better = [w for w in others if _lowers_error(problem, near, folds_of(problem, fits[w.members]))]
    return sorted(better, key=lambda w: _out_of_fold_cost(problem, fits[w.members]))


def _least_error_set(search: SetSearch, fits: dict[frozenset[str], Refit]) -> tuple[tuple[str, ...], float] | None:
    """The visited set of least error, and its error out of fold; None where that is not notably lower."""
    problem, root = search.problem, fits[frozenset()]
    least = min((w for w in search.visited.values() if not w.at_bounds), key=lambda w: w.fit.cost)

    def share(errors: np.ndarray) -> float:
        return search.relative_rms(problem.unweighed(errors)) ** 2

    if not share(root.errors) - share(least.fit.errors) > ACCEPTABLE_MISFIT**2:
        return None
    _cross_validate(search, fits, root, [root.composition, least.fit.composition])
    before, after = folds_of(problem, fits[frozenset()]), folds_of(problem, fits[least.members])
    if not (_lowers_error(problem, root, after) and share(before) - share(after) > ACCEPTABLE_MISFIT**2):
        return None
    return tuple(sorted(least.members)), float(np.sqrt(share(after)))


def _out_of_fold_cost(problem: DiagnosisProblem, fit: Refit) -> float:
    """Sum of the squared errors out of fold."""
    return float(np.sum(folds_of(problem, fit)**2))


def _confirmed_sets(search: SetSearch, rejected_sets: Collection[frozenset[str]],
                    smaller: Mapping[frozenset[str], frozenset[str]]) -> list[tuple[EvaluatedSet, float]]:
    """Visited sets and their weights, without the rejected ones; the baseline alone where no other is left.

    Where some members of a set do not lower the error out of fold (`smaller`), its weight goes to the set without them,
    or to the largest visited subset of that: to drop it would lower the weight of its other members too. So does that
    of a rejected set. Where no visited set with a cause is left it is dropped: that it fails is no evidence for the
    baseline alone.
    """
    visited = {w.members: w for w, _ in posterior(search)}
    weights = {members: 0.0 for members in visited if members not in smaller and members not in rejected_sets}
    for w, p in posterior(search):
        members = w.members
        while members in smaller:
            members = smaller[members]
        within = [m for m in weights if m <= members and (m or not w.members)]
        if within:
            weights[max(within, key=len)] += p
    total = sum(weights.values())
    if total <= 0:
        return [(search.root, 1.0)]
    return sorted(((visited[m], p / total) for m, p in weights.items()), key=lambda t: -t[1])


def _refitted(search: SetSearch, composition: Composition, near: Refit,
              in_parallel: Callable[[Callable[[np.ndarray], Refit], Sequence[np.ndarray]], list[Refit]]) -> Refit:
    """The better of two refits to the end: from a related fit, and from the refit of this set by the search."""
    known = search.visited.get(composition.members)
    starts = [start_vector(composition, near, {}), *([] if known is None else [known.fit.vector])]
    return min(in_parallel(lambda v: refit(search.problem, composition, v, rough=True), starts), key=lambda f: f.cost)


def _cross_validate(search: SetSearch, fits: dict[frozenset[str], Refit], near: Refit,
                    wanted: Sequence[Composition]) -> None:
    """Refit compositions that are not yet among `fits`, and compute the errors out of fold of all."""
    def checked(composition: Composition) -> tuple[Refit | None, np.ndarray]:
        known = fits.get(composition.members)
        found = known or _refitted(search, composition, near, lambda one, starts: [one(v) for v in starts])
        folds = folds_of(search.problem, found)
        return (None if known else found), folds  # a known fit is not sent back from its process

    new = {c.members: c for c in wanted if c.members not in fits or OUT_OF_FOLD not in fits[c.members].cache}
    for members, (found, folds) in zip(new, search.in_parallel(checked, list(new.values())), strict=True):
        fit = fits.setdefault(members, found) if found else fits[members]
        fit.cache[OUT_OF_FOLD] = folds


def on_all_samples(search: SetSearch, selected: SelectedSet, problem: DiagnosisProblem) -> SelectedSet:
    """The same with errors and parameters by refits on all samples, where the search used some.

    Parameters
    ----------
    search : SetSearch
    selected : SelectedSet
        On the samples of the search.
    problem : DiagnosisProblem
        Of all samples.

    Returns
    -------
    SelectedSet
        Its probabilities, gains, shares and relative error are still those of the search.
    """
    weighs = selected.members and search.problem.whitening and problem.n_samples <= LONG  # long blocks take long
    weighed = search.with_weights(problem, selected.fit, problem.signals) if weighs else problem
    alone = (selected.root.composition.baseline if weighs else selected.root).vector  # by weights it is another law

    def refitted(f: Refit, start: np.ndarray, on: DiagnosisProblem) -> Refit:
        found = refit(on, f.composition, start, rough=True)
        _ = found.jacobian  # with which the refits to both folds begin
        return found

    def of_each(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
        """On every processor, or one after the other along many samples: each takes the memory of a Jacobian."""
        if problem.n_samples <= LONG:
            return search.in_parallel(function, items, (problem, weighed))
        results = []
        for item in items:
            results.append(function(item))
            problem.forget_simulations(collected=True)
        return results

    fits = ((selected.root, alone, problem), (selected.fit, selected.fit.vector, weighed))
    root, fit = of_each(lambda i: refitted(*i), fits)
    halves = of_each(lambda i: errors_on_other_fold(i[0].problem, *i), [(f, k) for f in (fit, root) for k in (0, 1)])
    after, before = weighed.unweighed(join_folds(problem, halves[:2])), join_folds(problem, halves[2:])
    fit = fit.on(problem)
    places = {e.name: p for e, p in zip(fit.composition.effects, fit.composition.places, strict=True)}
    members = tuple(replace(m, values=fit.vector[places[m.effect.name]]) for m in selected.members)
    return replace(selected, problem=problem, root=root, fit=fit, before=before, after=after, members=members)


def folds_of(problem: DiagnosisProblem, fit: Refit) -> np.ndarray:
    """Errors out of fold, computed once for a fit.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
        To both folds; its cache keeps them.

    Returns
    -------
    (N,) array
        In the output's unit.
    """
    return fit.cached(OUT_OF_FOLD, lambda: out_of_fold(problem, fit))


def _gains(problem: DiagnosisProblem, before: Refit, after: np.ndarray) -> np.ndarray:
    """(blocks,) reduction of the squared error out of fold."""
    return problem.block_sums(folds_of(problem, before)**2 - after**2)


def _lowers_error(problem: DiagnosisProblem, before: Refit, after: np.ndarray) -> bool:
    """Whether the error out of fold is lower, by more than one standard error of the blocks' gains."""
    gains = _gains(problem, before, after)
    return bool(gains.sum() > np.sqrt(gains @ gains))


def reported_set(sets: Sequence[tuple[EvaluatedSet, float]]) -> EvaluatedSet:
    """The set to report: of the most probable components, in the forms that are sure.

    The weights of sets with the same components in different forms are added. The components are those that are more
    probable than not, if a visited set holds exactly these: the median probability model, which predicts best among
    single sets (Barbieri and Berger 2004). Otherwise, or where no component is so probable, they are those of the most
    probable set that holds all of these: else the baseline alone could come before rivals that share a weight. Of the
    sets of these components it is the most probable one whose special forms are all sure, else the most probable one.

    Parameters
    ----------
    sets : sequence of (EvaluatedSet, float)
        With their probabilities, the most probable first.

    Returns
    -------
    EvaluatedSet
    """
    weights = _component_weights(sets)
    median = frozenset(c for components in weights for c in components
                       if sum(p for k, p in weights.items() if c in k) > 0.5)
    larger = [k for k in weights if median <= k] or list(weights)
    components = median if median and median in weights else max(larger, key=lambda k: weights[k])
    forms = [w for w, _ in sets if frozenset(w.components) == components]
    return next((w for w in forms if _forms_sure(w, sets, weights)), forms[0])


def _component_weights(sets: Sequence[tuple[EvaluatedSet, float]]) -> dict[frozenset[str], float]:
    """Weight of every set of components, in any forms."""
    weights: dict[frozenset[str], float] = {}
    for w, p in sets:
        weights[frozenset(w.components)] = weights.get(frozenset(w.components), 0.0) + p
    return weights


def _forms_sure(w: EvaluatedSet, sets: Sequence[tuple[EvaluatedSet, float]], weights: Mapping[frozenset[str], float]
                ) -> bool:
    """Whether the special forms in a set have all but `SIGNIFICANT` of the weight of its components."""
    return all(e.component == k or
               sum(p for v, p in sets if match_form(e)(v) is not None) >= LEVEL * weights[frozenset(w.components)]
               for e, k in zip(w.effects, w.components, strict=True))


def _most_probable_with(effect: Effect, sets: Sequence[tuple[EvaluatedSet, float]], w: EvaluatedSet) -> EvaluatedSet:
    """The most probable set that holds an effect; `w` where no set of them does."""
    return next((v for v, _ in sets if effect in v.effects), w)


def _member(search: SetSearch, sets: Sequence[tuple[EvaluatedSet, float]], best: EvaluatedSet, w: EvaluatedSet,
            fit: Refit, after: np.ndarray, effect: Effect, ablation: Refit) -> SetMember:
    """An effect of a set `w` as a member; its rivals are those in the most probable set that holds it.

    The neighbours of that set were visited, and whether a name is sure must not depend on which of several nearly as
    probable sets predicts best. Nor on which components are more probable than not: friction and one of four springs
    leave a third of what friction alone leaves, and what replaces friction there need not do so beside a spring.
    """
    problem = fit.problem
    gains = _gains(problem, ablation, after)
    before, left = (float(np.sum(problem.unweighed(e) ** 2)) for e in (folds_of(problem, ablation), after))
    name, _, support = name_in(search, sets, w, effect)
    of_family = Support.of(sets, match_family(effect.family)).probability
    values = fit.vector[fit.composition.places[fit.composition.effects.index(effect)]]
    rivals = rivals_beside(search, sets, _most_probable_with(effect, sets, w), effect, values)
    without = search.visited.get(w.members - {effect.name}) or EvaluatedSet(search.data, ablation)
    gain = search.score(w) - search.score(without)
    return SetMember(effect, name, values, support.probability, of_family, support.weight, rivals,
                     ablation.cost - fit.cost, gain_percent(before, left) if before > 0 else 0.0,
                     float(np.mean(gains > 0)), search.relative_rms(problem.unweighed(ablation.errors - fit.errors)),
                     float(gain) if np.isfinite(gain) else None)
