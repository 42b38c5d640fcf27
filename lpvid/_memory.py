"""Memory: what was freed goes back to the system."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache

MMAP_THRESHOLD, TRIM_THRESHOLD = -3, -1
"""numbers of glibc's mallopt"""
LARGEST = 32 << 20
"""bytes, the largest threshold that glibc sets by itself"""


def give_back() -> None:
    """Hand freed memory back to the system, where the C library keeps it (glibc).

    Threads that take and free arrays of many sizes leave gaps, which count as used: a diagnosis that holds 230 MB was
    seen to occupy 1.2 GB, and some of an hour's scoreboard nine.
    """
    trim = _trim()
    if trim is not None:
        trim(0)


@cache
def keep_for_reuse() -> None:
    """Let the C library (glibc) take arrays of up to 32 MB from memory that it holds, rather than from the system.

    Work in parts takes and frees the same few arrays of some hundred kilobytes again and again. A program that has
    freed no larger one yet gets each of them as new pages, which took a quarter of the processor's time of a
    regression. Once it has freed one of 32 MB, the library does by itself what is asked for here, with these very
    bounds (``DEFAULT_MMAP_THRESHOLD_MAX``, and twice that for what stays free at the end of the heap).
    """
    set_option = of_library("mallopt")
    if set_option is not None:
        set_option(MMAP_THRESHOLD, LARGEST)
        set_option(TRIM_THRESHOLD, 2 * LARGEST)


def of_library(name: str) -> Callable[..., int] | None:
    """A function of the C library, where it is Linux's."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform.startswith("linux") else None


@cache
def _trim() -> Callable[[int], int] | None:
    return of_library("malloc_trim")
