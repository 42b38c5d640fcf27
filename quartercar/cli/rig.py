"""`quartercar rig`: synthetic measurements by the virtual rig."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.running import Results, command, conclude, working
from lpvid.errors import InputError

if TYPE_CHECKING:
    from lpvid.record import Record

PlanFile = Annotated[Path | None, typer.Argument(metavar="PLAN", help="A TOML plan; --template prints one.",
                                                 show_default=False)]


@command
def rig(plan: PlanFile = None,
        template: Annotated[bool, typer.Option("--template", help="Print a commented plan and stop.")] = False,
        out: options.Out = None, json: options.Json = False) -> None:
    """Synthetic measurements by the virtual rig: one csv for each run of a PLAN, and report.html."""
    from quartercar.rig import iterate_plan, load_plan, plan_template, write_csv

    if template:
        typer.echo(plan_template(), nl=False)
        return
    if plan is None:
        raise InputError("rig needs a plan", mend="quartercar rig --template > plan.toml")
    if out is None:
        raise InputError("rig needs a folder for its records", mend="add --out DIR")
    results, loaded = Results(out, "report.html"), load_plan(plan)
    records: list[Record] = []
    with working("running the rig") as report_progress:
        for record in iterate_plan(loaded):
            records.append(record)
            report_progress(f"running the rig: {record.name} done")
        from lpvid.auditing import audit
        from quartercar.report.rig import rig_page

        for record in records:
            results.add(f"{record.name}.csv", writer(write_csv, record), data=True)
        report_progress("auditing and drawing")
        found = audit(records)
        results.report(rig_page(loaded, found, records))
        report_progress("writing")
        data = {"schema": "quartercar/rig/1", "plan": str(plan), "audit": found.verdict,
                "records": [{"name": r.name, "file": f"{r.name}.csv", "n_samples": r.n_samples,
                             "duration": r.duration} for r in records]}
        conclude(results, data, "\n".join(map(repr, records[:8])), json)


def writer(write: Callable[[Record, Path], Path], record: Record) -> Callable[[Path], Path]:
    """`write` bound to its record, as `Results.add` takes it.

    Parameters
    ----------
    write : callable
        From a record and a path to the path that was written.
    record : Record
        What is written.

    Returns
    -------
    callable
        From a path to the path that was written.
    """
    return lambda path: write(record, path)
