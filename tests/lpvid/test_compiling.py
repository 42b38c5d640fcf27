"""Compiled kernels: kept on disk where possible, and no error where not."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import lpvid

PROBE = """
import numpy as np
from numba.core import caching
if {blind}:
    caching.FunctionCache._impl_class._locator_classes.clear()  # no folder can be written
import lpvid as lpv
assert lpv.__file__.startswith({folder!r})
model = lpv.LPVTransferFunction.siso(a=[[-0.5]], b=[[0.0], [1.0]], basis=lpv.Polynomial((), degree=0), sample_time=1.0)
record = lpv.Record({{"u1": np.eye(1, 20_000)[0]}}, sample_time=1.0)  # a short one is not compiled
print(lpv.simulate(model, record, "zero").output[:4, 0].tolist())
"""


@pytest.mark.parametrize("blind", [False, True], ids=["a folder for the cache", "none"])
def test_no_folder_for_the_cache_is_no_error(blind: bool, tmp_path: Path) -> None:
    """As in an installation for all users, run by somebody without a home."""
    source = Path(lpvid.__file__).parent
    shutil.copytree(source, tmp_path / "lpvid", ignore=shutil.ignore_patterns("*.nbi", "*.nbc"))
    done = subprocess.run([sys.executable, "-W", "error", "-c", PROBE.format(blind=blind, folder=str(tmp_path))],
                          cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path)}, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[0.0, 1.0, 0.5, 0.25]"
    kept = list(tmp_path.rglob("_kernels.free_run_io*.nbi"))
    assert bool(kept) is not blind
