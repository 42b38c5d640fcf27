"""The command line: `quartercar COMMAND`, one file per command."""

from __future__ import annotations


def main() -> None:
    """Entry point of the `quartercar` command."""
    from quartercar.cli.app import app

    app(prog_name="quartercar")


__all__ = ["main"]
