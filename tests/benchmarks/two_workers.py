"""What a second processor brings to the dear commands, and whether the result depends on it.

    python tests/benchmarks/two_workers.py [--only fit,diagnose,diagnose-command,tune] [--duration 30]

Each call runs in a process of its own, once bound to one processor and once to two (Linux). Printed are the wall and
processor time of each, the ratio of the walls, and whether both results are the same. The ratio says what the second
processor brings only where both are free: the processors that each run had (processor time over wall) stand beside it,
and the ratio that they would give on an idle machine is bounded by theirs. Expected, written down before the run: at
least 1.6, and the same result to the last digit. About four minutes idle; `identify --auto` runs on one processor.
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
from shutil import copy

from quartercar.rig import EXPERIMENTS, Rig, write_csv

HEAD = """
import json, sys
import lpvid as lpv
record = lpv.read("run1.csv")[0]
"""
CALLS: dict[str, str] = {
    "fit": """
from quartercar.dampers.evaluation.comparison import CompareSettings, compare
found = compare([record], "all", settings=CompareSettings(workers=None))
rows = [[r.name, r.held_out.total.esr, r.training.total.esr] for r in found.rows]
print(json.dumps([rows, found.failed if hasattr(found, "failed") else []], default=str))
""",
    "diagnose": """
from quartercar.effects import CATALOGUE
found = lpv.diagnose(record, "guo", CATALOGUE).to_dict()
del found["seconds"]
print(json.dumps(found, default=str, sort_keys=True))
""",
    "diagnose-command": """
from pathlib import Path
from lpvid.cli import main
sys.argv = "lpvid diagnose run1.csv --baseline guo --out why".split()
try:
    main()
finally:
    found = json.loads(Path("why/diagnosis.json").read_text())
    print(json.dumps({name: found[name] for name in found if name not in ("seconds", "made")}))
""",
    "tune": """
import quartercar as qc
from quartercar.controllers import law_class
from quartercar.rides.default_damper import identified_damper
from quartercar.rides.tuning import Trial, tune_all
from quartercar.roads.ride_roads import IsoRoad
from quartercar.vehicle.nonlinear import Coil
car = qc.QuarterCar(qc.parameters.MEGANE, identified_damper(), coil=Coil(highest=2.5))
trial = Trial(car, (IsoRoad("C", 20.0, 10.0),), (100, 101, 102))
found = tune_all({n: law_class(n)() for n in ("sh-add", "skyhook-linear", "skyhook", "add")}, trial, 64)
print(json.dumps({n: t.to_dict() for n, t in found.items()}, default=str, sort_keys=True))
""",
}


def once(text: str, processors: int, data: Path) -> tuple[float, float, str]:
    """Wall and processor time [s] on the first so many processors, and what the call printed."""
    allowed = sorted(os.sched_getaffinity(0))[:processors]
    here = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "call.py"
        script.write_text(HEAD + text)
        copy(data, Path(folder) / "run1.csv")
        bind = f"import os, runpy, sys; os.sched_setaffinity(0, {allowed}); runpy.run_path(sys.argv.pop(1))"
        before, begun = os.times(), time.perf_counter()
        done = subprocess.run([sys.executable, "-c", bind, str(script)], capture_output=True, text=True, env=here,
                              cwd=folder, check=False)
        wall, after = time.perf_counter() - begun, os.times()
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return wall, spent, done.stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default=",".join(CALLS))
    parser.add_argument("--duration", type=float, default=30.0)
    given = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} processors")
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "run1.csv"
        write_csv(Rig().run(replace(EXPERIMENTS["test-1"], duration=given.duration), seed=1), data)
        for name in given.only.split(","):
            rows = [once(CALLS[name], n, data) for n in (1, 2)]
            (wall, spent, found), (wall_two, spent_two, found_two) = rows
            print(f"{name:<16} one: {wall:6.1f} s, {spent:6.1f} s of processor ({spent / wall:.2f} of them); two: "
                  f"{wall_two:6.1f} s, {spent_two:6.1f} s ({spent_two / wall_two:.2f}); wall ratio "
                  f"{wall / wall_two:.2f}; results {'the same' if found == found_two else 'DIFFER'}", flush=True)


if __name__ == "__main__":
    main()
