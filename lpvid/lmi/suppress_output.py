"""Silence for compiled code that writes to the terminal by itself."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

STREAMS = (1, 2)
"""Descriptors of standard output and standard error."""


@contextmanager
def quiet() -> Iterator[None]:
    """What is written below Python to standard output and error is dropped; no effect where that cannot be arranged.

    The descriptors belong to the whole process: output of other threads is dropped for as long.

    Yields
    ------
    None
        While nothing is printed.

    Examples
    --------
    >>> with quiet():
    ...     count = os.write(1, b"from far below")
    >>> count
    14
    """
    _flush()
    with ExitStack() as stack:
        with suppress(OSError):
            null = os.open(os.devnull, os.O_WRONLY)
            stack.callback(os.close, null)
            for descriptor in STREAMS:
                with suppress(OSError):
                    kept = os.dup(descriptor)
                    stack.callback(_restore, kept, descriptor)
                    os.dup2(null, descriptor)
        stack.callback(_flush)
        yield


def _flush() -> None:
    """Empty the buffers of Python and of the C library, so that nothing is written later, or elsewhere, than meant."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):
            stream.flush()
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).fflush(None)


def _restore(kept: int, descriptor: int) -> None:
    os.dup2(kept, descriptor)
    os.close(kept)
