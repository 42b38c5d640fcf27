"""Judging: the most probable set that data not seen bear out, and what of it may be named."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.evidence.calibration import Finding, Support, component, family
from lpvid.diagnosis.evidence.search import LAGGING, SetSearch, akin, posterior
from lpvid.diagnosis.evidence.weighing import Weighed
from lpvid.diagnosis.folds import Folds, errors_beside, joined, out_of_fold
from lpvid.diagnosis.problem import EXPLODED, DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.remainder import predicted_share
from lpvid.diagnosis.screening import placed
from lpvid.diagnosis.spectra import noisier

NAMED, SURE = 2 / 3, 0.75
"""calibrated probability from which a cause, or a family, is named: twice as probable as not, where a wrong name costs
twice what a missing one does; and from which it is sure, so that a story of such causes explains an error
(docs/diagnosis_boards.md: right and wrong names by this number)"""
FORM = 0.95
"""share of the weight of its component from which a special form is reported in its place"""
LISTED = 0.05
"""weight of the sets without a cause that hold a rival, from which it is listed"""
NOTABLE, BESIDE = 0.02, 0.1
"""change of the output, as a share of its rms, from which a cause is named whatever is left; and as a share of what is
left, from which it is named where little is left (diagnosis_real)"""
LEAST = 0.005
"""change below which nothing is named: half a per cent of the output is nobody's concern"""
OUT_OF_FOLD = "out of fold"
"""what the folds of a fit are kept by"""


@dataclass(frozen=True, eq=False)
class Member:
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
        Of the output when it is taken away and the others follow, as a share of the output's rms.
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

    def objection(self, left: float, of_law: float) -> str | None:
        """Why it is not named; None where it is, or has rivals.

        Parameters
        ----------
        left : float
            Error that stays, over the output.
        of_law : float
            That part of it which the inputs predict: what the law still gets wrong. A cause that changes less than that
            may be no more than another piece of it.

        Returns
        -------
        str or None
        """
        least = max(min(NOTABLE, BESIDE * left), LEAST, of_law)
        if self.change < least:
            return f"it changes the output by {self.change:.1%}, less than {least:.1%}: small print"
        if self.probability < NAMED and not self.rivals:
            return f"probability {self.probability:.2f} only, and nothing takes its place"
        return None


@dataclass(frozen=True, eq=False)
class JudgedSet:
    """The chosen set.

    Attributes
    ----------
    problem : DiagnosisProblem
    root, fit : Refit
        The baseline alone and the set.
    won : float
        Squared error that the set takes away from the baseline alone, on the samples on which the members were judged.
    before, after : Folds
        Their errors out of fold.
    members : tuple of Member
        Largest change first.
    left : float
        Error out of fold of the set, over the output: root mean squares.
    predictable : float
        Share of its squared error that the inputs predict.
    dropped : tuple of (str, str)
        Effects that held-out data did not bear out, and what was said.
    sets : list of (Weighed, float)
        Visited sets and their probabilities, those not borne out left out.
    """

    problem: DiagnosisProblem
    root: Refit
    fit: Refit
    won: float
    before: Folds
    after: Folds
    members: tuple[Member, ...]
    left: float
    predictable: float
    dropped: tuple[tuple[str, str], ...]
    sets: list[tuple[Weighed, float]]

    @property
    def of_law(self) -> float:
        """That part of the error which the inputs predict, over the output."""
        return float(np.sqrt(self.predictable)) * self.left

    def objection(self, m: Member) -> str | None:
        """Why a member is not named; None where it is, or has rivals.

        Parameters
        ----------
        m : Member

        Returns
        -------
        str or None
        """
        return m.objection(self.left, self.of_law)


def judge(search: SetSearch, report_progress: Callable[[str], None],
          refused: Collection[frozenset[str]] = ()) -> JudgedSet:
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
        sets = _borne_out(search, refused, smaller)
        best = story(sets)
        report_progress(f"held-out check of {', '.join(sorted(best.members)) or 'the baseline alone'}")
        rests, useless = _less_one(search, fits, best)
        if not useless:
            break
        smaller[best.members] = best.members - useless
        dropped |= dict.fromkeys(useless, "held-out error is no lower with it")
    found = _judged(search, fits, sets, best, rests, dropped)
    for w in _better(search, fits, sets, best):
        rests, useless = _less_one(search, fits, w)
        other = None if useless else _judged(search, fits, sets, w, rests, dropped)
        if other is not None and _keeps(_named(other), _named(found)):
            return other
    return found


def _less_one(search: SetSearch, fits: dict[frozenset[str], Refit], w: Weighed) -> tuple[list[Refit], set[str]]:
    """Refits of a set without each of its members, and the members without which its error out of fold is no higher."""
    fit = fits[w.members] = fits.get(w.members) or _refitted(search, w.fit.composition, w.fit, search.each)
    without = [_less(fit.composition, e) for e in w.effects]
    _check(search, fits, fit, (fit.composition, *without, search.visited[frozenset()].fit.composition))
    after, rests = folds_of(search.problem, fit), [fits[c.members] for c in without]
    return rests, {e.name for e, r in zip(w.effects, rests, strict=True) if not _helps(search.problem, r, after)}


def _judged(search: SetSearch, fits: dict[frozenset[str], Refit], sets: list[tuple[Weighed, float]], w: Weighed,
            rests: Sequence[Refit], dropped: Mapping[str, str]) -> JudgedSet:
    """A set with what is known of its members."""
    problem, root, fit = search.problem, search.visited[frozenset()].fit, fits[w.members]
    after = folds_of(problem, fit)
    members = [_member(search, sets, w, fit, after, e, r) for e, r in zip(w.effects, rests, strict=True)]
    members.sort(key=lambda m: -m.change)
    for k, m in enumerate(members):  # a component is named once, by the form that changes most
        if m.name != m.effect.name and m.name in {other.name for other in members[:k]}:
            form = Support.of(sets, _in_this_form(m.effect), search.structured)
            members[k] = replace(m, name=m.effect.name, probability=form.probability, weight=form.weight)
    kept = {m.effect.name for m in members}
    left = float(np.sqrt(np.mean(after.plain**2))) / search.data.discrepancy.force
    share = predicted_share(problem, problem.errors(fit.composition, fit.vector), search.channels)
    return JudgedSet(problem, root, fit, root.cost - fit.cost, folds_of(problem, root), after, tuple(members), left,
                     share, tuple((n, why) for n, why in dropped.items() if n not in kept), sets)


def _named(judged: JudgedSet) -> dict[str, float]:
    """What a set names outright, and the work of each: what it changes in the logarithm of the error."""
    left = max(judged.root.cost - judged.won, 1e-300)
    return {m.name: float(np.log1p(max(m.cost, 0.0) / left)) for m in judged.members
            if judged.objection(m) is None and not m.rivals}


def _keeps(here: Mapping[str, float], of_story: Mapping[str, float]) -> bool:
    """Whether what the story names does half of its work here too: else something less probable does it here."""
    return all(2 * here.get(name, 0.0) >= work for name, work in of_story.items())


def _better(search: SetSearch, fits: dict[frozenset[str], Refit], sets: Sequence[tuple[Weighed, float]], best: Weighed
            ) -> list[Weighed]:
    """Sets nearly as probable as the story that predict better what their fit has not seen, the best first.

    Evidence counts a structured error as few samples, so that sets share the weight of which one leaves half the error
    out of fold. Of the most probable sets that hold all but `LISTED` of the weight these have an error out of fold that
    is lower than the story's by more than one standard error of the blocks' gains. A set whose error on the samples of
    its fit is above the story's out of fold cannot be one, and is not refitted; nor is one with a special form that is
    not sure. Where nothing is the story it stays.
    """
    if not best.members:
        return []
    problem, near = search.problem, fits[best.members]
    least = _squares(problem, near)
    before, mass = np.cumsum([0.0, *(p for _, p in sets[:-1])]), _masses(sets)
    others = [w for (w, _), held in zip(sets, before, strict=True)
              if held < 1.0 - LISTED and w.fit.cost < least and w is not best and _sure(w, sets, mass)]
    _check(search, fits, near, [w.fit.composition for w in others])
    better = [w for w in others if _helps(problem, near, folds_of(problem, fits[w.members]))]
    return sorted(better, key=lambda w: _squares(problem, fits[w.members]))


def _squares(problem: DiagnosisProblem, fit: Refit) -> float:
    """Sum of the squared errors out of fold."""
    return float(np.sum(folds_of(problem, fit).plain**2))


def _borne_out(search: SetSearch, refused: Collection[frozenset[str]], smaller: dict[frozenset[str], frozenset[str]]
               ) -> list[tuple[Weighed, float]]:
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
              each: Callable[[Callable[[np.ndarray], Refit], Sequence[np.ndarray]], list[Refit]]) -> Refit:
    """The better of two refits to all samples: from a fit nearby, and from where the search left this set."""
    known = search.visited.get(composition.members)
    starts = [placed(composition, near, {}), *([] if known is None else [known.fit.vector])]
    return min(each(lambda v: refit(search.problem, composition, v, rough=True), starts), key=lambda f: f.cost)


def _check(search: SetSearch, fits: dict[frozenset[str], Refit], near: Refit, wanted: Sequence[Composition]) -> None:
    """Refit compositions that are not yet among `fits`, and find the errors out of fold of all, on every processor."""
    def checked(composition: Composition) -> tuple[Refit | None, Folds]:
        known = fits.get(composition.members)
        found = known or _refitted(search, composition, near, lambda one, starts: [one(v) for v in starts])
        folds = folds_of(search.problem, found)
        return (None if known else found), folds  # of one that is known the folds alone are sent back

    new = {c.members: c for c in wanted if c.members not in fits or OUT_OF_FOLD not in fits[c.members].cache}
    for members, (found, folds) in zip(new, search.each(checked, list(new.values())), strict=True):
        fit = fits.setdefault(members, found) if found else fits[members]
        fit.cache[OUT_OF_FOLD] = folds


def on_all_samples(search: SetSearch, judged: JudgedSet, problem: DiagnosisProblem) -> JudgedSet:
    """The same with errors and parameters by refits on all samples, where the search was on some.

    Parameters
    ----------
    search : SetSearch
    judged : JudgedSet
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

    root, fit = search.each(refitted, (judged.root, judged.fit), (problem,))
    halves = search.each(lambda of: errors_beside(problem, *of), [(f, k) for f in (fit, root) for k in (0, 1)])
    after, before = joined(problem, halves[:2]), joined(problem, halves[2:])
    places = {e.name: p for e, p in zip(fit.composition.effects, fit.composition.places, strict=True)}
    members = tuple(replace(m, values=fit.vector[places[m.effect.name]]) for m in judged.members)
    return replace(judged, problem=problem, root=root, fit=fit, before=before, after=after, members=members)


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


def _less(composition: Composition, effect: Effect) -> Composition:
    return Composition(composition.baseline, tuple(e for e in composition.effects if e is not effect))


def _helps(problem: DiagnosisProblem, rest: Refit, after: Folds) -> bool:
    """Whether an effect lowers the error out of fold, by more than one standard error of the blocks' gains."""
    gains = problem.block_sums(folds_of(problem, rest).plain**2 - after.plain**2)
    return bool(gains.sum() > np.sqrt(gains @ gains))


def story(sets: Sequence[tuple[Weighed, float]]) -> Weighed:
    """The set to report: of the most probable components, in the forms that the data bear out.

    Sets that hold the same components in different forms add up. Every component that is more probable than not is in
    it, where some set holds all of these (the median probability model of Barbieri and Berger 2004): rivals that share
    the weight of a set must not let the baseline alone come before each of them. Of the sets of the most probable
    components the most probable one is taken whose special forms are sure themselves; a form that is not is replaced by
    its component.

    Parameters
    ----------
    sets : sequence of (Weighed, float)
        With their probabilities, the most probable first.

    Returns
    -------
    Weighed
    """
    mass = _masses(sets)
    likely = {c for kinds in mass for c in kinds if sum(p for k, p in mass.items() if c in k) > 0.5}
    kinds = max([k for k in mass if likely <= k] or mass, key=lambda k: mass[k])
    alike = [w for w, _ in sets if frozenset(w.kinds) == kinds]
    return next((w for w in alike if _sure(w, sets, mass)), alike[0])


def _masses(sets: Sequence[tuple[Weighed, float]]) -> dict[frozenset[str], float]:
    """Probability of every set of components, in whatever forms."""
    mass: dict[frozenset[str], float] = {}
    for w, p in sets:
        mass[frozenset(w.kinds)] = mass.get(frozenset(w.kinds), 0.0) + p
    return mass


def _sure(w: Weighed, sets: Sequence[tuple[Weighed, float]], mass: Mapping[frozenset[str], float]) -> bool:
    """Whether the special forms in a set have nearly all of the weight of its components."""
    return all(e.component == k or _form(e, sets) >= FORM * mass[frozenset(w.kinds)]
               for e, k in zip(w.effects, w.kinds, strict=True))


def _form(effect: Effect, sets: Sequence[tuple[Weighed, float]]) -> float:
    """Probability that an effect is there in this very form, wherever it sits."""
    return float(sum(p for w, p in sets if any(e.component == effect.component for e in w.effects)))


def _member(search: SetSearch, sets: Sequence[tuple[Weighed, float]], best: Weighed, fit: Refit, after: Folds,
            effect: Effect, rest: Refit) -> Member:
    problem = fit.problem
    gains = problem.block_sums(folds_of(problem, rest).plain**2 - after.plain**2)
    before = _squares(problem, rest)
    kind = best.kinds[best.effects.index(effect)]
    name, finding, support = named_as(effect, kind, sets, search.structured)
    of_family = Support.of(sets, family(effect.family), search.structured).probability
    values = fit.vector[fit.composition.places[fit.composition.effects.index(effect)]]
    if support.probability >= NAMED:
        rivals = _as_good(search, sets, best, effect)
        if name == effect.name:
            rivals += _described_too(search, sets, best, effect, values, {n for n, _ in rivals})
    else:
        rivals = _instead(sets, best, kind, finding, search.structured)
    change = float(np.sqrt(np.mean((rest.errors - fit.errors) ** 2))) / search.data.discrepancy.force
    without = search.visited.get(best.members - {effect.name})
    gain = search.score(best) - (search.score(without) if without is not None else -np.inf)
    return Member(effect, name, values, support.probability, of_family, support.weight, rivals,
                  rest.cost - fit.cost, 100 * float(gains.sum()) / max(before, 1e-300), float(np.mean(gains > 0)),
                  change, float(gain) if np.isfinite(gain) else 0.0)


def named_as(effect: Effect, kind: str, sets: Sequence[tuple[Weighed, float]], structured: float
             ) -> tuple[str, Finding, Support]:
    """What an effect is named, what finds that in a set, and what speaks for it.

    A special form is named where it is probable enough; else its component, where that is: of a current that
    rises and falls unequally in all likely sets, the lag may be sure and that its edges differ not.

    Parameters
    ----------
    effect : Effect
    kind : str
        Component of which it is a form, as its numbers stand.
    sets : sequence of (Weighed, float)
    structured : float
        As for `Support.of`.

    Returns
    -------
    name : str
    finding : callable
    support : Support
    """
    whole = Support.of(sets, component(kind), structured)
    if effect.component == kind:
        return effect.name, component(kind), whole
    if kind != effect.form_of:  # its numbers leave no more than that, here; in other sets they may be a little off it
        either = _holds(kind, effect.name)
        return kind, either, Support.of(sets, either, structured)
    form = Support.of(sets, _in_this_form(effect), structured)
    if form.probability < NAMED <= whole.probability:
        return kind, component(kind), whole
    return effect.name, _in_this_form(effect), form


def _in_this_form(effect: Effect) -> Finding:
    return lambda w: next((e for e in w.effects if e.component == effect.component), None)


def _as_good(search: SetSearch, sets: Sequence[tuple[Weighed, float]], best: Weighed, effect: Effect
             ) -> tuple[tuple[str, float], ...]:
    """What the error does not speak against in the place of an effect, whatever the sets that hold it weigh.

    By the error alone, as it is left of either all else refitted, a rival has the likelihood (e_r'e_r/e'e)^(−κN/2). It
    is listed where that is more than `LISTED`: a misfit of the law favours one of two that differ by less than it, and
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
    samples, kind = search.kept * search.problem.n_samples, best.kinds[best.effects.index(effect)]
    bare = search.visited.get(best.members - {effect.name})
    for others, w in _in_place_of(sets, best, kind):
        names = {e.name for e, _ in others}
        helped = len(w.members) > len(best.members)
        if (not names.isdisjoint(found) if helped else not akin(effect, others[0][0])) or \
                any(e.flexible and k == e.name and not akin(effect, e) for e, k in others):
            continue
        late = any(e.path in LAGGING for e, _ in others)
        cost = _without_noise if late else _cost
        beside = _helped_alike(search, best, w, cost) if helped else best
        against = 0.5 * samples * np.log(cost(w) / cost(beside))
        works = bare is None or cost(w) ** 2 < cost(bare) * cost(best)
        if against < (0.0 if helped else -np.log(LISTED)) and works:
            found |= {e.name: Support.of(sets, component(k), search.structured).probability for e, k in others}
    return tuple(found.items())


def _in_place_of(sets: Sequence[tuple[Weighed, float]], best: Weighed, kind: str
                 ) -> list[tuple[list[tuple[Effect, str]], Weighed]]:
    """What stands in the place of a kind in other sets, with these: one effect, or two that physics links.

    The sets of fewest members come first. A filter of all channels counts only where nothing else does.
    """
    found, rest = [], sorted(k for k in best.kinds if k != kind)
    for w, _ in sets:
        others = [(e, k) for e, k in zip(w.effects, w.kinds, strict=True)
                  if k not in best.kinds and e.name not in best.members]
        others = [(e, k) for e, k in others if e.path != "all"] or others
        if kind not in w.kinds and sorted(k for k in w.kinds if k in best.kinds) == rest and not w.at_bounds \
                and _one([e for e, _ in others]):
            found.append((others, w))
    return sorted(found, key=lambda pair: len(pair[1].members))


def _helped_alike(search: SetSearch, best: Weighed, w: Weighed, cost: Callable[[Weighed], float]) -> Weighed:
    """The best set with the filter of all channels that another one has and it has not; itself where that is no less.

    A filter rounds what either leaves: beside it friction is compared with a spring beside it, not alone.
    """
    places = w.fit.composition.places
    filters = [(e, w.fit.vector[p]) for e, p in zip(w.effects, places, strict=True)
               if e.path == "all" and e.name not in best.members]
    return min([best, *(search.with_one_more(best, e, v) for e, v in filters)], key=cost)


def _cost(w: Weighed) -> float:
    return max(w.fit.cost, 1e-300)


def _one(effects: Sequence[Effect]) -> bool:
    """Whether effects stand in the place of one: one itself, or two partners."""
    return len(effects) == 1 or (len(effects) == 2 and (effects[0].name in effects[1].partners
                                                       or effects[1].name in effects[0].partners))


def _described_too(search: SetSearch, sets: Sequence[tuple[Weighed, float]], best: Weighed, form: Effect,
                   values: np.ndarray, listed: Collection[str]) -> tuple[tuple[str, float], ...]:
    """Components of these data that a form describes too (`Effect.stands_for`), but for those listed by now."""
    known = {e.name for e in search.candidates} - {*best.kinds, *best.members, *listed}
    return tuple((n, Support.of(sets, component(n), search.structured).probability)
                 for n in form.stands_for(values, search.problem.signals) if n in known)


def _without_noise(w: Weighed) -> float:
    """Squared error of a set less what the noise of the sensors of motion makes of it: what as much again changes."""
    problem, composition, vector = w.data.problem, w.fit.composition, w.fit.vector

    def find() -> float:
        rng = np.random.default_rng(0)
        changes = [composition.predict(noisier(s, rng), vector) - composition.predict(s, vector)
                   for s in problem.signals]
        carried = float(np.sum(np.minimum(problem.stack(changes) ** 2, EXPLODED)))
        return max(w.fit.cost - carried, 1e-12 * w.fit.cost, 1e-300)

    return w.fit.cached("without noise", find)


def _holds(*names: str) -> Finding:
    """Finds a component, or an effect, of one of the names."""
    return lambda w: next((e for e, k in zip(w.effects, w.kinds, strict=True) if {k, e.name} & {*names}), None)


def _instead(sets: Sequence[tuple[Weighed, float]], best: Weighed, kind: str, finding: Finding,
             structured: float) -> tuple[tuple[str, float], ...]:
    """Effects that take the place of one, with their probability; none where it is not probable that one of them does.

    Of what a set holds in its absence, and the best set does not, that which contains it does its work, else that which
    changes the output most; and only where it or one of them is there with `NAMED` do they answer for it together.
    """
    lone: dict[str, float] = {}
    form: dict[str, str] = {}
    for w, p in sets:
        if finding(w) is None:
            other = [(kind in e.contains, c, k, e.name) for e, k, c in zip(w.effects, w.kinds, w.changes, strict=True)
                     if e.name not in best.members and (k == kind or k not in best.kinds or kind in e.contains)]
            if other:
                contains, _, k, name = max(other)
                k = name if contains else k
                lone[k] = lone.get(k, 0.0) + p
                form.setdefault(k, name)
    listed = {k: p for k, p in lone.items() if p > LISTED}
    others = [_holds(k) for k in listed]
    either = Support.of(sets, lambda w: next((e for f in (finding, *others) if (e := f(w)) is not None), None),
                        structured)
    if either.probability < NAMED:
        return ()
    return tuple((form[k], Support.of(sets, _holds(k), structured).probability)
                 for k, _ in sorted(listed.items(), key=lambda t: -t[1]))
