"""Threads: one for BLAS on small matrices, where more cost ten times what they bring; several for independent work."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")
MOST_WORKERS = 4


class _Crew:
    """Threads at work; who waits for others does not count."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.busy = 1

    @contextmanager
    def hired(self, wanted: int) -> Iterator[int]:
        """As many of the threads that are wanted as there are processors for, at least the one that asks."""
        with self.lock:
            found = max(min(wanted, processors() - self.busy + 1, MOST_WORKERS), 1)
            self.busy += found - 1
        try:
            yield found
        finally:
            with self.lock:
                self.busy -= found - 1


_crew = _Crew()


@cache
def _controller():
    import numpy.linalg  # noqa: F401
    import scipy.linalg  # noqa: F401  (both libraries' BLAS must be loaded to be seen)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def single_thread() -> Iterator[None]:
    """Limit every BLAS to one thread inside the block; nests."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


def in_parallel(function: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Results of a function over independent items, in their order, by as many threads as there are processors.

    For work that spends its time in compiled loops and linear algebra, which let go of the interpreter. Work inside of
    such work takes the processors that the outer one leaves. An exception (or an interruption) ends it; what has not
    begun by then is not begun.

    Examples
    --------
    >>> in_parallel(abs, [-2, 1])
    [2, 1]
    """
    with _crew.hired(len(items)) as workers:
        if workers < 2:
            return [function(item) for item in items]
        from concurrent.futures import ThreadPoolExecutor

        pool = ThreadPoolExecutor(workers)
        try:
            return list(pool.map(function, items))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
