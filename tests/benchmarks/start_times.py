"""How long the programs take to start, and the first identification after an installation.

    python tests/benchmarks/start_times.py [--rounds 3]

Wall and processor time, each the least of some rounds, of processes of their own. "First" has an empty folder for the
compiled kernels (``NUMBA_CACHE_DIR``), "second" the one that the first left. Expected, written down before the run: the
second process starts within 0.5 s, the first `identify` ends within 5 s. Under a minute on an idle machine.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from quartercar.rig import EXPERIMENTS, Rig, write_csv

IDENTIFY = "lpvid identify run.csv --input velocity --output force --schedule current"


def once(words: list[str], folder: Path, cache: Path) -> tuple[float, float]:
    """Wall and processor time of one process [s]."""
    here = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "LPVID_PROGRESS": "quiet", "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1"}
    before, begun = os.times(), time.perf_counter()
    subprocess.run(words, cwd=folder, env=here, check=True, capture_output=True)
    wall, after = time.perf_counter() - begun, os.times()
    return wall, after.children_user + after.children_system - before.children_user - before.children_system


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    python = sys.executable
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_csv(Rig().run(replace(EXPERIMENTS["test-1"], duration=30.0), seed=1), folder / "run.csv")
        calls = {"import numpy": [python, "-c", "import numpy"], "import lpvid": [python, "-c", "import lpvid"],
                 "lpvid --help": [python, "-m", "lpvid", "--help"],
                 "quartercar --help": [python, "-m", "quartercar", "--help"]}
        print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors; least of {given.rounds}")
        for label, words in calls.items():
            show(label, [once(words, folder, folder / "warm") for _ in range(given.rounds)])
        first = [once([python, "-m", *IDENTIFY.split()], folder, folder / f"empty-{k}") for k in range(given.rounds)]
        show("first identify, 30 s at 512 Hz", first)
        show("second identify", [once([python, "-m", *IDENTIFY.split()], folder, folder / "empty-0")
                                 for _ in range(given.rounds)])


def show(label: str, found: list[tuple[float, float]]) -> None:
    """One line."""
    wall, spent = (min(column) for column in zip(*found, strict=True))
    print(f"{label:<32} {wall:6.2f} s, {spent:6.2f} s of processor", flush=True)


if __name__ == "__main__":
    main()
