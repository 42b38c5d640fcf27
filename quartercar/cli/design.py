"""`quartercar design`: a suspension controller from weights."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.running import INTERRUPTED, SHORTFALL, Results, command, conclude, solver_output_suppressed, working
from quartercar.cli import car_options

if TYPE_CHECKING:
    from quartercar.controllers.designed.lpv_hinf import LpvHinf
    from quartercar.controllers.designed.lpv_hinf_clipped import LpvHinfClipped
    from quartercar.controllers.designed.lpv_hinf_identified import LpvHinfIdentified
    from quartercar.design.config import DesignConfig
    from quartercar.design.identified import IdentifiedDesign
    from quartercar.design.nominal import Design

@command
def design(
    config: car_options.Config = None,
    car: car_options.Car = None,
    damper: car_options.DamperFile = None,
    plant: Annotated[str | None, typer.Option("--plant", metavar="PLANT", help="identified: the damper's own dynamics "
                                              "(the default where it is an identified transfer function); nominal: "
                                              "c_nom alone.")] = None,
    template: car_options.Template = False,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON schema of a CONFIG and stop.")] = False,
    tune: Annotated[int | None, typer.Option("--tune", min=0, metavar="N", help="Tune the weights first, with N "
                                             "evaluations.")] = None,
    out: options.Out = None,
    json: options.Json = False,
) -> None:
    """An LPV H-infinity controller for a semi-active damper, from weights; its gain verified.

    Writes controller.json, which `quartercar ride --controller` takes, synthesis.json, closed_loop.json and
    certificate.json, which `lpvid verify` takes, report.html and its figures. Ctrl-C writes the best controller so
    far and ends with 130; a second one stops at once.
    Without CONFIG: the default weights, for --car and --damper or the embedded damper in the default car.
    """
    from quartercar.design.config import design_schema, design_template, load_design, read_design
    from quartercar.design.nominal import design as designed

    if template or schema:
        import json as writer

        typer.echo(design_template() if template else writer.dumps(design_schema(), indent=2) + "\n", nl=False)
        return
    from lpvid.synthesis.progress import followed, was_interrupted

    results = Results(out, "synthesis.json", "report.html")
    with working("reading") as report_progress, solver_output_suppressed():
        if config is None:
            given = {k: str(v) for k, v in (("car", car), ("damper", damper), ("plant", plant)) if v is not None}
            chosen = read_design(given)
        else:
            chosen = load_design(config, plant, car, damper)
        law = _tuned(chosen, chosen.tune if tune is None else tune, report_progress)
        report_progress("looking for a controller")
        with followed(report_progress):
            found = designed(chosen.car, law)
        _deliver(results, found, report_progress)
    conclude(results, found.to_dict(), str(found), json)
    if was_interrupted(found.synthesis):
        raise typer.Exit(INTERRUPTED)
    if not found.synthesis.solved:
        raise typer.Exit(SHORTFALL)


def _tuned(chosen: DesignConfig, budget: int,
           report_progress: Callable[[str], None]) -> LpvHinf | LpvHinfClipped | LpvHinfIdentified:
    """The law, tuned where that was requested."""
    if not budget:
        return chosen.law
    from quartercar.rides.tuning import Trial, tune
    from quartercar.roads.ride_roads import Bump, IsoRoad

    trial = Trial(chosen.car, (IsoRoad(duration=8.0), Bump()), seeds=(100_000, 100_001))
    return chosen.law.with_vector(
        tune(chosen.law, trial, max(budget, 4), report_progress=report_progress).controller.vector
    )


def _deliver(results: Results, found: Design | IdentifiedDesign, report_progress: Callable[[str], None]) -> None:
    """Queue the controller, the synthesis, the figures and the report."""
    if not results.kept:
        return
    from quartercar.design.report import design_figures, design_page

    report_progress("riding over a bump")
    rides = found.bump() if found.synthesis.solved else None
    report_progress("drawing")
    if found.synthesis.solved:
        results.save("controller.json", found.controller)
    else:
        results.without("controller.json")
    for name, part in (("closed_loop", found.synthesis.closed_loop), ("certificate", found.synthesis.certificate)):
        if part is None:
            results.without(f"{name}.json")
        else:
            results.save(f"{name}.json", part)
    results.json("synthesis.json", found.to_dict())
    figures = design_figures(found, rides)
    results.figures(figures)
    results.report(design_page(found, figures, rides))
