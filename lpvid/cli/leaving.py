"""Ctrl-C before a command has begun: while its modules load and its words are read, nothing is there to keep.

The handler ends the process itself. An exception would pass through half-loaded modules, of which those in C turn it
into errors of their own.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from types import FrameType

INTERRUPTED = 130
"""Exit code after Ctrl-C, whether a partial result was kept or none."""
NOTHING_WRITTEN = "interrupted: nothing was written"


def run_program(load: Callable[[], Callable[..., object]], name: str) -> None:
    """Load a program and run it; Ctrl-C ends it with one line and exit code 130 from here on, or by itself at the end.

    Parameters
    ----------
    load : callable
        Imports the program, which takes ``prog_name``.
    name : str
        Of the program, for its help.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # a shell may have it ignored
        signal.signal(signal.SIGINT, _leave)
    try:
        load()(prog_name=name)
    finally:  # what was to be written is
        if signal.getsignal(signal.SIGINT) in (signal.default_int_handler, _leave):
            signal.signal(signal.SIGINT, signal.SIG_DFL)


def command_begins() -> None:
    """From here on Ctrl-C is an exception: the command keeps what it has, or states that it keeps nothing."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, f"{NOTHING_WRITTEN}\n".encode())
    os._exit(INTERRUPTED)
