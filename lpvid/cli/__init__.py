"""The command line: `lpvid COMMAND`, one file per command."""

from __future__ import annotations

from collections.abc import Callable

from lpvid.cli.leaving import run_program


def main() -> None:
    """Entry point of the `lpvid` command."""
    run_program(_app, "lpvid")


def _app() -> Callable[..., object]:
    from lpvid.cli.app import app

    return app


__all__ = ["main"]
