"""Engine: from records, a baseline and a catalogue to a diagnosis, by the evidence of sets of causes."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lpvid._memory import give_back
from lpvid._threads import single_thread
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.budgets import LONG
from lpvid.baselines.repeats import repeats
from lpvid.baselines.signals import Signals
from lpvid.diagnosis.budgets import LISTED, MOST_MEMBERS
from lpvid.diagnosis.diagnosis import CannotTell, Diagnosis, SetProbabilities, VisitedSet
from lpvid.diagnosis.evidence.calibration import component_support
from lpvid.diagnosis.evidence.discrepancy import Discrepancy
from lpvid.diagnosis.evidence.laplace import EvidenceData, Members
from lpvid.diagnosis.evidence.members import SelectedSet
from lpvid.diagnosis.evidence.outcome import EvidenceOutcome
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.diagnosis.evidence.selection import on_all_samples, select_set
from lpvid.diagnosis.evidence.thinning import search_problem
from lpvid.diagnosis.evidence.visited import posterior
from lpvid.diagnosis.interrupted import BestSoFar, InterruptedSearch
from lpvid.diagnosis.problem import DiagnosisProblem, problem_of
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.screening import directions, screen
from lpvid.diagnosis.settings import DiagnosisSettings
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect, by_name
from lpvid.effects.scaling import Scales
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.validation.trust import LEVEL


def diagnose(records: Sequence[Record], baseline: Baseline, catalogue: Sequence[Effect],
             held_out: Sequence[Record] = (), settings: DiagnosisSettings | None = None,
             progress: Callable[[str], None] | None = None) -> Diagnosis:
    """Find the most probable sets of causes, name the probable components, extend the model, measure the gain.

    y = f(u; θ, S) + δ(u) + e over sets S: the steps and priors are those of docs/diagnosis_method.md.

    Parameters
    ----------
    records : sequence of Record
        Uniform, one rate.
    baseline : Baseline
    catalogue : sequence of Effect
    held_out : sequence of Record, optional
        Further records on which the gain is measured.
    settings : DiagnosisSettings, optional
    progress : callable, optional
        Receives a line of text at every stage.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        Too little data, missing channels, no candidates.
    InterruptedSearch
        Ctrl-C during the search, with the best set so far.
    """
    started, settings = time.perf_counter(), settings or DiagnosisSettings()

    def report_progress(text: str) -> None:
        give_back()
        if progress is not None:
            progress(text)

    if not catalogue:
        raise InputError("a diagnosis needs candidates", got="an empty catalogue")
    by_name(tuple(catalogue))
    with single_thread():
        if settings.fit_baseline:
            report_progress(f"fitting {baseline.name}")
            baseline = baseline.fit(records)
        search, unusable = prepared(records, baseline, catalogue, report_progress)
        try:
            search.run(root_of(search.problem, baseline))
            if weighed := search.reweighed():
                report_progress("searching with the errors weighed by the noise that the repeats show")
                weighed.run(refit(weighed.problem, Composition(baseline), weighed.root.fit.vector, rough=True))
                (weighed := weighed.reweighed() or weighed).settle()  # beside the misfit of another set
                search = weighed if weighed.is_mostly_noise(search.effective.floor) else search
            found = concluded(search, records, baseline, held_out, unusable, settings.seed, report_progress)
        except KeyboardInterrupt as stop:
            if not search.visited:
                raise
            raise InterruptedSearch(best_of(search)) from stop
    return replace(found, seconds=time.perf_counter() - started)


def concluded(search: SetSearch, records: Sequence[Record], baseline: Baseline, held_out: Sequence[Record],
              unusable: tuple[CannotTell, ...], seed: int, report_progress: Callable[[str], None]) -> Diagnosis:
    """The diagnosis by the most probable set that lowers the error on data not seen, measured on all samples.

    A set that does not lower it is rejected, and its weight goes to a smaller one, until they hold more than `LEVEL` of
    the weight that the search gave them, or are as many as a set has members: nothing is named then. Each further trial
    on the same data could pass by chance.

    Parameters
    ----------
    search : SetSearch
        That has been run.
    records : sequence of Record
        Prepared training records, whole.
    baseline : Baseline
    held_out : sequence of Record
        Further records on which the gain is measured; where there are none, it is measured out of fold.
    unusable : tuple of CannotTell
        Candidates that were not in the search.
    seed : int
        Of the sign patterns.
    report_progress : callable
        Receives a line of text at every stage.

    Returns
    -------
    Diagnosis
        Of the first set that lowers the error on data not seen; without any, of the most probable one, nothing named.
    """
    problem, alone = search.problem, search.root.fit
    screened = tuple(screen(problem, alone, directions(problem, alone, search.baseline_screening.changes),
                            np.random.default_rng(seed)))
    weights = {w.members: p for w, p in posterior(search)}
    rejected: list[Members] = []
    first = None
    while True:
        selected = _measured(search, rejected, records, baseline, report_progress)
        found = EvidenceOutcome(baseline, search, selected, screened, unusable, held_out,
                                tuple(sorted({n for members in rejected for n in members})))
        first = first or found
        if found.predicts:
            return (found if selected.members else first).diagnosis()
        rejected.append(selected.fit.composition.members)
        report_progress(f"no lower error on further data: {', '.join(sorted(rejected[-1]))}")
        held = sum(weights[members] for members in rejected)
        if held > LEVEL or len(rejected) == MOST_MEMBERS:
            return first.diagnosis()


def _measured(search: SetSearch, rejected: Sequence[Members], records: Sequence[Record], baseline: Baseline,
              report_progress: Callable[[str], None]) -> SelectedSet:
    """The set to report, the rejected ones left out, refitted to all samples."""
    problem = search.problem
    selected = select_set(search, report_progress, rejected)
    if problem.whitening or sum(r.n_samples for r in records) > sum(s.n_samples for s in problem.signals):
        problem.forget_simulations(sum(r.n_samples for r in records) > LONG)  # to free memory for the refit
        report_progress("refitting the best set to all samples")
        selected = on_all_samples(search, selected, problem_of(records, baseline))
    return selected


def best_of(search: SetSearch) -> BestSoFar:
    """The best set of an interrupted search.

    Parameters
    ----------
    search : SetSearch
        With one visited set at least.

    Returns
    -------
    BestSoFar
    """
    sets = posterior(search)
    best, share = sets[0]
    nothing = sum(p for w, p in sets if not w.members)
    weights = SetProbabilities({}, float(nothing), 0.0, "not computed", tuple(
        VisitedSet(tuple(e.name for e in w.effects), p, None) for w, p in sets[:LISTED]),
        component_support(sets))
    return BestSoFar(best.fit.composition, best.fit.vector, share, weights)


def prepared(records: Sequence[Record], baseline: Baseline, catalogue: Sequence[Effect],
             report_progress: Callable[[str], None]) -> tuple[SetSearch, tuple[CannotTell, ...]]:
    """A search over sets of the causes that these records can reveal, and the causes that they cannot reveal.

    Parameters
    ----------
    records : sequence of Record
        Uniform, one rate.
    baseline : Baseline
        Fitted, or with its parameters given.
    catalogue : sequence of Effect
    report_progress : callable
        Receives a line of text at every stage.

    Returns
    -------
    search : SetSearch
        Not yet run, on few samples.
    unusable : tuple of CannotTell
    """
    problem, recorded, factor = search_problem(records, baseline)
    if factor > 1:
        report_progress(f"searching on one sample in {factor}")
    usable, unusable = usable_of(catalogue, baseline, recorded)  # not joined: constant currents would vary
    scale = Scales.of(problem.signals).size
    grid_points = {e.name: np.array(e.spread_points(problem.signals, scale)).reshape(-1, len(e.parameters))
                   for e in usable}
    data = EvidenceData(problem, Discrepancy.of(problem, baseline), grid_points, usable)
    channels = [c for c in problem.signals[0].channels if c != baseline.output
                and all(s.has(c) for s in problem.signals)]
    inputs = {*baseline.channels, *(c for e in usable for c in e.needs)} - {baseline.output}
    pairs = tuple(repeats(recorded, [c for c in sorted(inputs) if all(s.has(c) for s in recorded)]))
    return SetSearch(data, usable, channels, report_progress, recorded=recorded, repeated=pairs), unusable


def root_of(problem: DiagnosisProblem, baseline: Baseline) -> Refit:
    """The baseline alone, by its best start.

    Parameters
    ----------
    problem : DiagnosisProblem
    baseline : Baseline
        Refitted from its parameters and from its `starts`.

    Returns
    -------
    Refit
    """
    composition = Composition(baseline)
    starts = [baseline.vector, *baseline.starts(problem.signals)]
    fits = [refit(problem, composition, v, rough=k > 0) for k, v in enumerate(starts)]
    return min(fits, key=lambda f: f.cost)


def usable_of(catalogue: Sequence[Effect], baseline: Baseline, signals: tuple[Signals, ...]
              ) -> tuple[tuple[Effect, ...], tuple[CannotTell, ...]]:
    """Candidates that these data can reveal, and why they cannot reveal the others.

    Parameters
    ----------
    catalogue : sequence of Effect
        Of the family "noise" none counts.
    baseline : Baseline
    signals : tuple of Signals
        One for each record: thinned, not cut together.

    Returns
    -------
    usable : tuple of Effect
    unusable : tuple of CannotTell
        With what is missing as the reason.
    """
    usable, unusable = [], []
    wanted = [e for e in catalogue if e.family != "noise"]
    absent = {e.name: f"no {', '.join(missing)} was measured" for e in wanted
              if (missing := e.missing(signals))}
    refused = absent | {e.name: why for e in wanted if e.name not in absent
                        and (why := e.applies(baseline, signals)) is not None}
    brought = {c for e in wanted if e.name not in refused for c in e.brings}
    for effect in wanted:
        why = refused.get(effect.name)
        if effect.name not in absent and effect.turns in brought - {*baseline.channels}:  # beside what brings it
            why = effect.determined(signals)
        if why is None:
            usable.append(effect)
        else:
            unusable.append(CannotTell(effect.name, why, None, effect.parameters[0].unit, effect.experiment))
    return tuple(usable), tuple(unusable)
