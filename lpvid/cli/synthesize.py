"""`lpvid synthesize` and `lpvid verify`: a controller for a plant, and a certificate checked without a solver."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lpvid.cli import options
from lpvid.cli.running import INTERRUPTED, SHORTFALL, Results, command, conclude, solver_output_suppressed, working
from lpvid.errors import InputError

if TYPE_CHECKING:
    from lpvid.model.state_space import LPVStateSpace
    from lpvid.synthesis.generalized_plant import GeneralizedPlant
    from lpvid.synthesis.synthesizing import Design

PlantFile = Annotated[Path | None, typer.Argument(metavar="PLANT", help="A TOML plant; --template prints one.",
                                                  show_default=False)]
DesignFile = Annotated[Path | None, typer.Option("--design", metavar="DESIGN", help="A TOML design; left out, the "
                                                 "design table of the plant.", show_default=False)]


@command
def synthesize(plant: PlantFile = None, design: DesignFile = None,
               template: Annotated[bool, typer.Option("--template", help="Print a commented plant with its design, and "
                                                      "stop.")] = False,
               schema: Annotated[bool, typer.Option("--schema", help="Print the JSON schema of plant and design, and "
                                                    "stop.")] = False,
               out: options.Out = None, json: options.Json = False) -> None:
    """A controller by linear matrix inequalities, its closed loop verified.

    Writes controller.json, synthesis.json, closed_loop.json, certificate.json and report.html. Exits with 3 when there
    is no controller, or only one with a relaxed requirement; the result states why and what would mend it.
    """
    from lpvid.synthesis.design_file import plant_schema
    from lpvid.synthesis.design_file import template as example

    if template:
        typer.echo(example(), nl=False)
        return
    if schema:
        import json as encoder

        typer.echo(encoder.dumps(plant_schema(), indent=2))
        return
    if plant is None:
        raise InputError("synthesize needs a plant", mend="lpvid synthesize --template > plant.toml")
    from lpvid.synthesis.design_log import limiting, limits
    from lpvid.synthesis.progress import was_interrupted
    from lpvid.synthesis.synthesizing import synthesize as solve

    results = Results(out, "synthesis.json", "report.html")
    loaded, settings, title, weights = _read(plant, design)
    with working("solving the matrix inequalities") as report_progress, solver_output_suppressed():
        result = solve(loaded, settings, progress=report_progress)
        found = () if result.closed_loop is None else limits(result.closed_loop)
        data: dict[str, Any] = {"schema": "lpvid/synthesis/1", **result.to_dict(), "plant": str(plant),
                                "design": repr(settings), "limits": [x.to_dict() for x in found]}
        if results.kept:
            from lpvid.report.synthesis import synthesis_page

            report_progress("drawing")
            results.json("synthesis.json", data)
            for name, part in (("controller", result.controller), ("closed_loop", result.closed_loop),
                               ("certificate", result.certificate)):
                if part is None:
                    results.without(f"{name}.json")
                else:
                    results.save(f"{name}.json", part)
            results.report(synthesis_page(result, loaded, title, weights))
    stated = limiting(found, result.gamma_verified)
    conclude(results, data, repr(result) + (f"\n  {stated}" if stated else ""), json)
    if was_interrupted(result):
        raise typer.Exit(INTERRUPTED)
    if result.verdict != "solved":
        raise typer.Exit(SHORTFALL)


@command
def verify(certificate: Annotated[Path, typer.Argument(metavar="CERTIFICATE", help="A certificate.json, or a "
                                                       "synthesis.json.", show_default=False)],
           model: Annotated[Path | None, typer.Argument(metavar="MODEL", help="Model or closed loop of the "
                                                        "certificate, e.g. closed_loop.json; left out, the one inside "
                                                        "synthesis.json.",
                                                        show_default=False)] = None,
           json: options.Json = False) -> None:
    """Re-check a saved certificate with numpy alone; exits with 3 where it does not hold."""
    from lpvid.analysis.certificates import Checkable, StabilityCertificate
    from lpvid.analysis.certificates import verify as check
    from lpvid.export.serialise import load
    from lpvid.synthesis.result import Synthesis

    held = load(certificate)
    system: Any = None if model is None else load(model)
    quoted: float | None = None
    if isinstance(held, Synthesis):
        system = held.closed_loop if system is None else system
        held, quoted = held.certificate, held.gamma_verified
        if held is None:
            raise InputError(f"'{certificate}' holds no certificate", got="a synthesis without one")
    if not isinstance(held, (StabilityCertificate, Checkable)):
        raise InputError(f"'{certificate}' holds no certificate", got=type(held).__name__,
                         mend="lpvid verify certificate.json closed_loop.json")
    if system is None:
        raise InputError("verify needs the model that the certificate was made for",
                         mend="lpvid verify certificate.json closed_loop.json")
    found = check(held, system)
    proven = getattr(held, "gamma", None)
    if found.holds and quoted is not None and proven is not None and quoted < proven * (1 - 1e-9):
        found = replace(found, holds=False, why=f"a gain of {quoted:.6g} is quoted, {proven:.6g} is certified")
    data = {"schema": "lpvid/verification/1", "holds": found.holds, "margin": found.margin,
            "between_grid": found.between_grid, "why": found.why, "claim": getattr(held, "claim", ""),
            "certificate": str(certificate)}
    claim = f"\n  {data['claim']}" if found.holds else ""
    conclude(None, data, f"{found}{claim}", json)
    if not found.holds:
        raise typer.Exit(SHORTFALL)


def _read(plant: Path, design: Path | None) -> tuple[GeneralizedPlant, Design, str,
                                                              dict[str, LPVStateSpace | float]]:
    """Plant and design of the files, with every fault named by its file; a title, and the performance weights."""
    from lpvid.codec import expect_table
    from lpvid.export.serialise import load
    from lpvid.synthesis.design_file import design_of
    from lpvid.synthesis.plant_file import output_weights, plant_of
    from lpvid.tables import read_toml, within

    example = "lpvid synthesize --template prints an example"
    table = read_toml(plant, example)
    asked = table.get("design") if design is None else read_toml(design, example)
    if asked is None:
        raise InputError(f"{plant} has no design", mend="add --design DESIGN.toml, or a [design] table")
    loaded = within(str(plant), lambda: plant_of(table, plant.parent, load))
    place = f"{plant} [design]" if design is None else str(design)
    settings = within(place, lambda: design_of(expect_table(asked, "the design"), loaded))
    return loaded, settings, str(table.get("name") or plant.stem), output_weights(table, loaded)
