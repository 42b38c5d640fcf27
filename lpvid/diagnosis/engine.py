"""Engine: from records, a baseline and a catalogue of effects to a diagnosis; it knows no damper."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lpvid._threads import in_parallel, single_thread
from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.deciding import (
    Folds,
    Judged,
    explained_share,
    judge,
    out_of_fold,
    shadowed,
    with_small_print,
    with_takeovers,
)
from lpvid.diagnosis.diagnosis import CannotTell, Cause, Diagnosis, Errors, Estimated, Rejected, Rivals
from lpvid.diagnosis.effect import Effect, by_name
from lpvid.diagnosis.intervals import deviations, of_effect
from lpvid.diagnosis.localise import localise
from lpvid.diagnosis.nameless import BEYOND, Nameless
from lpvid.diagnosis.noise import NoiseLevel, Whitening, noise_level
from lpvid.diagnosis.problem import Problem
from lpvid.diagnosis.refitting import Refit, covariance, refit
from lpvid.diagnosis.remainder import predictable_share
from lpvid.diagnosis.rivals import alternatives
from lpvid.diagnosis.screening import Evidence
from lpvid.diagnosis.selection import BIC_GAIN, Search
from lpvid.diagnosis.signals import in_turn
from lpvid.diagnosis.verdicts import Findings, told
from lpvid.errors import InputError
from lpvid.record import Record

MOST_REGROWN = 2
"""times that the set may grow anew after one of it has gone"""
MOST_TURNS = 5
"""times that one of the set may give way to another"""
PREDICTABLE = 0.02
"""share of the remaining error, beyond two standard errors, that a regression must predict to count as structure"""


@dataclass(frozen=True)
class DiagnosisSettings:
    """How to diagnose.

    Attributes
    ----------
    seed : int
        Of the sign patterns.
    fit_baseline : bool
        Whether the baseline is fitted first; False for one whose parameters are given.
    """

    seed: int = 0
    fit_baseline: bool = True


def diagnose(records: Sequence[Record], baseline: Baseline, catalogue: Sequence[Effect],
             held_out: Sequence[Record] = (), settings: DiagnosisSettings | None = None,
             progress: Callable[[str], None] | None = None) -> Diagnosis:
    """Find what a baseline's free run gets wrong, name the cause or say why not, extend the model, measure the gain.

    The steps and gates are those of docs/diagnosis.md: residual of the free run; noise level from repeats; whitening by
    what no candidate can explain; directions of all candidates with the baseline's own sensitivities projected out;
    block max-statistic; joint refits with forward selection, linked pairs, pruning; gates and rivals; share explained.

    Parameters
    ----------
    records : sequence of Record
        Uniform, one rate.
    baseline : Baseline
    catalogue : sequence of Effect
    held_out : sequence of Record, optional
        Further records on which the gain is measured; without them alternating blocks, each judged by the fit to the
        others.
    settings : DiagnosisSettings, optional
    progress : callable, optional
        Told in words what is being done.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        Too little data, missing channels, no candidates.
    """
    begun, settings = time.perf_counter(), settings or DiagnosisSettings()
    say = progress or (lambda text: None)
    if not catalogue:
        raise InputError("a diagnosis needs candidates", got="an empty catalogue")
    by_name(tuple(catalogue))
    with single_thread():
        case = _Case.prepare(records, baseline, tuple(catalogue), settings, say)
        found = case.decide(held_out)
    return replace(found, seconds=time.perf_counter() - begun)


@dataclass(frozen=True, eq=False)
class _Case:
    """Everything known before a decision."""

    records: tuple[Record, ...]
    baseline: Baseline
    first: Refit
    level: NoiseLevel
    usable: tuple[Effect, ...]
    unusable: tuple[CannotTell, ...]
    search: Search
    screened: tuple[Evidence, ...]
    given: np.ndarray
    say: Callable[[str], None]

    @classmethod
    def prepare(cls, records: Sequence[Record], baseline: Baseline, catalogue: tuple[Effect, ...],
                settings: DiagnosisSettings, say: Callable[[str], None]) -> _Case:
        if settings.fit_baseline:
            say(f"fitting {baseline.name}")
            baseline = baseline.fit(records)
        signals = in_turn([baseline.signals(r) for r in records])
        blocks = Blocks.of(signals, baseline.start)
        problem = Problem(signals, blocks, Whitening(np.ones(1), 1.0))
        composition = Composition(baseline)
        given = baseline.vector
        first = refit(problem, composition, given)
        level = noise_level(signals, [c for c in baseline.channels if c != baseline.output], blocks.mask())
        usable, unusable = _usable(catalogue, baseline, signals)
        say(f"screening {len(usable)} candidates")
        search, evidence, found = Search.begin(problem, first, usable, np.random.default_rng(settings.seed), say)
        screened = tuple(evidence)
        whitened_first = search.fit
        search.grow(evidence, found)
        return cls(tuple(records), baseline, whitened_first, level, usable, unusable, search, screened,
                   given, say)

    @property
    def problem(self) -> Problem:
        """Data, blocks, and the filter that whitens what the present set leaves."""
        return self.search.problem

    # -- deciding ----------------------------------------------------------------------------------------------------
    def decide(self, held_out: Sequence[Record]) -> Diagnosis:
        bare = refit(self.problem, Composition(self.baseline), self.first.vector)
        before = out_of_fold(self.problem, bare)
        judged, dropped, after = self._judged(before)
        problem, fit = self.problem, self.search.fit
        bare = refit(problem, Composition(self.baseline), self.first.vector)
        judged = sorted(judged, key=lambda j: -j.contribution)
        beyond, judged, resembling = self._with_a_name(bare, judged)
        named = [j for j in judged if not j.objections and not j.rivals]
        contested = [j for j in judged if not j.objections and j.rivals]
        predictable = self._predictable(fit)
        phi = explained_share(problem, before, after, self.level.variance, predictable) if named or contested else None
        verdict, reason = told(Findings(
            named=[j.effect for j in named],
            contested=[(j.effect, tuple(a.effect for a in j.rivals)) for j in contested], dropped=dropped,
            resembling=[j.effect for j in resembling], beyond=beyond, phi=phi,
            predictable=predictable, before=float(np.mean(before.plain**2)), after=float(np.mean(after.plain**2)),
            spread=problem.spread,
            unshared=self._unshared(bare) if phi is None else None,
            least=min((e.p_value for e in self.screened), default=1.0), coloured=problem.whitening.is_coloured,
            unit=self.baseline.output_unit))
        kept = [j for j in judged if j in named or j in contested or j in resembling]
        final = self._final(fit, kept)
        return self._result(verdict, reason, bare, final, before, judged, named, contested,
                            [*dropped, *resembling], phi, predictable, held_out)

    def _with_a_name(self, bare: Refit, judged: list[Judged]) -> tuple[float, list[Judged], list[Judged]]:
        """What nameless functions explain beyond the set; the judged, objecting to those that they replace; these."""
        fit = self.search.fit
        nameless = Nameless(self.problem, [c for c in self.baseline.channels if c != self.baseline.output])
        beyond = nameless.share(bare, fit)
        if beyond < BEYOND:
            return 0.0, judged, []
        said = (f"functions of the inputs without a name do its work, and explain {beyond:.0%} more",)
        out = [replace(j, objections=said) if not j.objections and nameless.replaces(fit, j.without) else j
               for j in judged]
        return beyond, out, [new for new, old in zip(out, judged, strict=True) if new is not old]

    def _judged(self, before: Folds) -> tuple[list[Judged], list[Judged], Folds]:
        """The chosen set judged; those objected to; the errors of the set out of fold.

        An effect gives way to a special case of it that does as well, and to another that does clearly better; one that
        is objected to gives way to the best plausible one in its place, and goes where there is none. What the others
        explain is then told once more: it must not lend them its share.
        """
        gone: list[Judged] = []
        turn = regrown = 0
        while True:
            turn += 1
            fit = self.search.fit
            after = out_of_fold(self.problem, fit) if fit.composition.effects else before
            self.say("weighing rivals")
            effects = fit.composition.effects
            judged = in_parallel(lambda e, a=after: judge(self.search, e, a, self._inputs), effects)
            if len(judged) > 1:
                judged = with_small_print(self.search, judged)
                structure = float(np.sqrt(self._predictable(fit) * np.mean(after.plain**2)))
                judged = with_takeovers(self.search, shadowed(self.search, judged, structure))
            if turn < MOST_TURNS and self._give_way(judged, gone):
                continue
            bad = [j for j in judged if j.objections]
            small = [j for j in judged if j.minor]
            if len(small) > 1:
                least = min(small, key=lambda j: j.contribution)  # each may be covered by the others
                gone.append(least)
                self.search.fit = self._final(fit, [j for j in judged if j is not least])
                continue
            if len(bad) == len(judged) or all(j.minor for j in bad):
                return [*judged, *gone], [*bad, *gone], after
            worst = min((j for j in bad if not j.minor), key=lambda j: j.contribution)
            gone.append(worst)
            self.search.fit = self._final(fit, [j for j in judged if j is not worst])
            if regrown < MOST_REGROWN:  # in its absence another may come forward
                regrown += 1
                self.search.grow(*self.search.rewhiten(), avoid=worst.effect.name)

    def _give_way(self, judged: list[Judged], gone: list[Judged]) -> bool:
        """Put a better name in the place of one of the set; whether there was one."""
        was = {j.effect.name for j in (*judged, *gone)}
        for j in judged:
            special = next((a for a in j.rivals if a.effect.name in j.effect.contains), None)
            instead = special or j.better
            if instead is None and j.objections and not j.minor:
                others = alternatives(self.search, j.effect, j.without)
                instead = next((a for a in others if a.effect.name not in was
                                and a.fit.bic() < j.without.bic() - BIC_GAIN), None)
                if instead is not None:
                    gone.append(j)
            if instead is not None:
                self.say(f"{instead.effect.name} in the place of {j.effect.name}")
                self.search.p_values[instead.effect.name] = j.p_value
                self.search.fit = instead.fit
                return True
        return False

    @property
    def _inputs(self) -> list[str]:
        """Every channel that all records have, read by the baseline or not, but the output."""
        signals = self.problem.signals
        return [c for c in signals[0].channels if c != self.baseline.output and all(s.has(c) for s in signals)]

    def _predictable(self, fit: Refit) -> float:
        """Share of the squared error of a fit that still follows the inputs; 0 where that is not sure."""
        errors = self.problem.errors(fit.composition, fit.vector)
        share, spread = predictable_share(self.problem, errors, self._inputs)
        return share if share - 2 * spread > PREDICTABLE else 0.0

    def _unshared(self, bare: Refit) -> float | None:
        """Variance of that part of the baseline's error which repeats of the same input do not share."""
        signals, inputs = self.problem.signals, [c for c in self.baseline.channels if c != self.baseline.output]
        errors = self.problem.errors(bare.composition, bare.vector)
        left = [replace(s, output=e) for s, e in zip(signals, errors, strict=True)]
        return noise_level(left, inputs, self.problem.blocks.mask()).variance

    def _final(self, fit: Refit, kept: Sequence[Judged]) -> Refit:
        """The fit with the kept effects only."""
        if len(kept) == len(fit.composition.effects):
            return fit
        return self.search.refitted(Composition(self.baseline, tuple(j.effect for j in kept)))

    # -- telling -----------------------------------------------------------------------------------------------------
    def _result(self, verdict: str, reason: str, bare: Refit, final: Refit, before: Folds, judged: list[Judged],
                named: list[Judged], contested: list[Judged], dropped: list[Judged],
                phi: tuple[float, float] | None, predictable: float, held_out: Sequence[Record]) -> Diagnosis:
        from lpvid.diagnosis.extended import ExtendedModel

        problem = self.problem
        spoken = verdict != "unexplained"
        after = out_of_fold(problem, final)
        model = ExtendedModel.of(final, covariance(problem, final), self.baseline)
        errors = problem.errors(bare.composition, bare.vector)
        sure = deviations(self.search) if spoken and named else np.empty(0)
        where = "alternating blocks, each judged by the fit to the others" if not held_out else \
            f"{len(held_out)} further record(s)"
        rejected = [Rejected(j.effect.name, "; ".join(j.objections)) for j in dropped]
        if not spoken:
            rejected += [Rejected(j.effect.name, f"resembles it, but explains {phi[0]:.0%} of the excess error only"
                                  if phi else "explains too little") for j in (*named, *contested)]
        return Diagnosis(
            verdict, reason, {**self.baseline.with_vector(bare.vector).describe()},
            self._errors(bare, before, held_out), self._errors(final, after, held_out),
            None if self.level.variance is None else float(np.sqrt(self.level.variance)),
            self._noise(predictable), localise(problem, errors),
            tuple(self._cause(j, bare, judged, sure) for j in named) if spoken else (),
            tuple(self._rivals(j) for j in contested) if spoken else (),
            (*self.unusable, *self._invisible({j.effect.name for j in judged})), tuple(rejected), phi, where, model,
            self.baseline.output_unit, None, self._evidence())

    def _errors(self, fit: Refit, folds: Folds, held_out: Sequence[Record]) -> Errors:
        problem = self.problem
        plain = problem.stack(problem.errors(fit.composition, fit.vector), whiten=False)
        power = problem.n_samples * problem.spread**2
        if not held_out:
            squares = float(folds.plain @ folds.plain)
            return Errors(float(plain @ plain) / power, squares / power, float(np.sqrt(squares / problem.n_samples)))
        error, total, count = 0.0, 0.0, 0
        for record in held_out:
            s = self.baseline.signals(record)
            e = (s.output - fit.composition.predict(s, fit.vector))[self.baseline.start:]
            y = s.output[self.baseline.start:]
            error, total, count = error + float(e @ e), total + float(np.sum((y - y.mean()) ** 2)), count + y.size
        return Errors(float(plain @ plain) / power, error / max(total, 1e-300), float(np.sqrt(error / max(count, 1))))

    def _cause(self, j: Judged, bare: Refit, judged: list[Judged], sure: np.ndarray) -> Cause:
        fit, problem = self.search.fit, self.problem
        excess = max(bare.cost - fit.cost, 1e-300)
        if len(judged) == 1:
            alone = (bare.cost - fit.cost) / excess
        else:
            from lpvid.diagnosis.screening import placed

            composition = Composition(self.baseline, (j.effect,))
            alone = (bare.cost - refit(problem, composition, placed(composition, bare, {j.effect.name: j.values})).cost
                     ) / excess
        parameters = _estimates(j.effect, j.values, of_effect(self.search, sure, j.effect))
        return Cause(j.effect.name, j.effect.told(j.values), parameters, j.p_value, j.delta_bic, float(alone),
                     float((j.without.cost - fit.cost) / excess), j.held_out_gain, j.blocks_better, j.contribution)

    def _rivals(self, j: Judged) -> Rivals:
        parameters = {j.effect.name: _estimates(j.effect, j.values, None)}
        for a in j.rivals:
            place = a.fit.composition.places[a.fit.composition.effects.index(a.effect)]
            parameters[a.effect.name] = _estimates(a.effect, a.fit.vector[place], None)
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
                "coefficients": w.coefficients.tolist(), "from_repeats": self.level.says,
                "predictable_share": predictable}

    def _evidence(self) -> dict[str, dict[str, Any]]:
        return {e.effect.name: {"likelihood_ratio": e.likelihood_ratio, "p_value": e.p_value,
                                "smallest_detectable": e.smallest_detectable} for e in self.screened}


def _usable(catalogue: tuple[Effect, ...], baseline: Baseline, signals: tuple) -> tuple[
        tuple[Effect, ...], tuple[CannotTell, ...]]:
    usable, unusable = [], []
    for effect in catalogue:
        if effect.family == "noise":
            continue
        missing = effect.missing(signals)
        why = f"no {', '.join(missing)} was measured" if missing else effect.applies(baseline, signals)
        if why is None:
            usable.append(effect)
        else:
            unusable.append(CannotTell(effect.name, why, None, effect.parameters[0].unit, effect.experiment))
    return tuple(usable), tuple(unusable)


def _estimates(effect: Effect, values: np.ndarray, deviation: np.ndarray | None) -> tuple[Estimated, ...]:
    found = []
    for k, p in enumerate(effect.parameters):
        std = None if deviation is None or not np.isfinite(deviation[k]) else float(deviation[k])
        found.append(Estimated(p.name, float(values[k]), std, p.unit, p.choice(float(values[k]))))
    return tuple(found)
