"""Judging: the most probable set that data not seen bear out, and what of it may be named."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.evidence.calibration import Support, match_family
from lpvid.diagnosis.evidence.discrepancy import ACCEPTABLE_MISFIT
from lpvid.diagnosis.evidence.laplace import EvaluatedSet
from lpvid.diagnosis.evidence.rivals import LISTED_WEIGHT, NAMED_PROBABILITY, match_form, reported_name, rivals_beside
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.diagnosis.evidence.visited import posterior
from lpvid.diagnosis.folds import Folds, errors_on_other_fold, join_folds, out_of_fold
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.remainder import predicted_share
from lpvid.diagnosis.screening import start_vector

SURE_PROBABILITY = 0.75
"""calibrated probability from which a name is sure, so that a story of such causes explains an error"""
FORM_SHARE = 0.95
"""share of the weight of its component from which a special form is reported in its place"""
NAMED_CHANGE, NAMED_SHARE_OF_ERROR = 0.02, 0.1
"""change of the output, as a share of its rms, from which a cause is named whatever is left; and as a share of what is
left, from which it is named where little is left (diagnosis_real)"""
LEAST_NAMED_CHANGE = 0.005
"""change below which nothing is named: half a per cent of the output is nobody's concern"""
OUT_OF_FOLD = "out of fold"
"""what the folds of a fit are kept by"""


@dataclass(frozen=True, eq=False)
class SetMember:
    """What is known of one effect of the chosen set.

    Attributes
    ----------
    effect : Effect
    name : str
        What may be named: the effect, or its component where that is probable enough and this form of it is not.
    values : (k,) array
    probability, of_family : float
        That what is named is there, wherever it sits; that one of its family is. Calibrated.
    weight : float
        Of the sets that hold it.
    rivals : tuple of (str, float)
        Effects that do its work in its absence, and how probable each is.
    cost : float
        Squared error that it takes away, the others refitted.
    gain : float
        Share of the held-out squared error of that which it takes away [%].
    better : float
        Share of the blocks in which it helps.
    change : float
        Of the output when it is taken away and the others follow, as a share of the output's rms. Of several that
        change too little to be named the rest is taken away first: two that do each other's work are not small print
        both.
    evidence : float
        Log-evidence with it less that without it.
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
    evidence: float

    def reason_not_named(self, relative_error: float, law_error: float) -> str | None:
        """Why it is not named; None where it is, or has rivals.

        Parameters
        ----------
        relative_error : float
            Error that stays, over the output.
        law_error : float
            That part of it which the inputs predict: what the law still gets wrong. A cause that changes less than that
            may be no more than another piece of it.

        Returns
        -------
        str or None
        """
        least = least_change(relative_error, law_error)
        if self.change < least:
            return f"it changes the output by {self.change:.1%}, less than {least:.1%}: small print"
        if self.probability < NAMED_PROBABILITY and not self.rivals:
            return f"probability {self.probability:.2f} only, and nothing takes its place"
        return None


def least_change(relative_error: float, law_error: float) -> float:
    """Change of the output, over its rms, below which a cause is small print.

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
    """The chosen set.

    Attributes
    ----------
    problem : DiagnosisProblem
    root, fit : Refit
        The baseline alone and the set.
    cost_reduction : float
        Squared error that the set takes away from the baseline alone, on the samples on which the members were judged.
    before, after : Folds
        Their errors out of fold.
    members : tuple of Member
        Largest change first.
    relative_error : float
        Error out of fold of the set, over the output: root mean squares.
    predictable : float
        Share of its squared error that the inputs predict.
    dropped : tuple of (str, str)
        Effects that held-out data did not bear out, and what was said.
    sets : list of (Weighed, float)
        Visited sets and their probabilities, those not borne out left out.
    least_error_set : (tuple of str, float), optional
        Where nothing is in the set all the same: the causes of the visited set of least error, and the error out of
        fold that they leave, over the output, if that is lower by more than a good law's misfit: what is left is no
        noise then.
    """

    problem: DiagnosisProblem
    root: Refit
    fit: Refit
    cost_reduction: float
    before: Folds
    after: Folds
    members: tuple[SetMember, ...]
    relative_error: float
    predictable: float
    dropped: tuple[tuple[str, str], ...]
    sets: list[tuple[EvaluatedSet, float]]
    least_error_set: tuple[tuple[str, ...], float] | None = None

    @property
    def law_error(self) -> float:
        """That part of the error which the inputs predict, over the output."""
        return float(np.sqrt(self.predictable)) * self.relative_error

    def reason_not_named(self, m: SetMember) -> str | None:
        """Why a member is not named; None where it is, or has rivals.

        Parameters
        ----------
        m : Member

        Returns
        -------
        str or None
        """
        return m.reason_not_named(self.relative_error, self.law_error)


def select_set(search: SetSearch, report_progress: Callable[[str], None],
          refused: Collection[frozenset[str]] = ()) -> SelectedSet:
    """The story, or the probable set that predicts best and takes no name away, and its members.

    Every member of either lowers the error out of fold.

    Parameters
    ----------
    search : SetSearch
    report_progress : callable
    refused : collection of frozenset of str
        Sets that further records did not bear out.

    Returns
    -------
    JudgedSet
    """
    root = search.visited[frozenset()].fit
    smaller: dict[frozenset[str], frozenset[str]] = {}
    dropped: dict[str, str] = {}
    fits = {frozenset(): root}
    while True:
        sets = _confirmed_sets(search, refused, smaller)
        best = reported_set(sets)
        report_progress(f"held-out check of {', '.join(sorted(best.members)) or 'the baseline alone'}")
        ablations, unhelpful = _ablated(search, fits, best)
        if not unhelpful:
            break
        smaller[best.members] = best.members - unhelpful
        dropped |= dict.fromkeys(unhelpful, "held-out error is no lower with it")
    found = _assessed(search, fits, sets, best, best, ablations, dropped)
    if not best.members:
        return replace(found, least_error_set=_least_error_set(search, fits))
    for w in _better_predicting(search, fits, sets, best):
        ablations, unhelpful = _ablated(search, fits, w)
        other = None if unhelpful else _assessed(search, fits, sets, best, w, ablations, dropped)
        if other is not None and _names_preserved(_named(other), _named(found)) and _all_notable(other):
            return other
    return found


def _ablated(search: SetSearch, fits: dict[frozenset[str], Refit], w: EvaluatedSet) -> tuple[list[Refit], set[str]]:
    """Refits of a set without each of its members, and the members without which its error out of fold is no higher."""
    fit = fits[w.members] = fits.get(w.members) or _refitted(search, w.fit.composition, w.fit, search.in_parallel)
    without = [_without(fit.composition, e) for e in w.effects]
    _cross_validate(search, fits, fit, (fit.composition, *without, search.visited[frozenset()].fit.composition))
    after, ablations = folds_of(search.problem, fit), [fits[c.members] for c in without]
    return ablations, {e.name for e, r in zip(w.effects, ablations, strict=True) if not _lowers_error(search.problem, r, after)}


def _assessed(search: SetSearch, fits: dict[frozenset[str], Refit], sets: list[tuple[EvaluatedSet, float]], best: EvaluatedSet,
            w: EvaluatedSet, ablations: Sequence[Refit], dropped: Mapping[str, str]) -> SelectedSet:
    """A set with what is known of its members, of which `best`, the story, has been pulled apart."""
    problem, root, fit = search.problem, search.visited[frozenset()].fit, fits[w.members]
    after = folds_of(problem, fit)
    members = [_member(search, sets, best, w, fit, after, e, r) for e, r in zip(w.effects, ablations, strict=True)]
    members.sort(key=lambda m: -m.change)
    for k, m in enumerate(members):  # a component is named once, by the form that changes most
        if m.name != m.effect.name and m.name in {other.name for other in members[:k]}:
            form = Support.of(sets, match_form(m.effect), search.structured)
            members[k] = replace(m, name=m.effect.name, probability=form.probability, weight=form.weight)
    kappa = {m.effect.name for m in members}
    relative_error = float(np.sqrt(np.mean(after.errors**2))) / search.data.discrepancy.output_rms
    share = predicted_share(problem, problem.errors(fit.composition, fit.vector), search.channels)
    selected = SelectedSet(problem, root, fit, root.cost - fit.cost, folds_of(problem, root), after, tuple(members), relative_error,
                       share, tuple((n, why) for n, why in dropped.items() if n not in kappa), sets)
    little = [m for m in members if m.change < least_change(relative_error, selected.law_error)]
    if len(little) < 2:
        return selected
    alone = _changes_alone(search, fits, fit, [m.effect for m in little])
    members = [replace(m, change=max(m.change, alone.get(m.effect.name, 0.0))) for m in members]
    return replace(selected, members=tuple(sorted(members, key=lambda m: -m.change)))


def _changes_alone(search: SetSearch, fits: dict[frozenset[str], Refit], fit: Refit, effects: Sequence[Effect]
              ) -> dict[str, float]:
    """What each of some members of a set changes where it is the only one of them, as a share of the output's rms."""
    others = tuple(e for e in fit.composition.effects if e not in effects)
    wanted = [Composition(fit.composition.baseline, others),
              *(Composition(fit.composition.baseline, tuple(e for e in fit.composition.effects if e in (*others, one)))
                for one in effects)]
    _cross_validate(search, fits, fit, wanted)
    without, *ones = (fits[c.members].errors for c in wanted)
    return {e.name: float(np.sqrt(np.mean((without - one) ** 2))) / search.data.discrepancy.output_rms
            for e, one in zip(effects, ones, strict=True)}


def _named(selected: SelectedSet) -> dict[str, float]:
    """What a set names outright, and the work of each: what it changes in the logarithm of the error."""
    error = max(selected.root.cost - selected.cost_reduction, 1e-300)
    return {m.name: float(np.log1p(max(m.cost, 0.0) / error)) for m in selected.members
            if selected.reason_not_named(m) is None and not m.rivals}


def _names_preserved(here: Mapping[str, float], of_story: Mapping[str, float]) -> bool:
    """Whether what the story names does half of its work here too: else something less probable does it here."""
    return all(2 * here.get(name, 0.0) >= work for name, work in of_story.items())


def _all_notable(selected: SelectedSet) -> bool:
    """Whether every member of a set changes enough to be worth a name, whatever the law still gets wrong."""
    return all(m.change >= least_change(selected.relative_error, 0.0) for m in selected.members)


def _better_predicting(search: SetSearch, fits: dict[frozenset[str], Refit], sets: Sequence[tuple[EvaluatedSet, float]], best: EvaluatedSet
            ) -> list[EvaluatedSet]:
    """Sets nearly as probable as the story that predict better what their fit has not seen, the best first.

    Evidence counts a structured error as few samples, so that sets share the weight of which one leaves half the error
    out of fold. Of the most probable sets that hold all but `LISTED_WEIGHT` of the weight these have an error out of fold that
    is lower than the story's by more than one standard error of the blocks' gains. A set whose error on the samples of
    its fit is above the story's out of fold cannot be one, and is not refitted; nor is one with a special form that is
    not sure. Where nothing is the story it stays.
    """
    if not best.members:
        return []
    problem, near = search.problem, fits[best.members]
    least = _out_of_fold_cost(problem, near)
    before, mass = np.cumsum([0.0, *(p for _, p in sets[:-1])]), _component_weights(sets)
    others = [w for (w, _), held in zip(sets, before, strict=True)
              if held < 1.0 - LISTED_WEIGHT and w.fit.cost < least and w is not best and _forms_sure(w, sets, mass)]
    _cross_validate(search, fits, near, [w.fit.composition for w in others])
    better = [w for w in others if _lowers_error(problem, near, folds_of(problem, fits[w.members]))]
    return sorted(better, key=lambda w: _out_of_fold_cost(problem, fits[w.members]))


def _least_error_set(search: SetSearch, fits: dict[frozenset[str], Refit]) -> tuple[tuple[str, ...], float] | None:
    """The visited set of least error, and what it leaves out of fold; None where that is not notably less."""
    problem, root = search.problem, fits[frozenset()]
    least = min((w for w in search.visited.values() if not w.at_bounds), key=lambda w: w.fit.cost)
    worth = problem.n_samples * (ACCEPTABLE_MISFIT * search.data.discrepancy.output_rms) ** 2
    if not root.cost - least.fit.cost > worth:
        return None
    _cross_validate(search, fits, root, [root.composition, least.fit.composition])
    after = folds_of(problem, fits[least.members])
    cost = float(np.sum(after.errors**2))
    if not (_lowers_error(problem, root, after) and _out_of_fold_cost(problem, root) - cost > worth):
        return None
    return tuple(sorted(least.members)), float(np.sqrt(cost / problem.n_samples)) / search.data.discrepancy.output_rms


def _out_of_fold_cost(problem: DiagnosisProblem, fit: Refit) -> float:
    """Sum of the squared errors out of fold."""
    return float(np.sum(folds_of(problem, fit).errors**2))


def _confirmed_sets(search: SetSearch, refused: Collection[frozenset[str]], smaller: dict[frozenset[str], frozenset[str]]
               ) -> list[tuple[EvaluatedSet, float]]:
    """Visited sets and their probabilities, without the refused ones; the baseline alone where no other is left.

    A set of which some members do not lower the error out of fold says of the others what the set without those does:
    its weight goes to that one, or to the largest visited one within it. To drop it would count against every member,
    as well proven as it may be.
    """
    visited = {w.members: w for w, _ in posterior(search)}
    weights = {members: 0.0 for members in visited if members not in smaller and members not in refused}
    for w, p in posterior(search):
        members = w.members
        while members in smaller:
            members = smaller[members]
        within = [m for m in weights if m <= members]
        if within and members not in refused:
            weights[max(within, key=len)] += p
    total = sum(weights.values())
    if total <= 0:
        return [(search.visited[frozenset()], 1.0)]
    return sorted(((visited[m], p / total) for m, p in weights.items()), key=lambda t: -t[1])


def _refitted(search: SetSearch, composition: Composition, near: Refit,
              in_parallel: Callable[[Callable[[np.ndarray], Refit], Sequence[np.ndarray]], list[Refit]]) -> Refit:
    """The better of two refits to all samples: from a fit nearby, and from where the search left this set."""
    known = search.visited.get(composition.members)
    starts = [start_vector(composition, near, {}), *([] if known is None else [known.fit.vector])]
    return min(in_parallel(lambda v: refit(search.problem, composition, v, rough=True), starts), key=lambda f: f.cost)


def _cross_validate(search: SetSearch, fits: dict[frozenset[str], Refit], near: Refit, wanted: Sequence[Composition]) -> None:
    """Refit compositions that are not yet among `fits`, and find the errors out of fold of all, on every processor."""
    def checked(composition: Composition) -> tuple[Refit | None, Folds]:
        known = fits.get(composition.members)
        found = known or _refitted(search, composition, near, lambda one, starts: [one(v) for v in starts])
        folds = folds_of(search.problem, found)
        return (None if known else found), folds  # of one that is known the folds alone are sent back

    new = {c.members: c for c in wanted if c.members not in fits or OUT_OF_FOLD not in fits[c.members].cache}
    for members, (found, folds) in zip(new, search.in_parallel(checked, list(new.values())), strict=True):
        fit = fits.setdefault(members, found) if found else fits[members]
        fit.cache[OUT_OF_FOLD] = folds


def on_all_samples(search: SetSearch, selected: SelectedSet, problem: DiagnosisProblem) -> SelectedSet:
    """The same with errors and parameters by refits on all samples, where the search was on some.

    Parameters
    ----------
    search : SetSearch
    selected : JudgedSet
        On the samples of the search.
    problem : DiagnosisProblem
        Of all samples.

    Returns
    -------
    JudgedSet
        Its probabilities, gains, shares and what is left stay those of the search.
    """
    def refitted(f: Refit) -> Refit:
        found = refit(problem, f.composition, f.vector, rough=True)
        _ = found.jacobian  # from which both folds begin
        return found

    root, fit = search.in_parallel(refitted, (selected.root, selected.fit), (problem,))
    halves = search.in_parallel(lambda of: errors_on_other_fold(problem, *of), [(f, k) for f in (fit, root) for k in (0, 1)])
    after, before = join_folds(problem, halves[:2]), join_folds(problem, halves[2:])
    places = {e.name: p for e, p in zip(fit.composition.effects, fit.composition.places, strict=True)}
    members = tuple(replace(m, values=fit.vector[places[m.effect.name]]) for m in selected.members)
    return replace(selected, problem=problem, root=root, fit=fit, before=before, after=after, members=members)


def folds_of(problem: DiagnosisProblem, fit: Refit) -> Folds:
    """Errors out of fold, found once for a fit.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
        To both folds; it keeps them.

    Returns
    -------
    Folds
    """
    return fit.cached(OUT_OF_FOLD, lambda: out_of_fold(problem, fit))


def _without(composition: Composition, effect: Effect) -> Composition:
    return Composition(composition.baseline, tuple(e for e in composition.effects if e is not effect))


def _lowers_error(problem: DiagnosisProblem, ablation: Refit, after: Folds) -> bool:
    """Whether an effect lowers the error out of fold, by more than one standard error of the blocks' gains."""
    gains = problem.block_sums(folds_of(problem, ablation).errors**2 - after.errors**2)
    return bool(gains.sum() > np.sqrt(gains @ gains))


def reported_set(sets: Sequence[tuple[EvaluatedSet, float]]) -> EvaluatedSet:
    """The set to report: of the most probable components, in the forms that the data bear out.

    Sets that hold the same components in different forms add up. The components are those that are more probable than
    not, if a set holds these and no other: the median probability model, which predicts best where a single set must
    (Barbieri and Berger 2004). Otherwise, or where no component is, they are those of the most probable set that holds
    all of these: rivals that share the weight of a set must not let the baseline alone come before each of them. Of the
    sets of these components the most probable one is taken whose special forms are sure themselves; a form that is not
    is replaced by its component.

    Parameters
    ----------
    sets : sequence of (Weighed, float)
        With their probabilities, the most probable first.

    Returns
    -------
    Weighed
    """
    mass = _component_weights(sets)
    median = frozenset(c for components in mass for c in components if sum(p for k, p in mass.items() if c in k) > 0.5)
    whole = [k for k in mass if median <= k] or list(mass)
    components = median if median and median in mass else max(whole, key=lambda k: mass[k])
    alike = [w for w, _ in sets if frozenset(w.components) == components]
    return next((w for w in alike if _forms_sure(w, sets, mass)), alike[0])


def _component_weights(sets: Sequence[tuple[EvaluatedSet, float]]) -> dict[frozenset[str], float]:
    """Probability of every set of components, in whatever forms."""
    mass: dict[frozenset[str], float] = {}
    for w, p in sets:
        mass[frozenset(w.components)] = mass.get(frozenset(w.components), 0.0) + p
    return mass


def _forms_sure(w: EvaluatedSet, sets: Sequence[tuple[EvaluatedSet, float]], mass: Mapping[frozenset[str], float]) -> bool:
    """Whether the special forms in a set have nearly all of the weight of its components."""
    return all(e.component == k or _form_weight(e, sets) >= FORM_SHARE * mass[frozenset(w.components)]
               for e, k in zip(w.effects, w.components, strict=True))


def _form_weight(effect: Effect, sets: Sequence[tuple[EvaluatedSet, float]]) -> float:
    """Probability that an effect is there in this very form, wherever it sits."""
    return float(sum(p for w, p in sets if any(e.component == effect.component for e in w.effects)))


def _member(search: SetSearch, sets: Sequence[tuple[EvaluatedSet, float]], best: EvaluatedSet, w: EvaluatedSet, fit: Refit,
            after: Folds, effect: Effect, ablation: Refit) -> SetMember:
    """What is known of an effect of a set `w`; its rivals are those beside the story where that holds it, too.

    What else would do its work was sought there. Whether a name is sure must not depend on which of several nearly
    likely sets predicts best.
    """
    problem = fit.problem
    gains = problem.block_sums(folds_of(problem, ablation).errors**2 - after.errors**2)
    before = _out_of_fold_cost(problem, ablation)
    component = w.components[w.effects.index(effect)]
    name, _, support = reported_name(effect, component, sets, search.structured)
    of_family = Support.of(sets, match_family(effect.family), search.structured).probability
    values = fit.vector[fit.composition.places[fit.composition.effects.index(effect)]]
    rivals = rivals_beside(search, sets, best if effect in best.effects else w, effect, values)
    change = float(np.sqrt(np.mean((ablation.errors - fit.errors) ** 2))) / search.data.discrepancy.output_rms
    without = search.visited.get(w.members - {effect.name}) or EvaluatedSet(search.data, ablation)
    gain = search.score(w) - search.score(without)
    return SetMember(effect, name, values, support.probability, of_family, support.weight, rivals,
                  ablation.cost - fit.cost, 100 * float(gains.sum()) / max(before, 1e-300), float(np.mean(gains > 0)),
                  change, float(gain) if np.isfinite(gain) else 0.0)
