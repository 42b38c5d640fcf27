"""in_processes: results in order, errors and deaths of one item, a budget, what is sent between the processes."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import importable
from helpers.importable import copied
from helpers.waiting import gone

from lpvid import Record, _processes, _threads, _workers
from lpvid._processes import Beside, Done, _left, in_processes
from lpvid._workers import ForkedWorker


@pytest.fixture(params=[pytest.param(True, marks=pytest.mark.skipif(sys.platform != "linux", reason="Linux")), False],
                ids=["forks", "fresh"], autouse=True)
def forks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether workers are forks; threads of the test runner wait and hold no lock."""
    monkeypatch.setattr(_threads, "undisturbed", lambda: request.param)
    return request.param


@pytest.mark.thinned(2, "seconds")
def test_forks_hold_what_the_caller_holds_and_use_one_blas_thread(forks: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its modules, at no memory of their own; a fresh interpreter has none of them."""
    monkeypatch.setitem(sys.modules, "of_the_caller", sys)
    threads = "[l['num_threads'] for l in __import__('threadpoolctl').threadpool_info() if l['user_api'] == 'blas']"
    asked = f"('of_the_caller' in __import__('sys').modules, __import__('numpy') and {threads})"
    found = [d.value for d in in_processes(eval, [asked] * 3, workers=2)]
    assert [held for held, _ in found] == [forks] * 3
    assert all(set(blas) == {1} for _, blas in found)


@pytest.mark.thinned(4, "seconds")
@pytest.mark.parametrize("workers", [1, 3])
def test_results_stand_in_their_order_whatever_the_number_of_processes(workers: int) -> None:
    items = [9.0, -1.0, 4.0, "x", 16.0]
    found = in_processes(math.sqrt, items, workers=workers)
    assert [d.value for d in found] == [3.0, None, 2.0, None, 4.0]
    assert [type(d.error) for d in found] == [type(None), ValueError, type(None), TypeError, type(None)]


@pytest.mark.seconds
def test_a_process_that_dies_takes_only_its_item_with_it() -> None:
    found = in_processes(os._exit, [3, 4], workers=2)
    assert [str(d.error) for d in found] == ["its process died"] * 2
    found = in_processes(eval, ["1", "__import__('os').abort()", "2", "3"], workers=2)
    assert [d.value for d in found] == [1, None, 2, 3] and "died" in str(found[1].error)


@pytest.mark.seconds
@pytest.mark.parametrize(("function", "stated"), [
    (importable.unreadable_error, "TwoParts: 1 of 2"), (importable.unwritable, "the result cannot be sent: too deep"),
    (importable.killed_amid_its_answer, "its process died")])
def test_what_cannot_be_received_is_one_item_lost(function: Callable[[int], object], stated: str) -> None:
    """The worker goes on, or another does: the lane that waits for it does not end with the item.

    Where Dask was imported (tblib), an exception can be sent whatever its `__init__` takes, and needs no name in front.
    """
    found = in_processes(function, [0, 1, 2, 3], workers=1, budget=900.0)
    assert [d.value for d in found] == [0, None, 2, 3]
    assert str(found[1].error) in (stated, stated.removeprefix("TwoParts: "))
    assert not any(d.stopped for d in found)


@pytest.mark.seconds
def test_an_item_that_cannot_be_made_states_why() -> None:
    class Cut(list):  # items that are made when they are taken, as stretches of records
        def __getitem__(self, k: Any) -> Any:
            if k == 1:
                raise ValueError("too short")
            return super().__getitem__(k)

    found = in_processes(abs, Cut([-1, -2, -3]), workers=2)
    assert [d.value for d in found] == [1, None, 3] and "too short" in str(found[1].error)


@pytest.mark.seconds
def test_what_a_fresh_interpreter_cannot_have_is_stated(forks: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A function of a notebook, or of no module: a fork has it."""
    here = ModuleType("of_a_notebook")
    exec("def doubled(k): return 2 * k", vars(here))
    monkeypatch.setitem(sys.modules, "of_a_notebook", here)
    for function, stated in ((here.doubled, "cannot be read in another process"),
                             (lambda k: 2 * k, "cannot be sent to another process")):
        found = in_processes(function, [1, 2], workers=2)
        assert [d.value for d in found] == ([2, 4] if forks else [None, None])
        assert all(d.error is None if forks else stated in str(d.error) for d in found)


@pytest.mark.seconds
def test_an_interruption_while_workers_begin_leaves_none(forks: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not forks:
        pytest.skip("threads begin them")
    begun: list[int] = []

    class Interrupted(ForkedWorker):
        def __init__(self, *given: Any) -> None:
            if begun:
                raise KeyboardInterrupt
            super().__init__(*given)
            begun.append(self.pid)

    monkeypatch.setattr(_processes, "ForkedWorker", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        in_processes(abs, [1, 2, 3], workers=3)
    with pytest.raises(ChildProcessError):
        os.waitpid(begun[0], os.WNOHANG)


@pytest.mark.seconds
def test_what_the_caller_has_yet_to_write_is_written_once(forks: bool, tmp_path: Path) -> None:
    """A script that prints to a file of its own, to which nothing else refers."""
    code = f"""
        import sys
        from lpvid import _processes, _threads
        _threads.undisturbed = lambda: {forks}
        sys.stdout = open({str(tmp_path / "log.txt")!r}, "w")
        print("once")
        assert [d.value for d in _processes.in_processes(abs, [-1, -2], workers=2)] == [1, 2]
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True)
    assert (tmp_path / "log.txt").read_text().split() == ["once"]


@pytest.mark.seconds
def test_a_budget_stops_what_runs_and_leaves_what_has_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock passes the budget once the first item is done and the next two run."""
    passed = [0.0]
    monkeypatch.setattr(_processes, "time", SimpleNamespace(monotonic=lambda: time.monotonic() + passed[0]))

    def look(done: int, running: list[int], left: float | None) -> None:
        if done == 1 and running == [1, 2]:
            passed[0] = 1000.0

    begun = time.monotonic()
    found = in_processes(time.sleep, [0.0, 600.0, 600.0, 0.0], workers=2, budget=900.0, report_progress=look)
    assert time.monotonic() - begun < 500
    assert [d.stopped for d in found] == ["", "budget", "budget", "budget"]


def test_what_runs_is_reported_with_an_estimate() -> None:
    stated: list[tuple] = []
    in_processes(
        time.sleep,
        [0.01, 0.02, 0.01],
        workers=1,
        costs=[1.0, 2.0, 1.0],
        report_progress=lambda *described: stated.append(described),
    )
    assert [t[:2] for t in stated] == [(0, [0]), (1, [1]), (2, [2])]
    assert stated[0][2] is None and stated[1][2] > stated[2][2] > 0


@pytest.mark.seconds
def test_records_go_there_and_back() -> None:
    record = Record({"u": np.arange(5.0)}, sample_time=0.1, roles={"input": "u"}, name="run")
    back, frozen = in_processes(copied, [record, MappingProxyType({"a": 1})], workers=2)
    assert isinstance(back, Done) and isinstance(back.value, Record) and isinstance(frozen.value, MappingProxyType)
    np.testing.assert_array_equal(back.value["input"], record["u"])



def test_a_call_beside_gives_its_result_and_its_error() -> None:
    with Beside(abs, -3) as good, Beside(int, "x") as bad:
        assert good.result() == 3
        with pytest.raises(ValueError, match="invalid literal"):
            bad.result()


def test_leaving_the_block_stops_the_call() -> None:
    begun = time.monotonic()
    with Beside(time.sleep, 60.0):
        time.sleep(0.5)
    assert time.monotonic() - begun < 20.0


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("without", ["", "_workers.ends_with_parent = lambda parent: None\n"], ids=["Linux", "other"])
def test_workers_end_with_their_parent_amid_their_work(how: signal.Signals, without: str, forks: bool) -> None:
    """By Linux's signal even in a call that keeps the interpreter's lock; elsewhere by the end of what they read."""
    if forks and without:
        pytest.skip("other systems have no forks")
    work = "__import__('time').sleep(600)" if without else "sum(iter(int, 1))"
    code = f"""
        from lpvid import _processes, _threads, _workers
        _threads.undisturbed = lambda: {forks}
        _workers.WORKER = "from lpvid import _workers\\n" + {without!r} + "_workers.serve({{}})"
        number = "__import__('os').write(1, b'%d' % __import__('os').getpid() + bytes([10]))"
        _processes.in_processes(eval, [number + " and {work}"] * 2, workers=2)
    """
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stderr=subprocess.PIPE, text=True) as parent:
        assert parent.stderr is not None  # what the work prints goes there, each number by one call
        try:
            workers = {int(parent.stderr.readline()) for _ in range(2)}
            parent.send_signal(how)
            parent.wait()
        finally:
            parent.kill()
        assert len(workers) == 2 and all(gone(pid) for pid in workers)


def test_elsewhere_a_worker_may_have_another_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    """A virtual environment's interpreter on Windows is begun by a launcher."""
    monkeypatch.setattr(_workers, "of_library", lambda name: None)
    monkeypatch.setattr(os, "_exit", lambda code: pytest.fail("a worker at work ended"))
    _workers.ends_with_parent(-1)


@pytest.mark.seconds
@pytest.mark.parametrize("awaited", [0, 1])
def test_an_interruption_keeps_what_is_done_and_is_raised_where_nothing_is(awaited: int) -> None:
    """One worker sleeps on the slow item, the other is done with the quick one: Ctrl-C comes then, or at once."""

    def interrupt(done: int, running: list[int], left: float | None) -> None:
        if done >= awaited:
            raise KeyboardInterrupt

    if not awaited:
        with pytest.raises(KeyboardInterrupt):
            in_processes(time.sleep, [600.0, 600.0], workers=2, report_progress=interrupt)
        return
    slow, quick = in_processes(time.sleep, [600.0, 0.0], workers=2, report_progress=interrupt)
    assert slow.stopped == "interrupted" and not quick.stopped and quick.error is None


def test_time_left_is_told_from_a_part_of_the_work_that_shows_its_rate() -> None:
    """A cheap first item takes its process seconds to begin: 56,821 s were announced for 20."""
    costs = [1e-3, 10.0, 10.0]
    assert _left([Done(0, seconds=5.0), None, None], costs, [1], 2) is None
    assert _left([Done(0, seconds=5.0), Done(0, seconds=10.0), None], costs, [2], 2) == pytest.approx(15.0, rel=1e-3)
    assert _left([], [1.0], [0], 1) is None
