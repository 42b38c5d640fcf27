"""Workers: processes that compute items one after the other, forks of this one or fresh interpreters."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import struct
import subprocess
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from io import BytesIO
from queue import SimpleQueue
from threading import Thread
from types import MappingProxyType
from typing import Any, BinaryIO, Protocol

from lpvid import _threads
from lpvid._memory import give_back, of_library

PARENT_DEATH_SIGNAL = 1
"""Linux's PR_SET_PDEATHSIG: the signal that a process gets when the thread that began it ends"""
WORKER = "from lpvid._workers import serve; serve({})"


class Worker(Protocol):
    """A process that computes items."""

    def result(self, k: int) -> tuple[bool, Any]:
        """Whether item k succeeded, and its value or exception.

        Parameters
        ----------
        k : int

        Returns
        -------
        bool, object

        Raises
        ------
        OSError, EOFError
            The process died.
        """
        ...

    def kill(self) -> None:
        """End the process amid its work."""
        ...

    def end(self) -> None:
        """No process, no open pipe is left behind."""
        ...


class FreshWorker:
    """A fresh interpreter, to which the function and every item are sent.

    Parameters
    ----------
    function : callable
        Found there by its module and name.
    items : sequence
    """

    def __init__(self, function: Callable[[Any], Any], items: Sequence[Any]) -> None:
        self.function, self.items = function, items
        quiet = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1",
                 "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        self.process = subprocess.Popen([sys.executable, "-c", WORKER.format(os.getpid())], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, env=quiet, start_new_session=True)

    def result(self, k: int) -> tuple[bool, Any]:
        assert self.process.stdin is not None and self.process.stdout is not None
        try:
            held = packed((self.function, self.items[k]))
        except Exception as error:
            return False, RuntimeError(f"it cannot be sent to another process: {error}")
        _send(self.process.stdin, held)
        return pickle.loads(_bytes(self.process.stdout))

    def kill(self) -> None:
        self.process.kill()

    def end(self) -> None:
        self.process.kill()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with suppress(OSError):  # what was still to be sent to a dead process
                    pipe.close()
        self.process.wait()


class ForkedWorker:
    """A fork of this process (Linux), which holds the function and all items; it is sent their numbers alone.

    What both hold is in memory once, libraries included, until one of them writes to it.

    Parameters
    ----------
    function : callable
    items : sequence
    others : sequence of ForkedWorker
        Forked before: this one is no end of their pipes.
    """

    def __init__(self, function: Callable[[Any], Any], items: Sequence[Any], others: Sequence[ForkedWorker]) -> None:
        asked, ask = os.pipe()
        answers, answer = os.pipe()
        parent = os.getpid()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12: threads of libraries, idle here
                self.pid = os.fork()
        except OSError:
            for end in (asked, ask, answers, answer):
                os.close(end)
            raise
        if not self.pid:
            try:
                for end in (ask, answers, *(e.fileno() for o in others for e in (o.ask, o.answers))):
                    os.close(end)
                _serve_forked(parent, function, items, asked, answer)
            finally:
                os._exit(1)  # nothing of the parent's is flushed or closed here
        os.close(asked)
        os.close(answer)
        self.ask, self.answers, self.waited = os.fdopen(ask, "wb"), os.fdopen(answers, "rb"), False

    def result(self, k: int) -> tuple[bool, Any]:
        self.ask.write(struct.pack("<Q", k))
        self.ask.flush()
        return pickle.loads(_bytes(self.answers))

    def kill(self) -> None:
        if not self.waited:
            with suppress(ProcessLookupError):  # the caller ignores SIGCHLD: it is waited for by the system
                os.kill(self.pid, signal.SIGKILL)

    def end(self) -> None:
        self.kill()
        for pipe in (self.ask, self.answers):
            with suppress(OSError):  # what was still to be sent to a dead process
                pipe.close()
        if not self.waited:
            self.waited = True  # from here on no other thread signals a number that may be another process's
            with suppress(ChildProcessError):
                os.waitpid(self.pid, 0)


# -- between the processes ---------------------------------------------------------------------------------------------
class Pickler(pickle.Pickler):
    """Read-only mappings, which records and models hold, as what they are."""

    def reducer_override(self, obj: Any) -> Any:
        return (_read_only, (dict(obj),)) if isinstance(obj, MappingProxyType) else NotImplemented


def _read_only(data: dict) -> MappingProxyType:
    """A class that pickle cannot find by its name."""
    return MappingProxyType(data)


def packed(data: Any) -> BytesIO:
    """Data as they are sent.

    Parameters
    ----------
    data : object

    Returns
    -------
    BytesIO
    """
    held = BytesIO()
    Pickler(held, protocol=pickle.HIGHEST_PROTOCOL).dump(data)
    return held


def _send(stream: BinaryIO | Any, held: BytesIO) -> None:
    stream.write(struct.pack("<Q", held.getbuffer().nbytes))
    stream.write(held.getbuffer())
    stream.flush()


def _number(stream: BinaryIO | Any) -> int:
    head = stream.read(8)
    if len(head) < 8:
        raise EOFError
    return struct.unpack("<Q", head)[0]


def _bytes(stream: BinaryIO | Any) -> bytes:
    size = _number(stream)
    found = stream.read(size)
    if len(found) < size:  # the other end died amid what it sent
        raise EOFError
    return found


# -- in the worker -----------------------------------------------------------------------------------------------------
def ends_with_parent(parent: int) -> None:
    """End this process when its parent has ended, however that was (Linux).

    Elsewhere nothing is done: the end of what a worker reads ends it. Windows may begin the interpreter of a virtual
    environment by another process, which is its parent.

    Parameters
    ----------
    parent : int
        Number of the process that began this one: it may have ended already.
    """
    control = of_library("prctl")
    if control is None:
        return
    control(PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


_of_parent: list[object] = []
"""a fork's parent's streams: one that nothing refers to writes what is in its buffer, which the parent writes too"""


def print_to_error_output() -> None:
    """Let a fork print to file descriptor 2, by a stream of its own: the parent's may be locked."""
    _of_parent.extend((sys.stdout, sys.stderr))
    sys.stdout = sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115


def _answer(function: Callable[[Any], Any], item: Any) -> BytesIO:
    """Whether it succeeded, and its value or exception, as they are sent.

    Pickle calls the class of an exception with its `args`, which not every `__init__` takes: one that cannot be read
    is sent by its name and text.
    """
    try:
        answer = True, function(item)
    except Exception as error:
        answer = False, error
        with suppress(Exception):
            held = packed(answer)
            pickle.loads(held.getbuffer())
            return held
        answer = False, RuntimeError(f"{type(error).__name__}: {error}")
    try:
        return packed(answer)
    except Exception as error:
        return packed((False, RuntimeError(f"the result cannot be sent: {error}")))


def _settle() -> None:
    """Several workers together: what one item left is not carried through the next."""
    gc.collect()
    give_back()


def _items(stream: BinaryIO, received: SimpleQueue[bytes]) -> None:
    """Hand on what comes; where nothing can come any more the parent has ended, and this process does, on any system.

    Not amid a call that keeps the interpreter's lock.
    """
    with suppress(EOFError):
        while True:
            received.put(_bytes(stream))
    os._exit(1)


def serve(parent: int) -> None:
    """A fresh worker: items from standard input, results to standard output; what the work prints to standard error.

    It ends with the process that began it, of that number, amid its work.
    """
    ends_with_parent(parent)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _threads.alone()
    received: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_items, args=(sys.stdin.buffer, received), daemon=True).start()
    while True:
        try:
            function, item = pickle.loads(received.get())
        except Exception as error:
            _send(answers, packed((False, RuntimeError(f"it cannot be read in another process: {error}"))))
            continue
        _send(answers, _answer(function, item))
        del function, item
        _settle()


def _serve_forked(parent: int, function: Callable[[Any], Any], items: Sequence[Any], asked: int, answer: int) -> None:
    """A fork at work, until its parent closes the pipe of numbers; what the work prints goes to standard error."""
    os.setsid()  # an interruption at the terminal is the parent's
    ends_with_parent(parent)
    os.dup2(2, 1)
    print_to_error_output()
    gc.freeze()  # what the parent holds is not looked through, which would copy its pages
    _threads.alone()
    with os.fdopen(asked, "rb") as numbers, os.fdopen(answer, "wb") as answers, suppress(EOFError), \
            _threads.single_thread():
        while True:
            _send(answers, _answer(lambda k: function(items[k]), _number(numbers)))
            _settle()
