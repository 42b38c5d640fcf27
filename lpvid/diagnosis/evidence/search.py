"""Search: over sets of causes, with a beam, pairs at the root, and every member of the best set dropped and swapped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.evidence.independence import WORTH, WORTHS, share_of
from lpvid.diagnosis.evidence.kinship import LAGGING, akin
from lpvid.diagnosis.evidence.looking import HOPELESS, FirstLook, by_predicted_gain, evenly, first_look, look
from lpvid.diagnosis.evidence.scaling import Scales
from lpvid.diagnosis.evidence.visited import RACED, VisitedSets, posterior
from lpvid.diagnosis.evidence.weighing import Weighed
from lpvid.diagnosis.problem import projector, without
from lpvid.diagnosis.refitting import ITERATIONS, Refit, refit
from lpvid.diagnosis.screening import Direction, placed
from lpvid.diagnosis.starting import starts

BEAM, DEEPEST = 3, 4
"""sets enlarged at every size, and members at most"""
ROUNDS = 2
"""times that the best set is pulled apart, each member dropped and swapped"""
TOGETHER = 3
"""points of either of a pair: it is refitted from the best of their combinations"""


@dataclass
class SetSearch(VisitedSets):
    """The order in which sets are visited.

    Attributes
    ----------
    seen : FirstLook
        What the effects changed beside the baseline alone.
    enlarged : set of frozenset of str
        Visited sets whose children are known.
    apart : set of frozenset of str
        Visited sets whose neighbours are known.
    """

    seen: FirstLook = field(default_factory=FirstLook)
    enlarged: set[frozenset[str]] = field(default_factory=set)
    apart: set[frozenset[str]] = field(default_factory=set)

    def run(self, root: Refit) -> None:
        """Visit sets from the baseline alone on.

        Parameters
        ----------
        root : Refit
            The baseline alone, on the samples of the data.
        """
        self.visited[frozenset()] = Weighed(self.data, root)
        self.reweigh()
        self.enlarge([self.root])  # else a pair that imitates a single cause comes before it
        self.reweigh()
        self._pairs()
        self.reweigh()
        for _ in range(DEEPEST):
            before = self.best
            self.enlarge(self._beam())
            self.reweigh()
            if self.best is before and self.best.members in self.enlarged:
                break
            if self.best is not before:
                self._neighbours(self.best)
                self.reweigh()
        self.worth = WORTH
        self.reweigh()
        for _ in range(ROUNDS):
            before = self.best
            self._pull_apart(before)
            self.reweigh()
            if self.best is before:
                break
        self.shares = tuple(share_of(self.structured, self.problem.n_samples, w) for w in WORTHS)
        self._pull_apart(posterior(self)[0][0])  # over all α it may be another set

    # -- larger sets -------------------------------------------------------------------------------------------------
    def _open(self, w: Weighed) -> bool:
        """Whether a set may still be enlarged; one with a filter of all channels is not, which comes last."""
        return w.members not in self.enlarged and len(w.members) < DEEPEST and all(e.path != "all" for e in w.effects)

    def _beam(self) -> list[Weighed]:
        """The most probable open sets of which none holds all components of a more probable one.

        Else forms of one component, and sets that grew from one another, would fill the beam: beside a law that lacks
        friction and a resonance, a spring comes first, alone and with any further effect, and the true causes long
        after.
        """
        chosen: list[Weighed] = []
        for w in sorted(filter(self._open, self.visited.values()), key=self.score, reverse=True):
            if len(chosen) < BEAM and not any(set(w.kinds) >= set(c.kinds) for c in chosen):
                chosen.append(w)
        return chosen

    def enlarge(self, sets: Sequence[Weighed]) -> None:
        """Visit the sets of the largest predicted gain with one effect more, of one set after the other.

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
        if any(not w.members for w in sets):
            self.seen = first_look(self)
        for w, found in zip(sets, look(self, self.seen, sets), strict=True):
            chosen = [e for e, cost in by_predicted_gain(self, self.seen, w, found).items()
                      if self.is_less(w.members | {e.name}, cost)]
            _ = w.fit.jacobian, self.root.fit.jacobian  # found once, for all forks
            for child in self._children(w, chosen, found):
                self.add(child)

    def _children(self, w: Weighed, chosen: Sequence[Effect], found: Sequence[Direction]) -> list[Weighed]:
        """Sets with one effect more, refitted."""
        return self.each(lambda e: self.weighed(self._child(w, e, found)), chosen)

    def _child(self, w: Weighed, added: Effect, found: Sequence[Direction]) -> Refit:
        """A set with one effect more, refitted from the points of the largest gain."""
        composition = Composition(w.fit.composition.baseline, (*w.effects, added))
        if not w.members and added.name in self.seen.following:  # the law follows the lag
            return self.settled(composition, [v for _, v in self.seen.following[added.name]], None, (added,))
        begun = [placed(composition, w.fit, {added.name: p}) for p in starts(added, found)]
        return self.settled(composition, begun, w.fit, (added,))

    def _pairs(self) -> None:
        """Visit pairs of effects that physics links, which may act only together."""
        root, names = self.root.fit, {e.name: e for e in self.candidates}
        pairs = sorted({tuple(sorted((e.name, p))) for e in self.candidates for p in e.partners if p in names
                        and self.allowed((e, names[p]))})
        self.report_progress(f"{len(pairs)} linked pairs")
        basis = projector(root.yielding)

        def refitted(pair: tuple[str, ...]) -> Weighed:
            composition = Composition(root.composition.baseline, tuple(names[n] for n in pair))
            grids = [evenly(self.data.looked_at[n], TOGETHER) for n in pair]
            begun = [placed(composition, root, {pair[0]: a, pair[1]: b}) for a in grids[0] for b in grids[1]]
            left = [self.left(composition, v, basis) for v in begun]
            return self.weighed(self.settled(composition, [begun[k] for k in np.argsort(left)[:RACED]], root,
                                             composition.effects, RACED))

        for pair in self.each(refitted, pairs):
            self.add(pair)

    # -- neighbours of the best set ----------------------------------------------------------------------------------
    def _pull_apart(self, w: Weighed) -> None:
        """Visit the neighbours of a set, and what enlarges it and the sets without one of its members."""
        self._neighbours(w)
        without = (w.members - {e.name} for e in w.effects)
        self.enlarge([*(self.visited[m] for m in without if m in self.visited), w])

    def _neighbours(self, w: Weighed) -> None:
        """Visit the set without each of its members, and with the next of kin in its place.

        A set that was visited is visited again where less error is in sight from here.
        """
        if w.members in self.apart:
            return
        self.apart.add(w.members)
        rests = [rest for e in w.effects if self.allowed(rest := tuple(x for x in w.effects if x is not e))]
        own = {x.name: w.fit.vector[p] for x, p in zip(w.effects, w.fit.composition.places, strict=True)}
        root = self.root.fit
        _ = w.fit.jacobian  # found once, for all forks

        def without_one(rest: tuple[Effect, ...]) -> Weighed | None:
            composition = Composition(w.fit.composition.baseline, rest)
            begun = [placed(composition, w.fit, {}), placed(composition, root, {x.name: own[x.name] for x in rest})]
            known = self.visited.get(composition.members)
            if known is not None and not any(self.left(composition, v) < known.fit.cost for v in begun):
                return None
            for x in rest:  # else a set may leave more than a smaller one does, of which it holds all members
                if (less := self.visited.get(frozenset(y.name for y in rest if y is not x))) and less.members:
                    begun.append(placed(composition, less.fit, {x.name: own[x.name]}))
            return self.weighed(self.settled(composition, begun, w.fit))

        swaps = [(e, y) for e in w.effects for y in self.candidates if akin(e, y) and y.name not in w.members
                 and self.allowed([*(x for x in w.effects if x is not e), y])]
        for found in [*self.each(without_one, rests), *self.each(lambda pair: self._swapped(w, *pair), swaps)]:
            if found is not None:
                self.add(found)

    def _swapped(self, w: Weighed, gone: Effect, come: Effect) -> Weighed | None:
        """A set with the next of kin in the place of one effect, from the numbers that the others have beside that.

        Without either effect the law follows what it lacks, a late motion for instance, and is no good start for the
        other one. None where the new set stays hopelessly behind, to first order: the others and the size of the
        change following. Lags do not act in proportion: all of them are refitted. Where a number of the law has gone to
        its bound, an effect does the work of that part, a friction that of the yield force: then the law begins from
        where it stands alone too, and is followed to its end unless it stays hopelessly behind.
        """
        composition = Composition(w.fit.composition.baseline, (*(x for x in w.effects if x is not gone), come))
        place = w.fit.composition.places[w.effects.index(gone)]
        basis = projector(np.delete(w.fit.jacobian, range(place.start, place.stop), axis=1))
        plain = without(basis, self.problem.stacked_errors(composition, placed(composition, w.fit, {})))
        points = come.refit_points(self.problem.signals, Scales.of(self.problem.signals).size)
        begun = [placed(composition, w.fit, {come.name: v}) for v in points]
        lag, left = come.path in LAGGING, []
        for vector in begun:
            error = without(basis, self.problem.stacked_errors(composition, vector))
            change = plain - error
            followed = 0.0 if lag else (error @ change) ** 2 / max(float(change @ change), 1e-300)
            left.append(float(error @ error - followed))

        def behind(cost: float) -> float:
            return 0.5 * self.kept * self.problem.n_samples * float(np.log(max(cost, 1e-300) / w.fit.cost))

        near = [begun[k] for k in np.argsort(left)[:RACED]]
        found = [self.settled(composition, near, w.fit, (come,), RACED)] if lag or behind(min(left)) < HOPELESS else []
        own, root = slice(composition.own), self.root.fit
        if np.any(w.fit.at_bounds()[own] & ~root.at_bounds()[own]):
            anew = [np.concatenate([root.vector[own], v[composition.own:]]) for v in begun]
            first = self.settled(composition, [min(anew, key=lambda v: self.left(composition, v))], None)
            if behind(first.cost) < HOPELESS:
                first = refit(self.problem, composition, first.vector, iterations=2 * ITERATIONS)
            found.append(first)
        return self.weighed(min(found, key=lambda f: f.cost)) if found else None
