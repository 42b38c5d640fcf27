"""Facade: `lpvid.diagnose`, from records as read, names and files to a diagnosis."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from gc import collect
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid._forks import in_forks
from lpvid._memory import give_back
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.budgets import LONG
from lpvid.baselines.signals import ROLES
from lpvid.condition.preparing import with_current
from lpvid.condition.segmentation import refuse_text
from lpvid.condition.tables import as_records
from lpvid.diagnosis.budgets import SEARCH_SAMPLES
from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.preparing import PreparedRecords, prepare
from lpvid.effects.composition import ComposedBaseline
from lpvid.effects.effect import Effect
from lpvid.effects.given import as_baseline, as_effects, by_roles, channels_of, opened, rate_of
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.training_fingerprint import of_files, recalled
from lpvid.training_rows import PARTLY, TRAINING, TrainingRows, compared_rows

if TYPE_CHECKING:
    from lpvid.auditing import Audit
    from lpvid.diagnosis.settings import DiagnosisSettings
    from lpvid.effects.extended import ExtendedModel

Progress = Callable[[str], None]
AUTO = "auto"
"""instead of a baseline's name: the installed law that describes the records best"""


@dataclass(frozen=True, eq=False)
class DiagnosisTask:
    """Prepared records, baseline and catalogue of a diagnosis.

    Attributes
    ----------
    prepared : PreparedRecords
        Records on one clock.
    baseline : Baseline
        Fitted only if its parameters were given.
    fitted : bool
        Whether the parameters were given: the search starts from them, and `esr_as_given` is their error.
    catalogue : tuple of Effect
    raw : tuple of Record
        As read, for the audit.
    baseline_fitted : bool
        Whether the baseline has been fitted to these records already.
    n_training : int or None
        How many of `raw` are training records, which come first; None for all.
    """

    prepared: PreparedRecords
    baseline: Baseline
    fitted: bool
    catalogue: tuple[Effect, ...]
    raw: tuple[Record, ...]
    baseline_fitted: bool = False
    n_training: int | None = None


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


def prepare_task(records: Record | Sequence[Record], baseline: Any, catalogue: Any = None,
                 held_out: Record | Sequence[Record] | None = None, *, parameters: Any = None,
                 sample_rate: float | None = None, progress: Progress | None = None) -> DiagnosisTask:
    """Resolve names, read the model, prepare the records; arguments as for `diagnose`.

    Parameters
    ----------
    records : Record or sequence of Record
    baseline : str, path, model or Baseline
    catalogue : sequence of Effect, name or names, optional
    held_out : Record or sequence of Record, optional
    parameters : path or object, optional
    sample_rate : float, optional
        [Hz].
    progress : callable, optional

    Returns
    -------
    DiagnosisTask

    Raises
    ------
    InputError
        Parameters for a baseline that is not given by name; no such baseline or catalogue, missing channels, an output
        or a motion that is constant throughout.
    """
    training, kept = _listed(records), _listed(held_out)
    effects, given = as_effects(catalogue), opened(baseline)
    if parameters is not None and not isinstance(given, str):
        raise InputError("parameters belong to a baseline that is given by name", got=type(given).__name__,
                         mend="leave them out, a model file holds its own")
    training, kept = (recalled(part, getattr(given, "metadata", {})) for part in (training, kept))
    given = by_roles(given)
    rate = sample_rate or rate_of(given, [*training, *kept])
    prepared = prepare(training, kept, effects, channels_of(given), rate)
    if given == AUTO:
        from lpvid.diagnosis.automatic import automatic

        if parameters is not None:
            raise InputError("parameters belong to a baseline that is given by name", got=AUTO,
                             mend="name the baseline, or leave them out")
        found, note = automatic(prepared.training, progress or (lambda text: None))
        prepared = replace(prepared, notes=(note, *prepared.notes))
    else:
        try:
            found = as_baseline(given, prepared.training, parameters)
        except InputError:  # text may be why a channel is not there
            refuse_text([*training, *kept], ROLES)
            raise
    _check_moving(found, prepared.training)
    fitted = parameters is not None or not isinstance(given, (str, Baseline))
    causes = found.candidates(effects) if isinstance(found, ComposedBaseline) else tuple(effects)
    return DiagnosisTask(prepared, found, fitted, causes, (*training, *kept), given == AUTO, len(training))


def _check_moving(baseline: Baseline, records: Sequence[Record]) -> None:
    """Raise where the output, or every measured channel of the motion, is constant."""
    values = [r[baseline.output] for r in records if r.has(baseline.output)]
    if values and np.ptp(np.concatenate(values)) == 0:
        unit = next(r.unit(baseline.output) for r in records if r.has(baseline.output))
        raise InputError(f"'{baseline.output}' never changes in the training records, so that there is nothing to "
                         "explain", got=f"{values[0][0]:.6g} {unit} throughout",
                         mend="check the sensor, or leave these files out")
    motions = [r[role] for r in records for role in ("displacement", "velocity") if r.has(role)]
    if motions and not any(np.ptp(x) for x in motions):
        raise InputError("nothing moves in the training records", got="a constant displacement or velocity throughout",
                         mend="check the sensor, or leave these files out")


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
    notes = [*_polarity_note(baseline), *_unused_note(baseline, prepared.training), *prepared.notes]
    stage = [f"fitting {baseline.name}"]

    def report_stage(text: str) -> None:
        stage[0] = text
        report_progress(text)

    def audit_raw() -> Audit:
        return audit(task.raw,
                     scheduling=tuple(n for n in baseline.schedule if all(r.has(n) for r in task.raw)))

    report_progress("auditing")
    given = audited = None
    if task.fitted:
        given = {"training": _esr(baseline, prepared.training),
                 "held_out": _esr(baseline, prepared.held_out) if prepared.held_out else None}
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
        found.extended.remembering(prepared.training, _training_rows(task), SEARCH_SAMPLES), task)
    baseline_text = {**found.baseline, "polarity": baseline.polarity, **({"esr_as_given": given} if given else {})}
    notes += _seen_rows(task)
    return replace(_with_channel_names(found, task.raw), audit=audited or audit_raw(), notes=(*found.notes, *notes),
                   extended=extended, baseline=baseline_text)


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


def _listed(records: Record | Sequence[Record] | None) -> list[Record]:
    return [] if records is None else as_records(records)


def _with_roles(extended: ExtendedModel, task: DiagnosisTask) -> ExtendedModel:
    """The extended model with, in its metadata, the channel of the files for each of its roles."""
    raw = with_current(task.raw)[0]
    names = [n for n in (*extended.reads, task.baseline.output) if raw[0].has(n)]
    return replace(extended, metadata={**extended.metadata, **of_files(raw, names)})


def _training_rows(task: DiagnosisTask) -> Sequence[Record]:
    """The training records as read, where they have the baseline's output: resampled ones have other rows."""
    raw = task.raw[:task.n_training]
    return raw if all(r.has(task.baseline.output) for r in raw) else ()


def _seen_rows(task: DiagnosisTask) -> tuple[str, ...]:
    """A note where held-out records hold rows of the training records."""
    apart = task.raw[len(task.raw) if task.n_training is None else task.n_training:]
    if not apart or not task.prepared.held_out:
        return ()
    output = task.baseline.output
    known = TrainingRows.of(_training_rows(task) or task.prepared.training, output).to_dict()
    label, notes = compared_rows({"training": {"rows": known}}, apart, task.prepared.held_out, output).labelled()
    return notes if label in (TRAINING, PARTLY) else ()


def _polarity_note(baseline: Baseline) -> list[str]:
    if baseline.polarity > 0:
        return []
    return [f"reversed polarity: the {baseline.output} opposes the motion in these records. The diagnosis is that "
            f"of the device itself, with the sign turned; extended_model.json simulates the records as measured. "
            f"--flip {baseline.output} turns the records"]


def _unused_note(baseline: Baseline, records: Sequence[Record]) -> list[str]:
    """Advice where a current moves in the records and the baseline does not read it.

    It moves where the mean square of its steps is less than half of that of noise of its variance (von Neumann 1941).
    """
    if "current" in baseline.channels or not all(r.has("current") for r in records):
        return []
    currents = [r["current"] for r in records]
    pooled = np.concatenate(currents)
    steps = float(np.mean(np.concatenate([np.diff(c) for c in currents]) ** 2))
    if not steps / 2 < 0.5 * float(pooled.var()) > np.finfo(float).eps * float(np.mean(pooled**2)):
        return []
    return [f"the current moves between {pooled.min():.3g} and {pooled.max():.3g} and {baseline.name} does not read "
            f"it: its influence counts as error here, or as a cause. --baseline {AUTO} selects a law that reads it"]


def _esr(baseline: Baseline, records: Sequence[Record]) -> float | None:
    """Pooled free-run ESR at the baseline's own parameters; None where it diverges."""
    error = power = 0.0
    for record in records:
        s = baseline.signals(record)
        with np.errstate(all="ignore"):
            e = (s.output - baseline.core(baseline.vector)(s))[baseline.start:]
        y = s.output[baseline.start:]
        error, power = error + float(e @ e), power + float(np.sum((y - y.mean()) ** 2))
    return error / power if np.isfinite(error) and power > 0 else None
