"""Threads: results in order, never more at work than there are processors."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time

import pytest

from lpvid import _threads
from lpvid._threads import in_parallel

PRINTED = """
from lpvid._threads import processors
try:
    print(processors())
except ValueError as error:
    print(error)
"""

@pytest.fixture
def three(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_threads, "processors", lambda: 3)


class Counted:
    """How many are at work at a time."""

    def __init__(self) -> None:
        self.lock, self.now, self.most = threading.Lock(), 0, 0

    def work(self, item: int) -> int:
        with self.lock:
            self.now += 1
            self.most = max(self.most, self.now)
        time.sleep(0.02)
        with self.lock:
            self.now -= 1
        return item


@pytest.mark.seconds
def test_a_share_of_the_processors_is_kept_and_nothing_else_is_one() -> None:
    """In processes of their own: pytest's has a share already."""
    def stated(share: str) -> str:
        return subprocess.run([sys.executable, "-c", PRINTED], env={**os.environ, _threads.SHARE: share}, check=True,
                              capture_output=True, text=True).stdout.strip()

    whole = stated("")
    assert [stated(share) for share in ("1", "100000")] == ["1", whole] and int(whole) >= 1
    for wrong in ("0", "-1", "two", "1.5"):
        assert stated(wrong).startswith(f"LPVID_PROCESSORS is no number of processors: got {wrong!r}."), stated(wrong)


@pytest.mark.usefixtures("three")
def test_work_inside_of_work_takes_the_processors_that_are_left() -> None:
    counted = Counted()
    found = in_parallel(lambda k: in_parallel(lambda j: counted.work(10 * k + j), range(4)), range(2))
    assert found == [[0, 1, 2, 3], [10, 11, 12, 13]]
    assert 2 <= counted.most <= 3


@pytest.mark.usefixtures("three")
def test_processors_are_given_back_after_an_error() -> None:
    def fails(item: int) -> int:
        raise ValueError(item)

    for _ in range(3):
        with pytest.raises(ValueError, match="0"):
            in_parallel(fails, range(3))
    counted = Counted()
    assert in_parallel(counted.work, range(6)) == list(range(6))
    assert counted.most == 3


@pytest.mark.usefixtures("three")
def test_work_inside_of_work_takes_the_processors_that_become_free() -> None:
    counted = Counted()

    def uneven(k: int) -> list[int]:
        return in_parallel(lambda j: counted.work(10 * k + j), range(12 if k == 0 else 1))

    begun = time.perf_counter()
    assert in_parallel(uneven, range(3)) == [list(range(12)), [10], [20]]
    assert counted.most == 3
    assert time.perf_counter() - begun < 11 * 0.02  # all but the first items by three
