"""Facade: `lpvid.diagnose`, from records as read, names and files to a diagnosis."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from gc import collect
from typing import TYPE_CHECKING, Any

from lpvid._forks import in_forks
from lpvid._memory import give_back
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.budgets import LONG
from lpvid.baselines.unread import unread_current
from lpvid.condition.preparing import with_current
from lpvid.condition.tables import as_records
from lpvid.diagnosis.budgets import SEARCH_SAMPLES
from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.estimates import esr_as_given
from lpvid.diagnosis.task import DiagnosisTask, Progress, prepare_task
from lpvid.record import Record
from lpvid.training_fingerprint import beyond_training, of_files, ranges
from lpvid.training_rows import PARTLY, TRAINING, TrainingRows, compared_rows

if TYPE_CHECKING:
    from lpvid.auditing import Audit
    from lpvid.diagnosis.settings import DiagnosisSettings
    from lpvid.effects.extended import ExtendedModel

def diagnose(records: Record | Sequence[Record], baseline: Any, catalogue: Any = None,
             held_out: Record | Sequence[Record] | None = None, *, parameters: Any = None,
             settings: DiagnosisSettings | None = None, sample_rate: float | None = None,
             progress: Progress | None = None, units: Mapping[str, str] | None = None) -> Diagnosis:
    """Localise the error of a baseline, name its causes or the reason for none, extend the baseline, measure the gain.

    Parameters
    ----------
    records : Record or sequence of Record
        As read: a velocity is derived where it was not measured, gaps and NaN cut records, a common rate above 1024 Hz
        is decimated.
    baseline : str, path, model or Baseline
        The name of an installed baseline (``"guo"``), fitted to the records first, or ``"auto"`` for the installed law
        that describes them best; a file written by `lpvid.save`; a model; or a `Baseline`.
    catalogue : sequence of Effect, name or names, optional
        Candidates: effects, or the names of installed catalogues; all installed ones by default.
    held_out : Record or sequence of Record, optional
        Further records on which the gain is measured.
    parameters : path or object, optional
        Parameters of a named baseline, instead of fitting it: a published set.
    settings : DiagnosisSettings, optional
    sample_rate : float, optional
        Resample to this rate [Hz].
    progress : callable, optional
        Receives a line of text at every stage.
    units : mapping of str to str, optional
        Of columns without a unit in their name, where the data are no Records; of a plain array, its columns in order.

    Returns
    -------
    Diagnosis
        After an interruption (Ctrl-C) the best set so far, with ``complete`` False.

    Raises
    ------
    InputError
        No such baseline or catalogue, missing channels, too little data.
    """
    training, kept = ([] if part is None else as_records(part, name, units)
                      for part, name in ((records, "data"), (held_out, "held-out")))
    task = prepare_task(training, baseline, catalogue, kept, parameters=parameters, sample_rate=sample_rate,
                        progress=progress)
    return run_task(task, settings, progress)


def run_task(task: DiagnosisTask, settings: DiagnosisSettings | None = None,
             progress: Progress | None = None) -> Diagnosis:
    """Run the engine on a task; the notes list the preparation of the data.

    Parameters
    ----------
    task : DiagnosisTask
    settings : DiagnosisSettings, optional
    progress : callable, optional
        Receives a line of text at every stage.

    Returns
    -------
    Diagnosis
        After an interruption (Ctrl-C) the best set so far, with ``complete`` False.
    """
    from lpvid.auditing import audit
    from lpvid.diagnosis.evidence import engine
    from lpvid.diagnosis.settings import DiagnosisSettings

    settings, report_progress = settings or DiagnosisSettings(), progress or (lambda text: None)
    prepared, baseline = task.prepared, task.baseline
    notes = [*unread_current(baseline, prepared.training), *prepared.notes]
    stage = [f"fitting {baseline.name}"]

    def report_stage(text: str) -> None:
        stage[0] = text
        report_progress(text)

    def audit_raw() -> Audit:
        return audit(task.raw,
                     scheduling=tuple(n for n in baseline.schedule if all(r.has(n) for r in task.raw)) or None)

    report_progress("auditing")
    given = audited = None
    if task.fitted:
        given = {"training": esr_as_given(baseline, prepared.training),
                 "held_out": esr_as_given(baseline, prepared.held_out)}
        notes.append("the baseline's parameters were given; the search refits them with each candidate, so that a "
                     "wrong parameter is not taken for a cause" if baseline.vector.size else
                     "the baseline's parameters were given and stay as they are")
    try:
        if settings.fit_baseline and not task.fitted and not task.baseline_fitted:
            report_stage(f"fitting {baseline.name}")
            both: tuple[Callable[[], Any], ...] = (lambda start=baseline: start.fit(prepared.training), audit_raw)
            results: list[Any] = in_forks(lambda call: call(), both)
            baseline, audited = results
        found = engine.diagnose(prepared.training, baseline, task.catalogue, prepared.held_out,
                                replace(settings, fit_baseline=False), report_stage)
    except KeyboardInterrupt as stop:
        from lpvid.diagnosis.interrupted import InterruptedSearch, interrupted

        found = interrupted(baseline, prepared, stage[0], stop.best if isinstance(stop, InterruptedSearch) else None)
    if sum(r.n_samples for r in prepared.training) > LONG:  # signals and what is cached along them refer to each other
        collect()
        give_back()
    extended = None if found.extended is None else _with_roles(
        found.extended.remembering(prepared.training, task.training_rows, SEARCH_SAMPLES), task)
    audited = audited or audit_raw()
    found, seen = _labelled(found, task)
    noted = (*found.notes, *_polarity_note(baseline, audited), *notes, *seen)
    given = given and given | ({} if found.before.part == "held-out" else {"held_out": None})
    base = {**found.baseline, "polarity": baseline.polarity} | ({"esr_as_given": given} if given else {})
    return replace(_with_channel_names(found, task.raw), audit=audited, baseline=base, extended=extended, notes=noted)


def _with_channel_names(found: Diagnosis, records: Sequence[Record]) -> Diagnosis:
    """The diagnosis with the channel's own name in the regimes of its error, where a voltage is used as the current."""
    first = with_current(records)[0][0]
    if not first.has("current") or first.unit("current") == "A":
        return found
    named = first.resolve("current")

    def own(text: str) -> str:
        return re.sub(r"\bcurrent\b", lambda _: named, text)

    weights = found.weights
    return replace(found, wrong=tuple(replace(w, where=own(w.where)) for w in found.wrong),
                   weights=None if weights is None else replace(weights, where=own(weights.where)))


def _with_roles(extended: ExtendedModel, task: DiagnosisTask) -> ExtendedModel:
    """The extended model with, in its metadata, the channel of the files for each of its roles."""
    raw = with_current(task.raw)[0]
    names = [n for n in (*extended.reads, task.baseline.output) if raw[0].has(n)]
    return replace(extended, metadata={**extended.metadata, **of_files(raw, names)})


def _labelled(found: Diagnosis, task: DiagnosisTask) -> tuple[Diagnosis, tuple[str, ...]]:
    """The figures of further records with their true label, and notes: rows of training data, channels beyond them."""
    apart, kept, output = task.raw[len(task.raw_training):], task.prepared.held_out, task.baseline.output
    if not apart or not kept or not found.complete:
        return found, ()
    rows = TrainingRows.of(task.training_rows or task.prepared.training, output).to_dict()
    label, notes = compared_rows({"training": {"rows": rows}}, apart, kept, output).labelled()
    inputs = [n for n in task.baseline.channels if n != output]
    beyond = beyond_training(kept, {"training": {"ranges": ranges(task.prepared.training, inputs)}}, inputs)
    if label not in (TRAINING, PARTLY):
        return found, beyond
    weights = found.weights and replace(found.weights, sets=tuple(replace(w, held_out_esr=None)
                                                                  for w in found.weights.sets))
    return replace(found, before=replace(found.before, part=label), after=replace(found.after, part=label),
                   weights=weights, held_out=f"{found.held_out} with rows of the training data"), (*notes, *beyond)


def _polarity_note(baseline: Baseline, audited: Audit) -> list[str]:
    if baseline.polarity > 0:
        return []
    turned = "velocity" if any(f.name == "velocity-sign" for f in audited.findings) else baseline.output
    return [f"reversed polarity: the {baseline.output} opposes the motion in these records. The diagnosis is that "
            f"of the device itself, with the sign turned; extended_model.json simulates the records as measured. "
            f"--flip {turned} turns the records"]
