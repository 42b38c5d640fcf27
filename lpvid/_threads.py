"""Threads: one for BLAS on small matrices, where more cost ten times what they bring; several for independent work."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")
MOST_WORKERS = 4


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

    For work that spends its time in compiled loops and linear algebra, which let go of the interpreter. An exception
    (or an interruption) ends it; what has not begun by then is not begun.

    Examples
    --------
    >>> in_parallel(abs, [-2, 1])
    [2, 1]
    """
    workers = min(len(items), processors(), MOST_WORKERS)
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
