"""The command line: `quartercar rig` makes measurements, `quartercar demo` walks the whole road."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.running import Results, command, conclude, new_app, working
from lpvid.errors import InputError

if TYPE_CHECKING:
    from lpvid.record import Record
    from quartercar.demo import Demo

app = new_app()
DEMO_FOLDER = Path("quartercar-demo")
PlanFile = Annotated[Path | None, typer.Argument(metavar="PLAN", help="A TOML plan; --template prints one.",
                                                 show_default=False)]


def main() -> None:
    """Entry point of the `quartercar` command."""
    app(prog_name="quartercar")


def _version(value: bool) -> None:
    if value:
        from lpvid import __version__

        typer.echo(f"quartercar {__version__}")
        raise typer.Exit


@app.callback()
def _common(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                                  help="Print the version and stop.")] = False) -> None:
    """Dampers and quarter cars: a virtual test rig, and the road from its records to a stability report.

    Exit codes: 0 done; 2 the input is at fault (one line says what, nothing is written); 3 a numerical outcome short of
    what was asked, with the result written.
    """


@app.command()
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
    results, loaded = Results(out), load_plan(plan)
    records: list[Record] = []
    with working("running the rig") as say:
        for record in iterate_plan(loaded):
            records.append(record)
            say(f"running the rig: {record.name} done")
        from lpvid.auditing import audit
        from lpvid.report.inspection import inspection_page

        for record in records:
            results.add(f"{record.name}.csv", _writer(write_csv, record))
        say("auditing and drawing")
        found = audit(records)
        results.report(inspection_page(found, records))
        say("writing")
        data = {"schema": "quartercar/rig/1", "plan": str(plan), "audit": found.verdict,
                "records": [{"name": r.name, "file": f"{r.name}.csv", "n_samples": r.n_samples,
                             "duration": r.duration} for r in records]}
        conclude(results, data, "\n".join(map(repr, records[:8])), json)


def _writer(write: Callable[[Record, Path], Path], record: Record) -> Callable[[Path], Path]:
    return lambda path: write(record, path)


@app.command()
@command
def demo(out: options.Out = DEMO_FOLDER,
         seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the virtual rig.")] = 0,
         json: options.Json = False) -> None:
    """The whole road on embedded data: rig, audit, identification, state-space forms, stability, report."""
    from quartercar.demo import run_demo

    results = Results(out)
    with working("starting") as say:
        found = run_demo(seed, say, (lambda stage, result: None) if json else _Teller(say).tell)
        say("drawing")
        _deliver(results, found)
    conclude(results, found.to_dict(), _closing(found, out), json)


def _deliver(results: Results, found: Demo) -> None:
    from lpvid import plot as lpv_plot
    from lpvid.export.serialise import save
    from quartercar import plot
    from quartercar.demo import TARGET, comparisons, demo_page
    from quartercar.rig import write_csv

    shown = comparisons(found)
    results.add("model.json", lambda path: save(found.found.model, path))
    results.json("identification.json", found.found.to_dict())
    results.json("stability.json", found.study.to_dict())
    results.json("demo.json", found.to_dict())
    sample = next(r for r in found.held_out if r.name.startswith("test-1-"))
    results.add(f"{sample.name}.csv", _writer(write_csv, sample))
    figures = {"experiments.png": plot.experiments([(e.name, e.esr, e.plain_esr) for e in found.experiments], TARGET),
               "overview.png": plot.overview(next(c for c in shown if c.record.name == sample.name),
                                             [c for c in shown if c.record.name.startswith("test-7-")])}
    figures |= {"locus.png": lpv_plot.locus(*found.study.loci[0], found.study.frozen.critical)}
    for name, figure in figures.items():
        results.bytes(name, lpv_plot.png(figure))
    results.report(demo_page(found, shown))


def _closing(found: Demo, out: Path | None) -> str:
    where = f"{out}/" if out is not None else ""
    sample = next(r.name for r in found.held_out if r.name.startswith("test-1-"))
    return (f"\n{found.verdict}\n{found.study.verdict}\n"
            f"Look at {where}report.html; try: lpvid validate {where}model.json {where}{sample}.csv")


class _Teller:
    """Prints each stage as it is ready, with the time since the last one."""

    def __init__(self, say: Callable[[str], None]) -> None:
        import time

        from rich.console import Console

        self.console = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 100)
        self.clock = time.perf_counter
        self.since = self.clock()

    def tell(self, stage: str, result: object) -> None:
        """Print one stage in about ten lines."""
        from rich.rule import Rule
        from rich.text import Text

        now = self.clock()
        heading = f"{_STAGES[stage][0]}  ({now - self.since:.1f} s)"
        self.since = now
        self.console.print(Rule(Text(heading, style="bold"), align="left", style="dim", characters="─"),
                           width=min(self.console.width, 100))
        for line in _STAGES[stage][1](result):
            self.console.print(line if not isinstance(line, str) else Text(line))


def _rig_lines(result) -> list:
    training, held_out = result
    rows = [f"{len(training)} training records: {_counted(training)}",
            f"{len(held_out)} held-out records: {_counted(held_out)}"]
    samples = sum(r.n_samples for r in (*training, *held_out))
    return [*rows, f"{samples:,} samples at {1 / training[0].sample_time:g} Hz: displacement [m], velocity [m/s], "
                   "current [A], force [N]",
            "the damper: series compliance, yield that saturates with current, coil 5 ms up and 10 ms down, asymmetry "
            "1.3, gas, 1 % noise"]


def _counted(records: list[Record]) -> str:
    """Experiments with the number of their records."""
    from collections import Counter

    counts = Counter(r.name.rpartition("-r")[0] for r in records)
    return ", ".join(name if n == 1 else f"{name} ×{n}" for name, n in counts.items())


def _experiment_lines(figures) -> list:
    from rich.table import Table

    from quartercar.demo import experiments_table

    told = experiments_table(figures)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for i, name in enumerate(told.columns):
        table.add_column(name, justify="right" if i in told.numeric else "left", no_wrap=True)
    for row in told.rows:
        table.add_row(*row, style="bold" if row[0] == "mean" else None)
    return [f"{told.caption}", table]


_STAGES: dict[str, tuple[str, Callable]] = {
    "rig": ("1 Virtual rig", _rig_lines),
    "audit": ("2 Audit of the training records", lambda found: str(found).splitlines()[:10]),
    "identification": ("3 LPV-ARX identification", lambda found: repr(found).splitlines()[:10]),
    "experiments": ("4 Every experiment", _experiment_lines),
    "forms": ("5 State-space forms", lambda gaps: [str(g) for g in gaps]),
    "stability": ("6 Stability", lambda study: str(study).splitlines()[:10]),
}
