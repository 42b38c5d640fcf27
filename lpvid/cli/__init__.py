"""The command line: `lpvid COMMAND`, one file per command."""

from __future__ import annotations


def main() -> None:
    """Entry point of the `lpvid` command."""
    from lpvid.cli.app import app

    app(prog_name="lpvid")


__all__ = ["main"]
