"""Engine: from records, a baseline and a catalogue of effects to a diagnosis; it knows no damper."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid._memory import give_back
from lpvid._threads import in_parallel, single_thread
from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.deciding import (
    Folds,
    JudgedEffect,
    judge,
    out_of_fold,
    shadowed,
    surer_share,
    weighty,
    with_small_print,
    with_takeovers,
)
from lpvid.diagnosis.diagnosis import CannotTell, Diagnosis
from lpvid.diagnosis.effect import Effect, by_name
from lpvid.diagnosis.nameless import BEYOND, Nameless
from lpvid.diagnosis.noise import WHITE, NoiseLevel, noise_level
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.remainder import predictable_share
from lpvid.diagnosis.rivals import alternatives
from lpvid.diagnosis.screening import Evidence
from lpvid.diagnosis.selection import BIC_GAIN, ForwardSelection
from lpvid.diagnosis.signals import in_turn
from lpvid.diagnosis.telling import Decided, Telling
from lpvid.diagnosis.verdicts import Findings, described
from lpvid.errors import InputError
from lpvid.record import Record

MOST_REGROWN = 2
"""times that the set may grow anew after one of it has gone"""
AS_WELL = BIC_GAIN / 2
"""log-likelihood up to which a special case does as well; one that trails by more is a rival"""
MOST_TURNS = 5
"""times that one of the set may give way to another"""
DONE_AS_WELL = "functions of the inputs without a name do its work as well, and explain {:.0%} more"
"""what is said of a cause whose name says too much"""
WAS_LOGGED = "functions of the inputs do its work as well, so that it need not be anything that was not logged"
"""what is said of something unlogged that may as well be something that was"""
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
        others, in which it weighs a hundredth (`refitting.LENT`).
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

    def report_progress(text: str) -> None:
        give_back()
        if progress is not None:
            progress(text)

    if not catalogue:
        raise InputError("a diagnosis needs candidates", got="an empty catalogue")
    by_name(tuple(catalogue))
    with single_thread():
        case = _Case.prepare(records, baseline, tuple(catalogue), settings, report_progress)
        found = case.decide(held_out)
    return replace(found, seconds=time.perf_counter() - begun)


@dataclass(frozen=True, eq=False)
class _Case:
    """Everything known before a decision."""

    baseline: Baseline
    plainly: Refit
    first: Refit
    level: NoiseLevel
    unusable: tuple[CannotTell, ...]
    search: ForwardSelection
    screened: tuple[Evidence, ...]
    report_progress: Callable[[str], None]

    @classmethod
    def prepare(cls, records: Sequence[Record], baseline: Baseline, catalogue: tuple[Effect, ...],
                settings: DiagnosisSettings, report_progress: Callable[[str], None]) -> _Case:
        if settings.fit_baseline:
            report_progress(f"fitting {baseline.name}")
            baseline = baseline.fit(records)
        signals = in_turn([baseline.signals(r) for r in records])
        blocks = Blocks.of(signals, baseline.start)
        problem = DiagnosisProblem(signals, blocks, WHITE)
        composition = Composition(baseline)
        first = refit(problem, composition, baseline.vector)
        level = noise_level(signals, _driving(baseline), blocks.mask())
        usable, unusable = _usable(catalogue, baseline, signals)
        report_progress(f"screening {len(usable)} candidates")
        search, evidence, found = ForwardSelection.begin(
            problem, first, usable, np.random.default_rng(settings.seed), report_progress
        )
        screened = tuple(evidence)
        whitened_first = search.fit
        search.grow(evidence, found)
        return cls(baseline, first, whitened_first, level, unusable, search, screened, report_progress)

    @property
    def problem(self) -> DiagnosisProblem:
        """Data, blocks, and the filter that whitens what the present set leaves."""
        return self.search.problem

    # -- deciding ----------------------------------------------------------------------------------------------------
    def decide(self, held_out: Sequence[Record]) -> Diagnosis:
        judged, dropped, after = self._judged(self._alone()[1])
        problem, fit = self.problem, self.search.fit
        bare, before = self._alone()  # by the colour that was found meanwhile
        judged = sorted(judged, key=lambda j: -j.contribution)
        beyond, resembling = self._without_a_name(bare, judged)
        judged = [next((r for r in resembling if r.without is j.without), j) for j in judged]
        named = [j for j in judged if not j.objections and not j.rivals]
        contested = [j for j in judged if not j.objections and j.rivals]
        if resembling:  # they must not lend the others their share
            fit = self._final(fit, [*named, *contested])
            after = out_of_fold(problem, fit)
        predictable = self._predictable(fit)
        phi = surer_share(problem, before, after, self.level, self._unshared(fit, whiten=True),
                          predictable) if named or contested else None
        verdict, reason = described(Findings(
            named=[j.effect for j in named],
            contested=[(j.effect, tuple(a.effect for a in j.rivals)) for j in contested], dropped=dropped,
            resembling=[j.effect for j in resembling], beyond=beyond, phi=phi,
            predictable=predictable, before=float(np.mean(before.plain**2)), after=float(np.mean(after.plain**2)),
            spread=problem.spread, unshared=self._unshared(bare).variance if phi is None else None,
            least=min((e.p_value for e in self.screened), default=1.0), coloured=problem.whitening.is_coloured,
            unit=self.baseline.output_unit))
        kept = [*named, *contested, *resembling]
        final = self._final(self.search.fit, kept) if kept else self.plainly
        decided = Decided(verdict, reason, bare, self.plainly, final, before, judged, named, contested,
                          [*dropped, *resembling], phi, predictable)
        return Telling(self.baseline, self.search, self.level, self.unusable, self.screened, held_out,
                       decided).diagnosis()

    def _alone(self) -> tuple[Refit, Folds]:
        """The baseline alone, and its out-of-fold errors: whitened and in the output's unit, each by the fit to it.

        What no candidate explains is whitened as noise is: of a slow error a fit to the whitened one leaves more, up to
        all of it, than the baseline has when it is fitted as anyone would.
        """
        bare = refit(self.problem, Composition(self.baseline), self.first.vector)
        plain = self.plainly.cached("out of fold", lambda: out_of_fold(self.plainly.problem, self.plainly))
        return bare, Folds(out_of_fold(self.problem, bare).errors, plain.plain)

    def _without_a_name(self, bare: Refit, judged: list[JudgedEffect]) -> tuple[float, list[JudgedEffect]]:
        """Those whose work functions without a name do, with that objection, and what these explain beyond the set."""
        standing = [j for j in judged if not j.objections]
        if not standing:
            return 0.0, []
        functions = Nameless(self.problem, _driving(self.baseline))
        out, shares = [], [0.0]
        for j in standing:
            share = functions.beyond(bare, self.search.fit, j.without)
            if share > BEYOND:
                out.append(replace(j, objections=(DONE_AS_WELL.format(share),)))
                shares.append(share)
            elif j.effect.unlogged and functions.do_the_work(self.search.fit, j.without):
                out.append(replace(j, objections=(WAS_LOGGED,)))
        return max(shares), out

    def _judged(self, before: Folds) -> tuple[list[JudgedEffect], list[JudgedEffect], Folds]:
        """The chosen set judged; those objected to; the errors of the set out of fold.

        An effect gives way to a special case of it that does as well, and to another that does clearly better; one that
        is objected to gives way to the best plausible one in its place, and goes where there is none. What the others
        explain is then told once more: it must not lend them its share.
        """
        gone: list[JudgedEffect] = []
        been: set[frozenset[str]] = set()
        turn = regrown = 0
        while True:
            turn += 1
            fit = self.search.fit
            been.add(fit.composition.members)
            self.search.rests[fit.composition.members] = fit
            after = out_of_fold(self.problem, fit) if fit.composition.effects else before
            self.report_progress("weighing rivals")
            effects = fit.composition.effects
            judged = in_parallel(lambda e, a=after: judge(self.search, e, a, self._inputs), effects)
            if len(judged) > 1:
                judged = with_small_print(self.search, judged)
                structure = float(np.sqrt(max(self._predictable(fit) * np.mean(after.plain**2), self._repeated(fit))))
                judged = weighty(with_takeovers(self.search, shadowed(self.search, judged, structure)))
            if turn < MOST_TURNS and self._give_way(judged, gone, been):
                continue
            bad = [j for j in judged if j.objections]
            small = [j for j in judged if j.minor]
            if len(small) > 1:
                least = min(small, key=lambda j: j.contribution)  # each may be covered by the others
                gone.append(least)
                self.search.fit = self._final(fit, [j for j in judged if j is not least])
                continue
            if len(bad) == len(judged) or all(j.minor for j in bad):
                return [*judged, *gone], [*bad, *reversed(gone)], after
            worst = min((j for j in bad if not j.minor), key=lambda j: j.contribution)
            gone.append(worst)
            self.search.fit = self._final(fit, [j for j in judged if j is not worst])
            if regrown < MOST_REGROWN:  # in its absence another may come forward
                regrown += 1
                self.search.grow(*self.search.rewhiten(), avoid=worst.effect.name)

    def _give_way(self, judged: list[JudgedEffect], gone: list[JudgedEffect], been: set[frozenset[str]]) -> bool:
        """Put a better name in the place of one of the set; whether there was one that leads to no set that has been.

        Two that are better than each other, each by its own fit, would take turns.
        """
        was = {j.effect.name for j in (*judged, *gone)}
        for j in judged:
            special = next((a for a in j.rivals if a.effect.name in j.effect.contains and a.apart < AS_WELL), None)
            instead = special or j.better
            if instead is not None:
                instead = None if instead.fit.composition.members in been else instead
            elif j.objections and not j.minor:
                others = alternatives(self.search, j.effect, j.without)
                instead = next((a for a in others if a.effect.name not in was and a.fit.composition.members not in been
                                and a.fit.bic() < j.without.bic() - BIC_GAIN), None)
                if instead is not None:
                    gone.append(j)
                    instead = replace(instead, fit=refit(self.problem, instead.fit.composition, instead.fit.vector))
            if instead is not None:
                self.report_progress(f"{instead.effect.name} in the place of {j.effect.name}")
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
        """Share of the squared error of a fit that still follows the inputs; 0 where that is not sure.

        Of the whitened errors or of those in the output's unit, whichever says more: what no candidate explains is
        whitened as noise is, and a tone or a band that is all structure keeps little of it.
        """
        errors = self.problem.errors(fit.composition, fit.vector)
        asked = [predictable_share(p, errors, self._inputs) for p in (self.problem, self.problem.with_whitening(WHITE))]
        return max((share for share, spread in asked if share - 2 * spread > PREDICTABLE), default=0.0)

    def _repeated(self, fit: Refit) -> float:
        """Mean squared error of a fit which repeats of the same input surely share; 0 where nothing repeats.

        What they share is no noise, even where no function of the inputs that a regression knows follows it. Of
        e² = (e_a e_b) + (e_a − e_b)²/2 the mean of the second is noise; beyond two of its standard errors the first is
        structure.
        """
        noise = self._unshared(fit)
        if noise.variance is None:
            return 0.0
        problem = self.problem
        squares = problem.stack(problem.errors(fit.composition, fit.vector), whiten=False) ** 2
        power = float(np.mean(squares))
        uneven = max(float(np.mean(squares**2)) / (3 * max(power, 1e-300) ** 2), 1.0)  # louder here than there
        return max(power - noise.variance - 2 * np.sqrt(uneven) * noise.error(problem.whitening), 0.0)

    def _unshared(self, fit: Refit, whiten: bool = False) -> NoiseLevel:
        """That part of the error of a fit which repeats of the same input do not share."""
        signals, problem = self.problem.signals, self.problem
        errors = problem.errors(fit.composition, fit.vector)
        left = [replace(s, output=problem.whitening.apply(e) if whiten else e)
                for s, e in zip(signals, errors, strict=True)]
        return noise_level(left, _driving(self.baseline), problem.blocks.mask())

    def _final(self, fit: Refit, kept: Sequence[JudgedEffect]) -> Refit:
        """The fit with the kept effects only."""
        if len(kept) == len(fit.composition.effects):
            return fit
        return self.search.refitted(Composition(self.baseline, tuple(j.effect for j in kept)))


def _driving(baseline: Baseline) -> list[str]:
    """Channels that a baseline reads but the one that it simulates."""
    return [c for c in baseline.channels if c != baseline.output]


def _usable(catalogue: tuple[Effect, ...], baseline: Baseline, signals: tuple) -> tuple[
        tuple[Effect, ...], tuple[CannotTell, ...]]:
    usable, unusable = [], []
    for effect in catalogue:
        if effect.family == "noise" or effect.by_evidence:
            continue
        missing = effect.missing(signals)
        why = f"no {', '.join(missing)} was measured" if missing else effect.applies(baseline, signals)
        if why is None:
            usable.append(effect)
        else:
            unusable.append(CannotTell(effect.name, why, None, effect.parameters[0].unit, effect.experiment))
    return tuple(usable), tuple(unusable)
