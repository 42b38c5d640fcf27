"""Selection: the most probable set that is confirmed out of fold, with its members assessed."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lpvid.baselines.budgets import LONG
from lpvid.diagnosis.evidence.calibration import Support, match_family
from lpvid.diagnosis.evidence.discrepancy import ACCEPTABLE_MISFIT
from lpvid.diagnosis.evidence.laplace import EvaluatedSet, Members, WeighedSets
from lpvid.diagnosis.evidence.members import NAMED_CHANGE, SelectedSet, SetMember, keeps_names, named_alike, named_once
from lpvid.diagnosis.evidence.rivals import SIGNIFICANT, name_in, rivals_beside
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.diagnosis.evidence.weighed_sets import confirmed_sets, reported_set
from lpvid.diagnosis.folds import errors_on_other_fold, join_folds, out_of_fold
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.remainder import predicted_share
from lpvid.diagnosis.screening import start_vector
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from lpvid.validation.figures import gain_percent

NEEDLESS = f"with it the error out of fold is no lower, or the output changes by less than {NAMED_CHANGE:.1%}"
"""why a member of a more probable set is left out"""
OUT_OF_FOLD = "out of fold"
"""key under which the folds of a fit are cached"""


def select_set(search: SetSearch, report_progress: Callable[[str], None],
               rejected_sets: Collection[Members] = ()) -> SelectedSet:
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
    smaller: dict[Members, Members] = {}
    dropped: dict[str, str] = {}
    fits = {frozenset(): root}
    while True:
        sets = confirmed_sets(search, rejected_sets, smaller)
        best = reported_set(sets)
        report_progress(f"out-of-fold check of {', '.join(sorted(best.members)) or 'the baseline alone'}")
        ablations, unhelpful = _ablated(search, fits, best)
        if not unhelpful:
            break
        # one at a time: of two with the same effect, as a preload and an offset, either is needless beside the other
        least = min(sorted(unhelpful), key=lambda n: _out_of_fold_cost(search.problem, fits[best.members - {n}]))
        smaller[best.members] = best.members - {least}
        dropped[least] = NEEDLESS
    found = _assessed(search, fits, sets, best, ablations, dropped)
    if not best.members:
        return replace(found, least_error_set=_least_error_set(search, fits))
    for w in _better_predicting(search, fits, sets, best):
        ablations, unhelpful = _ablated(search, fits, w)
        if not unhelpful and keeps_names(other := _assessed(search, fits, sets, w, ablations, dropped), found):
            return named_alike(other, found)
    return found


def _ablated(search: SetSearch, fits: dict[Members, Refit], w: EvaluatedSet) -> tuple[list[Refit], set[str]]:
    """Refits of a set without each of its members, and the members that do not lower its error out of fold.

    Nor does one help that changes the output by less than `NAMED_CHANGE`: of a lag and a delay under a sinusoidal
    current either does what both do.
    """
    fit = fits[w.members] = fits.get(w.members) or _refitted(search, w.fit.composition, w.fit, search.in_parallel)
    without = [Composition(fit.composition.baseline, tuple(e for e in w.effects if e is not one)) for one in w.effects]
    _cross_validate(search, fits, fit, (fit.composition, *without, search.root.fit.composition))
    after, ablations = folds_of(search.problem, fit), [fits[c.members] for c in without]
    return ablations, {e.name for e, ablation in zip(w.effects, ablations, strict=True)
                       if _gains(search.problem, ablation, after).sum() <= 0 or
                       _change(search, ablation, fit) < NAMED_CHANGE}


def _assessed(search: SetSearch, fits: dict[Members, Refit], sets: WeighedSets, w: EvaluatedSet,
              ablations: Sequence[Refit], dropped: Mapping[str, str]) -> SelectedSet:
    """A set with its members assessed."""
    problem, root, fit = search.problem, search.root.fit, fits[w.members]
    after = folds_of(problem, fit)
    members = [_member(search, sets, w, fit, after, e, r) for e, r in zip(w.effects, ablations, strict=True)]
    members.sort(key=lambda m: -m.change)
    members = named_once(members, sets)
    relative_error = search.relative_rms(problem.unweighed(after))
    share = predicted_share(problem, problem.errors(fit.composition, fit.vector), search.channels)
    return SelectedSet(problem, root, fit, root.cost - fit.cost, folds_of(problem, root), after, tuple(members),
                       relative_error, share, tuple(t for t in dropped.items() if t[0] not in w.members), sets)


def _better_predicting(search: SetSearch, fits: dict[Members, Refit],
                       sets: WeighedSets, best: EvaluatedSet) -> list[EvaluatedSet]:
    """Sets nearly as probable as the most probable one that have less error out of fold, the least first.

    Evidence counts a structured error as few samples, so that two sets may share the weight where one leaves half of
    the other's error. Of the most probable sets that hold all but `SIGNIFICANT` of the weight these have an error out
    of fold that is lower than that of the most probable set `best` by more than one standard error of the blocks'
    gains. A set whose error on the samples of its fit is above that cannot be one, and is not refitted.
    """
    problem, near = search.problem, fits[best.members]
    least = _out_of_fold_cost(problem, near)
    before = np.cumsum([0.0, *(p for _, p in sets[:-1])])
    others = [w for (w, _), held in zip(sets, before, strict=True)
              if held < 1.0 - SIGNIFICANT and w.fit.cost < least and w is not best]
    _cross_validate(search, fits, near, [w.fit.composition for w in others])
    better = [w for w in others if _lowers_error(problem, near, folds_of(problem, fits[w.members]))]
    return sorted(better, key=lambda w: _out_of_fold_cost(problem, fits[w.members]))


def _least_error_set(search: SetSearch, fits: dict[Members, Refit]) -> tuple[tuple[str, ...], float] | None:
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


def _refitted(search: SetSearch, composition: Composition, near: Refit,
              in_parallel: Callable[[Callable[[np.ndarray], Refit], Sequence[np.ndarray]], list[Refit]]) -> Refit:
    """The better of two refits to the end: from a related fit, and from the refit of this set by the search."""
    known = search.visited.get(composition.members)
    starts = [start_vector(composition, near, {}), *([] if known is None else [known.fit.vector])]
    return min(in_parallel(lambda v: refit(search.problem, composition, v, rough=True), starts), key=lambda f: f.cost)


def _cross_validate(search: SetSearch, fits: dict[Members, Refit], near: Refit, wanted: Sequence[Composition]) -> None:
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

    def of_each(function: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
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


def _change(search: SetSearch, ablation: Refit, fit: Refit) -> float:
    """Of the output without a member, the others refitted, as a share of the output's rms."""
    return search.relative_rms(search.problem.unweighed(ablation.errors - fit.errors))


def _member(search: SetSearch, sets: WeighedSets, w: EvaluatedSet, fit: Refit, after: np.ndarray, effect: Effect,
            ablation: Refit) -> SetMember:
    """An effect of a set as a member."""
    problem = fit.problem
    better = float(np.mean(_gains(problem, ablation, after) > 0))
    before, left = (float(np.sum(problem.unweighed(e) ** 2)) for e in (folds_of(problem, ablation), after))
    name, _, support = name_in(search, sets, w, effect)
    others = {k for e, k in zip(w.effects, w.components, strict=True) if e is not effect}
    family = Support.of(sets, match_family(effect.family, others))
    values = fit.vector[fit.composition.places[fit.composition.effects.index(effect)]]
    rivals = rivals_beside(search, sets, w, effect, values)
    without = search.visited.get(w.members - {effect.name}) or EvaluatedSet(search.data, ablation)
    gain = search.score(w) - search.score(without)
    return SetMember(effect, name, values, support.probability, family.probability, support.weight, rivals,
                     ablation.cost - fit.cost, gain_percent(before, left) if before > 0 else 0.0, better,
                     _change(search, ablation, fit),
                     float(gain) if np.isfinite(gain) else None)
