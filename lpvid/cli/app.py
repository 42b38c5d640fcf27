"""The `lpvid` application: its commands and what they share."""

from __future__ import annotations

from typing import Annotated

import typer

from lpvid.cli.compare import compare
from lpvid.cli.diagnose import diagnose
from lpvid.cli.export import export
from lpvid.cli.identify import identify
from lpvid.cli.inspect import inspect
from lpvid.cli.running import new_app
from lpvid.cli.simulate import simulate
from lpvid.cli.stability import stability
from lpvid.cli.synthesize import synthesize, verify
from lpvid.cli.validate import validate

app = new_app()


def _version(value: bool) -> None:
    if value:
        from lpvid import __version__

        typer.echo(f"lpvid {__version__}")
        raise typer.Exit


@app.callback()
def _common(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                                  help="Print the version and stop.")] = False) -> None:
    """Identify LPV models from measured data, say how good and how stable they are, and what a simulation gets wrong.

    Exit codes: 0 done; 2 the input is at fault (one line says what, nothing is written); 3 a numerical outcome short of
    what was asked, with the result written.
    """


for _command in (inspect, identify, simulate, validate, compare, stability, diagnose, synthesize, verify, export):
    app.command()(_command)
