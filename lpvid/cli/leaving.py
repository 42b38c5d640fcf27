"""Ctrl-C before a command has begun: while its modules load and its words are read, nothing is there to keep.

The handler ends the process itself. An exception would pass through half-loaded modules, of which those in C turn it
into errors of their own.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType

INTERRUPTED = 130
"""Exit code after Ctrl-C, whether a partial result was kept or none."""
NOTHING_WRITTEN = "interrupted: nothing was written"
_pressed = threading.Event()


def run_program(load: Callable[[], Callable[..., object]], name: str) -> None:
    """Load a program and run it; Ctrl-C ends it with one line and exit code 130 from here on.

    A caller that goes on behind it has its own handler again. Where the process ends, Ctrl-C ends it by itself: what
    was to be written is.

    Parameters
    ----------
    load : callable
        Imports the program, which takes ``prog_name``.
    name : str
        Of the program, for its help.
    """
    # a shell may have it ignored, and only the main thread may handle it
    ours = (threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGINT) is signal.default_int_handler)
    if ours:
        signal.signal(signal.SIGINT, _leave)
        before, sys.unraisablehook = sys.unraisablehook, _without_interrupts
        atexit.unregister(_end_by_itself)
        atexit.register(_end_by_itself)
    try:
        load()(prog_name=name)
    finally:
        if ours and signal.getsignal(signal.SIGINT) in (_leave, _interrupt):
            signal.signal(signal.SIGINT, signal.default_int_handler)
            sys.unraisablehook = before


def command_begins() -> None:
    """From here on Ctrl-C is an exception: the command keeps what it has, or states that it keeps nothing."""
    _pressed.clear()
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, _interrupt)


def was_pressed() -> bool:
    """Whether Ctrl-C was pressed since the command began: a compiler in C turns the exception into errors of its own.

    Returns
    -------
    bool
    """
    return _pressed.is_set()


def _without_interrupts(found: sys.UnraisableHookArgs) -> None:
    """Print an exception that nothing can catch, but for a Ctrl-C inside a callback from C."""
    if not issubclass(found.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(found)


def _interrupt(number: int, frame: FrameType | None) -> None:
    _pressed.set()
    signal.default_int_handler(number, frame)


def _end_by_itself() -> None:
    """Where Python ends: its modules are taken down, and an exception among them would be a traceback."""
    if signal.getsignal(signal.SIGINT) in (_interrupt, signal.default_int_handler):
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, f"{NOTHING_WRITTEN}\n".encode())
    os._exit(INTERRUPTED)
