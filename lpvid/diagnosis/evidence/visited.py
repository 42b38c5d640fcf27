"""Visited sets of causes: their refits, evidence and posterior weights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from lpvid._forks import in_forks
from lpvid._projection import without
from lpvid.diagnosis.budgets import COARSE_ITERATIONS, NEAR_ITERATIONS
from lpvid.diagnosis.evidence.effective_samples import STRUCTURED_SAMPLES, EffectiveSamples, effective_samples
from lpvid.diagnosis.evidence.laplace import NEGLIGIBLE_CHANGE, EvaluatedSet, EvidenceData, Members, WeighedSets
from lpvid.diagnosis.evidence.priors import misfit_prior
from lpvid.diagnosis.evidence.relations import compatible
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, descend, refined_by_trial, settled_start
from lpvid.diagnosis.screening import start_vector
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from lpvid.rounding import EXPLODED, TINY

T = TypeVar("T")
R = TypeVar("R")
SEARCH_FACTOR = 3.0
"""factor on α during the search: three causes that only act jointly must be reached from two with little gain alone"""
LEAST_KAPPA = 0.1
"""least κ by which a refit of the search is ended"""


@dataclass
class VisitedSets:
    """Sets that were visited, the best refit of each, and κ, at which their evidence is computed.

    Attributes
    ----------
    data : EvidenceData
    candidates : tuple of Effect
    channels : sequence of str
        Inputs on which an error may depend.
    report_progress : callable
        Receives a line of text at every stage.
    visited : dict of frozenset of str to EvaluatedSet
        By the names of their effects.
    effective : EffectiveSamples
        Of the best set's error.
    alpha : float
        α of that; larger by `SEARCH_FACTOR` during the search, so that larger sets are reached.
    kappas : tuple of float
        κ at every α over which the weights are averaged; empty during the search, which uses `kappa` alone.
    """

    data: EvidenceData
    candidates: tuple[Effect, ...]
    channels: Sequence[str]
    report_progress: Callable[[str], None]
    visited: dict[Members, EvaluatedSet] = field(default_factory=dict)
    effective: EffectiveSamples = field(default_factory=lambda: EffectiveSamples(1.0, 0.0, 0.0))
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

    @property
    def kappa(self) -> float:
        """κ of the best set's error, which is used for all sets."""
        return self.effective.kappa

    def relative_rms(self, values: np.ndarray) -> float:
        """Root mean square of values over that of the output.

        Parameters
        ----------
        values : (N,) array
            In the output's unit.

        Returns
        -------
        float
        """
        return float(np.sqrt(np.mean(values**2))) / self.data.discrepancy.output_rms

    # -- evidence ----------------------------------------------------------------------------------------------------
    def score(self, w: EvaluatedSet) -> float:
        """Evidence of a set at the current κ.

        Parameters
        ----------
        w : EvaluatedSet

        Returns
        -------
        float
            In nats, up to what all sets share; minus infinity for one with a strength at its bound.
        """
        return self.evidence(w, self.kappa)

    def evidence(self, w: EvaluatedSet, kappa: float) -> float:
        """Evidence of a set at some κ, with the prior of its structured error (`misfit_prior`).

        Parameters
        ----------
        w : EvaluatedSet
        kappa : float
            κ.

        Returns
        -------
        float
            As of `score`.
        """
        structured = max(w.mean_square - self.effective.floor, 0.0)
        return w.evidence(kappa) + misfit_prior(np.sqrt(structured) / self.data.discrepancy.output_rms)

    def deficit(self, cost: float, other: float) -> float:
        """Deficit of the log-likelihood at a squared error against that at another one, at the current κ.

        Parameters
        ----------
        cost, other : float
            In the squared unit of the output, over all samples.

        Returns
        -------
        float
            In nats; negative where the cost is the lower one.
        """
        return 0.5 * self.kappa * self.problem.n_samples * float(np.log(max(cost, TINY) / max(other, TINY)))

    def update_kappa(self) -> None:
        """Compute κ from the error of the best set, up to three times: another set may become the best."""
        for _ in range(3):
            best = self.best
            self.effective = best.fit.cached(("effective samples", self.alpha), lambda f=best.fit: effective_samples(
                self.problem, self.problem.errors(f.composition, f.vector), self.alpha))
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
        """Results for independent items, on every processor.

        Parameters
        ----------
        function : callable
            Of one item.
        items : sequence
        shared : sequence of object
            What results refer to besides the data, the baseline and the candidates.

        Returns
        -------
        list
        """
        return in_forks(function, items, (self.data, self.problem, self.root.fit.composition.baseline,
                                          *self.candidates, *shared))

    def best_refit(self, composition: Composition, start_vectors: Sequence[np.ndarray], near: Refit | None,
                   added: Sequence[Effect] = (), full_refits: int = 1) -> Refit:
        """The best refit from several start vectors: coarse refits, continued from the best of them.

        Parameters
        ----------
        composition : Composition
        start_vectors : sequence of (P,) arrays
        near : Refit or None
            Of a neighbouring set, whose sensitivities are used first; None where there is none.
        added : sequence of Effect
            Of these, parameters without a useful derivative are also changed by trial.
        full_refits : int
            Coarse refits that are continued.

        Returns
        -------
        Refit
        """
        weight = max(self.kappa, LEAST_KAPPA)
        starts = {np.clip(v, *composition.bounds).tobytes(): v for v in start_vectors}.values()

        def coarsely(start: np.ndarray) -> Refit:
            settled = start if near is None else settled_start(self.problem, composition, start, near)
            return descend(self.problem, composition, settled, None, COARSE_ITERATIONS, near, True, weight)

        coarse = self.in_parallel(coarsely, list(starts), (composition,))
        leading = sorted(coarse, key=lambda f: f.cost)[:full_refits]
        if any(e.stepwise or e.rugged for e in added):
            leading[0] = refined_by_trial(leading[0], COARSE_ITERATIONS, rough=True)
        fits = self.in_parallel(lambda f: descend(self.problem, composition, f.vector, iterations=NEAR_ITERATIONS,
                                                  rough=True, sample_weight=weight), leading, (composition,))
        return min(fits, key=lambda f: f.cost)

    def cost_at(self, composition: Composition, vector: np.ndarray, basis: np.ndarray | None = None) -> float:
        """Squared error at a vector; with a basis of sensitivities, less what a first-order step along these removes.

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
        """A refitted set, with its evidence computed.

        Parameters
        ----------
        fit : Refit

        Returns
        -------
        EvaluatedSet
        """
        found = EvaluatedSet(self.data, fit)
        if np.isfinite(fit.cost):
            self.score(found)
        return found

    def has_lower_cost(self, members: Members, cost: float) -> bool:
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
        return members not in self.visited or cost < self.visited[members].fit.cost

    def add(self, w: EvaluatedSet) -> None:
        """Keep a set if its cost is lower than before; if a refit reduced members to zero, visit the set without them.

        An earlier refit of that smaller set may have ended in another minimum.

        Parameters
        ----------
        w : EvaluatedSet
        """
        if not np.isfinite(w.fit.cost):
            return
        if self.has_lower_cost(w.members, w.fit.cost):
            self.visited[w.members] = w
        present = tuple(e for e, change in zip(w.effects, w.changes, strict=True) if change >= NEGLIGIBLE_CHANGE)
        if len(present) < len(w.effects) and self.has_lower_cost(frozenset(e.name for e in present), w.fit.cost):
            composition = Composition(w.fit.composition.baseline, present)
            self.add(self.evaluated(self.best_refit(composition, [start_vector(composition, w.fit, {})], w.fit)))


def posterior(sets: VisitedSets) -> WeighedSets:
    """Visited sets with their posterior weights among these, averaged over α; largest first.

    Parameters
    ----------
    sets : VisitedSets

    Returns
    -------
    list of (EvaluatedSet, float)
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
