"""Independent work in processes of its own: Python's loops run side by side, and what takes too long is stopped."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from gc import collect
from queue import Empty, Queue
from threading import Lock, Thread
from typing import Any, Generic, TypeVar

from lpvid import _threads
from lpvid._memory import give_back
from lpvid._workers import ForkedWorker, FreshWorker, Worker

T = TypeVar("T")
R = TypeVar("R")
KNOWN = 0.1
"""part of all costs from which their rate is estimated: the seconds in which a process begins would count tenfold"""
POLL = 0.2
"""Time between two looks at the clock while work goes on [s]."""


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

    Each worker is handed one item after the other, in their order, with one BLAS thread. Workers are forks of this
    process, whose libraries and data they share, on Linux where no other thread of it computes; elsewhere, and in place
    of one that died, fresh interpreters. The script that calls this is not run again there: the function must be
    importable by its module and name.

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
        lanes: list[Thread] = []
        try:
            forks: list[Worker | None] = self._forked() or [None] * self.workers
            lanes = [Thread(target=self._lane, args=(worker,), daemon=True) for worker in forks]
            for lane in lanes:
                lane.start()
            while any(lane.is_alive() for lane in lanes):
                left = math.inf if self.budget is None else max(begun + self.budget - time.monotonic(), 0.0)
                next((lane for lane in lanes if lane.is_alive()), lanes[0]).join(min(POLL, left))
                with self.lock:
                    running, done = sorted(self.running), sum(d is not None for d in self.found)
                self.report_progress(done, running, _left(self.found, self.costs, running, self.workers))
                if self.budget is not None and time.monotonic() - begun >= self.budget:
                    why = "budget"
                    break
        except KeyboardInterrupt:
            why = "interrupted"
        finally:
            self._stop()
        for lane in lanes:
            if lane.ident is not None:  # it was begun before an interruption
                lane.join()
        for worker in self.alive:  # of lanes that were not
            worker.end()
        if why == "interrupted" and not any(d is not None for d in self.found):
            raise KeyboardInterrupt
        return [Done(stopped=why or "lost") if d is None else d for d in self.found]

    def _stop(self) -> None:
        with self.lock:
            self.over = True
            for worker in self.alive:
                worker.kill()

    def _forked(self) -> list[Worker | None]:
        """All workers as forks, before a thread here is begun; none where no fork is safe."""
        if sys.platform != "linux" or not _threads.undisturbed():
            return []
        collect()  # what is garbage here would be garbage in each
        give_back()
        begun: list[ForkedWorker] = []
        with suppress(OSError):  # no room for another process: fewer of them
            for _ in range(self.workers):
                begun.append(ForkedWorker(self.function, self.items, begun))
                self.alive.add(begun[-1])
        return [*begun]

    def _lane(self, worker: Worker | None) -> None:
        """Items by one worker after the other: one that is killed loses its item, and another is begun."""
        try:
            while not self.over:
                try:
                    k = self.waiting.get_nowait()
                except Empty:
                    return
                if worker is None:
                    worker = FreshWorker(self.function, self.items)
                    with self.lock:
                        self.alive.add(worker)
                        if self.over:
                            worker.kill()
                with self.lock:
                    self.running.add(k)
                begun = time.monotonic()
                good, found = _result(worker, k)
                seconds = time.monotonic() - begun
                with self.lock:
                    self.running.discard(k)
                    if found is None and not good:
                        if self.over:
                            return
                        self.found[k] = Done(error=RuntimeError("its process died"), seconds=seconds)
                        self.alive.discard(worker)
                        worker.end()
                        worker = None
                    else:
                        self.found[k] = Done(found, seconds=seconds) if good else Done(error=found, seconds=seconds)
        finally:
            if worker is not None:
                worker.end()


def _result(worker: Worker, k: int) -> tuple[bool, Any]:
    """Whether item k succeeded, and its value or exception; False and None where the worker died."""
    try:
        return worker.result(k)
    except (OSError, EOFError):
        return False, None
    except Exception as error:  # of what was received, which cannot be read
        return False, error
