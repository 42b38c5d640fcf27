"""`lpvid stability`: is a model stable, frozen and while its scheduling moves?"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.running import SHORTFALL, Results, command, conclude, solver_output_suppressed, working

if TYPE_CHECKING:
    from lpvid.report import Page
    from lpvid.report.self_scheduled import SelfScheduledStudy
    from lpvid.report.stability import StabilityStudy
    from lpvid.report.stability_reach import Questions

    Study = StabilityStudy | SelfScheduledStudy


@command
def stability(model: options.ModelFile,
              rate: Annotated[list[str] | None, typer.Option("--rate", metavar="R", help="How fast the scheduling may "
                              "move, in its units per second: R for all, or NAME=R. Left out: arbitrarily "
                              "fast.")] = None,
              range: Annotated[list[str] | None, typer.Option("--range", metavar="A:B", help="Range to examine instead "
                               "of the training range, or the hull of a design: A:B, or NAME=A:B for each "
                               "variable.")] = None,
              largest_range: Annotated[bool, typer.Option("--largest-range", help="Also scale the range, or the "
                               "hull of a design, about its centre until stability can no longer be "
                               "certified.")] = False,
              largest_rate: Annotated[bool, typer.Option("--largest-rate", help="Also find the fastest motion within "
                              "the range that is certified.")] = False,
              draws: Annotated[int, typer.Option("--draws", min=0, metavar="N", help="Draw N models from the "
                               "parameters' covariance (300 for the frozen poles), and state for which share the "
                               "same certificate holds.")] = 0,
              gain: Annotated[bool, typer.Option("--gain", help="Also bound the induced L2 gain from inputs to "
                              "outputs.")] = False,
              seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the draws from the parameters' "
                              "covariance.")] = 0,
              out: options.Out = None, json: options.Json = False) -> None:
    """Pole locus, exact critical scheduling values, certificate; writes stability.json, locus.png and report.html.

    Where there is a certificate, certificate.json too, which lpvid verify checks against the model.

    Exits with 0 when the model is stable at every held scheduling value (frozen) and certified for a moving one, with 3
    when not. For a model scheduled on its own output, what is certified holds for every course of that output.
    """
    from lpvid.export.serialise import load
    from lpvid.report.stability import StabilityStudy
    from lpvid.report.stability_reach import Questions

    results = Results(out, "stability.json", "report.html")
    loaded = load(model)
    with working("looking for a certificate") as report_progress, solver_output_suppressed():
        questions = Questions(largest_range, largest_rate, gain, draws)
        found, render = _studied(loaded, model, (rate, range), seed, questions, report_progress)
        data = {**found.to_dict(), "model": str(model)}
        if results.kept:
            report_progress("drawing")
            results.json("stability.json", data)
            if isinstance(found, StabilityStudy) and found.certificate.verified:
                results.save("certificate.json", found.certificate)
            else:
                results.without("certificate.json")
            _draw(results, found)
            results.report(render())
    conclude(results, data, str(found), json)
    if not found.certified:
        raise typer.Exit(SHORTFALL)


def _studied(loaded: object, path: Path, motion: tuple[list[str] | None, list[str] | None], seed: int,
             questions: Questions, report_progress: Callable[[str], None]) -> tuple[Study, Callable[[], Page]]:
    """What can be stated of a model of any kind, and what makes its page."""
    from lpvid.cli.data import rates
    from lpvid.errors import InputError
    from lpvid.model.adaptable import Adaptable
    from lpvid.model.compliance import ComplianceModel
    from lpvid.model.quasi import QuasiLPVModel, SelfScheduled
    from lpvid.model.state_space import LPVStateSpace
    from lpvid.model.transfer_function import LPVTransferFunction
    from lpvid.report.self_scheduled import self_scheduled_page, study_self_scheduled
    from lpvid.report.stability import stability_page, study_stability

    named = type(loaded).__name__
    if isinstance(loaded, Adaptable):
        loaded = loaded.to_linear_model()
    if not isinstance(loaded, (LPVTransferFunction, LPVStateSpace, QuasiLPVModel, ComplianceModel)):
        raise InputError(f"'{path}' holds no model that a stability analysis takes", got=named,
                         mend="give a transfer function, a state-space model, or a model that schedules itself")
    speeds, ranges = rates(motion[0], loaded.box.names), _ranges(motion[1], loaded.box.names)
    if isinstance(loaded, SelfScheduled):
        if questions != type(questions)():
            raise InputError(f"'{path}' holds a model that schedules itself",
                             got="--largest-range, --largest-rate, --draws or --gain",
                             why="its scheduling follows from its own output, within a range that is fixed",
                             mend="leave these options out")
        own = study_self_scheduled(loaded, rate=speeds, range=ranges, seed=seed, report_progress=report_progress)
        return own, lambda: self_scheduled_page(own, path.name)
    found = study_stability(loaded, rate=speeds, range=ranges, seed=seed, questions=questions,
                            report_progress=report_progress)
    return found, lambda: stability_page(found, path.name)


def _ranges(given: list[str] | None, names: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    from lpvid.cli.data import interval, split_names
    from lpvid.errors import InputError

    found: dict[str, tuple[float, float]] = {}
    for text in split_names(given):
        name, pair = interval(text, "--range")
        if not name and len(names) != 1:
            raise InputError("--range needs a name for each range", got=repr(text),
                             mend=f"the model schedules on {', '.join(names) or 'nothing'}")
        found[name or names[0]] = pair
    return found


def _draw(results: Results, study: Study) -> None:
    from lpvid import plot
    from lpvid.report.self_scheduled import SelfScheduledStudy

    found = study.embedded if isinstance(study, SelfScheduledStudy) else study
    if found is None:
        return  # bounded by construction: there are no poles to draw
    if not found.loci:
        discrete = found.model.sample_time is not None
        results.bytes("locus.png", plot.png(plot.poles(found.model.frozen_poles(found.model.box.centre), discrete)))
    for i, (locus, band) in enumerate(found.loci):
        name = "locus.png" if i == 0 else f"locus-{i + 1}.png"
        results.bytes(name, plot.png(plot.locus(locus, band, found.frozen.critical)))
