"""Telling: a diagnosis in plain data, from what was decided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.deciding import EXPLAINED, Folds, JudgedEffect, out_of_fold
from lpvid.diagnosis.diagnosis import CannotTell, Cause, Diagnosis, Errors, Estimated, Rejected, Rivals
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.intervals import deviations, of_effect
from lpvid.diagnosis.localise import localise
from lpvid.diagnosis.noise import NoiseLevel
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, covariance, refit
from lpvid.diagnosis.screening import Evidence, placed
from lpvid.diagnosis.selection import ForwardSelection
from lpvid.record import Record


@dataclass(frozen=True, eq=False)
class Decided:
    """What was decided.

    Attributes
    ----------
    verdict, reason : str
    bare, plainly, final : Refit
        The baseline alone, to the whitened error and to that in the output's unit; what stays in the simulation.
    before : Folds
        Out-of-fold errors of the baseline, each by the fit to it.
    judged, named, contested, dropped : sequence of Judged
        All that were judged; those named; those that have rivals; those objected to.
    phi : (share, standard error) or None
        Of the excess error that is explained.
    predictable : float
        Share of the squared error left that still follows the inputs.
    """

    verdict: str
    reason: str
    bare: Refit
    plainly: Refit
    final: Refit
    before: Folds
    judged: Sequence[JudgedEffect]
    named: Sequence[JudgedEffect]
    contested: Sequence[JudgedEffect]
    dropped: Sequence[JudgedEffect]
    phi: tuple[float, float] | None
    predictable: float


@dataclass(frozen=True, eq=False)
class Telling:
    """What a diagnosis is told from.

    Attributes
    ----------
    baseline : Baseline
    search : Search
    level : NoiseLevel
    unusable : tuple of CannotTell
        Candidates that these data cannot be asked for.
    screened : tuple of Evidence
        Of all others, before any was added.
    held_out : sequence of Record
    decided : Decided
    """

    baseline: Baseline
    search: ForwardSelection
    level: NoiseLevel
    unusable: tuple[CannotTell, ...]
    screened: tuple[Evidence, ...]
    held_out: Sequence[Record]
    decided: Decided

    @property
    def problem(self) -> DiagnosisProblem:
        """Data, blocks, and the filter that whitens what the set leaves."""
        return self.search.problem

    def diagnosis(self) -> Diagnosis:
        """All of it."""
        from lpvid.diagnosis.extended import ExtendedModel

        d, problem = self.decided, self.problem
        spoken = d.verdict != "unexplained"
        after = d.before if d.final is d.plainly else out_of_fold(problem, d.final)
        model = ExtendedModel.of(d.final, covariance(d.final.problem, d.final), self.baseline)
        errors = problem.errors(d.plainly.composition, d.plainly.vector)
        sure = deviations(self.search) if spoken and d.named else np.empty(0)
        where = f"{len(self.held_out)} further record(s)" if self.held_out else \
            "alternating blocks, each judged by the fit to the others, in which it weighs a hundredth"
        standing = {j.effect.name for j in (*d.named, *d.contested)}
        latest = {j.effect.name: j for j in reversed(d.dropped) if j.effect.name not in standing}
        rejected = [Rejected(j.effect.name, "; ".join(j.objections)) for j in reversed(latest.values())]
        if not spoken:
            why = "what is left still follows the inputs" if d.phi is None or d.phi[0] >= EXPLAINED else \
                f"explains {d.phi[0]:.0%} of the excess error only"
            rejected += [Rejected(j.effect.name, f"resembles it, but {why}") for j in (*d.named, *d.contested)]
        return Diagnosis(
            d.verdict, d.reason, {**self.baseline.with_vector(d.plainly.vector).describe()},
            self._errors(d.plainly, d.before), self._errors(d.final, after),
            None if self.level.variance is None else float(np.sqrt(self.level.variance)),
            self._noise(d.predictable), localise(problem, errors),
            tuple(self._cause(j, sure) for j in d.named) if spoken else (),
            tuple(self._rivals(j) for j in d.contested) if spoken else (),
            (*self.unusable, *self._invisible({j.effect.name for j in d.judged})), tuple(rejected), d.phi, where, model,
            self.baseline.output_unit, None, self._evidence())

    def _errors(self, fit: Refit, folds: Folds) -> Errors:
        return errors_of(self.problem, self.baseline, fit, folds, self.held_out)

    def _cause(self, j: JudgedEffect, sure: np.ndarray) -> Cause:
        bare, fit, problem = self.decided.bare, self.search.fit, self.problem
        excess = max(bare.cost - fit.cost, 1e-300)
        if len(self.decided.judged) == 1:
            alone = (bare.cost - fit.cost) / excess
        else:
            composition = Composition(self.baseline, (j.effect,))
            alone = (bare.cost - refit(problem, composition, placed(composition, bare, {j.effect.name: j.values})).cost
                     ) / excess
        parameters = estimates(j.effect, j.values, of_effect(self.search, sure, j.effect))
        return Cause(j.effect.name, j.effect.described(j.values), parameters, j.p_value, j.delta_bic, float(alone),
                     float((j.without.cost - fit.cost) / excess), j.held_out_gain, j.blocks_better, j.contribution)

    def _rivals(self, j: JudgedEffect) -> Rivals:
        parameters = {j.effect.name: estimates(j.effect, j.values, None)}
        for a in j.rivals:
            place = a.fit.composition.places[a.fit.composition.effects.index(a.effect)]
            parameters[a.effect.name] = estimates(a.effect, a.fit.vector[place], None)
        experiments = list(dict.fromkeys([j.effect.experiment, *(a.effect.experiment for a in j.rivals)]))
        return Rivals((j.effect.name, *(a.effect.name for a in j.rivals)), float(max(a.similarity for a in j.rivals)),
                      "; or ".join(experiments), parameters)

    def _invisible(self, chosen: set[str]) -> tuple[CannotTell, ...]:
        """Candidates whose smallest detectable strength lies above what is plausible."""
        out = []
        for e in self.screened:
            strength = e.effect.parameters[0]
            largest = max(abs(strength.plausible[0] - strength.neutral), abs(strength.plausible[1] - strength.neutral))
            if e.effect.name in chosen:
                continue
            if e.smallest_detectable is None or e.smallest_detectable > largest:
                why = "these data carry no trace of it at any strength" if e.smallest_detectable is None else \
                    f"only {strength.name} above {e.smallest_detectable:.3g} {strength.unit} would show".rstrip()
                out.append(CannotTell(e.effect.name, why, e.smallest_detectable, strength.unit, e.effect.experiment))
        return tuple(out)

    def _noise(self, predictable: float) -> Mapping[str, Any]:
        w = self.problem.whitening
        return {"name": "coloured-noise" if w.is_coloured else "white-noise", "order": w.order, "level": w.level,
                "coefficients": w.coefficients.tolist(), "from_repeats": self.level.description,
                "predictable_share": predictable}

    def _evidence(self) -> dict[str, dict[str, Any]]:
        return {e.effect.name: {"likelihood_ratio": e.likelihood_ratio, "p_value": e.p_value,
                                "smallest_detectable": e.smallest_detectable} for e in self.screened}


def errors_of(
    problem: DiagnosisProblem, baseline: Baseline, fit: Refit, folds: Folds, held_out: Sequence[Record]
) -> Errors:
    """Free-run errors of a fit: on training samples, and on further records or, without them, out of fold."""
    plain = problem.stack(problem.errors(fit.composition, fit.vector), whiten=False)
    inside = [s.output[n >= 0] for s, n in zip(problem.signals, problem.blocks.number, strict=True)]
    about = (float(np.sum((y - y.mean()) ** 2)) for y in inside if y.size)  # each record about its own mean
    power = max(sum(about), 1e-300)
    if not held_out:
        squares = float(folds.plain @ folds.plain)
        return Errors(float(plain @ plain) / power, squares / power, float(np.sqrt(squares / problem.n_samples)))
    error, total, count = 0.0, 0.0, 0
    for record in held_out:
        s = baseline.signals(record)
        e = (s.output - fit.composition.predict(s, fit.vector))[baseline.start:]
        y = s.output[baseline.start:]
        error, total, count = error + float(e @ e), total + float(np.sum((y - y.mean()) ** 2)), count + y.size
    return Errors(float(plain @ plain) / power, error / max(total, 1e-300), float(np.sqrt(error / max(count, 1))))


def estimates(effect: Effect, values: np.ndarray, deviation: np.ndarray | None) -> tuple[Estimated, ...]:
    found = []
    for k, p in enumerate(effect.parameters):
        std = None if deviation is None or not np.isfinite(deviation[k]) else float(deviation[k])
        found.append(Estimated(p.name, float(values[k]), std, p.unit, p.choice(float(values[k]))))
    return tuple(found)
