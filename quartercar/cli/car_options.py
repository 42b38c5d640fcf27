"""Options of the commands that build a car (`design`, `ride`, `export`), beside those of `lpvid.cli.options`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Config = Annotated[Path | None, typer.Argument(metavar="CONFIG", help="A TOML file; --template prints one. Options "
                                               "take precedence over it.", show_default=False)]
Car = Annotated[str | None, typer.Option("--car", metavar="NAME", help="Parameter set of the car.")]
DamperFile = Annotated[Path | None, typer.Option("--damper", metavar="FILE", help="A model.json of lpvid identify, or "
                                                 "a damper that fit wrote; left out: the embedded one.")]
Measurements = Annotated[str | None, typer.Option("--measurements", metavar="SET", help="stroke-body (the default), "
                                                  "stroke-body-wheel or ideal.")]
Template = Annotated[bool, typer.Option("--template", help="Print a commented configuration and stop.")]
