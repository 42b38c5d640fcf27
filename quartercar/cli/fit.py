"""`quartercar fit`: every damper model that the data allow, fitted and ranked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.running import INTERRUPTED, SHORTFALL, Results, command, conclude, working
from lpvid.errors import InputError, TooFewSamples

if TYPE_CHECKING:
    from lpvid.record import Record
    from quartercar.dampers.contract import Damper
    from quartercar.dampers.evaluation.compared import Comparison

HOLD_OUT = "last-third"
READ = ("force", "velocity", "displacement", "current")
"""roles that every model reads where the records have them."""


@command
def fit(
    data: options.Data,
    models: Annotated[list[str] | None, typer.Option("--models", metavar="NAMES", help="Models to fit, with commas, or "
                                                     "all (the default); --list prints their names.")] = None,
    parameters: Annotated[list[Path] | None, typer.Option("--parameters", metavar="FILE", help="Also compare this "
                          "damper as it is: a published set, a damper that fit wrote, a model.json of lpvid "
                          "identify; repeat for several.")] = None,
    held_out: Annotated[list[str] | None, typer.Option("--held-out", metavar="DATA", help="Files the fits do not see; "
                                                       "repeat for several.")] = None,
    hold_out: Annotated[str | None, typer.Option("--hold-out", metavar="SHARE", help="Keep the last part of every "
                                                 "record out of the fits (last-third, without --held-out).")] = None,
    thorough: Annotated[bool, typer.Option("--thorough", help="Fit slow models to all data from twenty starts, however "
                                           "long it takes.")] = False,
    passive: Annotated[bool, typer.Option("--passive", help="Fit lpv-arx so that it never gives energy, certified; the "
                                          "other models' passivity is checked only.")] = False,
    budget: Annotated[float | None, typer.Option("--budget", min=1.0, metavar="SECONDS", help="Time of the fits "
                                                 "after which those not yet done are left out; cheap models come "
                                                 "first. Reading and report come on top; what they took is printed "
                                                 "at the end.")] = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Processes that fit (one per core).")] = None,
    input: options.Inputs = None,
    output: options.Outputs = None,
    schedule: options.Schedule = None,
    role: options.Role = None,
    flip: options.Flip = None,
    sample_rate: options.SampleRateOrRaw = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the starting points.")] = 0,
    list_models: Annotated[bool, typer.Option("--list", help="Print the models' names and stop.",
                                              callback=lambda value: _listed(value), is_eager=True)] = False,
    out: options.Out = None,
    json: options.Json = False,
) -> None:
    """Fit damper models and rank them by their free run on data that no fit has seen.

    Channels are found by their names velocity, displacement, current, force; --input, --schedule and --output name them
    otherwise. Writes comparison.json, a file for each fitted model, report.html and its figures. Exits with 3 where the
    free run of every fitted model on its training data diverges or is no better than their mean.
    """
    from lpvid.auditing import record_remarks
    from lpvid.cli.data import asked_rate, read_parts_clocked, split_names, with_cause
    from lpvid.cli.data import hold_out as part_of
    from lpvid.cli.parts import damper_parts
    from lpvid.condition.preparing import common_rate
    from lpvid.condition.segmentation import refuse_text
    from lpvid.training_fingerprint import recalled
    from quartercar.dampers.evaluation.comparison import CompareSettings, compare

    begun = monotonic()
    results = Results(out, "comparison.json", "report.html")
    with working("reading") as report_progress:
        asked, raw = asked_rate(sample_rate)
        alone = [d for d in map(_alone, parameters or ()) if d is not None]
        whole, kept, clockless = read_parts_clocked(data, held_out, roles=role, flip=flip, sample_rate=asked,
                                                    like=alone)
        named = (split_names(input), split_names(output), split_names(schedule))
        refuse_text([*whole, *kept], [*READ, *(n for names in named for n in names)])
        share = hold_out or (None if kept else HOLD_OUT)
        training, tail = part_of(whole, share)
        kept = [*tail, *kept]
        rate = common_rate(training) if raw else None if clockless else asked
        training, kept = ([damper_parts(r, *named) for r in part] for part in (training, kept))
        for damper in alone:
            training, kept = (recalled(part, damper.metadata) for part in (training, kept))
        wanted: list[str | Damper] = [*(split_names(models) or ([] if parameters else ("all",)))]
        read = monotonic()
        settings = CompareSettings(seed=seed, sample_rate=rate, thorough=thorough, passive=passive,
                                   workers=workers, budget=budget)
        try:
            found = compare(
                training, [*wanted, *_given(parameters or (), training, kept, rate)], kept, settings, report_progress
            )
        except TooFewSamples as error:
            raise with_cause(error, whole, training, share, rate) from None
        fitted = monotonic()
        notes = () if share is None else (f"held out: the last {share.removeprefix('last-')} of every record in DATA",)
        found = found.with_notes((*notes, *record_remarks([*training, *kept])))
        _deliver(results, found, report_progress)
    if not found.complete:
        typer.echo("interrupted: the models that were done are kept; the result is marked incomplete", err=True)
    conclude(results, found.to_dict(), str(found), json)
    if budget is not None:
        typer.echo(f"--budget {budget:g}: reading {read - begun:.1f} s, fits and their comparison "
                   f"{fitted - read:.1f} s, report {monotonic() - fitted:.1f} s", err=True)
    if not found.complete:
        raise typer.Exit(INTERRUPTED)
    if found.fails:
        raise typer.Exit(SHORTFALL)


def _listed(value: bool) -> None:
    if value:
        from quartercar.dampers import model_class, model_names

        for name in model_names():
            typer.echo(f"{name:<26}{model_class(name).title}")
        raise typer.Exit


def _alone(file: Path) -> Damper | None:
    """The damper in a file; None where its open settings need the data."""
    from quartercar.dampers import load_damper

    try:
        return load_damper(file)
    except InputError:
        return None


def _given(files: Sequence[Path], training: Sequence[Record], kept: Sequence[Record],
           rate: float | None) -> list[Damper]:
    """Parameter sets from files, their open settings and place as these data have them."""
    if not files:
        return []
    from quartercar.dampers import load_damper, model_class
    from quartercar.dampers.facts import Facts
    from quartercar.dampers.preparing import prepare
    from quartercar.dampers.published import model_of

    prepared = prepare(training, kept, rate)
    facts = Facts.of(prepared.training, prepared.polarity)
    found = []
    for file in files:
        name = model_of(file)
        try:
            like = None if name is None else model_class(name).suited(facts)
        except InputError:
            like = None
        found.append(load_damper(file, like))
    return found


def _deliver(results: Results, found: Comparison, report_progress: Callable[[str], None]) -> None:
    """Queue comparison.json, the models, the figures and the report."""
    if not results.kept:
        return
    from quartercar.report.fit import comparison_figures, comparison_page

    report_progress("drawing")
    results.json("comparison.json", found.to_dict())
    for row in found.rows:
        if row.fit is not None:
            results.save(f"{row.name}.json", row.damper)
    figures = comparison_figures(found)
    results.figures(figures)
    results.report(comparison_page(found, figures))
