"""Laplace: the evidence of a set of causes by Laplace's method around its refit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.baselines.spectra import noisier
from lpvid.diagnosis.evidence import priors
from lpvid.diagnosis.evidence.discrepancy import Discrepancy, MarginalLikelihood, marginal
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit
from lpvid.effects.effect import Effect
from lpvid.rounding import EXPLODED, HALF_DIGITS, STEP, TINY
from lpvid.validation.trust import QUANTILE

NEGLIGIBLE_CHANGE = STEP
"""change of the output, as a share of its rms, below which a member counts as absent: its derivatives, by differences
of such steps, do not resolve it, and the set is a smaller one"""


@dataclass(frozen=True, eq=False)
class EvidenceData:
    """Data of which the evidence of all sets is computed.

    Attributes
    ----------
    problem : DiagnosisProblem
    discrepancy : Discrepancy
    grid_points : mapping of str to (points, k) array
        At which each effect is screened.
    candidates : tuple of Effect
    """

    problem: DiagnosisProblem
    discrepancy: Discrepancy
    grid_points: dict[str, np.ndarray]
    candidates: tuple[Effect, ...] = ()


@dataclass(frozen=True, eq=False)
class EvaluatedSet:
    """A refitted set of causes and its evidence.

    Attributes
    ----------
    data : EvidenceData
    fit : Refit
    """

    data: EvidenceData
    fit: Refit

    @property
    def members(self) -> frozenset[str]:
        """Names of its effects."""
        return self.fit.composition.members

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Its effects."""
        return self.fit.composition.effects

    @cached_property
    def components(self) -> tuple[str, ...]:
        """Per effect the component of which it is a form at its fitted parameters."""
        places = self.fit.composition.places
        return tuple(component_of(e, self.fit.vector[p], self.data.problem.signals, self.data.candidates)
                     for e, p in zip(self.effects, places, strict=True))

    @cached_property
    def carried_noise(self) -> np.ndarray:
        """(N,) change of the output by as much noise of the motion sensors again, at the fitted parameters."""
        composition, vector, rng = self.fit.composition, self.fit.vector, np.random.default_rng(0)
        changes = [composition.predict(noisier(s, rng), vector) - composition.predict(s, vector)
                   for s in self.data.problem.signals]
        return self.data.problem.stack(changes)

    @cached_property
    def mean_square(self) -> float:
        """Of the error as it is in time, in the output's unit squared."""
        return float(np.mean(self.data.problem.unweighed(self.fit.errors) ** 2))

    @cached_property
    def projected_error(self) -> np.ndarray:
        """(K,) error projected on the discrepancy's columns."""
        return self.data.discrepancy.columns.T @ self.fit.errors

    @cached_property
    def projected_jacobian(self) -> np.ndarray:
        """(K, P) sensitivities projected on them."""
        return self.data.discrepancy.columns.T @ self.fit.jacobian

    @cached_property
    def curvature(self) -> np.ndarray:
        """(P, P) J'J."""
        return self.fit.jacobian.T @ self.fit.jacobian

    @cached_property
    def changes(self) -> tuple[float, ...]:
        """Per effect its change of the output at the fitted parameters, the others in place, as a share of its rms."""
        output_rms = self.data.discrepancy.output_rms
        return tuple(output_change(self.data.problem, self.fit, e) / output_rms for e in self.effects)

    @cached_property
    def at_bounds(self) -> dict[str, str]:
        """Effects whose strength is at its bound, within the resolution of the clock, and the bound.

        Such an effect fits another cause's error: the optimum lies beyond what is possible (a displacement recorded a
        tenth of a second late). A share, which has no unit, may be at its bound.
        """
        found = {}
        low, high = self.fit.composition.bounds
        scales = self.fit.composition.scales
        for e, place in zip(self.effects, self.fit.composition.places, strict=True):
            clock = QUANTILE * e.clock_errors(self.fit.vector[place], self.data.problem.signals)
            for k, p in enumerate(e.parameters[: e.strengths]):
                v, j = float(self.fit.vector[place][k]), place.start + k
                slack = float(clock[k]) + HALF_DIGITS * scales[j]
                for end in (low[j], high[j]):
                    if p.unit and end != p.neutral and abs(v - end) <= slack:
                        found[e.name] = f"{p.name} {end:g} {p.unit}".rstrip()
        return found

    def marginal(self, kappa: float) -> MarginalLikelihood:
        """Marginal likelihood at the most probable noise and discrepancy.

        Parameters
        ----------
        kappa : float
            κ, share of independent samples.

        Returns
        -------
        MarginalLikelihood
        """
        return marginal(self.fit.cost, self.projected_error, self.data.discrepancy, self.data.problem.n_samples, kappa)

    def evidence(self, kappa: float) -> float:
        """ln p(y | set) + ln p(set), up to what all sets share.

        ln p(y|θ̂) + ln p(θ̂) + d/2 ln 2π − ½ ln(|H|/|H_b|) over the d strengths. H is that of strengths and baseline,
        κ/σ² J'(I − Φ diag(w) Φ')J + prior precision (Tierney, Kadane 1986), w the `woodbury_weights`; H_b is that of
        the baseline alone: its parameters are in every set, at their most probable values. Shapes are at these too;
        each that the data determine (`determined_count`) costs one, the gain of a log-likelihood that a free parameter
        is expected to have (Akaike 1974). A parameter to which the output does not
        respond costs nothing. A set with a strength at its bound has no evidence.

        Parameters
        ----------
        kappa : float
            κ, share of independent samples.

        Returns
        -------
        float
            In nats; minus infinity also where a member changes less than `NEGLIGIBLE_CHANGE` of the output, and where
            the sensitivities explode.
        """
        return -np.inf if self.at_bounds else self.evidence_ignoring_bounds(kappa)

    def evidence_ignoring_bounds(self, kappa: float) -> float:
        """The same, also where a strength is at its bound.

        Parameters
        ----------
        kappa : float
            κ.

        Returns
        -------
        float
        """
        return self.fit.cached(("evidence", kappa), lambda: self._laplace(kappa))

    def _laplace(self, kappa: float) -> float:
        if min(self.changes, default=1.0) < NEGLIGIBLE_CHANGE:
            return -np.inf
        m = self.marginal(kappa)
        prior, deviation, precision, integrated = self._prior
        jacobian = self.projected_jacobian
        hessian = (self.curvature - jacobian.T @ (m.woodbury_weights[:, None] * jacobian)) * (kappa / m.noise)
        curvature, shapes = np.diag(hessian).clip(0), ~integrated
        prior += priors.deviation_penalty(deviation, precision, curvature) - \
            priors.determined_count(curvature[shapes], precision[shapes])
        hessian = hessian + np.diag(precision)
        effective = np.diag(hessian) > TINY  # a parameter of 1e200 without effect is in every set alike
        law, integrated = effective & (np.arange(precision.size) < self.fit.composition.own), effective & integrated
        gaussian = 0.5 * np.log(2 * np.pi) * (integrated.sum() - law.sum())
        log_volume = gaussian - 0.5 * (_log_determinant(hessian, integrated) - _log_determinant(hessian, law))
        evidence = m.likelihood + prior + log_volume + sum(map(priors.inclusion_prior, self.effects))
        return evidence if np.isfinite(evidence) else -np.inf  # sensitivities explode: the determinant is lost

    @cached_property
    def _prior(self) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Log-density, deviation of shapes from their prior, precision, and which parameters are integrated out."""
        composition, vector = self.fit.composition, self.fit.vector
        total, precision = 0.0, np.zeros(vector.size)
        deviation, integrated = np.zeros(vector.size), np.full(vector.size, True)
        precision[: composition.own] = (1 / priors.SHAPE_FACTOR / composition.scales[: composition.own]) ** 2
        output_norm = self.data.discrepancy.output_rms * np.sqrt(self.data.problem.n_samples)
        for effect, place, change in zip(self.effects, composition.places, self.changes, strict=True):
            points = self.data.grid_points[effect.name]
            for k, (p, j) in enumerate(zip(effect.parameters, range(place.start, place.stop), strict=True)):
                if k >= effect.strengths:
                    deviation[j], curvature = priors.shape_prior(p, float(vector[j]), np.unique(points[:, k]).tolist())
                    value, integrated[j] = 0.0, False
                else:
                    distance = float(vector[j]) - p.neutral
                    value, curvature = priors.strength_prior(
                        *self._strength_change(j, distance, change, output_norm, effect.strengths == 1))
                total, precision[j] = total + value, curvature
        return total, deviation, precision, integrated

    def _strength_change(self, j: int, distance: float, change: float, output_norm: float, alone: bool
                         ) -> tuple[float, float]:
        """Change of the output by one strength, and its slope, as shares of the output's rms."""
        slope = float(np.linalg.norm(self.data.problem.unweighed(self.fit.jacobian[:, j]))) / output_norm
        if not alone:
            return abs(distance) * slope, slope
        return change, change / abs(distance) if distance else slope


Members = frozenset[str]
"""names of the effects in a set"""
WeighedSets = Sequence[tuple[EvaluatedSet, float]]
"""visited sets and their weights, the most probable first"""


def _log_determinant(matrix: np.ndarray, chosen: np.ndarray) -> float:
    """ln of the determinant of the chosen rows and columns, scaled for accuracy."""
    part = matrix[np.ix_(chosen, chosen)]
    scale = 1 / np.sqrt(np.maximum(np.diag(part), TINY))
    return float(np.linalg.slogdet(part * np.outer(scale, scale))[1] - 2 * np.log(scale).sum())


def component_of(effect: Effect, values: np.ndarray, signals: Sequence[Signals], candidates: Sequence[Effect]) -> str:
    """Name of the candidate of which an effect is a form at given parameters.

    Friction that breaks away, friction behind a spring and |v|^n sgn v of a small n are dry friction; air in the oil is
    a spring or play. The weights of sets that differ in the form alone are added.

    Parameters
    ----------
    effect : Effect
    values : (k,) array
        Its parameters.
    signals : sequence of Signals
        The data.
    candidates : sequence of Effect

    Returns
    -------
    str
    """
    known = {c.name for c in candidates}
    simpler = [n for n in (*effect.comes_to(values, signals), effect.form_of) if n in known]
    return simpler[0] if simpler else effect.component


def output_change(problem: DiagnosisProblem, fit: Refit, effect: Effect) -> float:
    """Root mean square of the change of the output by an effect of a fit, the others in place.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
    effect : Effect
        One of the fit's.

    Returns
    -------
    float
        In the output's unit.
    """
    place = fit.composition.places[fit.composition.effects.index(effect)]
    vector = fit.vector.copy()
    vector[place] = effect.neutral
    with np.errstate(all="ignore"):
        removed = problem.stack(problem.errors(fit.composition, vector))
    errors = problem.stack(problem.errors(fit.composition, fit.vector))
    return float(np.sqrt(np.mean(np.minimum((removed - errors) ** 2, EXPLODED))))
