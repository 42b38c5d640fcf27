"""The `quartercar` application: its commands and what they share."""

from __future__ import annotations

from typing import Annotated

import typer

from lpvid.cli.running import new_app
from quartercar.cli.characterise import characterise
from quartercar.cli.demo import demo
from quartercar.cli.design import design
from quartercar.cli.export import export
from quartercar.cli.fit import fit
from quartercar.cli.ride import ride
from quartercar.cli.rig import rig

app = new_app()


def _version(value: bool) -> None:
    if value:
        from lpvid import __version__

        typer.echo(f"quartercar {__version__}")
        raise typer.Exit


@app.callback()
def _common(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                                  help="Print the version and stop.")] = False) -> None:
    """Dampers and quarter cars: a virtual test rig, damper models fitted and compared, and the road to stability.

    Exit codes: 0 done; 2 the input is at fault (one line says what, nothing is written); 3 a numerical outcome short of
    what was asked, with the result written.
    """


for _command in (rig, characterise, fit, design, ride, export, demo):
    app.command()(_command)
