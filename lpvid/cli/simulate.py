"""`lpvid simulate`: a model's free run along records, as tables that every reader takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from lpvid.cli import options
from lpvid.cli.running import Results, command, conclude, working

if TYPE_CHECKING:
    from lpvid.validation.free_runs import FreeRuns

Format = Literal["csv", "parquet", "mat"]
"""Tables by their extension."""


@command
def simulate(model: options.ModelFile, data: options.Data, input: options.Inputs = None, output: options.Outputs = None,
             schedule: options.Schedule = None, role: options.Role = None, flip: options.Flip = None,
             sample_rate: options.ModelsRate = None,
             format: Annotated[Format, typer.Option("--format", help="Format of the simulation.")] = "csv",
             out: options.Out = None, json: options.Json = False) -> None:
    """Simulate a model in free run; writes simulation.csv (or parquet, mat), simulation.json and report.html.

    Columns: time, measured, simulated, residual, then what drives and schedules the model; one file per record where
    there are several. A run starts from the first measured samples; without a measured output it starts from zero. Data
    of another rate are resampled to the model's, and a note states so.
    """
    from lpvid.cli.data import asked_rate, models_rate, read_clocked, split_names
    from lpvid.cli.parts import parts
    from lpvid.export.serialise import load
    from lpvid.training_fingerprint import unstated_of
    from lpvid.validation import acting_model
    from lpvid.validation.free_runs import free_runs

    results = Results(out, "simulation.json", "report.html")
    given, raw = asked_rate(sample_rate)
    with working("reading") as report_progress:
        loaded = load(model)
        records, clockless = read_clocked(data, roles=role, flip=flip, sample_rate=given, like=loaded)
        acting = acting_model(loaded, records, given)
        named = {"input": split_names(input), "output": split_names(output), "schedule": split_names(schedule)}
        records = [r.with_roles(parts(acting, named)) for r in records]
        report_progress("simulating")
        found = free_runs(acting, records, models_rate(records, given, raw, clockless))
        found = replace(found, notes=(*found.notes, *unstated_of(acting, records)))
        if results.kept:
            _deliver(results, found, format, model.name, report_progress)
    conclude(results, found.to_dict(), repr(found), json)


def _deliver(results: Results, found: FreeRuns, kind: str, name: str, report_progress: Callable[[str], None]) -> None:
    """Queue the tables, the figures and the report."""
    from lpvid.cli.run_tables import queue_runs
    from lpvid.report.simulation import simulation_page

    report_progress("writing")
    queue_runs(results, found, kind)
    results.json("simulation.json", found.to_dict())
    results.report(simulation_page(found, name))
