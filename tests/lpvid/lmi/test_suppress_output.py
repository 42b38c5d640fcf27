"""Solvers that talk below Python: what they write is dropped, and only that."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys

import cvxpy
import numpy as np
import pytest

from lpvid.lmi.program import Program
from lpvid.lmi.suppress_output import quiet

CHATTER = """
import ctypes, os, sys
from lpvid.lmi.suppress_output import quiet
for descriptor in CLOSED:
    os.close(descriptor)
with quiet():
    ctypes.CDLL(None).puts(b"from C")
    for descriptor in (1, 2):
        try:
            os.write(descriptor, b"from far below")
        except OSError:
            pass
for descriptor in {1, 2} - set(CLOSED):
    os.write(descriptor, b"after")
"""


@pytest.fixture
def talkative(monkeypatch):
    """cvxpy with solvers that write to both descriptors, by the system and by the C library's buffer."""
    silent = cvxpy.Problem.solve

    def solve(problem, *given, **options):
        os.write(1, b"pdINF criteria")
        os.write(2, b"ARPACK error")
        ctypes.CDLL(None).puts(b"pUNBD criteria")
        return silent(problem, *given, **options)

    monkeypatch.setattr(cvxpy.Problem, "solve", solve)


@pytest.mark.skipif(os.name != "posix", reason="the C library is called by its POSIX name")
def test_a_solver_prints_nothing(talkative, capfd):
    program = Program()
    t = program.unknowns.scalar()
    program.require(t.times(np.eye(2)) - np.diag([1.0, 3.0]))
    program.minimise(t)
    print("before")
    assert next(program.solve(solvers=("SCS",))).objective == pytest.approx(3.0, abs=1e-3)
    print("after")
    ctypes.CDLL(None).fflush(None)
    printed = capfd.readouterr()
    assert printed.out.split() == ["before", "after"] and printed.err == ""


def test_output_after_a_failure_is_printed(capfd):
    with pytest.raises(ValueError, match="no answer"), quiet():
        os.write(2, b"never")
        raise ValueError("no answer")
    os.write(2, b"again")
    assert capfd.readouterr().err == "again"


@pytest.mark.skipif(os.name != "posix", reason="the C library is called by its POSIX name")
@pytest.mark.parametrize("closed", [(), (1,), (2,), (1, 2)])
def test_a_process_without_a_terminal_goes_on(closed):
    done = subprocess.run([sys.executable, "-c", CHATTER.replace("CLOSED", repr(closed))], capture_output=True)
    assert done.returncode == 0
    assert done.stdout == (b"" if 1 in closed else b"after") and done.stderr == (b"" if 2 in closed else b"after")
