"""What a search is doing, how long it will take, and the best controller so far when it is interrupted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lpvid.synthesis.result import Synthesis

Report = Callable[[str], None]
INTERRUPTED = "interrupted after"
"""how the first note of a synthesis begins that Ctrl-C ended"""


@dataclass(eq=False)
class Watch:
    """One synthesis under way.

    Parameters
    ----------
    report_progress : callable or None
        Takes what is being done now.
    best : Synthesis or None
        Of lowest verified gain so far.
    started : float
        Monotonic time [s].
    stopped : bool
        The search was interrupted once: what was found so far is written down.
    """

    report_progress: Report | None = None
    best: Synthesis | None = None
    started: float = field(default_factory=time.monotonic)
    stopped: bool = False


_WATCH: ContextVar[Watch | None] = ContextVar("lpvid_synthesis_watch", default=None)
_FOLLOWER: ContextVar[Report | None] = ContextVar("lpvid_synthesis_follower", default=None)


@contextmanager
def followed(report_progress: Report) -> Iterator[None]:
    """Follow every synthesis inside that is not followed by its own argument, each for itself.

    Parameters
    ----------
    report_progress : callable
        Takes a line on what is being done.

    Yields
    ------
    None
    """
    token = _FOLLOWER.set(report_progress)
    try:
        yield
    finally:
        _FOLLOWER.reset(token)


@contextmanager
def watched(report_progress: Report | None) -> Iterator[Watch]:
    """Follow what runs inside; a synthesis within a synthesis belongs to the outer one.

    Parameters
    ----------
    report_progress : callable or None
        Takes a line on what is being done.

    Yields
    ------
    Watch
        The synthesis under way.
    """
    outer = _WATCH.get()
    if outer is not None:
        yield outer
        return
    watch = Watch(report_progress or _FOLLOWER.get())
    token = _WATCH.set(watch)
    try:
        yield watch
    finally:
        _WATCH.reset(token)


def stage(text: str) -> None:
    """State what is being done now, where progress is shown.

    Parameters
    ----------
    text : str
        One line.
    """
    watch = _WATCH.get()
    if watch is not None and watch.report_progress is not None:
        watch.report_progress(text)


def stop_at(error: KeyboardInterrupt) -> None:
    """End a search that has something to go on with; a second interruption is raised again.

    Parameters
    ----------
    error : KeyboardInterrupt
        The interruption.

    Raises
    ------
    KeyboardInterrupt
        The same one, where no progress is shown or the search was interrupted before.
    """
    watch = _WATCH.get()
    if watch is None or watch.stopped:
        raise error
    watch.stopped = True
    stage("interrupted: writing down what was found so far; interrupt again to stop at once")


def stopped() -> bool:
    """The search was interrupted: nothing better is looked for.

    Returns
    -------
    bool
        False where no progress is shown.
    """
    watch = _WATCH.get()
    return watch is not None and watch.stopped


def remember(found: Synthesis) -> Synthesis:
    """Keep a synthesis as the best so far, where it is, and hand it on.

    Parameters
    ----------
    found : Synthesis
        A result; without controller it is not kept.

    Returns
    -------
    Synthesis
        The same one.
    """
    watch = _WATCH.get()
    if watch is not None and found.controller is not None:
        bound = math.inf if found.gamma_verified is None else found.gamma_verified
        best = watch.best
        if best is None or bound < (math.inf if best.gamma_verified is None else best.gamma_verified):
            watch.best = found
    return found


def interrupted(found: Synthesis, watch: Watch) -> Synthesis:
    """A synthesis that states that it is the best so far.

    Parameters
    ----------
    found : Synthesis
        The best so far.
    watch : Watch
        The synthesis under way, for the time spent.

    Returns
    -------
    Synthesis
        With a note and the seconds.
    """
    seconds = time.monotonic() - watch.started
    note = f"{INTERRUPTED} {seconds:.3g} s: the best controller so far, verified as any other"
    return replace(found, notes=(note, *found.notes), seconds=seconds)


def was_interrupted(found: Synthesis) -> bool:
    """A synthesis is the best so far of a search that Ctrl-C ended.

    Parameters
    ----------
    found : Synthesis
        A result.

    Returns
    -------
    bool
        Its first note states it.
    """
    return bool(found.notes) and found.notes[0].startswith(INTERRUPTED)


@dataclass(eq=False)
class Rounds:
    """Rounds of one kind, timed: what is left of them at most.

    Parameters
    ----------
    what : str
    most : int
    """

    what: str
    most: int
    _done: int = 0
    _begun: float = field(default_factory=time.monotonic)

    def enter(self, detail: str = "") -> None:
        """The next round begins.

        Parameters
        ----------
        detail : str
            What is reported of the round besides its number.
        """
        spent = time.monotonic() - self._begun
        left = f", at most {(self.most - self._done) * spent / self._done:.0f} s more" if self._done else ""
        self._done += 1
        stage(f"{self.what}: round {self._done} of at most {self.most}{left}{', ' + detail if detail else ''}")
