"""Outcome: verdict and diagnosis as plain data, from the selected set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Signals
from lpvid.diagnosis.budgets import LISTED
from lpvid.diagnosis.diagnosis import (
    CannotTell,
    Cause,
    Diagnosis,
    Errors,
    Rejected,
    Rivals,
    SetProbabilities,
    VisitedSet,
)
from lpvid.diagnosis.estimates import errors_of, estimates
from lpvid.diagnosis.evidence.calibration import Support, component_support, match_family
from lpvid.diagnosis.evidence.discrepancy import ACCEPTABLE_MISFIT
from lpvid.diagnosis.evidence.members import SelectedSet, SetMember
from lpvid.diagnosis.evidence.rivals import SIGNIFICANT
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.diagnosis.intervals import covariance
from lpvid.diagnosis.localise import ErrorRegime, localise, spectrum_lines
from lpvid.diagnosis.noise import NoiseLevel, noise_level
from lpvid.diagnosis.screening import ScreeningResult
from lpvid.effects.extended import ExtendedModel
from lpvid.record import Record
from lpvid.rounding import TINY

NO_GAIN = "with the set that it belongs to, the error on data that the fit has not seen is no lower"
"""why no member of the most probable set is named where the set predicts no better than the baseline"""


@dataclass(frozen=True, eq=False)
class EvidenceOutcome:
    """The selected set and all else that a diagnosis is made of.

    Attributes
    ----------
    baseline : Baseline
    search : SetSearch
    selected : SelectedSet
    screened : tuple of ScreeningResult
        Of all candidates beside the baseline alone.
    unusable : tuple of CannotTell
    held_out : sequence of Record
    without_gain : tuple of str
        Members of more probable sets whose error on data that the fit has not seen is no lower.
    """

    baseline: Baseline
    search: SetSearch
    selected: SelectedSet
    screened: tuple[ScreeningResult, ...]
    unusable: tuple[CannotTell, ...]
    held_out: Sequence[Record]
    without_gain: tuple[str, ...] = ()

    @property
    def significant(self) -> bool:
        """Whether the error of the baseline is structured, by the sign-flip test."""
        return min((e.p_value for e in self.screened), default=1.0) < SIGNIFICANT

    @cached_property
    def errors(self) -> tuple[Errors, Errors]:
        """Of the baseline alone and of the set."""
        selected = self.selected
        before = errors_of(selected.problem, selected.root, selected.before, self.held_out)
        if not selected.members or not self.significant:
            return before, before
        return before, errors_of(selected.problem, selected.fit, selected.after, self.held_out)

    @property
    def predicts(self) -> bool:
        """Whether the set lowers the error on data that no fit has seen, or is the baseline alone."""
        before, extended = self.errors
        return extended is before or extended.rmse < before.rmse

    def diagnosis(self) -> Diagnosis:
        """The diagnosis.

        Returns
        -------
        Diagnosis
            Without audit, time and notes.
        """
        selected, problem = self.selected, self.selected.problem
        before, extended = self.errors
        found = selected.members if self.significant else ()
        final = selected.fit if found and self.predicts else selected.root
        of_parameters = covariance(problem, final)
        spread = np.sqrt(np.diag(of_parameters))
        members = found if self.predicts else ()
        reasons = {m.effect.name: selected.reason_not_named(m) for m in members}
        named = [m for m in members if reasons[m.effect.name] is None and not m.rivals]
        contested = [m for m in members if reasons[m.effect.name] is None and m.rivals]
        rejected = [Rejected(m.effect.name, why) for m in members if (why := reasons[m.effect.name])]
        rejected += [Rejected(m.effect.name, NO_GAIN) for m in found if not members]
        known = {r.name for r in rejected} | {m.effect.name for m in found}
        why_not = {**dict.fromkeys(self.without_gain, NO_GAIN), **dict(selected.dropped), **self._at_bounds()}
        rejected += [Rejected(n, why) for n, why in why_not.items() if n not in known]
        left = problem.errors(final.composition, final.vector)
        level = noise_level(problem, [c for c in self.baseline.channels if c != self.baseline.output], left)
        verdict, reason = self._verdict(named, contested, [m for m in found if not members or reasons[m.effect.name]],
                                        level, spectrum_lines(problem, left))
        wrong = localise(problem, problem.errors(selected.root.composition, selected.root.vector))
        places = "; ".join(f"{w.where} ({w.share:.0%})" for w in localise(problem, left)[:2])
        after = extended if members else before
        where = f"{len(self.held_out)} further record(s)" if self.held_out else \
            f"{problem.blocks.halves} after start-up; each is predicted by a fit in which its weight is .01"
        if not named and before.esr_held_out > 1:
            verdict = "unexplained"
            reason = f"the free run of {self.baseline.name} is farther from the data than their mean (ESR " \
                     f"{before.esr_held_out:.3g} on {where}): take a baseline that simulates them, for example auto"
        in_set = {n for m in members for n in (m.effect.name, m.name)}
        return Diagnosis(
            verdict, reason, {**self.baseline.with_vector(selected.root.vector).describe()}, before, after,
            None if level.variance is None else float(np.sqrt(level.variance)), self._noise(level), wrong,
            tuple(self._cause(m, spread) for m in named), tuple(self._rivals(m) for m in contested),
            (*self.unusable, *self._invisible(in_set)), tuple(rejected),
            self._share(level.variance or 0.0) if named or contested else None, where,
            ExtendedModel.of(final, of_parameters, self.baseline), self.baseline.output_unit, None,
            {e.effect.name: {"likelihood_ratio": e.likelihood_ratio, "p_value": e.p_value,
                             "smallest_detectable": e.smallest_detectable} for e in self.screened},
            weights=SetProbabilities(self._families(), float(sum(p for w, p in selected.sets if not w.members)),
                                     selected.law_error, places or "in every part of the records alike",
                                     self._listed_sets(after.esr_held_out), component_support(selected.sets)))

    # -- verdict -------------------------------------------------------------------------------------------------------
    def _verdict(self, named: Sequence[SetMember], contested: Sequence[SetMember], others: Sequence[SetMember],
                 level: NoiseLevel, lines: Sequence[ErrorRegime]) -> tuple[str, str]:
        law_error, left = self.selected.law_error, self.search.relative_rms(self.selected.after)
        repeating, most = (r / self.search.data.discrepancy.output_rms for r in level.repeating)
        foreign = max((float(np.sqrt(x.share)) * left for x in lines), default=0.0)
        searched = self.selected.relative_error
        elsewhere = float(np.sqrt(max(left**2 - searched**2, 0.0)))  # beyond the samples of the search
        structure = f"on training data the inputs predict a free-run error of {law_error:.1%} of the output"
        structure += f"; {lines[0].where} is {foreign:.1%} of it" if lines else ""
        structure += f"; an error of at least {repeating:.1%} repeats where they do" if repeating > law_error else ""
        structure += f"; the error out of fold is {left:.1%} on all samples and {searched:.1%} on those of the " \
                     "search: a cause, or more noise, where none of these lies" if elsewhere > ACCEPTABLE_MISFIT else ""
        shown = "is taken for noise; a repeat of the run decides that" if level.variance is None else \
            f"is noise but for at most {min(most, left):.1%} that may repeat"
        noise = f"; what is left, {left:.1%} of the output, {shown}" if left > ACCEPTABLE_MISFIT else ""
        if named:
            described = ", ".join(f"{m.name} ({m.probability:.2f})" for m in named)
            most_left = max(law_error, foreign, repeating, elsewhere, *(m.change for m in others))
            if not contested and most_left <= ACCEPTABLE_MISFIT:
                return "explained", f"{described}; {structure}, as much as a good law leaves{noise}"
            rest = [f"{m.name} or {' or '.join(n for n, _ in m.rivals)}" for m in contested]
            return "partly-explained", "; ".join([described, *rest, structure])
        if contested:
            described = "; ".join(_either(m, self.search.problem.signals) for m in contested)
            return "cannot-tell", f"these data do not distinguish between {described}; {structure}"
        if others:
            names = ", ".join(m.effect.name for m in others)
            why = "; ".join(f"{m.effect.name}: {self.selected.reason_not_named(m) or NO_GAIN}" for m in others)
            return "unexplained", f"the best set is {names}, of which nothing can be named ({why}); {structure}"
        if self.selected.least_error_set is not None and foreign <= ACCEPTABLE_MISFIT:
            causes, lower = self.selected.least_error_set
            fall = f"{', '.join(causes)} it falls out of fold from {self.selected.relative_error:.1%} to {lower:.1%} " \
                   "of the output"
            return "unexplained", "no cause is probable enough to be named, and the error is no noise: with " \
                                  f"{fall}; {structure}"
        if max(law_error, foreign, repeating, elsewhere) > ACCEPTABLE_MISFIT:
            return "unexplained", f"no cause of the catalogue is probable enough; {structure}"
        return "nothing-to-explain", f"no cause is needed; {structure}{noise}"

    def _at_bounds(self) -> dict[str, str]:
        """Causes at their bounds, and why they are rejected, where sets with them would be more probable."""
        s, best = self.search, self.selected.sets[0][0]
        least = best.evidence(s.kappa)
        sets = [w for w in s.visited.values() if w.at_bounds and w.evidence_ignoring_bounds(s.kappa) > least]
        return {n: f"it fits best at its bound, {bound}: the optimum is beyond what is possible"
                for w in sets for n, bound in w.at_bounds.items() if n not in best.members}

    def _share(self, noise: float) -> tuple[float, float] | None:
        """Share of the baseline's squared error out of fold, less the noise of repeats, that the set removes.

        None where the noise is all of that error.
        """
        selected = self.selected
        excess = float(np.sum(selected.before**2)) - noise * selected.problem.n_samples
        if not excess > 0:
            return None
        gains = selected.gains
        return float(gains.sum()) / excess, float(gains.std(ddof=1) * np.sqrt(gains.size)) / excess

    # -- plain data ----------------------------------------------------------------------------------------------------
    def _cause(self, m: SetMember, spread: np.ndarray) -> Cause:
        selected = self.selected
        single = self.search.visited.get(frozenset({m.effect.name}))
        root = self.search.root
        alone = 0.0 if single is None else _share_of(root.fit.cost - single.fit.cost,
                                                     root.fit.cost - self.search.best.fit.cost)
        place = selected.fit.composition.places[selected.fit.composition.effects.index(m.effect)]
        p_value = next((e.p_value for e in self.screened if e.effect.name == m.effect.name), 1.0)
        described = m.effect.described(m.values)
        if m.name != m.effect.name:
            title = next(e.title for e in self.search.candidates if e.name == m.name)
            described = f"{title}; simulated as {m.effect.name} ({described})"
        return Cause(m.name, described, estimates(m.effect, m.values, spread[place]), p_value,
                     None if m.evidence is None else -2 * m.evidence, float(alone),
                     _share_of(m.cost, selected.cost_reduction), m.gain, m.better,
                     m.change * self.search.data.discrepancy.output_rms, m.probability, m.effect.family, m.weight,
                     m.effect.name if m.name != m.effect.name else None)

    def _rivals(self, m: SetMember) -> Rivals:
        known = {e.name: e for e in self.search.candidates}
        others = [known[n] for n, _ in m.rivals]
        parameters = {m.effect.name: estimates(m.effect, m.values, None)}
        for e in others:
            holding = (w for w, _ in self.selected.sets if e in w.effects)
            if w := next(holding, None):
                parameters[e.name] = estimates(e, w.fit.vector[w.fit.composition.places[w.effects.index(e)]], None)
        experiments = [m.effect.experiment, *(e.experiment for e in others)]
        return Rivals((m.name, *(e.name for e in others)), float(1 - m.probability), alternatives(experiments),
                      parameters)

    def _invisible(self, in_set: set[str]) -> tuple[CannotTell, ...]:
        """Candidates that are detectable only where they change as much as the whole output."""
        out, output_rms = [], self.search.data.discrepancy.output_rms
        for e in self.screened:
            unit = e.effect.parameters[0].unit
            if e.effect.name in in_set:
                continue
            if e.smallest_detectable is None or e.best is None:
                out.append(CannotTell(e.effect.name, "it is not detectable in these data at any strength", None, unit,
                                      e.effect.experiment))
            elif e.best.size * e.smallest_detectable / max(e.best.strength, TINY) > output_rms:  # it is proportional
                why = f"only {e.effect.parameters[0].name} above {e.smallest_detectable:.3g} {unit}".rstrip()
                out.append(CannotTell(e.effect.name, f"{why} is detectable", e.smallest_detectable, unit,
                                      e.effect.experiment))
        return tuple(out)

    def _families(self) -> dict[str, float]:
        families = {e.family for w, _ in self.selected.sets for e in w.effects}
        found = {f: Support.of(self.selected.sets, match_family(f)).probability
                 for f in families}
        return dict(sorted(found.items(), key=lambda t: (-t[1], t[0])))

    def _listed_sets(self, esr: float) -> tuple[VisitedSet, ...]:
        reported = self.selected.fit.composition.members
        return tuple(VisitedSet(tuple(e.name for e in w.effects), p,
                                esr if w.members == reported and self.significant else None)
                     for k, (w, p) in enumerate(self.selected.sets) if k < LISTED or w.members == reported)

    def _noise(self, level: NoiseLevel) -> dict[str, Any]:
        s, weighed = self.search, self.search.problem.whitening is not None
        noise = s.effective.floor if weighed else self.selected.sets[0][0].marginal(s.kappa).noise
        return {"name": "white-noise" if s.kappa > 0.5 and not weighed else "coloured-noise", "order": 0,
                "level": float(np.sqrt(noise)), "coefficients": [1.0], "from_repeats": level.description,
                "repeating": list(level.repeating), "weighed": weighed, "predictable_share": self.selected.predictable,
                "independent_samples": s.kappa * s.problem.n_samples}


def _either(m: SetMember, signals: Sequence[Signals]) -> str:
    """A member or its rivals, with their probabilities, except for those that a form describes too, and its family."""
    too = [n for n in m.effect.stands_for(m.values, signals) if n in dict(m.rivals)]
    others = [f"{n} ({p:.2f})" for n, p in m.rivals if n not in too]
    form = f", a form that describes {', '.join(too)} too" if too else ""
    family = f", {m.family_stated}" if m.family_stated else ""
    return " or ".join([f"{m.name} ({m.probability:.2f})", *others]) + form + family


def _share_of(part: float, reduction: float) -> float:
    """Of a reduction of the cost; 0 where there is none."""
    return float(part / reduction) if reduction > 0 else 0.0


def alternatives(experiments: Sequence[str]) -> str:
    """Experiments of several causes as one text, in which each part stands once, with its reason where it has one.

    Parameters
    ----------
    experiments : sequence of str
        Of each cause, in parts that a semicolon separates; a reason follows a colon.

    Returns
    -------
    str

    Examples
    --------
    >>> alternatives(["creep at two places: gas depends on them", "no load; creep at two places", "no load"])
    'creep at two places: gas depends on them; or no load'
    """
    parts = [part for text in experiments for part in text.split("; ")]
    repeated = {p for p in parts if any(q.startswith(f"{p}: ") for q in parts)}
    found: list[str] = []
    for text in experiments:
        own = [p for p in text.split("; ") if p not in repeated and not any(p in t.split("; ") for t in found)]
        found += ["; ".join(own)] if own else []
    return "; or ".join(found)
