"""Threads: one for BLAS on small matrices, where more cost ten times what they bring; several for independent work."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from threading import Lock, Thread, current_thread
from threading import enumerate as enumerate_threads
from typing import Any, Generic, TypeVar
from weakref import WeakSet

from lpvid.errors import InputError

T = TypeVar("T")
R = TypeVar("R")
MOST_WORKERS = 4
SHARE = "LPVID_PROCESSORS"
"""environment variable: most processors that a command and its processes may use side by side"""


class _Crew:
    """Threads at work; who waits for others does not count."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.busy = 1

    def hire(self, wanted: int) -> int:
        """As many of the threads that are wanted as there are processors for, at least the calling one."""
        with self.lock:
            found = max(min(wanted, processors() - self.busy + 1, MOST_WORKERS), 1)
            self.busy += found - 1
            return found

    def dismiss(self, count: int) -> None:
        """Give back so many of those that were hired."""
        with self.lock:
            self.busy -= count


_crew = _Crew()


def alone() -> None:
    """No further threads in this process: its neighbours have the processors."""
    with _crew.lock:
        _crew.busy = processors() + 1


_showing: WeakSet[Thread] = WeakSet()


@contextmanager
def showing_progress() -> Iterator[None]:
    """Threads begun inside the block do no more than write how the work goes: forks beside them are safe."""
    before = set(enumerate_threads())
    yield
    _showing.update(set(enumerate_threads()) - before)


def undisturbed() -> bool:
    """Whether no other thread of this process computes: a fork copies the calling one alone, with all locks as held."""
    return all(t is current_thread() or t in _showing for t in enumerate_threads())


@contextmanager
def hired(wanted: int) -> Iterator[int]:
    """As many of the requested processors as are free, at least the caller's own, inside the block."""
    found = _crew.hire(wanted)
    try:
        yield found
    finally:
        _crew.dismiss(found - 1)


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
    such work takes the processors that the outer one leaves, from the next item on where it leaves them later. An
    exception (or an interruption) ends it; what has not begun by then is not begun.

    Examples
    --------
    >>> in_parallel(abs, [-2, 1])
    [2, 1]
    """
    done: list[R] = []
    while len(done) < len(items):
        rest = items[len(done):]
        workers = _crew.hire(len(rest))
        done += [function(rest[0])] if workers < 2 else _shared(function, rest, workers)
    return done


def _shared(function: Callable[[T], R], items: Sequence[T], workers: int) -> list[R]:
    """The same by so many threads that have been hired, each of which is given back when nothing is left for it."""
    from concurrent.futures import ThreadPoolExecutor

    lock, left, hired = Lock(), len(items), workers

    def one(item: T) -> R:
        nonlocal left, hired
        try:
            return function(item)
        finally:
            with lock:
                left -= 1
                spare = max(hired - max(left, 1), 0)
                hired -= spare
            _crew.dismiss(spare)

    pool = ThreadPoolExecutor(workers)
    try:
        return list(pool.map(one, items))
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        _crew.dismiss(hired - 1)


class found_once(Generic[R]):
    """A property that is computed when it is first requested, without a lock.

    `functools.cached_property` of Python 3.11 holds one lock per class while it computes: two threads whose properties
    ask for each other's wait for ever. Here both may compute, and the later one is kept.

    Examples
    --------
    >>> class Square:
    ...     @found_once
    ...     def area(self):
    ...         print("computed")
    ...         return 4
    >>> s = Square()
    >>> s.area, s.area
    computed
    (4, 4)
    """

    def __init__(self, make: Callable[[Any], R]) -> None:
        self.make, self.__doc__ = make, make.__doc__

    def __get__(self, of: Any, kind: Any = None) -> R:
        if of is None:
            return self  # type: ignore[return-value]
        found = self.make(of)
        of.__dict__[self.make.__name__] = found
        return found


def processors() -> int:
    """Processors that this process may use: those of the system, no more than `SHARE` states where it is set.

    Returns
    -------
    int

    Raises
    ------
    InputError
        `SHARE` is no whole number from 1 on.
    """
    whole = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    stated = os.environ.get(SHARE, "")
    if not stated:
        return whole
    if not stated.isdecimal() or int(stated) < 1:
        raise InputError(f"{SHARE} is no number of processors", got=repr(stated),
                         mend="give a whole number from 1 on, or unset it")
    return min(whole, int(stated))
