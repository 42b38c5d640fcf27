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
from lpvid import toolkit
assert toolkit.__file__.startswith({folder!r})
source, target = np.array([1.0, 0.5]), np.zeros(2)
toolkit.copy_values(source, target)
print(target.tolist())
"""


@pytest.mark.parametrize("blind", [
    pytest.param(False, id="a folder for the cache"), pytest.param(True, id="none", marks=pytest.mark.seconds)])
def test_no_folder_for_the_cache_is_no_error(blind: bool, tmp_path: Path) -> None:
    """As in an installation for all users, run by somebody without a home."""
    source = Path(lpvid.__file__).parent
    shutil.copytree(source, tmp_path / "lpvid", ignore=shutil.ignore_patterns("*.nbi", "*.nbc"))
    beside = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run([sys.executable, "-W", "error", "-c", PROBE.format(blind=blind, folder=str(tmp_path))],
                          cwd=tmp_path, env=beside, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[1.0, 0.5]"
    kept = list(tmp_path.rglob("_compiling.copy_values*.nbi"))
    assert bool(kept) is not blind
