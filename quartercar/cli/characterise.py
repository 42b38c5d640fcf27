"""`quartercar characterise`: the page of a damper dynamometer, from raw records."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.running import Results, command, conclude, working
from lpvid.errors import InputError

if TYPE_CHECKING:
    from quartercar.characterisation import Characterisation, CharacteriseSettings, Tolerance
    from quartercar.dampers.contract import Damper


@command
def characterise(
    data: options.Data,
    damper: Annotated[Path | None, typer.Option("--damper", metavar="FILE", help="A damper model to draw beside the "
                                                "measurement: what fit or lpvid identify wrote.")] = None,
    speeds: Annotated[list[str] | None, typer.Option("--speeds", metavar="M/S", help="Speeds of the force table, with "
                                                     "commas; left out: .05,.1,.13,.26,.3,.52,.6,1.05.")] = None,
    rebound: Annotated[str, typer.Option("--rebound", metavar="SIGN", help="Show rebound forces positive or "
                                         "negative.")] = "positive",
    tolerance: Annotated[str | None, typer.Option("--tolerance", metavar="BAND", help="10%+20N about the nominal "
                                                  "forces (--nominal, else the mean of the specimens), or a CSV with "
                                                  "columns speed, direction, lower, upper.")] = None,
    nominal: Annotated[Path | None, typer.Option("--nominal", metavar="CSV", help="Nominal forces: speed, direction, "
                                                 "force, current; forces.csv of an earlier run will do.")] = None,
    specimen: Annotated[str, typer.Option("--specimen", metavar="PATTERN", help="'file' for one specimen per file, or "
                                          "a regular expression on the file name whose group names it: "
                                          "'(S[0-9]+)_'.")] = "",
    delay: Annotated[list[str] | None, typer.Option("--delay", metavar="ROLE=TIME", help="Known delay of a sensor and "
                                                    "its filter, taken off: force=1.2ms.")] = None,
    input: options.Inputs = None,
    output: options.Outputs = None,
    schedule: options.Schedule = None,
    role: options.Role = None,
    flip: options.Flip = None,
    sample_rate: options.SampleRateOrRaw = None,
    out: options.Out = None,
    json: options.Json = False,
) -> None:
    """Read off raw records what a damper dynamometer shows, without a model.

    Forces at standard speeds, peak- and continuous-velocity plots, loops, gas force and friction, hysteresis, spread
    over the current, switching time, drift, velocity histogram, tolerance bands. What the records do not hold is listed
    with the test that gives it.
    """
    from lpvid.cli.data import asked_rate, read_clocked, split_names
    from lpvid.cli.parts import damper_parts
    from lpvid.training_fingerprint import recalled
    from quartercar.characterisation import Tolerance
    from quartercar.characterisation import characterise as characterised
    from quartercar.dampers import load_damper

    results = Results(out, "characterisation.json", "report.html")
    settings = _settings(speeds, rebound, specimen, delay, asked_rate(sample_rate))
    band = _band(tolerance, nominal, Tolerance)
    model: Damper | None = None if damper is None else load_damper(damper)
    with working("reading") as report_progress:
        records, _ = read_clocked(data, roles=role, flip=flip, sample_rate=settings.sample_rate, like=model)
        named = (split_names(input), split_names(output), split_names(schedule))
        records = recalled([damper_parts(r, *named) for r in records], {} if model is None else model.metadata)
        found = characterised(records, settings, damper=model, tolerance=band, report_progress=report_progress)
        _deliver(results, found, report_progress)
    conclude(results, found.to_dict(), str(found), json)


def _settings(speeds: list[str] | None, rebound: str, specimen: str, delay: list[str] | None,
              rate: tuple[float | None, bool]) -> CharacteriseSettings:
    from lpvid.cli.data import split_names
    from lpvid.units import quantity_to_si
    from quartercar.characterisation import CharacteriseSettings
    from quartercar.characterisation.settings import SPEEDS

    asked = tuple(_speed(text) for text in split_names(speeds)) or SPEEDS
    delays = {}
    for text in split_names(delay):
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError("--delay takes ROLE=TIME", got=repr(text), mend="e.g. --delay force=1.2ms")
        seconds, unit = quantity_to_si(value.strip() if not _bare(value) else float(value))
        if unit not in ("s", ""):
            raise InputError("--delay takes a time", got=repr(text), mend="e.g. --delay force=1.2ms")
        delays[name.strip()] = seconds
    return CharacteriseSettings(asked, rebound.strip().lower(), rate[0], rate[1], delays, specimen)  # type: ignore[arg-type]


def _bare(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _speed(text: str) -> float:
    from lpvid.units import quantity_to_si

    if _bare(text):
        return float(text)
    mend = "e.g. --speeds 0.1,0.3,0.6 or '100 mm/s'"
    try:
        speed, unit = quantity_to_si(text.strip())
    except InputError:
        raise InputError("--speeds takes numbers in m/s, or speeds", got=repr(text), mend=mend) from None
    if unit != "m/s":
        raise InputError("--speeds takes numbers in m/s, or speeds", got=repr(text), mend=mend)
    return speed


def _band(tolerance: str | None, nominal: Path | None, kind: type[Tolerance]) -> Tolerance | None:
    if tolerance is None:
        if nominal is not None:
            raise InputError("--nominal needs the width of its band", mend="add --tolerance 10%+20N")
        return None
    return kind.parse(tolerance, nominal)


def _deliver(results: Results, found: Characterisation, report_progress) -> None:
    """Queue characterisation.json, the tables, the figures and the report."""
    if not results.kept:
        return
    from quartercar.characterisation.figures import figures_of
    from quartercar.characterisation.page import characterisation_page
    from quartercar.characterisation.tables import named_tables

    report_progress("drawing")
    results.json("characterisation.json", found.to_dict())
    for name, text in named_tables(found).items():
        results.bytes(name, text.encode("utf-8"))
    figures = figures_of(found)
    results.figures(figures)
    results.report(characterisation_page(found, figures))
