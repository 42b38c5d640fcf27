"""`lpvid export`: a model, damper or controller for other tools: C99, FMU, MATLAB, python-control, tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from lpvid.cli import options
from lpvid.cli.running import SHORTFALL, Results, command, conclude, working
from lpvid.errors import InputError

if TYPE_CHECKING:
    from lpvid.export.exporting import Content

To = Annotated[str, typer.Option("--to", metavar="FORM", help="c, fmu2, fmu3, modelica, matlab, control or csv.")]
Name = Annotated[str, typer.Option("--name", metavar="NAME", help="Prefix of files and functions; left out, one from "
                                   "the kind of model.", show_default=False)]
Precision = Annotated[str, typer.Option("--precision", metavar="TYPE", help="Arithmetic of the C code: double or "
                                        "float.")]
Clamp = Annotated[bool | None, typer.Option("--clamp/--no-clamp", help="Hold the scheduling inside the model's box; "
                                            "left out, for designed controllers only.", show_default=False)]
Rate = Annotated[float | None, typer.Option("--sample-rate", metavar="HZ", help="Rate of a damper law or control law "
                                            "that runs at any rate, or at which a continuous model is discretised; a "
                                            "sampled model keeps its own.", show_default=False)]
At = Annotated[list[str] | None, typer.Option("--at", metavar="INPUT=VALUE", help="Hold an input, so that the model is "
                                              "frozen there: current=1.2; repeat.")]
Limit = Annotated[list[str] | None, typer.Option("--limit", metavar="CONTROL=LOW:HIGH", help="Limits of a controller's "
                                                 "output, or its largest magnitude: force=1500, force=-200:1500; "
                                                 "repeat.")]
Windup = Annotated[float | None, typer.Option("--anti-windup", metavar="SECONDS", help="With --limit: time constant of "
                                              "back-calculation; left out, the limits do not act on the states.",
                                              show_default=False)]


@command
def export(model: options.ModelFile, to: To = "c", out: options.Out = None, name: Name = "",
           precision: Precision = "double", clamp: Clamp = None, sample_rate: Rate = None, at: At = None,
           limit: Limit = None, anti_windup: Windup = None, json: options.Json = False) -> None:
    """Write a model, damper, controller or synthesis for other tools.

    c: one header, one source and a self-test in C99, without allocation or global state. fmu2, fmu3: an FMU of the same
    C, compiled here, sources inside, for co-simulation, or model exchange where it is continuous. modelica: a package
    in text. matlab: a .mat file with .m files that rebuild and step it. control: a Python file for python-control. csv:
    coefficients and frozen matrices. What was exported is compared with this package's own simulation where the system
    has the tools for it; the figures are printed, and the exit code is 3 where they exceed an export's tolerance.
    """
    from lpvid.export.exportable import Options
    from lpvid.export.exporting import content
    from lpvid.export.serialise import load
    from lpvid.export.step_builder import checked_name

    if sample_rate is not None and not sample_rate > 0:
        raise InputError("--sample-rate must be positive", got=f"{sample_rate:g} Hz")
    results = Results(out)
    with working(f"exporting to {to}"):
        checked_name(name)
        noun = _limited(load(model), limit or [], anti_windup)
        chosen = Options(name, clamp, None if sample_rate is None else 1 / sample_rate, _held(at or []))
        found = content(noun, to, chosen, precision)
    deliver(results, found, str(model), json)


def deliver(results: Results, found: Content, source: str, as_json: bool) -> None:
    """Write the files of an export and print its checks; exits with 3 where one of them did not hold.

    Parameters
    ----------
    results : Results
        Where the files go.
    found : Content
        Files and checks, in memory.
    source : str
        Name of what was exported, for the JSON.
    as_json : bool
        Whether JSON is printed in place of text.

    Raises
    ------
    typer.Exit
        With code 3 where a check did not hold; the files are written before.
    """
    for file, data in found.files.items():
        results.bytes(file, data)
    stated = {"schema": "lpvid/export/1", "form": found.form, "says": found.description, "files": list(found.files),
            "checks": list(found.checks), "passed": found.passed, "notes": list(found.notes), "model": source}
    lines = [
        f"{found.form}: {found.description}",
        *(f"  {c}" for c in found.checks),
        *(f"  note: {n}" for n in found.notes),
    ]
    conclude(results, stated, "\n".join(lines), as_json)
    if not found.passed:
        raise typer.Exit(SHORTFALL)


def _limited(noun: Any, limit: list[str], anti_windup: float | None) -> Any:
    """The controller behind limits, where limits are given."""
    if not limit:
        if anti_windup is not None:
            raise InputError("--anti-windup needs the limits", mend="--limit CONTROL=LOW:HIGH")
        return noun
    from lpvid.model.state_space import LPVStateSpace
    from lpvid.synthesis.anti_windup import back_calculation
    from lpvid.synthesis.result import Synthesis
    from lpvid.synthesis.saturated import saturate

    controller = noun.required() if isinstance(noun, Synthesis) else noun
    if not isinstance(controller, LPVStateSpace):
        raise InputError("--limit belongs to a state-space controller", got=type(noun).__name__,
                         mend="leave it out; a scheduled controller of a car has its own anti-windup")
    limits = dict(_interval(text) for text in limit)
    return saturate(controller, limits) if anti_windup is None else back_calculation(controller, limits, anti_windup)


def _held(given: list[str]) -> dict[str, float]:
    out = {}
    for text in given:
        name, _, value = text.partition("=")
        try:
            out[name] = float(value)
        except ValueError:
            raise InputError(f"--at {text}: an input with its value is wanted", mend="--at current=1.2") from None
    return out


def _interval(text: str) -> tuple[str, float | tuple[float, float]]:
    name, mark, ends = text.partition("=")
    try:
        values = [float(v) for v in ends.split(":")]
    except ValueError:
        values = []
    if not mark or len(values) not in (1, 2):
        raise InputError(f"--limit {text}: a control with its limits is wanted", mend="--limit force=-200:1500")
    return name, values[0] if len(values) == 1 else (values[0], values[1])
