"""Search over sets of causes: beam search, linked pairs, and the members of the best set removed and exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from lpvid._projection import projector, without
from lpvid.baselines.repeats import Repeat
from lpvid.baselines.signals import Signals
from lpvid.diagnosis.blocks import START_UP
from lpvid.diagnosis.budgets import BEAM_WIDTH, ITERATIONS, MOST_MEMBERS, MOST_STARTS, REFITTED_STARTS
from lpvid.diagnosis.evidence import candidates as screenings
from lpvid.diagnosis.evidence.discrepancy import TYPICAL_MISFIT, Discrepancy
from lpvid.diagnosis.evidence.effective_samples import STRUCTURED_SAMPLES, STRUCTURED_SAMPLES_RANGE
from lpvid.diagnosis.evidence.laplace import EvaluatedSet, Members
from lpvid.diagnosis.evidence.relations import LAGGING, related
from lpvid.diagnosis.evidence.visited import SEARCH_FACTOR, VisitedSets, posterior
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import ROUGH_DECREASE, Refit, descend, refit, settled_start
from lpvid.diagnosis.screening import Direction, start_vector
from lpvid.diagnosis.start_points import start_points
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from lpvid.effects.scaling import Scales
from lpvid.rounding import TINY
from lpvid.validation.whitening import Whitening, whitening_of


@dataclass
class SetSearch(VisitedSets):
    """Visited sets and the order in which sets are visited.

    Attributes
    ----------
    baseline_screening : BaselineScreening
        Of all effects beside the baseline alone.
    enlarged : set of frozenset of str
        Visited sets whose children were visited.
    exchanged : set of frozenset of str
        Visited sets of which members were removed and exchanged.
    recorded : tuple of Signals
        One for each record, whole.
    repeated : tuple of Repeat
        Of these.
    noise : Whitening, optional
        What does not repeat of the best set's error.
    weighed_for : frozenset of str, optional
        The set beside whose misfit the errors are weighed.
    """

    baseline_screening: screenings.BaselineScreening = field(default_factory=screenings.BaselineScreening)
    enlarged: set[Members] = field(default_factory=set)
    exchanged: set[Members] = field(default_factory=set)
    recorded: tuple[Signals, ...] = ()
    repeated: tuple[Repeat, ...] = ()
    noise: Whitening | None = None
    weighed_for: Members | None = None

    def run(self, root: Refit) -> None:
        """Visit sets, starting from the baseline alone.

        Parameters
        ----------
        root : Refit
            The baseline alone, on the samples of the data.
        """
        self.visited[frozenset()] = EvaluatedSet(self.data, root)
        self.update_kappa()
        self.enlarge([self.root])  # before the pairs, which can fit the error of a single cause
        self.update_kappa()
        if self.weighed_for is None:  # else they are known
            self._pairs()
            self.update_kappa()
        for _ in range(MOST_MEMBERS):
            before = self.best
            self.enlarge(self._beam())
            self.update_kappa()
            if self.best is before and self.best.members in self.enlarged:
                break
            if self.best is not before:
                self._exchange_members(self.best)
                self.update_kappa()
        self.settle()

    def settle(self) -> None:
        """Visit the neighbours of the best set until it stays the best one."""
        self.alpha = STRUCTURED_SAMPLES
        self.update_kappa()
        for _ in range(MOST_MEMBERS):
            before = self.best
            self._exchange_and_enlarge(before)
            self.update_kappa()
            if self.best is before:
                break
        self.kappas = tuple(map(self.effective.kappa_at, STRUCTURED_SAMPLES_RANGE))
        self._exchange_and_enlarge(posterior(self)[0][0])  # averaged over α, it may be another set

    def add(self, w: EvaluatedSet) -> None:
        """Keep a set if its cost is lower than before; its neighbours are then visited again from its new refit.

        Parameters
        ----------
        w : EvaluatedSet
        """
        before = self.visited.get(w.members)
        super().add(w)
        if before and self.visited[w.members] is w and self.deficit(before.fit.cost, w.fit.cost) > ROUGH_DECREASE:
            self.enlarged.discard(w.members)
            self.exchanged.discard(w.members)

    def reweighed(self) -> SetSearch | None:
        """A search that has visited the same sets, its errors weighed by the noise that repeats show.

        The misfit beside the noise is that of the best set. Errors are weighed where slow noise is the larger part of
        it (`is_mostly_noise`), and where errors do not count as noise already.

        Returns
        -------
        SetSearch or None
            Not yet run; None too where nothing repeats, or where the weights are those for the best set.
        """
        best, problem, floor = self.best, self.problem, self.effective.floor
        if not self.repeated or best.members == self.weighed_for:
            return None
        weighed = self.with_weights(problem, best.fit, self.recorded)
        self.noise = weighed.whitening
        if self.noise is None or (problem.whitening is None and (self.kappa > 0.5 or not self.is_mostly_noise(floor))):
            return None
        data = replace(self.data, problem=weighed, discrepancy=Discrepancy.of(weighed, best.fit.composition.baseline))
        found = replace(self, data=data, visited={}, enlarged=set(), exchanged=set(), kappas=(),
                        alpha=SEARCH_FACTOR * STRUCTURED_SAMPLES, weighed_for=best.members,
                        # costs of lags differ
                        baseline_screening=screenings.BaselineScreening(self.baseline_screening.changes))

        def moved(w: EvaluatedSet) -> EvaluatedSet:
            fit = w.fit.on(weighed)
            vector = settled_start(weighed, fit.composition, fit.vector, fit)
            return found.evaluated(descend(weighed, fit.composition, vector, iterations=0))

        sets = self.in_parallel(moved, list(self.visited.values()), (weighed, data))
        found.visited |= {w.members: w for w in sets if np.isfinite(w.fit.cost)}
        found.update_kappa()
        return found

    def is_mostly_noise(self, floor: float) -> bool:
        """Whether slow noise, known by repeats, is the larger part of what counts as misfit beside the best set.

        A misfit that is mostly slow has no weight in a weighed search: its best set may leave far more of it.

        Parameters
        ----------
        floor : float
            Variance of white noise, in the output's unit squared.

        Returns
        -------
        bool
        """
        return self.noise is not None and 2 * (self.noise.variance - floor) >= self.best.mean_square - floor

    def with_weights(self, problem: DiagnosisProblem, fit: Refit, signals: tuple[Signals, ...]) -> DiagnosisProblem:
        """A problem with its errors weighed by the noise that repeats show beside a fit, and by the misfit of that.

        Parameters
        ----------
        problem : DiagnosisProblem
        fit : Refit
            On its samples.
        signals : tuple of Signals
            One for each record, whole, on its clock.

        Returns
        -------
        DiagnosisProblem
            Not weighed where too little repeats.
        """
        period = signals[0].sample_time
        ratio, size = round(self.recorded[0].sample_time / period), problem.n_samples // problem.blocks.count
        errors = replace(problem, signals=signals).errors(fit.composition, fit.vector)
        output = problem.stack([s.output - s.output.mean() for s in problem.signals])
        noise = whitening_of([r._replace(lag=ratio * r.lag) for r in self.repeated], errors, output, size,
                             round(START_UP / period), (TYPICAL_MISFIT * self.data.discrepancy.output_rms) ** 2)
        error = problem.stack(problem.errors(fit.composition, fit.vector))
        return replace(problem, whitening=noise and noise.beside(error, STRUCTURED_SAMPLES))

    # -- larger sets -------------------------------------------------------------------------------------------------
    def _can_grow(self, w: EvaluatedSet) -> bool:
        """Whether a set may still be enlarged."""
        return w.members not in self.enlarged and len(w.members) < MOST_MEMBERS

    def _beam(self) -> list[EvaluatedSet]:
        """The most probable sets that may be enlarged, of which none holds all components of a more probable one, or a
        filter of all channels: that is added last.

        Otherwise forms of one component, and subsets of one set, would fill the beam: beside a law that lacks friction
        and a resonance, a spring is most probable at first, alone and with any further effect.
        """
        chosen: list[EvaluatedSet] = []
        for w in sorted(filter(self._can_grow, self.visited.values()), key=self.score, reverse=True):
            if all(e.path != "all" for e in w.effects) and \
                    len(chosen) < BEAM_WIDTH and not any(set(w.components) >= set(c.components) for c in chosen):
                chosen.append(w)
        return chosen

    def enlarge(self, sets: Sequence[EvaluatedSet]) -> None:
        """Visit the sets with one effect more that have the largest predicted gain, for one set after the other.

        A set that was visited before is refitted where the predicted cost is lower than that of its last refit.

        Parameters
        ----------
        sets : sequence of EvaluatedSet
            Screened together; those that cannot be enlarged, or have been, are passed over.
        """
        sets = [w for w in sets if self._can_grow(w)]
        self.enlarged |= {w.members for w in sets}
        if not sets:
            return
        best, share = posterior(self)[0]
        names = "; ".join(", ".join(sorted(w.members)) or "the baseline alone" for w in sets)
        leader = ", ".join(sorted(best.members)) or "nothing"
        self.report_progress(f"enlarging {names} (best so far: {leader}, {share:.2f} of {len(self.visited)} sets)")
        if self.weighed_for is None and any(not w.members for w in sets):
            self.baseline_screening = screenings.screen_beside_baseline(self)
        for w, found in zip(sets, screenings.screen_beside_sets(self, self.baseline_screening, sets), strict=True):
            chosen = [e for e, cost in screenings.by_predicted_gain(self, self.baseline_screening, w, found).items()
                      if self.has_lower_cost(w.members | {e.name}, cost)]
            _ = w.fit.jacobian, self.root.fit.jacobian  # computed once, for all forks
            for child in self.in_parallel(lambda e, w=w, found=found: self.evaluated(self._child(w, e, found)), chosen):
                self.add(child)

    def _child(self, w: EvaluatedSet, added: Effect, found: Sequence[Direction]) -> Refit:
        """A set with one effect more, refitted from the grid points of the largest gain."""
        composition = Composition(w.fit.composition.baseline, (*w.effects, added))
        if not w.members and (lag_starts := self.baseline_screening.lag_starts.get(added.name)) is not None:
            return self.best_refit(composition, [v for _, v in lag_starts], None, (added,))
        vectors = [start_vector(composition, w.fit, {added.name: p}) for p in start_points(added, found)]
        return self.best_refit(composition, vectors, w.fit, (added,), REFITTED_STARTS)

    def _pairs(self) -> None:
        """Visit pairs of effects that physics links, which may act only together."""
        root, names = self.root.fit, {e.name: e for e in self.candidates}
        pairs = sorted({tuple(sorted((e.name, p))) for e in self.candidates for p in e.partners if p in names
                        and self.allowed((e, names[p]))})
        self.report_progress(f"{len(pairs)} linked pairs")
        basis = projector(root.free_jacobian)

        def refitted(pair: tuple[str, ...]) -> EvaluatedSet:
            composition = Composition(root.composition.baseline, tuple(names[n] for n in pair))
            grids = [screenings.evenly_spaced(self.data.grid_points[n], MOST_STARTS) for n in pair]
            vectors = [start_vector(composition, root, {pair[0]: a, pair[1]: b}) for a in grids[0] for b in grids[1]]
            costs = [self.cost_at(composition, v, basis) for v in vectors]
            best = [vectors[k] for k in np.argsort(costs)[:REFITTED_STARTS]]
            return self.evaluated(self.best_refit(composition, best, root, composition.effects, REFITTED_STARTS))

        for pair in self.in_parallel(refitted, pairs):
            self.add(pair)

    # -- neighbours of the best set ----------------------------------------------------------------------------------
    def _exchange_and_enlarge(self, w: EvaluatedSet) -> None:
        """Exchange the members of a set; enlarge it and the sets without one of its members."""
        self._exchange_members(w)
        self.enlarge([*(self.visited[m] for e in w.effects if (m := w.members - {e.name}) in self.visited), w])

    def _exchange_members(self, w: EvaluatedSet) -> None:
        """Visit the set without each of its members, and with related effects in the place of each.

        Sets that were visited before are refitted too: an earlier refit may have ended in another minimum. Without a
        spring, friction behind it is dry friction (`Effect.placement_of`).
        """
        if w.members in self.exchanged:
            return
        self.exchanged.add(w.members)
        known, own = {c.name: c for c in self.candidates}, w.fit.composition.by_effect(w.fit.vector)
        behind = {x.name: known[x.component] for x in w.effects if x.behind and x.component in known}
        own |= {e.name: e.in_place_of(known[name], own[name]) for name, e in behind.items()}
        reduced = [tuple(x for x in w.effects if x is not e) for e in w.effects]
        reduced = [r if self.allowed(r) else tuple(behind.get(x.name, x) for x in r) for r in reduced]
        _ = w.fit.jacobian  # computed once, for all forks

        def without_one(remaining: tuple[Effect, ...]) -> EvaluatedSet:
            composition = Composition(w.fit.composition.baseline, remaining)
            vectors = [start_vector(composition, fit, {x.name: own[x.name] for x in remaining})
                       for fit in (w.fit, self.root.fit)]
            for x in remaining:  # so that no set has a higher cost than one of its subsets
                if (less := self.visited.get(frozenset(y.name for y in remaining if y is not x))) and less.members:
                    vectors.append(start_vector(composition, less.fit, {x.name: own[x.name]}))
            return self.evaluated(self.best_refit(composition, vectors, w.fit))

        swaps = [(e, y) for e in w.effects for y in self.candidates if related(e, y) and y.name not in w.members
                 and self.allowed([*(x for x in w.effects if x is not e), y])]
        calls = [*(partial(without_one, remaining) for remaining in reduced if self.allowed(remaining)),
                 *(partial(self._exchanged, w, *pair) for pair in swaps)]
        for found in filter(None, self.in_parallel(lambda call: call(), calls)):
            self.add(found)

    def _exchanged(self, w: EvaluatedSet, removed: Effect, inserted: Effect) -> EvaluatedSet | None:
        """A set with a related effect in the place of one, from the parameters that the others have beside that one.

        Without either effect the law is fitted to a wrong input, such as a late motion, and is no good start vector.
        None where the predicted deficit of log-evidence, with the other parameters and the size of the change refitted
        to first order, is above `MOST_DEFICIT`. The change by a lag is not proportional to it: lags are always
        refitted. Where a parameter of the law has moved to its bound, an effect has replaced that part of the law, such
        as friction its yield force: then the set is also refitted from the parameters of the law alone, to the end
        unless the deficit is too large.
        """
        composition = Composition(w.fit.composition.baseline, (*(x for x in w.effects if x is not removed), inserted))
        place = w.fit.composition.places[w.effects.index(removed)]
        basis = projector(np.delete(w.fit.jacobian, range(place.start, place.stop), axis=1))
        without_either = without(basis, self.problem.stacked_errors(composition, start_vector(composition, w.fit, {})))
        points = inserted.refit_points(self.problem.signals, Scales.of(self.problem.signals).size)
        vectors = [start_vector(composition, w.fit, {inserted.name: v}) for v in points]
        lag, costs = inserted.path in LAGGING, []
        for vector in vectors:
            error = without(basis, self.problem.stacked_errors(composition, vector))
            change = without_either - error
            scaling_gain = 0.0 if lag else (error @ change) ** 2 / max(float(change @ change), TINY)
            costs.append(float(error @ error - scaling_gain))

        found = []
        if lag or self.deficit(min(costs), w.fit.cost) < screenings.MOST_DEFICIT:
            best = [vectors[k] for k in np.argsort(costs)[:REFITTED_STARTS]]
            found.append(self.best_refit(composition, best, w.fit, (inserted,), REFITTED_STARTS))
        own, root = slice(composition.own), self.root.fit
        if np.any(w.fit.at_bounds()[own] & ~root.at_bounds()[own]):
            restarted = [np.concatenate([root.vector[own], v[composition.own:]]) for v in vectors]
            first = self.best_refit(composition, [min(restarted, key=lambda v: self.cost_at(composition, v))], None)
            if self.deficit(first.cost, w.fit.cost) < screenings.MOST_DEFICIT:
                first = refit(self.problem, composition, first.vector, iterations=2 * ITERATIONS)
            found.append(first)
        return self.evaluated(min(found, key=lambda f: f.cost)) if found else None
