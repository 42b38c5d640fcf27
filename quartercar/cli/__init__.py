"""The command line: `quartercar COMMAND`, one file per command."""

from __future__ import annotations

from collections.abc import Callable

from lpvid.cli.leaving import run_program


def main() -> None:
    """Entry point of the `quartercar` command."""
    run_program(_app, "quartercar")


def _app() -> Callable[..., object]:
    from quartercar.cli.app import app

    return app


__all__ = ["main"]
