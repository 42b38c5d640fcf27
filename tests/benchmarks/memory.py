"""Peak memory of every command of both programs on ten minutes at 512 Hz.

    python tests/benchmarks/memory.py FOLDER [--duration 600] [--only identify,fit] [--limit 500] [--stop 120]

One record of the virtual rig (test 1, synthetic) and two more of 30 s where a command wants several. What counts is
the proportional set size (PSS of Linux's smaps_rollup: pages that several processes map count once, shared out among
them) of the command and all its processes together, looked at every 20 ms; the largest single process stands beside
it. Commands are stopped after ``--stop`` seconds and marked so: their memory is that until then. Expected,
written down before the run: 500 MB at most each.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

from readme_times import COMMANDS, SIGNALS

from quartercar.rig import EXPERIMENTS, Rig, write_csv

LOOK = 0.02
"""time between two looks [s]"""
MORE: dict[str, str] = {
    "simulate": "lpvid simulate model/model.json run1.csv --out simulated",
    "validate-long": "lpvid validate model/model.json run1.csv --out validated",
    "verify": "lpvid verify stability/stability.json",
    "identify-auto": f"lpvid identify run1.csv {SIGNALS} --auto --budget 60 --out auto",
    "identify-oe": f"lpvid identify run1.csv {SIGNALS} --structure oe --out oe",
    "export-law": "quartercar export --controller sh-add --to c --out law",
    "rig": "quartercar rig plan.toml --out rig",
}
"""beside those of the README"""
ORDER = ("inspect", "identify", "simulate", "validate", "validate-long", "stability", "verify", "compare", "export",
         "identify-oe", "characterise", "fit-budget", "fleet", "design-nominal", "ride-nominal", "rig", "diagnose",
         "identify-auto", "demo")
PLAN = '''seed = 1
[[experiments]]
name = "long"
displacement = { kind = "road" }
current = { kind = "aprbs", clock = 0.03 }
duration = 600.0
'''


def commands() -> dict[str, str]:
    """All of them, by name."""
    return {**COMMANDS, **MORE, "design-nominal": "quartercar design --out design",
            "ride-nominal": "quartercar ride --controller passive,sh-add --seeds 5 --out ride"}


def family(pid: int) -> list[int]:
    """A process and all that descend from it."""
    found, left = [], [pid]
    while left:
        one = left.pop()
        found.append(one)
        try:
            for task in Path(f"/proc/{one}/task").iterdir():
                left += [int(p) for p in (task / "children").read_text().split()]
        except (OSError, ValueError):
            continue
    return found


def held(pid: int) -> int:
    """Bytes of a process that are in memory, its share of those that processes share; 0 for one that has ended."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
        return 1024 * int(text.split("Pss:")[1].split()[0])
    except (OSError, IndexError, ValueError):
        return 0


def watched(words: list[str], folder: Path, stop: float) -> tuple[float, float, int, str]:
    """Peak of the whole family and of one process [MB], how many at once, and how it ended."""
    started = subprocess.Popen(words, cwd=folder, env={**os.environ, "LPVID_PROGRESS": "quiet"},
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True, text=True)
    together = single = most = 0
    begun, how = time.monotonic(), ""
    while started.poll() is None:
        sizes = [held(p) for p in family(started.pid)]
        together, single, most = max(together, sum(sizes)), max(single, *sizes), max(most, len(sizes))
        if time.monotonic() - begun > stop:
            how = f"stopped after {stop:.0f} s"
            for pid in reversed(family(started.pid)):
                os.kill(pid, signal.SIGKILL)
            break
        time.sleep(LOOK)
    assert started.stderr is not None
    stated = started.stderr.read().strip().splitlines()
    if started.wait() not in (0, 3) and not how:
        how = f"exit {started.returncode}: {stated[-1][:90] if stated else ''}"
    return together / 1e6, single / 1e6, most, how


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--duration", type=float, default=600.0)
    parser.add_argument("--only", default=",".join(ORDER))
    parser.add_argument("--limit", type=float, default=500.0)
    parser.add_argument("--stop", type=float, default=120.0)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    for seed, duration in ((1, given.duration), (2, 30.0), (9, 30.0)):
        path = given.folder / f"run{seed}.csv"
        if not path.exists():
            write_csv(Rig().run(replace(EXPERIMENTS["test-1"], duration=duration), seed=seed), path)
    (given.folder / "plan.toml").write_text(PLAN)
    known = commands()
    print(f"{'command':<17} {'together':>9} {'largest':>9}  processes")
    for name in given.only.split(","):
        program, *words = known[name].split()
        together, single, most, how = watched([sys.executable, "-m", program, *words], given.folder, given.stop)
        over = "  OVER" if together > given.limit else ""
        print(f"{name:<17} {together:6.0f} MB {single:6.0f} MB  {most:3d}{over}  {how}", flush=True)


if __name__ == "__main__":
    main()
