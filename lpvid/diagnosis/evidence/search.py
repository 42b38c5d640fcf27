"""Search: over sets of causes, with a beam, pairs at the root, and every member of the best set dropped and swapped."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np

from lpvid._forks import in_forks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.evidence.discrepancy import USUAL
from lpvid.diagnosis.evidence.independence import WORTH, WORTHS, independent, share_of
from lpvid.diagnosis.evidence.priors import inclusion, of_misfit
from lpvid.diagnosis.evidence.scaling import Scales
from lpvid.diagnosis.evidence.weighing import ABSENT, Data, Weighed
from lpvid.diagnosis.problem import DiagnosisProblem, projector, without
from lpvid.diagnosis.refitting import ITERATIONS, Refit, descend, hopped_on, refit
from lpvid.diagnosis.screening import Direction, Move, directions, move, placed
from lpvid.diagnosis.signals import Signals
from lpvid.diagnosis.starting import starts

T = TypeVar("T")
R = TypeVar("R")
BEAM, CHILDREN, DEEPEST = 3, 6, 4
"""sets enlarged at every size, refitted children of each, and members at most"""
OF_EACH = 2
"""of the children at least so many without memory and so many with one: each imitates the other at first"""
EAGER = 3.0
"""times the samples that a structured error is worth, as which it counts while sets are sought: three causes that only
act jointly must be reached over two that win too little by themselves"""
ROUNDS = 2
"""times that the best set is pulled apart, each member dropped and swapped"""
HEAT, STEPS = 2, 8
"""iterations from every starting point of a child, and further ones from where the best of them ended"""
LOOKED, POINTS = 14, 4
"""effects beside a set that are simulated anew, those first that promise most by what they changed beside the
baseline alone, and points at which each is looked at"""
MISSED = 2 * USUAL
"""root mean square of an error, over the output's, that a good law may leave: twice the usual"""
LAGGING = ("motion", "force", "all")
"""paths whose lags, delays and filters imitate each other and every dynamic cause; a set holds one of them"""
HOPELESS = 20.0
"""log-evidence by which a set with one effect more may stay behind the best one, as its look promises, and is refitted
all the same: a refit may find more than first order does"""
LEAST_WORTH = 0.1
"""share of independent samples that a refit of the search assumes at least, for where it ends"""
TOGETHER, RACED = 3, 2
"""points of either of a pair, and pairs of them from which it is refitted: those that leave least as they stand"""


@dataclass(frozen=True, eq=False)
class _SetView:
    """A set, effects outside of it, where each is looked at, the simulation, and what its parameters can yield to."""

    of: Weighed
    outside: Sequence[Effect]
    points: Mapping[str, np.ndarray]
    now: Sequence[np.ndarray]
    basis: np.ndarray


@dataclass
class SetSearch:
    """Sets that were visited.

    Attributes
    ----------
    data : Data
    candidates : tuple of Effect
    channels : sequence of str
        Inputs that an error may follow.
    say : callable
    visited : dict
        By the names of their effects.
    moved : list of Move
        What the effects changed beside the baseline alone.
    following : dict
        By lag, where a fit beside the law alone may begin and the squared error there, the least first.
    enlarged : set
        Of those, the ones whose children are known.
    anew : set
        Those that `with_one_more` has refitted.
    kept : float
        κ of the best set's error, by which all sets are weighed.
    structured : float
        Share of that error beyond the noise floor.
    floor : float
        Variance of the noise.
    worth : float
        α of that: more while sets are sought, so that larger ones are reached, than where they are judged.
    shares : tuple of float
        κ at every α over which the judgement is averaged; empty while sets are sought, by κ alone then.
    """

    data: Data
    candidates: tuple[Effect, ...]
    channels: Sequence[str]
    report_progress: Callable[[str], None]
    visited: dict[frozenset[str], Weighed] = field(default_factory=dict)
    moved: list[Move] = field(default_factory=list)
    following: dict[str, list[tuple[float, np.ndarray]]] = field(default_factory=dict)
    enlarged: set[frozenset[str]] = field(default_factory=set)
    anew: set[frozenset[str]] = field(default_factory=set)
    kept: float = 1.0
    structured: float = 0.0
    floor: float = 0.0
    worth: float = EAGER * WORTH
    shares: tuple[float, ...] = ()

    @property
    def problem(self) -> DiagnosisProblem:
        """Of the data."""
        return self.data.problem

    @property
    def best(self) -> Weighed:
        """The most probable set."""
        return max(self.visited.values(), key=self.score)

    def score(self, w: Weighed) -> float:
        """Evidence of a set at the present κ.

        Parameters
        ----------
        w : Weighed

        Returns
        -------
        float
            In nats, up to what all sets share; minus infinity for one with a strength at its bound.
        """
        return self.evidence(w, self.kept)

    def evidence(self, w: Weighed, kept: float) -> float:
        """Evidence of a set at some κ, and how usual it is for the best law to leave what it leaves beyond noise.

        Parameters
        ----------
        w : Weighed
        kept : float
            κ.

        Returns
        -------
        float
            As of `score`.
        """
        beyond = max(w.fit.cost / self.problem.n_samples - self.floor, 0.0)
        return w.evidence(kept) + of_misfit(np.sqrt(beyond) / self.data.discrepancy.force)

    def run(self, root: Refit) -> None:
        """Visit sets from the baseline alone on.

        Parameters
        ----------
        root : Refit
            The baseline alone, on the samples of the data.
        """
        self.visited[frozenset()] = Weighed(self.data, root)
        self._reweigh()
        self.enlarge([self.visited[frozenset()]])  # else a pair that imitates a single cause comes before it
        self._reweigh()
        self._pairs(self.visited[frozenset()])
        self._reweigh()
        for _ in range(DEEPEST):
            before = self.best
            self.enlarge(self._beam())
            self._reweigh()
            if self.best is before and self.best.members in self.enlarged:
                break
        self.worth = WORTH
        self._reweigh()
        apart = set()
        for _ in range(ROUNDS):
            before = self.best
            apart.add(before.members)
            self._pull_apart(before)
            self._reweigh()
            if self.best is before:
                break
        self.shares = tuple(share_of(self.structured, self.problem.n_samples, w) for w in WORTHS)
        if (likeliest := posterior(self)[0][0]).members not in apart:  # over all α it may be another set
            self._pull_apart(likeliest)

    def _together(self, effects: Sequence[Effect]) -> bool:
        """Whether effects may be in one set beside this baseline."""
        return together(effects, self.visited[frozenset()].fit.composition.baseline.channels)

    def _open(self, w: Weighed) -> bool:
        """Whether a set may still be enlarged; one with a filter of all channels is not, which comes last."""
        return w.members not in self.enlarged and len(w.members) < DEEPEST and all(e.path != "all" for e in w.effects)

    def _beam(self) -> list[Weighed]:
        """The most probable open sets of which none holds all components of a more probable one.

        Forms of one component, and sets that grew from one another, would take every place: beside a law that lacks
        friction and a resonance a spring comes first, alone and with whatever else, and either of the two long after.
        """
        chosen: list[Weighed] = []
        for w in sorted(filter(self._open, self.visited.values()), key=self.score, reverse=True):
            if len(chosen) < BEAM and not any(set(w.kinds) >= set(c.kinds) for c in chosen):
                chosen.append(w)
        return chosen

    def with_one_more(self, w: Weighed, e: Effect, values: np.ndarray) -> Weighed:
        """A set with one effect more, refitted from its numbers elsewhere; one that was visited and leaves less.

        Parameters
        ----------
        w : Weighed
        e : Effect
            Not in it.
        values : (k,) array
            Its numbers, from which the refit begins.

        Returns
        -------
        Weighed
            Kept among those visited; the set itself where the refit comes to no end.
        """
        more = w.members | {e.name}
        known = self.visited.get(more)
        if known is None or (known.fit.cost > w.fit.cost and more not in self.anew):
            self.anew.add(more)
            composition = Composition(w.fit.composition.baseline, (*w.effects, e))
            self._add(self._weighed(self._settled(composition, [placed(composition, w.fit, {e.name: values})], w.fit)))
        return self.visited.get(more, w)

    # -- visiting ----------------------------------------------------------------------------------------------------
    def enlarge(self, sets: Sequence[Weighed]) -> None:
        """Visit the most promising sets with one effect more, of one set after the other.

        A set that was visited from another one is visited again where less error is in sight from here.

        Parameters
        ----------
        sets : sequence of Weighed
            Looked at together; those that cannot be enlarged, or have been, are passed over.
        """
        sets = [w for w in sets if self._open(w)]
        self.enlarged |= {w.members for w in sets}
        if not sets:
            return
        best, share = posterior(self)[0]
        names = "; ".join(", ".join(sorted(w.members)) or "the baseline alone" for w in sets)
        leader = ", ".join(sorted(best.members)) or "nothing"
        self.report_progress(f"looking beyond {names} (best so far: {leader}, {share:.2f} of {len(self.visited)} sets)")
        for w, found in zip(sets, self.look(sets), strict=True):
            chosen = [e for e, cost in self._promising(w, found).items() if self._less(w.members | {e.name}, cost)]
            _ = w.fit.jacobian, self.visited[frozenset()].fit.jacobian  # found once, for all forks
            for child in self._children(w, chosen, found):
                self._add(child)

    def _children(self, w: Weighed, chosen: Sequence[Effect], found: Sequence[Direction]) -> list[Weighed]:
        """Sets with one effect more, refitted."""
        return self.each(lambda e: self._weighed(self._child(w, (e,), found)), chosen)

    def each(self, function: Callable[[T], R], items: Sequence[T], shared: Sequence[object] = ()) -> list[R]:
        """Results over independent items, on every processor.

        Parameters
        ----------
        function : callable
            Of one item.
        items : sequence
        shared : sequence of object
            What results refer to beside the data, the baseline and the candidates.

        Returns
        -------
        list
        """
        baseline = self.visited[frozenset()].fit.composition.baseline
        return in_forks(function, items, (self.data, self.problem, baseline, *self.candidates, *shared))

    def _weighed(self, fit: Refit) -> Weighed:
        """A refitted set, its evidence found."""
        found = Weighed(self.data, fit)
        if np.isfinite(fit.cost):
            self.score(found)
        return found

    def look(self, sets: Sequence[Weighed]) -> list[list[Direction]]:
        """What the effects outside of each set would change, at the points where they are looked at.

        All of them beside the baseline alone. Beside a set what they changed there serves first: less the set's
        sensitivities, it is what each would take away if it acted as it did there; those that promise most, and the
        partners of the members, are simulated anew.

        Parameters
        ----------
        sets : sequence of Weighed

        Returns
        -------
        list of list of Direction
            Of each set.
        """
        views = [self._view(w) for w in sets]
        items = [(v, e) for v in views for e in v.outside]
        if any(not w.members for w in sets):
            (first,) = views
            self.moved, self.following = self._first_look(first)
            return [directions(self.problem, first.of.fit, self.moved, first.basis)]
        found = iter(self.each(lambda t: directions(self.problem, t[0].of.fit, self._moves(*t), t[0].basis), items))
        return [[d for _ in v.outside for d in next(found)] for v in views]

    def _view(self, w: Weighed) -> _SetView:
        """A set and the effects outside of it that are worth a look."""
        outside = [e for e in self.candidates if e.name not in w.members and self._together((*w.effects, e))]
        points, basis = self.data.looked_at, projector(w.fit.yielding)
        if w.members and self.moved:
            outside = self._foremost(w, outside, basis)
            points = {e.name: _spread(points[e.name], POINTS) for e in outside}
        errors = self.problem.errors(w.fit.composition, w.fit.vector)
        now = [s.output - e for s, e in zip(self.problem.signals, errors, strict=True)]
        return _SetView(w, outside, points, now, basis)

    def _moves(self, view: _SetView, e: Effect) -> list[Move]:
        """What an effect would change at each of its points at which it can be simulated."""
        tried = (move(self.problem, view.of.fit, e, v, view.now) for v in view.points[e.name])
        return [m for m in tried if m is not None]

    def _first_look(self, view: _SetView) -> tuple[list[Move], dict[str, list[tuple[float, np.ndarray]]]]:
        """What each effect would change beside the baseline alone, and where fits with a lag may begin."""
        lags = [(e, v) for e in view.outside if e.path in LAGGING for v in view.points[e.name]]
        calls: list[Callable[[], Any]] = [partial(self._followed, view.of, *lag) for lag in lags]
        calls += [partial(self._moves, view, e) for e in view.outside]
        found = self.each(lambda call: call(), calls)
        following: dict[str, list[tuple[float, np.ndarray]]] = {}
        for name in dict.fromkeys(e.name for e, _ in lags):
            of_lag = [kinds for (e, _), kinds in zip(lags, found, strict=False) if e.name == name]
            raced = [sorted([k[n] for k in of_lag if len(k) > n], key=lambda t: t[0])[:RACED] for n in (0, 1)]
            following[name] = sorted([t for kind in raced for t in kind], key=lambda t: t[0])
        return [m for moves in found[len(lags):] for m in moves], following

    def _followed(self, w: Weighed, e: Effect, values: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """Where fits with a lag of these values may begin, and the squared error there: near the present law, and anew.

        A law that moves too early or too late is fitted to next to nothing, beside which no lag shows: its numbers must
        follow. By how much they can is found to first order; where that leads over a bent valley, a law without memory
        begins anew from the signals as the lag leaves them.
        """
        composition = Composition(w.fit.composition.baseline, (*w.effects, e))
        own = range(composition.own)
        near = placed(composition, w.fit, {e.name: values})
        slopes = self.problem.stack([composition.sensitivities(s, near, free=own) for s in self.problem.signals])
        found = [(self._left(composition, near, projector(slopes[:, own])), near)]
        begun = [np.concatenate([b, near[own.stop:]]) for b in _starts_behind(e, values, w, self.problem.signals)]
        if begun:
            found.append(min(((self._left(composition, b), b) for b in begun), key=lambda t: t[0]))
        return found

    def _foremost(self, w: Weighed, outside: Sequence[Effect], basis: np.ndarray) -> list[Effect]:
        """Effects worth a look beside a set."""
        promised = {e.name: 0.0 for e in outside}
        for d in directions(self.problem, w.fit, [m for m in self.moved if m.effect.name in promised], basis):
            if d.visible:
                promised[d.effect.name] = max(promised[d.effect.name], d.gain)
        linked = {p for e in w.effects for p in e.partners}
        unseen = {e.name for e in outside} - {m.effect.name for m in self.moved}
        ranked = sorted(outside, key=lambda e: (e.name not in linked | unseen, -promised[e.name]))
        return ranked[: LOOKED + len((linked | unseen) & promised.keys())]

    def _promising(self, w: Weighed, found: Sequence[Direction]) -> dict[Effect, float]:
        """Children worth a refit, the best by what they would take away and the best of either kind: what they leave.

        To first order: a squared error.
        """
        left = {e: lags[0][0] / w.fit.cost for e in self.candidates if (lags := self.following.get(e.name))
                and not w.members}
        for d in found:
            if d.visible:
                gain = max(d.gain, d.at_face_value, 0.0)
                left[d.effect] = min(left.get(d.effect, 1.0), 1 - gain / w.fit.cost)
        count = 0.5 * self.kept * self.problem.n_samples
        lost = {e: count * np.log(max(left[e], 1e-12)) - inclusion(e) for e in left}
        enough = self.score(w) - self.score(self.best) + HOPELESS
        ranked = sorted((e for e in left if lost[e] < enough), key=lambda e: lost[e])
        chosen = ranked[:CHILDREN]
        for memoryless in (True, False):
            have = sum(e.memoryless is memoryless for e in chosen)
            more = [e for e in ranked[CHILDREN:] if e.memoryless is memoryless]
            chosen = [*chosen, *more[: max(OF_EACH - have, 0)]]
        return {e: left[e] * w.fit.cost for e in chosen}

    def _child(self, w: Weighed, added: tuple[Effect, ...], found: Sequence[Direction]) -> Refit:
        """A set with one effect more, refitted from the points that promise most."""
        composition = Composition(w.fit.composition.baseline, (*w.effects, *added))
        if not w.members and added[0].name in self.following:  # it moved too early
            return self._settled(composition, [v for _, v in self.following[added[0].name]], None, added)
        begun = [placed(composition, w.fit, {added[0].name: p}) for p in starts(added[0], found)]
        return self._settled(composition, begun, w.fit, added)

    def _settled(self, composition: Composition, begun: Sequence[np.ndarray], near: Refit | None,
                 added: Sequence[Effect] = (), followed: int = 1) -> Refit:
        """The best of a few steps from several starts; what no derivative moves by trial, if just added.

        Of the starts so many are `followed` to their end.
        """
        worth = max(self.kept, LEAST_WORTH)
        low, high = composition.bounds
        starts = {np.clip(v, low, high).tobytes(): v for v in begun}.values()
        heats = self.each(lambda v: descend(self.problem, composition, v, iterations=HEAT, near=near, rough=True,
                                            worth=worth), list(starts), (composition,))
        ahead = sorted(heats, key=lambda f: f.cost)[:followed]
        if any(e.stepwise or e.rugged for e in added):
            ahead[0] = hopped_on(ahead[0], HEAT, rough=True)
        ends = self.each(lambda f: descend(self.problem, composition, f.vector, iterations=STEPS, rough=True,
                                           worth=worth), ahead, (composition,))
        return min(ends, key=lambda f: f.cost)

    def _pairs(self, root: Weighed) -> None:
        """Visit pairs of effects that physics links, which may act only together."""
        names = {e.name: e for e in self.candidates}
        pairs = sorted({tuple(sorted((e.name, p))) for e in self.candidates for p in e.partners if p in names
                        and self._together((e, names[p]))})
        self.report_progress(f"{len(pairs)} linked pairs")
        basis = projector(root.fit.yielding)

        def refitted(pair: tuple[str, ...]) -> Weighed:
            composition = Composition(root.fit.composition.baseline, tuple(names[n] for n in pair))
            grids = [_spread(self.data.looked_at[n], TOGETHER) for n in pair]
            begun = [placed(composition, root.fit, {pair[0]: a, pair[1]: b}) for a in grids[0] for b in grids[1]]
            left = [self._left(composition, v, basis) for v in begun]
            return self._weighed(self._settled(composition, [begun[k] for k in np.argsort(left)[:RACED]], root.fit,
                                               composition.effects, RACED))

        for pair in self.each(refitted, pairs):
            self._add(pair)

    def _left(self, composition: Composition, vector: np.ndarray, basis: np.ndarray | None = None) -> float:
        """Squared error at a vector; with a basis that which these directions cannot take away, to first order."""
        error = self._error(composition, vector)
        error = error if basis is None else without(basis, error)
        return float(np.minimum(error**2, 1e100).sum())

    def _error(self, composition: Composition, vector: np.ndarray) -> np.ndarray:
        """(N,) error at a vector."""
        return self.problem.stack(self.problem.errors(composition, vector))

    def _pull_apart(self, w: Weighed) -> None:
        """Visit the set without each of its members, and with another in its place."""
        rests = [rest for e in w.effects if self._together(rest := tuple(x for x in w.effects if x is not e))]
        own = {x.name: w.fit.vector[p] for x, p in zip(w.effects, w.fit.composition.places, strict=True)}
        root = self.visited[frozenset()].fit

        def without_one(rest: tuple[Effect, ...]) -> Weighed:
            composition = Composition(w.fit.composition.baseline, rest)
            begun = [placed(composition, w.fit, {}), placed(composition, root, {x.name: own[x.name] for x in rest})]
            for x in rest:  # else a set may leave more than a smaller one does, of which it holds all members
                if (less := self.visited.get(frozenset(y.name for y in rest if y is not x))) and less.members:
                    begun.append(placed(composition, less.fit, {x.name: own[x.name]}))
            return self._weighed(self._settled(composition, begun, w.fit))

        members = [frozenset(x.name for x in rest) for rest in rests]
        _ = w.fit.jacobian  # found once, for all forks
        for one in self.each(without_one, [r for r, m in zip(rests, members, strict=True) if m not in self.visited]):
            self._add(one)
        self.enlarge([*(self.visited[m] for m in members if m in self.visited), w])
        swaps = [(e, y) for e in w.effects for y in self.candidates if akin(e, y) and y.name not in w.members
                 and self._together([*(x for x in w.effects if x is not e), y])]
        for found in self.each(lambda pair: self._swapped(w, *pair), swaps):
            if found is not None:
                self._add(found)

    def _swapped(self, w: Weighed, gone: Effect, come: Effect) -> Weighed | None:
        """A set with the next of kin in the place of one effect, from the numbers that the others have beside that.

        Without either the law follows what it lacks, a late motion say, and leads to no good start of the other. None
        where to first order, the others and the size of the change following, it stays hopelessly behind. Lags do not
        act in proportion: all of them are refitted. Where a number of the law has gone to its bound, an effect does the
        work of that part, a friction that of the yield force: then the law begins from where it stands alone too.
        """
        composition = Composition(w.fit.composition.baseline, (*(x for x in w.effects if x is not gone), come))
        place = w.fit.composition.places[w.effects.index(gone)]
        basis = projector(np.delete(w.fit.jacobian, range(place.start, place.stop), axis=1))
        plain = without(basis, self._error(composition, placed(composition, w.fit, {})))
        points = come.refit_points(self.problem.signals, Scales.of(self.problem.signals).size)
        begun = [placed(composition, w.fit, {come.name: v}) for v in points]
        lag, left = come.path in LAGGING, []
        for vector in begun:
            error = without(basis, self._error(composition, vector))
            change = plain - error
            followed = 0.0 if lag else (error @ change) ** 2 / max(float(change @ change), 1e-300)
            left.append(float(error @ error - followed))
        behind = 0.5 * self.kept * self.problem.n_samples * np.log(max(min(left), 1e-300) / w.fit.cost)
        first = [begun[k] for k in np.argsort(left)[:RACED]]
        found = [self._settled(composition, first, w.fit, (come,), RACED)] if lag or behind < HOPELESS else []
        own, root = slice(composition.own), self.visited[frozenset()].fit
        if np.any(w.fit.at_bounds()[own] & ~root.at_bounds()[own]):
            anew = [np.concatenate([root.vector[own], v[composition.own:]]) for v in begun]
            nearest = min(anew, key=lambda v: self._left(composition, v))
            found.append(refit(self.problem, composition, nearest, iterations=2 * ITERATIONS))
        return self._weighed(min(found, key=lambda f: f.cost)) if found else None

    def _add(self, w: Weighed) -> None:
        """Keep a set if it leaves less than before; one that a refit has emptied of a member leads to the smaller set.

        From where that began it may have ended in another minimum.
        """
        if not np.isfinite(w.fit.cost):
            return
        if self._less(w.members, w.fit.cost):
            self.visited[w.members] = w
        there = tuple(e for e, change in zip(w.effects, w.changes, strict=True) if change >= ABSENT)
        if len(there) < len(w.effects) and self._less(frozenset(e.name for e in there), w.fit.cost):
            composition = Composition(w.fit.composition.baseline, there)
            self._add(self._weighed(self._settled(composition, [placed(composition, w.fit, {})], w.fit)))

    def _less(self, members: frozenset[str], cost: float) -> bool:
        """Whether a squared error is below that of a visited set, or there is no such set."""
        known = self.visited.get(members)
        return known is None or cost < known.fit.cost

    def _reweigh(self) -> None:
        """κ anew from the error of the best set, until the best set stays."""
        for _ in range(3):
            best = self.best
            errors = self.problem.errors(best.fit.composition, best.fit.vector)
            found = best.fit.cached(("independent", self.worth),
                                    lambda e=errors, worth=self.worth: independent(self.problem, e, worth))
            self.kept, self.structured, self.floor = found.kept, found.structured, found.floor
            if self.best is best:
                return


def akin(one: Effect, other: Effect) -> bool:
    """Whether two effects are next of kin: other components of one family, or lags on the way of motion and force.

    Parameters
    ----------
    one, other : Effect

    Returns
    -------
    bool
    """
    return one.component != other.component and (one.family == other.family
                                                 or (one.path in LAGGING and other.path in LAGGING))


def together(effects: Sequence[Effect], channels: Sequence[str]) -> bool:
    """Whether effects may be in one set: no component twice, what sits behind a series element with one, one lag.

    Of lags, delays and filters on the way of motion and force a set holds one: two imitate whatever there is. What
    turns a channel needs something that reads it, the law (`channels`) or a member that brings it.

    Parameters
    ----------
    effects : sequence of Effect
    channels : sequence of str
        Roles that the law reads.

    Returns
    -------
    bool
    """
    read = {"", *channels, *(c for e in effects for c in e.brings)}
    if any(e.turns not in read for e in effects):
        return False
    components, stages = [e.component for e in effects], {e.stage for e in effects}
    return len(set(components)) == len(components) and all(not e.behind or e.behind in stages for e in effects) and \
        sum(e.path in LAGGING for e in effects) <= 1


def _starts_behind(e: Effect, values: np.ndarray, w: Weighed, signals: Sequence[Signals]) -> list[np.ndarray]:
    """Starts of the law of a set from signals as an effect turns them; none where it leaves them alone."""
    baseline, seen = w.fit.composition.baseline, []

    def law(s: Signals) -> np.ndarray:
        seen.append(s)
        return np.zeros(s.n_samples)

    for s in signals:
        e.compose(law, values, baseline)(s)
    return baseline.starts(seen) if any(a is not b for a, b in zip(seen, signals, strict=False)) else []


def _spread(points: np.ndarray, count: int) -> np.ndarray:
    """So many of the points, evenly among them."""
    return points[np.unique(np.linspace(0, len(points) - 1, count).round().astype(int))]


def posterior(search: SetSearch) -> list[tuple[Weighed, float]]:
    """Visited sets with their weight among these, averaged over what a structured error may be worth; largest first.

    Parameters
    ----------
    search : SetSearch

    Returns
    -------
    list of (Weighed, float)
        The weights add up to one.
    """
    every = list(search.visited.values())
    weights = np.zeros(len(every))
    shares = search.shares or (search.kept,)
    for kept in shares:
        scores = np.array([search.evidence(w, kept) for w in every])
        relative = np.exp(scores - scores.max())
        weights += relative / relative.sum() / len(shares)
    return sorted(zip(every, weights.tolist(), strict=True), key=lambda t: -t[1])
