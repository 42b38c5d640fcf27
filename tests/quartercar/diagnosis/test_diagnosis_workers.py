"""A diagnosis is the same to the last digit whatever the number of processes it is shared among."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace

import pytest

import lpvid as lpv
from lpvid import _threads
from quartercar.effects import CATALOGUE
from quartercar.rig import EXPERIMENTS, Rig

SOME = ("series-compliance", "coil-lag", "coulomb-friction", "asymmetry")


@pytest.mark.seconds
@pytest.mark.skipif(sys.platform != "linux", reason="forks are used on Linux")
def test_one_and_two_processes_write_the_same_file(monkeypatch: pytest.MonkeyPatch) -> None:
    record = Rig().run(replace(EXPERIMENTS["test-1"], duration=3.0), seed=1)
    effects = [e for e in CATALOGUE if e.name in SOME]
    begun, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: begun.append(1) or fork())
    monkeypatch.setattr(_threads, "undisturbed", lambda: True)  # threads of the test runner wait and hold no lock

    def written(processors: int) -> tuple[str, int]:
        monkeypatch.setattr(_threads, "processors", lambda: processors)
        monkeypatch.setattr(_threads, "_crew", _threads._Crew())
        begun.clear()
        found = replace(lpv.diagnose(record, "guo", effects), seconds=0.0)
        assert found.causes and found.extended is not None
        return json.dumps([found.to_dict(), found.extended.to_dict()]), len(begun)

    (one, alone), (two, beside) = written(1), written(2)
    assert one == two
    assert alone == 0 and beside > 8  # the fit beside the audit, looks, refits, held-out checks, all samples
