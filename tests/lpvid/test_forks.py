"""in_forks: results in order whatever the number of forks, errors, forks that die, what results refer to."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.waiting import gone

from lpvid import _forks, _threads
from lpvid._forks import in_forks, processor_time

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="forks are used on Linux")


@pytest.fixture(params=[1, 2, 3])
def forking(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """So many processors; threads of the test runner wait and hold no lock."""
    monkeypatch.setattr(_threads, "processors", lambda: request.param)
    monkeypatch.setattr(_threads, "_crew", _threads._Crew())
    monkeypatch.setattr(_threads, "undisturbed", lambda: True)
    return request.param


def test_results_stand_in_their_order_and_come_from_so_many_processes(forking: int) -> None:
    read, write = os.pipe()  # every process but the last to arrive waits for the next one

    def work(item: int) -> tuple[int, int]:
        if item < forking - 1:
            os.read(read, 1)
        elif item == forking - 1:
            os.write(write, b"x" * (forking - 1))
        return item, os.getpid()

    found = in_forks(work, range(20))
    assert [k for k, _ in found] == list(range(20))
    assert len({pid for _, pid in found[:forking]}) == forking
    os.close(read)
    os.close(write)


@pytest.mark.thinned(3, "seconds")
def test_time_in_forks_counts(forking: int) -> None:
    """Oracle: every item measures its own, wherever it is worked on; children are counted by clock ticks."""
    begun = processor_time()

    def work(item: int) -> float:
        first = time.process_time()
        while time.process_time() - first < 0.05:
            pass
        return time.process_time() - first

    spent = sum(in_forks(work, range(4)))
    assert processor_time() - begun > spent - 2 * forking / os.sysconf("SC_CLK_TCK")


def test_what_the_caller_holds_is_referred_to(forking: int) -> None:
    held: list[Callable[[], int]] = [lambda: 3, lambda: 4]  # neither can be sent
    found = in_forks(lambda k: (held[k % 2], k), range(8), shared=held)
    assert all(f is held[k % 2] for f, k in found)


def test_what_cannot_be_sent_is_computed_here(forking: int) -> None:
    assert [f() for f in in_forks(lambda k: lambda: k, range(6))] == list(range(6))


def test_what_a_fork_that_died_had_is_computed_here(forking: int) -> None:
    here = os.getpid()

    def work(item: int) -> int:
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return item

    assert in_forks(work, range(6)) == list(range(6))


@pytest.mark.thinned(3, "seconds")
def test_the_first_error_is_raised_and_no_process_is_left(forking: int) -> None:
    def fails(item: int) -> int:
        if item > 2:
            raise ValueError(f"item {item}")
        return item

    with pytest.raises(ValueError, match="item 3"):
        in_forks(fails, range(9))
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)
    assert in_forks(abs, range(9)) == list(range(9))  # the processors were given back


class OfTwo(Exception):
    def __init__(self, item: int, why: str) -> None:
        super().__init__(f"item {item}: {why}")


def test_an_error_that_cannot_be_read_back_is_raised_as_it_is(forking: int) -> None:
    def fails(item: int) -> int:
        if item > 2:
            raise OfTwo(item, "why")
        return item

    with pytest.raises(OfTwo, match="item 3: why"):
        in_forks(fails, range(9))


class Unreadable:
    def __reduce__(self) -> tuple[Callable[[str], int], tuple[str]]:
        return int, ("no number",)


def test_a_result_that_cannot_be_read_back_is_computed_here(forking: int) -> None:
    assert all(type(r) is Unreadable for r in in_forks(lambda k: Unreadable(), range(6)))


def test_where_the_caller_ignores_its_children_results_are_the_same(forking: int) -> None:
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        assert in_forks(lambda k: (time.sleep(0.005), k)[1], range(9)) == list(range(9))
    finally:
        signal.signal(signal.SIGCHLD, before)


def _warns(item: int) -> int:
    time.sleep(0.005)
    warnings.warn(f"item {item}", RuntimeWarning, stacklevel=1)
    warnings.warn("of each", UserWarning, stacklevel=1)
    return item


@pytest.mark.parametrize("action", ["always", "default", "once", "ignore"])
def test_warnings_are_those_of_a_loop(forking: int, action: Any) -> None:
    def of(work: Callable[[], object]) -> list[tuple]:
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("ignore")
            warnings.filterwarnings(action, module=__name__)
            getattr(warnings, "onceregistry", {}).clear()
            work()
        return [(str(w.message), w.category, w.filename, w.lineno) for w in seen]

    expected = of(lambda: [_warns(k) for k in range(6)])
    assert len(expected) == {"always": 12, "default": 7, "once": 7, "ignore": 0}[action]
    assert of(lambda: in_forks(_warns, range(6))) == expected


def test_a_warning_that_is_an_error_is_raised(forking: int) -> None:
    with pytest.raises(RuntimeWarning, match="item 0"):
        in_forks(_warns, range(6))


def test_beside_another_thread_nothing_is_forked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_forks, "_by_forks", lambda *a: pytest.fail("a lock of the other thread may be held"))
    end = threading.Event()
    other = threading.Thread(target=end.wait)
    other.start()
    assert in_forks(abs, [-1, 2, -3]) == [1, 2, 3]
    end.set()
    other.join()


def test_a_thread_that_only_shows_progress_is_no_hindrance(monkeypatch: pytest.MonkeyPatch) -> None:
    others = [t for t in threading.enumerate() if t is not threading.current_thread()]  # of the test runner
    monkeypatch.setattr(_threads, "_showing", set(others))
    end = threading.Event()
    plain, showing = threading.Thread(target=end.wait), threading.Thread(target=end.wait)
    with _threads.showing_progress():
        showing.start()
    assert _threads.undisturbed()
    plain.start()
    assert not _threads.undisturbed()
    end.set()
    plain.join()
    showing.join()


def test_what_the_caller_has_yet_to_write_is_written_once(tmp_path: Path) -> None:
    """A script that prints to a file of its own, to which nothing else refers."""
    code = f"""
        import sys
        from lpvid import _threads
        from lpvid._forks import in_forks
        _threads.processors = lambda: 2
        sys.stdout = open({str(tmp_path / "log.txt")!r}, "w")
        print("once")
        assert in_forks(abs, [-1, -2]) == [1, 2]
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True)
    assert (tmp_path / "log.txt").read_text().split() == ["once"]


def test_forks_end_with_a_killed_parent() -> None:
    code = """
        import os, time
        from lpvid import _threads
        from lpvid._forks import in_forks
        _threads.processors = lambda: 2
        in_forks(lambda k: (os.write(1, f"{os.getpid()}\\n".encode()), time.sleep(600)), range(2))
    """
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        (fork,) = {int(parent.stdout.readline()) for _ in range(2)} - {parent.pid}
        parent.kill()
    assert gone(fork)
