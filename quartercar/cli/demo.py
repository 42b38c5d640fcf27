"""`quartercar demo`: the whole chain on embedded data."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.running import Results, command, conclude, working
from quartercar.cli.rig import writer

if TYPE_CHECKING:
    from lpvid.record import Record
    from quartercar.demo.run import Demo

DEMO_FOLDER = Path("quartercar-demo")


@command
def demo(out: options.Out = DEMO_FOLDER,
         seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the virtual rig.")] = 0,
         json: options.Json = False) -> None:
    """The whole chain on embedded data: rig, identification, stability, diagnosis, controller, ride and report."""
    from quartercar.demo.run import run_demo

    results = Results(out, "demo.json", "report.html")
    with working("starting") as report_progress:
        report_stage = (lambda stage, result: None) if json else _StagePrinter(report_progress).show
        found = run_demo(seed, report_progress, report_stage)
        report_progress("drawing")
        _deliver(results, found)
    conclude(results, found.to_dict(), _closing(found, out), json)


def _deliver(results: Results, found: Demo) -> None:
    from lpvid import plot as lpv_plot
    from quartercar import plot
    from quartercar.demo.page import demo_page
    from quartercar.demo.run import TARGET
    from quartercar.rig import write_csv

    shown = found.drawn.shown
    results.save("model.json", found.found.model)
    results.json("identification.json", found.found.to_dict())
    results.json("stability.json", found.study.to_dict())
    results.json("demo.json", found.to_dict())
    if found.diagnosis.found.extended is not None:
        results.save("extended_model.json", found.diagnosis.found.extended)
    if found.ride.design.synthesis.solved:
        results.save("controller.json", found.ride.design.controller)
    results.json("ride.json", found.ride.rides.to_dict())
    sample = next(r for r in found.held_out if r.name.startswith("test-1-"))
    results.add(f"{sample.name}.csv", writer(write_csv, sample), data=True)
    figures = {"experiments.png": plot.experiments([(e.name, e.esr, e.plain_esr) for e in found.experiments], TARGET),
               "overview.png": plot.overview(next(c for c in shown if c.record.name == sample.name),
                                             [c for c in shown if c.record.name.startswith("test-7-")])}
    figures |= {"locus.png": lpv_plot.locus(*found.study.loci[0], found.study.frozen.critical)}
    for name, figure in figures.items():
        results.bytes(name, lpv_plot.png(figure))
    results.report(demo_page(found))


def _closing(found: Demo, out: Path | None) -> str:
    where = f"{out}/" if out is not None else ""
    sample = next(r.name for r in found.held_out if r.name.startswith("test-1-"))
    return (f"\n{found.verdict}\n{found.study.verdict}\n{found.diagnosis.verdict}\n"
            f"Look at {where}report.html; try: lpvid validate {where}model.json {where}{sample}.csv")


class _StagePrinter:
    """Prints each stage as it is ready, with the time since the last one."""

    def __init__(self, report_progress: Callable[[str], None]) -> None:
        import time

        from rich.console import Console

        self.console = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 100)
        self.clock = time.perf_counter
        self.since = self.clock()

    def show(self, stage: str, result: object) -> None:
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

    from quartercar.demo.page import experiments_table

    described = experiments_table(figures)
    table = Table(box=None, pad_edge=False, header_style="dim")
    for i, name in enumerate(described.columns):
        table.add_column(name, justify="right" if i in described.numeric else "left", no_wrap=True)
    for row in described.rows:
        table.add_row(*row, style="bold" if row[0] == "mean" else None)
    return [f"{described.caption}", table]


_STAGES: dict[str, tuple[str, Callable]] = {
    "rig": ("1 Virtual rig", _rig_lines),
    "audit": ("2 Audit of the training records", lambda found: str(found).splitlines()[:10]),
    "identification": ("3 LPV-ARX identification", lambda found: repr(found).splitlines()[:10]),
    "experiments": ("4 Every experiment", _experiment_lines),
    "forms": ("5 State-space forms", lambda gaps: [str(g) for g in gaps]),
    "stability": ("6 Stability", lambda study: str(study).splitlines()[:10]),
    "diagnosis": ("7 A hidden cause", lambda found: found.lines()),
    "ride": ("8 A controller, and its ride", lambda found: found.lines()),
}
