"""Functions that a worker process imports by their names: this folder stands on its path."""

from __future__ import annotations

import os
import signal
import struct
from typing import Any

from lpvid import _workers


def copied(given: object) -> object:
    """What it was given, after its way to the worker and back."""
    return given


class TwoParts(Exception):
    """An error that pickle writes and cannot read: it has one argument then."""

    def __init__(self, first: int, second: int) -> None:
        super().__init__(f"{first} of {second}")


class Unwritable:
    """A value that pickle cannot write, nor say so by an error of its own."""

    def __getstate__(self) -> Any:
        raise RecursionError("too deep")


def unreadable_error(k: int) -> int:
    """The number, but for 1 an error that cannot be read."""
    if k == 1:
        raise TwoParts(k, 2)
    return k


def unwritable(k: int) -> object:
    """The number, but for 1 a value that cannot be written."""
    return Unwritable() if k == 1 else k


def killed_amid_its_answer(k: int) -> int:
    """The number; the worker is killed when it has sent a part of the answer after that of 0."""
    def begun(stream: Any, held: Any) -> None:
        stream.write(struct.pack("<Q", held.getbuffer().nbytes) + held.getbuffer()[:4])
        stream.flush()
        os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))

    if k == 0:
        _workers._send = begun  # a call looks its function up before the arguments: this answer is sent whole
    return k
