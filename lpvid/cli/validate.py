"""`lpvid validate`: how good a model is on data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, Any

import typer

from lpvid.cli import options
from lpvid.cli.running import Results, command, conclude, working
from lpvid.errors import InputError


@command
def validate(model: options.ModelFile, data: options.Data, input: options.Inputs = None, output: options.Outputs = None,
             schedule: options.Schedule = None, role: options.Role = None, flip: options.Flip = None,
             sample_rate: options.ModelsRate = None,
             horizon: Annotated[list[int] | None, typer.Option("--horizon", metavar="K", min=2,
                                help="Also predict this "
                                "many samples ahead; repeat for several.")] = None,
             training: Annotated[bool, typer.Option("--training", help="These data are those the model was fitted to: "
                                                    "label the figures so.")] = False,
             beside: options.Beside = None,
             chunk: options.Chunk = None, out: options.Out = None, json: options.Json = False) -> None:
    """Compare a model with measurements, free run first; writes validation.json, simulation.csv and report.html.

    --input, --output and --schedule state which channels play the parts of the model's, in the model's order. Data of
    another rate are resampled to the model's, and a note states so.
    """
    from lpvid.cli.beside import beside_sections, compared, load_beside
    from lpvid.cli.data import asked_rate, models_rate, read_clocked, split_names
    from lpvid.cli.parts import parts, refuse_still
    from lpvid.export.serialise import load
    from lpvid.training_fingerprint import unstated_of
    from lpvid.validation import acting_model

    results = Results(out, "validation.json", "report.html")
    given, raw = asked_rate(sample_rate)
    with working("reading") as report_progress:
        loaded = load(model)
        name, others = load_beside(beside, str(model))
        if chunk is not None:
            if others:
                raise InputError("--beside needs whole records", got="--chunk", mend="lpvid compare on a part of them")
            _in_parts(results, loaded, data, {"roles": role, "flip": flip, "sample_rate": given}, chunk,
                      "training" if training else None, json, report_progress)
            return
        records, clockless = read_clocked(data, roles=role, flip=flip, sample_rate=given,
                                          like=[loaded, *others.values()])
        loaded = acting_model(loaded, records, given)
        named = {"input": split_names(input), "output": split_names(output), "schedule": split_names(schedule)}
        measured, records = records, [r.with_roles(parts(loaded, named)) for r in records]
        from lpvid import validation

        report_progress("simulating")
        label = "training" if training else None
        rate = models_rate(records, given, raw, clockless)
        found = validation.validate(loaded, records, sample_rate=rate, label=label, horizons=horizon or ())
        refuse_still(loaded, found)
        found = replace(found, notes=(*found.notes, *unstated_of(loaded, records)))
        beside_it = compared((name, loaded), others, measured, label, rate, named)
        stated = found.to_dict() if beside_it is None else {**found.to_dict(), "beside": beside_it.to_dict()}
        if results.kept:
            from lpvid.cli.run_tables import queue_run
            from lpvid.report.figures import comparisons
            from lpvid.report.validation import validation_page

            report_progress("drawing")
            results.json("validation.json", stated)
            queue_run(results, loaded, records, rate)
            results.report(validation_page(found, loaded, comparisons(loaded, records, found.label), model.name,
                                           beside_sections(beside_it, measured, named)))
    conclude(results, stated, repr(found) if beside_it is None else f"{found!r}\n{beside_it!r}", json)


def _in_parts(results: Results, model: Any, data: Sequence[str], how: dict[str, Any], rows: int, label: str | None,
              json: bool, report_progress: Callable[[str], None]) -> None:
    """The same for data that are read in parts."""
    from lpvid.cli.streamed import beginning, first_samples, parts
    from lpvid.training_fingerprint import unstated_of, with_sources
    from lpvid.validation.report import acting_model
    from lpvid.validation.streamed import validate_stream

    chunks = parts(data, rows, like=model, **how)
    head = beginning(chunks)
    acts = acting_model(model, [head])
    used = with_sources([*(s.name for s in (*acts.inputs, *acts.outputs)), *acts.box.names], acts.metadata)
    found = validate_stream(acts, chunks.only(used), label=label, report_progress=report_progress)
    found = replace(found, notes=(*found.notes, *unstated_of(acts, first_samples(chunks))))
    if results.kept:
        from lpvid.report.figures import comparisons
        from lpvid.report.validation import validation_page

        report_progress("drawing")
        results.json("validation.json", found.to_dict())
        results.report(validation_page(found, acts, comparisons(acts, [head], found.label), "the model"))
    conclude(results, found.to_dict(), repr(found), json)
