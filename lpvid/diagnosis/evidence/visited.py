"""Visited sets: how a set of causes is refitted, weighed and kept, and how probable each is among the visited ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from lpvid._forks import in_forks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.evidence.effective_samples import STRUCTURED_SAMPLES, effective_samples
from lpvid.diagnosis.evidence.laplace import NEGLIGIBLE_CHANGE, EvaluatedSet, EvidenceData
from lpvid.diagnosis.evidence.priors import misfit_prior
from lpvid.diagnosis.evidence.relations import compatible
from lpvid.diagnosis.problem import EXPLODED, DiagnosisProblem, without
from lpvid.diagnosis.refitting import Refit, descend, refined_by_trial
from lpvid.diagnosis.screening import start_vector

T = TypeVar("T")
R = TypeVar("R")
SEARCH_FACTOR = 3.0
"""times α that a structured error counts as while sets are sought: three causes that only act jointly must be reached
over two that win too little by themselves"""
COARSE_ITERATIONS, REFIT_ITERATIONS = 2, 8
"""iterations from every start of a set, and further ones from where the best of them ended"""
REFITTED_STARTS = 2
"""starts of one set, of all that were tried, from which it is refitted: those that leave least as they stand"""
LEAST_KAPPA = 0.1
"""share of independent samples that a refit of the search assumes at least, which decides where it ends"""


@dataclass
class VisitedSets:
    """Sets that were visited, the best refit of each, and κ, by which they are weighed.

    Attributes
    ----------
    data : Data
    candidates : tuple of Effect
    channels : sequence of str
        Inputs that an error may follow.
    report_progress : callable
        Receives in words what is being done.
    visited : dict of frozenset of str to Weighed
        By the names of their effects.
    refitted_larger : set of frozenset of str
        Those that `refitted_with` has refitted.
    kappa : float
        κ of the best set's error, by which all sets are weighed.
    structured : float
        Share of that error beyond the noise floor.
    floor : float
        Variance of the noise.
    alpha : float
        α of that: more while sets are sought, so that larger ones are reached, than where they are judged.
    kappas : tuple of float
        κ at every α over which the judgement is averaged; empty while sets are sought, by κ alone then.
    """

    data: EvidenceData
    candidates: tuple[Effect, ...]
    channels: Sequence[str]
    report_progress: Callable[[str], None]
    visited: dict[frozenset[str], EvaluatedSet] = field(default_factory=dict)
    refitted_larger: set[frozenset[str]] = field(default_factory=set)
    kappa: float = 1.0
    structured: float = 0.0
    floor: float = 0.0
    alpha: float = SEARCH_FACTOR * STRUCTURED_SAMPLES
    kappas: tuple[float, ...] = ()

    @property
    def problem(self) -> DiagnosisProblem:
        """Of the data."""
        return self.data.problem

    @property
    def root(self) -> EvaluatedSet:
        """The baseline alone, which is visited first."""
        return self.visited[frozenset()]

    @property
    def best(self) -> EvaluatedSet:
        """The most probable set."""
        return max(self.visited.values(), key=self.score)

    # -- weighing ----------------------------------------------------------------------------------------------------
    def score(self, w: EvaluatedSet) -> float:
        """Evidence of a set at the present κ.

        Parameters
        ----------
        w : Weighed

        Returns
        -------
        float
            In nats, up to what all sets share; minus infinity for one with a strength at its bound.
        """
        return self.evidence(w, self.kappa)

    def evidence(self, w: EvaluatedSet, kappa: float) -> float:
        """Evidence of a set at some κ, and how usual it is for the best law to leave what it leaves beyond noise.

        Parameters
        ----------
        w : Weighed
        kappa : float
            κ.

        Returns
        -------
        float
            As of `score`.
        """
        beyond = max(w.fit.cost / self.problem.n_samples - self.floor, 0.0)
        return w.evidence(kappa) + misfit_prior(np.sqrt(beyond) / self.data.discrepancy.output_rms)

    def update_kappa(self) -> None:
        """Find κ from the error of the best set, which may make another set the best: up to three times."""
        for _ in range(3):
            best = self.best
            errors = self.problem.errors(best.fit.composition, best.fit.vector)
            found = best.fit.cached(("independent", self.alpha),
                                    lambda e=errors, alpha=self.alpha: effective_samples(self.problem, e, alpha))
            self.kappa, self.structured, self.floor = found.kappa, found.structured, found.floor
            if self.best is best:
                return

    # -- refitting ---------------------------------------------------------------------------------------------------
    def allowed(self, effects: Sequence[Effect]) -> bool:
        """Whether effects may be in one set beside this baseline.

        Parameters
        ----------
        effects : sequence of Effect

        Returns
        -------
        bool
        """
        return compatible(effects, self.root.fit.composition.baseline.channels)

    def in_parallel(self, function: Callable[[T], R], items: Sequence[T], shared: Sequence[object] = ()) -> list[R]:
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
        baseline = self.root.fit.composition.baseline
        return in_forks(function, items, (self.data, self.problem, baseline, *self.candidates, *shared))

    def best_refit(self, composition: Composition, start_vectors: Sequence[np.ndarray], near: Refit | None,
                added: Sequence[Effect] = (), full_refits: int = 1) -> Refit:
        """The best refit from several starts: a few iterations from each, more from the best of them.

        Parameters
        ----------
        composition : Composition
        start_vectors : sequence of (P,) arrays
            Starts.
        near : Refit or None
            Of a neighbouring set, whose sensitivities serve at first; None where there is none.
        added : sequence of Effect
            Of these, parameters that no derivative moves are also changed by trial.
        full_refits : int
            Starts that are refitted to their end.

        Returns
        -------
        Refit
        """
        weight = max(self.kappa, LEAST_KAPPA)
        low, high = composition.bounds
        starts = {np.clip(v, low, high).tobytes(): v for v in start_vectors}.values()
        coarse = self.in_parallel(lambda v: descend(self.problem, composition, v, iterations=COARSE_ITERATIONS, near=near, rough=True,
                                            sample_weight=weight), list(starts), (composition,))
        leading = sorted(coarse, key=lambda f: f.cost)[:full_refits]
        if any(e.stepwise or e.rugged for e in added):
            leading[0] = refined_by_trial(leading[0], COARSE_ITERATIONS, rough=True)
        fits = self.in_parallel(lambda f: descend(self.problem, composition, f.vector, iterations=REFIT_ITERATIONS, rough=True,
                                           sample_weight=weight), leading, (composition,))
        return min(fits, key=lambda f: f.cost)

    def cost_at(self, composition: Composition, vector: np.ndarray, basis: np.ndarray | None = None) -> float:
        """Squared error at a vector; with a basis the part that its directions cannot take away, to first order.

        Parameters
        ----------
        composition : Composition
        vector : (P,) array
        basis : (N, r) array, optional
            Orthonormal.

        Returns
        -------
        float
            In the squared unit of the output, over all samples.
        """
        error = self.problem.stacked_errors(composition, vector)
        error = error if basis is None else without(basis, error)
        return float(np.minimum(error**2, EXPLODED).sum())

    # -- keeping -----------------------------------------------------------------------------------------------------
    def evaluated(self, fit: Refit) -> EvaluatedSet:
        """A refitted set, its evidence found.

        Parameters
        ----------
        fit : Refit

        Returns
        -------
        Weighed
        """
        found = EvaluatedSet(self.data, fit)
        if np.isfinite(fit.cost):
            self.score(found)
        return found

    def has_lower_cost(self, members: frozenset[str], cost: float) -> bool:
        """Whether a squared error is below that of a visited set, or there is no such set.

        Parameters
        ----------
        members : frozenset of str
            Names of the set's effects.
        cost : float
            Squared error.

        Returns
        -------
        bool
        """
        known = self.visited.get(members)
        return known is None or cost < known.fit.cost

    def add(self, w: EvaluatedSet) -> None:
        """Keep a set if it leaves less than before; where a refit has emptied a member, visit the set without it too.

        From where that began it may have ended in another minimum.

        Parameters
        ----------
        w : Weighed
        """
        if not np.isfinite(w.fit.cost):
            return
        if self.has_lower_cost(w.members, w.fit.cost):
            self.visited[w.members] = w
        present = tuple(e for e, change in zip(w.effects, w.changes, strict=True) if change >= NEGLIGIBLE_CHANGE)
        if len(present) < len(w.effects) and self.has_lower_cost(frozenset(e.name for e in present), w.fit.cost):
            composition = Composition(w.fit.composition.baseline, present)
            self.add(self.evaluated(self.best_refit(composition, [start_vector(composition, w.fit, {})], w.fit)))

    def refitted_with(self, w: EvaluatedSet, e: Effect, values: np.ndarray) -> EvaluatedSet:
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
        if known is None or (known.fit.cost > w.fit.cost and more not in self.refitted_larger):
            self.refitted_larger.add(more)
            composition = Composition(w.fit.composition.baseline, (*w.effects, e))
            self.add(self.evaluated(self.best_refit(composition, [start_vector(composition, w.fit, {e.name: values})], w.fit)))
        return self.visited.get(more, w)


def posterior(sets: VisitedSets) -> list[tuple[EvaluatedSet, float]]:
    """Visited sets with their weight among these, averaged over what a structured error may be worth; largest first.

    Parameters
    ----------
    sets : VisitedSets

    Returns
    -------
    list of (Weighed, float)
        The weights add up to one.
    """
    every = list(sets.visited.values())
    weights = np.zeros(len(every))
    kappas = sets.kappas or (sets.kappa,)
    for kappa in kappas:
        scores = np.array([sets.evidence(w, kappa) for w in every])
        relative = np.exp(scores - scores.max())
        weights += relative / relative.sum() / len(kappas)
    return sorted(zip(every, weights.tolist(), strict=True), key=lambda t: -t[1])
