"""`lpvid compare`: several models of any kind on the same records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.beside import labels, with_roles_of
from lpvid.cli.running import Results, command, conclude, working

if TYPE_CHECKING:
    from lpvid.record import Record
    from lpvid.validation.comparing import ComparedModel


@command
def compare(
    files: Annotated[list[str], typer.Argument(metavar="MODEL… DATA…", help="Model files (.json), then measurements.",
                                               show_default=False)],
    input: options.Inputs = None, output: options.Outputs = None, schedule: options.Schedule = None,
    role: options.Role = None, flip: options.Flip = None, sample_rate: options.ModelsRate = None,
    training: Annotated[bool, typer.Option("--training", help="These data are those the models were fitted to: label "
                                           "the figures so.")] = False,
    out: options.Out = None, json: options.Json = False,
) -> None:
    """Rank models by their free run on the same records; writes compare.json and report.html.

    Any kinds together: transfer functions, state spaces, damper models, extended models. Each runs at its own rate.
    """
    from lpvid.cli.data import asked_rate, models_rate, read_clocked, split_names
    from lpvid.cli.parts import refuse_still
    from lpvid.errors import InputError
    from lpvid.export.serialise import load
    from lpvid.validation.comparing import compare_models

    results = Results(out, "compare.json", "report.html")
    given, raw = asked_rate(sample_rate)
    models, data = [f for f in files if f.endswith(".json")], [f for f in files if not f.endswith(".json")]
    if not models or not data:
        raise InputError("lpvid compare needs model files and data", got=", ".join(files) or "nothing",
                         mend="lpvid compare a.json b.json run*.csv")
    named = {"input": split_names(input), "output": split_names(output), "schedule": split_names(schedule)}

    with_roles = with_roles_of(named)
    with working("reading") as report_progress:
        loaded = {name: load(file) for name, file in zip(labels(models), models, strict=True)}
        records, clockless = read_clocked(data, roles=role, flip=flip, sample_rate=given,
                                          like=list(loaded.values()))
        report_progress("simulating")
        found = compare_models(loaded, records, sample_rate=models_rate(records, given, raw, clockless),
                               label="training" if training else None, fitted=with_roles)
        found = replace(found, models=tuple(_with_units(m, with_roles(m.model, records)) for m in found.models))
        refuse_still(found.models[0].model, found.models[0].found)
        if results.kept:
            from lpvid.report.comparing import compare_page

            report_progress("drawing")
            results.json("compare.json", found.to_dict())
            results.report(compare_page(found, records, with_roles))
    conclude(results, found.to_dict(), repr(found), json)


def _with_units(compared: ComparedModel, records: Sequence[Record]) -> ComparedModel:
    """The same with a note on channels whose unit no file states."""
    from lpvid.training_fingerprint import unstated_of

    found = compared.found
    return replace(compared, found=replace(found, notes=(*found.notes, *unstated_of(compared.model, records))))
