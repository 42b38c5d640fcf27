"""Independent work in forks of this process: what it holds is there at once, and Python's loops run side by side."""

from __future__ import annotations

import gc
import os
import pickle
import select
import signal
import struct
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from io import BytesIO
from time import process_time
from typing import Any, TypeAlias, TypeVar

from lpvid import _threads
from lpvid._workers import Pickler, ends_with_parent, print_to_error_output

T = TypeVar("T")
R = TypeVar("R")
Answer: TypeAlias = tuple[bool, Any, list[tuple[Warning | str, str, int]]]
"""whether it succeeded, its value or exception, its warnings with file and line"""


def in_forks(function: Callable[[T], R], items: Sequence[T], shared: Sequence[object] = (), *, threads: bool = True
             ) -> list[R]:
    """Results of a function over independent items, in their order, by as many processes as there are processors.

    The processes are forks (Linux): the function and the items need not be sent, and what the caller holds is not
    copied before it is written to. Each takes the next item when it is done with one. Only results are sent back.
    What a killed fork had done, or cannot send, is computed here. Where no fork is safe, beside other threads of
    this process or on other systems, `in_parallel` does the same by threads, or this process does it alone.

    Parameters
    ----------
    function : callable
        Of one item; what it leaves in caches is lost where a fork computed it.
    items : sequence
    shared : sequence of object
        What results refer to and the caller holds: it is referred to in what is sent, not copied.
    threads : bool
        Whether threads may compute the function side by side.

    Returns
    -------
    list
        An exception of the function is raised, of several that of the first item; an interruption ends the work.
        Warnings are issued here, in the order of the items, up to the one that is raised.

    Examples
    --------
    >>> in_forks(abs, [-2, 1])
    [2, 1]
    """
    if not _possible(len(items)):
        return _threads.in_parallel(function, items) if threads else [function(item) for item in items]
    with _threads.hired(len(items)) as workers:
        found = _by_forks(function, items, shared, workers - 1) if workers > 1 else {}
        results: list[R] = []
        for k, item in enumerate(items):
            if k not in found:
                found[k] = True, function(item), []
            good, value, warned = found[k]
            for warning in warned:
                _issue(*warning)
            if not good:
                raise value
            results.append(value)
        return results


def processor_time() -> float:
    """Processor time of this process and of its forks that have ended [s].

    How many items of `in_forks` the caller works on itself depends on what else the machine does; the sum does not.

    Returns
    -------
    float
    """
    ended = os.times()
    return process_time() + ended.children_user + ended.children_system


def _possible(count: int) -> bool:
    return sys.platform == "linux" and _threads.undisturbed() and 2 * count <= select.PIPE_BUF


def _by_forks(function: Callable[[T], R], items: Sequence[T], shared: Sequence[object], forks: int
              ) -> dict[int, Answer]:
    """Of each item that was taken."""
    source, into = os.pipe()
    os.write(into, struct.pack(f"<{len(items)}H", *range(len(items))))  # two bytes apiece: a read of them is one
    os.close(into)
    begun: list[tuple[int, int]] = []
    found: dict[int, Answer] = {}
    try:
        with suppress(OSError):  # no room for another process: fewer of them
            for _ in range(forks):
                begun.append(_begin(function, items, shared, source))
        for k in _taken(source):
            found[k] = _attempt(function, items[k])
        for _, answers in begun:
            with os.fdopen(os.dup(answers), "rb") as stream:
                sent = stream.read()
            try:
                found |= _Reader(BytesIO(sent), shared).load()
            except Exception:  # it was killed, or what it sent cannot be read: its items are missing
                continue
        return found
    finally:
        os.close(source)
        for pid, answers in begun:
            os.close(answers)
            with suppress(ChildProcessError, ProcessLookupError):  # the caller ignores SIGCHLD: it is waited for
                if os.waitpid(pid, os.WNOHANG) == (0, 0):
                    os.kill(pid, signal.SIGKILL)
                    os.waitpid(pid, 0)


def _begin(function: Callable[[T], R], items: Sequence[T], shared: Sequence[object], source: int) -> tuple[int, int]:
    """A fork at work: its number, and where its answers come from."""
    answers, out = os.pipe()
    parent = os.getpid()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12: threads of libraries, which are idle here
        pid = os.fork()
    if pid:
        os.close(out)
        return pid, answers
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends the work
        print_to_error_output()
        ends_with_parent(parent)
        gc.freeze()  # what the parent holds is not looked through, which would copy its pages
        _threads.alone()
        held = BytesIO()
        done = {k: _attempt(function, items[k]) for k in _taken(source)}
        _Sender(held, shared).dump({k: a for k, a in done.items() if _arrives(a, shared)})
        with os.fdopen(out, "wb") as stream:
            stream.write(held.getbuffer())
    finally:
        os._exit(0)  # nothing of the parent's is flushed or closed here


def _taken(source: int) -> Iterator[int]:
    """Items that nobody else has taken."""
    while two := os.read(source, 2):
        yield struct.unpack("<H", two)[0]


def _attempt(function: Callable[[T], R], item: T) -> Answer:
    with warnings.catch_warnings(record=True) as seen:  # under the caller's filters, of which "error" raises here
        warnings.filters = [("default" if f[0] == "once" else f[0], *f[1:]) for f in warnings.filters]  # once: _issue
        try:
            good, value = True, function(item)
        except Exception as error:
            good, value = False, error
    return good, value, [(w.message, w.filename, w.lineno) for w in seen]


def _issue(message: Warning | str, filename: str, line: int) -> None:
    """A warning that was recorded, as from its line: filters go by its module, whose registry holds what was shown."""
    of = next((vars(m) for m in list(sys.modules.values()) if getattr(m, "__file__", None) == filename), {})
    warnings.warn_explicit(message, type(message), filename, line, of.get("__name__"),  # pyright: ignore
                           of.setdefault("__warningregistry__", {}))


def _arrives(answer: Answer, shared: Sequence[object]) -> bool:
    """Whether errors and warnings can be read: pickle calls a class with `args`, which not every `__init__` takes."""
    good, value, warned = answer
    if good and not warned:
        return True
    held = BytesIO()
    try:
        _Sender(held, shared).dump((None if good else value, warned))
        _Reader(BytesIO(held.getvalue()), shared).load()
    except Exception:
        return False
    return True


class _Sender(Pickler):
    """What both processes hold, by its address, which is the same in a fork."""

    def __init__(self, file: BytesIO, shared: Sequence[object]) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self.held = {id(o) for o in shared}

    def persistent_id(self, obj: Any) -> int | None:
        return id(obj) if id(obj) in self.held else None


class _Reader(pickle.Unpickler):
    def __init__(self, file: BytesIO, shared: Sequence[object]) -> None:
        super().__init__(file)
        self.held = {id(o): o for o in shared}

    def persistent_load(self, pid: Any) -> Any:
        return self.held[pid]
