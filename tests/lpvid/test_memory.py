"""Freed memory goes back, where the C library has a way to."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from lpvid import _memory

FREED = """
import numpy as np
from lpvid._memory import give_back

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6

taken = [np.ones(12_000) for _ in range(4000)]  # 96 kB each: from the heap
kept = taken[::50]
del taken
before = resident()
give_back()
print(before - resident(), sum(float(k.sum()) for k in kept))
"""


@pytest.mark.seconds
@pytest.mark.skipif(not Path("/proc/self/statm").exists() or _memory._trim() is None, reason="another C library")
def test_gaps_between_arrays_that_are_kept_go_back() -> None:
    found = subprocess.run([sys.executable, "-c", FREED], capture_output=True, text=True, check=True).stdout.split()
    assert float(found[0]) > 200 and float(found[1]) == 80 * 12_000


def test_without_such_a_way_nothing_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_memory.sys, "platform", "elsewhere")
    _memory._trim.cache_clear()
    _memory.give_back()
    assert _memory._trim() is None
    _memory._trim.cache_clear()


FAULTS = """
import resource
import numpy as np
from lpvid._memory import keep_for_reuse

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(50):
        np.ones(100_000)  # 0.8 MB, 195 pages
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

if {asked}:
    keep_for_reuse()
np.ones(100_000)
print(faults())
"""


@pytest.mark.skipif(_memory.of_library("mallopt") is None, reason="another C library")
def test_arrays_that_come_and_go_are_taken_from_what_is_held() -> None:
    programs = [[sys.executable, "-c", FAULTS.format(asked=asked)] for asked in (False, True)]
    plain, kept = (int(subprocess.run(p, capture_output=True, text=True, check=True).stdout) for p in programs)
    assert kept < 400  # pages of two of the fifty arrays
    assert plain >= kept
