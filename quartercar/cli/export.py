"""`quartercar export`: the loop law of a car, from sensor readings to current, for a controller unit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lpvid.cli import options
from lpvid.cli.export import Name, Precision, To, deliver
from lpvid.cli.running import Results, command, solver_output_suppressed, working
from quartercar.cli import car_options

if TYPE_CHECKING:
    from quartercar.controllers.contract import Controller
    from quartercar.export.loop_steps import LoopLaw

ConfigFile = Annotated[Path | None, typer.Argument(metavar="CONFIG", help="A TOML file of quartercar ride; left out, "
                                                   "the default car.", show_default=False)]


@command
def export(
    config: ConfigFile = None,
    controller: Annotated[str, typer.Option("--controller", metavar="LAW", help="A law by name, a controller.json, or "
                                            "a controller of CONFIG.")] = "skyhook",
    to: To = "c",
    car: Annotated[str | None, typer.Option("--car", metavar="NAME", help="Parameter set of the car, without "
                                            "CONFIG.")] = None,
    damper: Annotated[Path | None, typer.Option("--damper", metavar="FILE", help="A damper that fit wrote, without "
                                                "CONFIG; left out: the embedded identified one.")] = None,
    measurements: car_options.Measurements = None,
    road_ahead: Annotated[int | None, typer.Option("--road-ahead", metavar="SAMPLES", min=0, help="Coming samples "
                                                   "whose road is known, each an input: 69 for 2.7 m at 20 m/s and 512 "
                                                   "Hz. For preview-lqr and preview-lpv.")] = None,
    out: options.Out = None,
    name: Name = "",
    precision: Precision = "double",
    json: options.Json = False,
) -> None:
    """One control law with its observer and inverse damper model, as `quartercar ride` runs it, for other tools.

    Input: the sensors' readings at a sample, and what is known of the road ahead; output: the current to command until
    the next. Dampers and laws alone are exported by `lpvid export`. Forms, checks and exit codes are those of that.
    """
    from lpvid.export.exportable import Options
    from lpvid.export.exporting import content
    from lpvid.export.step_builder import checked_name

    results = Results(out)
    with working(f"exporting to {to}"), solver_output_suppressed():
        checked_name(name)
        loop = _loop(config, controller, car, damper, measurements, road_ahead)
        found = content(loop, to, Options(name), precision)
    deliver(results, found, str(config or "the default car"), json)


def _loop(config: Path | None, controller: str, car: str | None, damper: Path | None,
          measurements: str | None, road_ahead: int | None) -> LoopLaw:
    """The loop of a configuration with one of its laws, or with another one."""
    from dataclasses import replace

    from quartercar.export.loop_steps import LoopLaw
    from quartercar.rides.config import RideConfig, build_car, given_laws, load_config, measuring

    base = load_config(config, car, damper) if config is not None else \
        RideConfig(build_car(car or "megane", None if damper is None else str(damper)))
    law = dict(base.controllers).get(controller) if config is not None else None
    law = law or next(iter(given_laws((controller,)).values()))
    settings = base.settings if measurements is None else measuring(measurements)
    return LoopLaw(law, replace(settings.setting(base.car, 1), preview=_samples(law, road_ahead)), base.car.coil,
                   settings.chain)


def _samples(law: Controller, given: int | None) -> int:
    """Samples of the road ahead that a law is exported with: stated for one that reads them, none for another."""
    from lpvid.errors import InputError
    from quartercar.controllers.laws.preview_model import LinearPreview

    if not isinstance(law, LinearPreview):
        if given:
            raise InputError(f"'{law.name}' does not export with a road ahead", got=f"--road-ahead {given}",
                             mend="leave it out, or export preview-lpv or preview-lqr")
        return 0
    if given is None:
        raise InputError(f"'{law.name}' reads the road ahead, and how far is not stated",
                         mend="--road-ahead 69 for 2.7 m at 20 m/s and 512 Hz, --road-ahead 0 for none")
    return given
