"""Independent work in processes of its own: Python's loops run side by side, and what takes too long is stopped."""

from __future__ import annotations

import os
import pickle
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from gc import collect
from io import BytesIO
from queue import Empty, Queue, SimpleQueue
from threading import Lock, Thread
from types import MappingProxyType
from typing import Any, BinaryIO, Generic, TypeVar

from lpvid import _threads
from lpvid._memory import give_back, of_library

T = TypeVar("T")
R = TypeVar("R")
KNOWN = 0.1
"""part of all costs from which their rate is estimated: the seconds in which a process begins would count tenfold"""
POLL = 0.2
"""Time between two looks at the clock while work goes on [s]."""
PARENT_DEATH_SIGNAL = 1
"""Linux's PR_SET_PDEATHSIG: the signal that a process gets when the thread that began it ends"""
WORKER = "from lpvid._processes import serve; serve({})"


@dataclass(frozen=True, eq=False)
class Done(Generic[R]):
    """How one item ended: with a value, with an error, or not at all.

    Attributes
    ----------
    value : object
    error : Exception or None
    stopped : str
        Why it was not finished: "budget" or "interrupted"; empty where it was.
    seconds : float
    """

    value: R | None = None
    error: Exception | None = None
    stopped: str = ""
    seconds: float = 0.0


def in_processes(function: Callable[[T], R], items: Sequence[T], *, workers: int | None = None,
                 budget: float | None = None, costs: Sequence[float] | None = None,
                 report_progress: Callable[[int, list[int], float | None], None] = lambda done, running, left: None,
                 ) -> list[Done[R]]:
    """Results of a function over independent items, in their order, whatever the number of processes.

    Each worker is a fresh interpreter that is handed one item after the other, in their order, with one BLAS thread.
    The script that calls this is not run again there: the function must be importable by its module and name.

    Parameters
    ----------
    function : callable
        Of one item; both and the results can be pickled.
    items : sequence
    workers : int, optional
        Processes; left out, one for each processor. With one and no budget the work is done here.
    budget : float, optional
        Wall time [s] after which what still runs is stopped, and what has not begun is left.
    costs : sequence of float, optional
        What each item is expected to take, in any unit, for the estimate of the time that is left.
    report_progress : callable
        Receives how many are done, which are running, and the estimated seconds left (None while hardly anything is
        done).

    Returns
    -------
    list of Done
        An interruption (Ctrl-C) ends the work; it is raised where nothing is done yet.

    Examples
    --------
    >>> [d.value for d in in_processes(abs, [-2, 3], workers=1)]
    [2, 3]
    """
    count = min(workers or _threads.processors(), len(items)) or 1
    if count == 1 and budget is None:
        return _here(function, items, list(costs or [1.0] * len(items)), report_progress)
    return _Lanes(function, items, count, budget, list(costs or [1.0] * len(items)), report_progress).run()


class Beside(Generic[R]):
    """One call in a process of its own, while the caller goes on with something else.

    With one processor it is made here, when its result is asked for. Leaving the block stops it.

    Parameters
    ----------
    function : callable
        Of one item; found by its module and name.
    item : object

    Examples
    --------
    >>> with Beside(abs, -2) as other:
    ...     other.result()
    2
    """

    def __init__(self, function: Callable[[T], R], item: T) -> None:
        self._found: Done[R] | None = None
        self._call = lambda: function(item)
        self._lanes = self._thread = None
        if _threads.processors() > 1:
            self._lanes = _Lanes(function, [item], 1, None, [1.0], lambda done, running, left: None)
            self._thread = Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        assert self._lanes is not None
        self._found = self._lanes.run()[0]

    def __enter__(self) -> Beside[R]:
        if self._thread is not None:
            self._thread.start()
        return self

    def __exit__(self, *why: object) -> None:
        if self._lanes is not None and self._thread is not None:
            self._lanes._stop()
            self._thread.join()

    def result(self) -> R:
        """What the call returned; what it raised is raised here."""
        if self._thread is None:
            return self._call()
        while self._thread.is_alive():  # short waits: Ctrl-C is seen between them
            self._thread.join(POLL)
        assert self._found is not None
        if self._found.error is not None:
            raise self._found.error
        return self._found.value  # type: ignore[return-value]


def _here(function: Callable[[T], R], items: Sequence[T], costs: list[float],
          report_progress: Callable[[int, list[int], float | None], None]) -> list[Done[R]]:
    found: list[Done[R]] = []
    for k, item in enumerate(items):
        report_progress(k, [k], _left(found, costs, [k], 1))
        begun = time.monotonic()
        try:
            found.append(Done(function(item), seconds=time.monotonic() - begun))
        except KeyboardInterrupt:
            if not found:
                raise
            return found + [Done(stopped="interrupted")] * (len(items) - k)
        except Exception as error:
            found.append(Done(error=error, seconds=time.monotonic() - begun))
    return found


def _left(found: Sequence[Done | None], costs: Sequence[float], running: Sequence[int], workers: int) -> float | None:
    """Seconds left, at the rate of what is done; None while that is too small a part for an estimate of the rate."""
    done = [k for k, d in enumerate(found) if d is not None]
    if sum(costs[k] for k in done) < KNOWN * sum(costs) or not done:
        return None
    rate = sum(found[k].seconds for k in done) / max(sum(costs[k] for k in done), 1e-300)  # type: ignore[union-attr]
    ahead = [c for k, c in enumerate(costs) if k >= len(found) or found[k] is None]
    return rate * max(sum(ahead) / workers, max(ahead, default=0.0))


class _Lanes(Generic[T, R]):
    """Workers, each with a thread here that hands it items and waits for its answers."""

    def __init__(self, function: Callable[[T], R], items: Sequence[T], workers: int, budget: float | None,
                 costs: list[float], report_progress: Callable[[int, list[int], float | None], None]) -> None:
        self.function, self.items, self.workers, self.budget = function, items, workers, budget
        self.costs, self.report_progress = costs, report_progress
        self.found: list[Done[R] | None] = [None] * len(items)
        self.waiting: Queue[int] = Queue()
        self.lock, self.running, self.alive, self.over = Lock(), set(), set(), False
        for k in range(len(items)):
            self.waiting.put(k)

    def run(self) -> list[Done[R]]:
        begun, why = time.monotonic(), ""
        lanes = [Thread(target=self._lane, daemon=True) for _ in range(self.workers)]
        for lane in lanes:
            lane.start()
        try:
            while any(lane.is_alive() for lane in lanes):
                next(lane for lane in lanes if lane.is_alive()).join(POLL)
                with self.lock:
                    running, done = sorted(self.running), sum(d is not None for d in self.found)
                self.report_progress(done, running, _left(self.found, self.costs, running, self.workers))
                if self.budget is not None and time.monotonic() - begun > self.budget:
                    why = "budget"
                    break
        except KeyboardInterrupt:
            why = "interrupted"
        finally:
            self._stop()
        for lane in lanes:
            lane.join()
        if why == "interrupted" and not any(d is not None for d in self.found):
            raise KeyboardInterrupt
        return [Done(stopped=why or "lost") if d is None else d for d in self.found]

    def _stop(self) -> None:
        with self.lock:
            self.over = True
            for worker in self.alive:
                worker.kill()

    def _lane(self) -> None:
        """Items by one worker after the other: one that is killed loses its item, and another is begun."""
        worker: subprocess.Popen | None = None
        try:
            while not self.over:
                try:
                    k = self.waiting.get_nowait()
                except Empty:
                    return
                if worker is None:
                    worker = self._begun()
                with self.lock:
                    self.running.add(k)
                begun = time.monotonic()
                try:
                    assert worker.stdin is not None and worker.stdout is not None
                    _send(worker.stdin, _packed((self.function, self.items[k])))
                    good, found = _receive(worker.stdout)
                except (OSError, EOFError):
                    good, found = False, None
                seconds = time.monotonic() - begun
                with self.lock:
                    self.running.discard(k)
                    if found is None and not good:
                        if self.over:
                            return
                        self.found[k] = Done(error=RuntimeError("its process died"), seconds=seconds)
                        self.alive.discard(worker)
                        _ended(worker)
                        worker = None
                    else:
                        self.found[k] = Done(found, seconds=seconds) if good else Done(error=found, seconds=seconds)
        finally:
            if worker is not None:
                _ended(worker)

    def _begun(self) -> subprocess.Popen:
        quiet = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1",
                 "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        worker = subprocess.Popen([sys.executable, "-c", WORKER.format(os.getpid())], stdin=subprocess.PIPE,
                                  stdout=subprocess.PIPE, env=quiet, start_new_session=True)
        with self.lock:
            self.alive.add(worker)
            if self.over:
                worker.kill()
        return worker


def _ended(worker: subprocess.Popen) -> None:
    """No process, no open pipe is left behind."""
    worker.kill()
    for pipe in (worker.stdin, worker.stdout):
        if pipe is not None:
            with suppress(OSError):  # what was still to be sent to a dead process
                pipe.close()
    worker.wait()


# -- between the processes ---------------------------------------------------------------------------------------------
class Pickler(pickle.Pickler):
    """Read-only mappings, which records and models hold, as what they are."""

    def reducer_override(self, obj: Any) -> Any:
        return (_read_only, (dict(obj),)) if isinstance(obj, MappingProxyType) else NotImplemented


def _read_only(data: dict) -> MappingProxyType:
    """A class that pickle cannot find by its name."""
    return MappingProxyType(data)


def _packed(data: Any) -> BytesIO:
    held = BytesIO()
    Pickler(held, protocol=pickle.HIGHEST_PROTOCOL).dump(data)
    return held


def _send(stream: BinaryIO | Any, held: BytesIO) -> None:
    stream.write(struct.pack("<Q", held.getbuffer().nbytes))
    stream.write(held.getbuffer())
    stream.flush()


def _receive(stream: BinaryIO | Any) -> Any:
    return pickle.loads(_bytes(stream))


def _bytes(stream: BinaryIO | Any) -> bytes:
    head = stream.read(8)
    if len(head) < 8:
        raise EOFError
    return stream.read(struct.unpack("<Q", head)[0])


def ends_with_parent(parent: int) -> None:
    """End this process when its parent has ended, however that was (Linux).

    Parameters
    ----------
    parent : int
        Number of the process that began this one: it may have ended already.
    """
    control = of_library("prctl")
    if control is not None:
        control(PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def _items(stream: BinaryIO, received: SimpleQueue[bytes]) -> None:
    """Hand on what comes; where nothing can come any more the parent has ended, and this process does, on any system.

    Not amid a call that keeps the interpreter's lock.
    """
    with suppress(EOFError):
        while True:
            received.put(_bytes(stream))
    os._exit(1)


def serve(parent: int) -> None:
    """A worker: items from standard input, results to standard output; what the work prints goes to standard error.

    It ends with the process that began it, of that number, amid its work.
    """
    ends_with_parent(parent)
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    _threads.alone()
    received: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_items, args=(sys.stdin.buffer, received), daemon=True).start()
    while True:
        function, item = pickle.loads(received.get())
        try:
            answer = True, function(item)
        except Exception as error:
            answer = False, error
        try:
            held = _packed(answer)
        except (TypeError, AttributeError, pickle.PicklingError) as error:
            held = _packed((False, RuntimeError(f"the result cannot be sent: {error}")))
        _send(answers, held)
        del function, item, answer, held
        collect()  # several workers together: what one item left is not carried through the next
        give_back()
