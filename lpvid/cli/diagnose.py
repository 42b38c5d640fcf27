"""`lpvid diagnose`: what a simulation gets wrong, and the cause by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lpvid.cli import options
from lpvid.cli.running import INTERRUPTED, Results, command, conclude, working

if TYPE_CHECKING:
    from lpvid.diagnosis.diagnosis import Diagnosis
    from lpvid.diagnosis.task import DiagnosisTask
    from lpvid.effects.lpv_extension import LpvExtension
    from lpvid.record import Record

PLAN, LPV_MODEL = "experiment.toml", "extended_lpv.json"


@command
def diagnose(
    data: options.Data,
    baseline: Annotated[str, typer.Option("--baseline", metavar="NAME|MODEL", help="A baseline by name (guo, bouc-wen, "
                                          "lpv-arx, linear, quarter-car, …), fitted to the data first; 'auto' for the "
                                          "law that suits them best; or a saved model file.", show_default=False)],
    parameters: Annotated[Path | None, typer.Option("--parameters", metavar="FILE", help="Parameters of a named "
                          "baseline, instead of fitting it: a published set.")] = None,
    held_out: Annotated[list[str] | None, typer.Option("--held-out", metavar="DATA", help="Files on which the gain is "
                                                       "measured; without them every second record or block of "
                                                       "DATA, by a fit to the others.")] = None,
    catalogue: Annotated[list[str] | None, typer.Option("--catalogue", metavar="NAME", help="Catalogue of causes, e.g. "
                         "quartercar; repeat for several (all that are installed).")] = None,
    plan_experiment: Annotated[bool, typer.Option("--plan-experiment", help="Also write experiment.toml: the "
                               "measurement that decides between the causes that these data leave open.")] = False,
    input: options.Inputs = None,
    output: options.Outputs = None,
    schedule: options.Schedule = None,
    role: options.Role = None,
    flip: options.Flip = None,
    sample_rate: options.SampleRateOrRaw = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the significance tests.")] = 0,
    out: options.Out = None,
    json: options.Json = False,
) -> None:
    """Find what a simulation gets wrong, name its cause or the reason for none, extend the model, measure the gain.

    Writes diagnosis.json, extended_model.json (which validate and diagnose take as any other model), with a cause named
    extended_lpv.json (the same cause in an LPV model), and report.html.
    --input, --schedule and --output name the motion, the current and the force, or play the model's parts in its order.
    """
    from lpvid.cli.data import asked_rate, read_parts_clocked, split_names
    from lpvid.condition.preparing import common_rate
    from lpvid.diagnosis.facade import run_task
    from lpvid.diagnosis.settings import DiagnosisSettings
    from lpvid.diagnosis.task import prepare_task
    from lpvid.errors import InputError

    results = Results(out, "diagnosis.json", "report.html")
    rate, raw = asked_rate(sample_rate)
    if plan_experiment and out is None:
        raise InputError("--plan-experiment writes a file", mend="add --out DIR")
    named = {"input": split_names(input), "output": split_names(output), "schedule": split_names(schedule)}
    with working("reading") as report_progress:
        start, is_model = _starting_point(baseline)
        training, kept, clockless = read_parts_clocked(data, held_out, roles=role, flip=flip, sample_rate=rate,
                                                       like=start)
        training, kept = ([_with_parts(r, start if is_model else None, named) for r in p] for p in (training, kept))
        task = prepare_task(
            training,
            start,
            split_names(catalogue) or None,
            kept,
            parameters=parameters,
            sample_rate=common_rate(training) if raw else None if clockless else rate,
            progress=report_progress,
        )
        found = run_task(task, DiagnosisSettings(seed=seed), report_progress)
        report_progress("the same causes in an LPV model")
        lpv = _lpv_extension(found, task)
        described = _deliver(results, found, task, lpv, plan_experiment, report_progress)
    if not found.complete:
        typer.echo("interrupted: no cause is named; the result is what was found so far, on training data", err=True)
    conclude(results, _described(found, lpv), "\n".join([repr(found), *described]), json)
    if not found.complete:
        raise typer.Exit(INTERRUPTED)


def _starting_point(text: str) -> tuple[Any, bool]:
    """A name as it is, or the model in a file."""
    from lpvid.effects.given import is_file

    if not is_file(text):
        return text, False
    from lpvid.export.serialise import load

    return load(text), True


def _with_parts(record: Record, model: Any, named: dict[str, tuple[str, ...]]) -> Record:
    from lpvid.cli.parts import damper_parts, parts
    from lpvid.model.adaptable import acting

    if not any(named.values()):
        return record
    if model is None:
        return damper_parts(record, named["input"], named["output"], named["schedule"])
    return record.with_roles(parts(acting(model, record.time_base.period), named))


def _lpv_extension(found: Diagnosis, task: DiagnosisTask) -> LpvExtension | None:
    """The named causes in an LPV model, where there are some and the records allow one.

    Held-out records that hold rows of the training records are not: the last third of every record is, as without any.
    """
    from lpvid.effects.lpv_extension import common_structure, measured_extension
    from lpvid.errors import InputError

    names = {c.name for c in found.causes}
    records, kept = task.prepared.training, task.prepared.held_out if found.before.part == "held-out" else ()
    structure = common_structure((*records, *kept), task.baseline.output) if names else None
    if structure is None:
        return None
    try:
        return measured_extension(records, structure, [e for e in task.catalogue if e.name in names], kept)
    except InputError:  # data on which no model of this structure can be fitted: the grey box stands alone
        return None


def _described(found: Diagnosis, lpv: LpvExtension | None) -> dict[str, Any]:
    """diagnosis.json."""
    return {**found.to_dict(), "extended_lpv": None if lpv is None else {**lpv.to_dict(), "model": LPV_MODEL}}


def _deliver(results: Results, found: Diagnosis, task: DiagnosisTask, lpv: LpvExtension | None, plan: bool,
             report_progress: Callable[[str], None]) -> Sequence[str]:
    """Queue the files; lines to print about the LPV model and the experiment."""
    from lpvid.auditing import record_remarks

    described = [f"  audit: {remark}" for remark in record_remarks(task.raw)]
    described += [] if lpv is None else [f"  {lpv}"]
    if not results.kept:
        return described
    from lpvid.cli.run_tables import queue_run
    from lpvid.diagnosis.experiments import proposed
    from lpvid.report.diagnosis import diagnosis_page

    report_progress("drawing")
    results.json("diagnosis.json", _described(found, lpv))
    if lpv is not None:
        results.save(LPV_MODEL, lpv.extended.model)
    if found.extended is not None:
        results.save("extended_model.json", found.extended)
        queue_run(results, found.extended, task.prepared.held_out or task.prepared.training)
    proposal = proposed(found) if plan else None
    planned = proposal is not None and bool(proposal.text)
    if proposal is not None and planned:
        results.add(PLAN, lambda path: path.write_text(proposal.text, encoding="utf-8"))
        described.append(
            f"  experiment: {proposal.description}\n  quartercar rig {results.folder}/{PLAN} --out DIR runs it on the "
            "virtual rig"
        )
    elif plan:
        described.append("  no experiment is needed, or none is known: nothing was left open that one could settle")
    advice = () if proposal is None else proposal.advice
    described += [f"  not settled by any run of the rig: {a}" for a in advice]
    words = (
        () if proposal is None else (*([f"{PLAN} holds the plan: {proposal.description}"] if planned else []), *advice)
    )
    results.report(diagnosis_page(found, task, lpv, words))
    return described
