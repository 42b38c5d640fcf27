"""Time and peak memory of every command of the README on data of the virtual rig, one after the other.

    python tests/benchmarks/readme_times.py FOLDER [--duration 30] [--only identify,fit]

Prints the load at the start of each command: times are worth something on an idle machine only. ``--duration 600``
gives the memory on ten minutes at 512 Hz (aim: at most 500 MB each).
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

from quartercar.rig import EXPERIMENTS, Rig, write_csv

SIGNALS = "--input velocity --output force --schedule current"
COMMANDS: dict[str, str] = {
    "inspect": "lpvid inspect run1.csv --out audit",
    "identify": f"lpvid identify run1.csv run2.csv {SIGNALS} --shape tanh --hold-out 1/3 --out model",
    "validate": "lpvid validate model/model.json run9.csv --out validation",
    "stability": "lpvid stability model/model.json --out stability",
    "compare": "lpvid compare model/model.json run9.csv --out compare",
    "export": "lpvid export model/model.json --to c --out unit",
    "characterise": "quartercar characterise run1.csv run2.csv --out page",
    "fit": "quartercar fit run1.csv --models all --out fit",
    "fit-budget": "quartercar fit run1.csv --models all --budget 60 --out fit",
    "diagnose": "lpvid diagnose run1.csv --baseline guo --out why",
    "identify-passive": f"lpvid identify run1.csv {SIGNALS} --shape tanh --passive --out passive",
    "design": "quartercar design --damper passive/model.json --out design",
    "ride": "quartercar ride --damper passive/model.json --controller design/controller.json,sh-add,passive --seeds 20 "
            "--out ride",
    "bound": "quartercar ride --bound --out bound",
    "fleet": f"lpvid fleet run1.csv run2.csv run9.csv --do audit,identify {SIGNALS} --out fleet",
    "demo": "quartercar demo --out demo",
}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--duration", type=float, default=30.0)
    parser.add_argument("--only", default=",".join(COMMANDS))
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    for seed in (1, 2, 9):
        record = Rig().run(replace(EXPERIMENTS["test-1"], duration=given.duration), seed=seed)
        write_csv(record, given.folder / f"run{seed}.csv")
    here = {**os.environ, "LPVID_PROGRESS": "quiet"}
    for name in given.only.split(","):
        program, *words = COMMANDS[name].split()
        load, begun = os.getloadavg()[0], time.perf_counter()
        started = subprocess.Popen([sys.executable, "-m", program, *words], cwd=given.folder, env=here,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        assert started.stderr is not None
        stated = started.stderr.read()
        _, status, used = os.wait4(started.pid, 0)
        code = os.waitstatus_to_exitcode(status)
        left = "" if code in (0, 3) else f"  exit {code}: {stated.decode().strip().splitlines()[-1][:90]}"
        wall, spent = time.perf_counter() - begun, used.ru_utime + used.ru_stime
        print(f"{name:<17} {wall:7.1f} s, {spent:7.1f} s of processor, peak "
              f"{used.ru_maxrss / 1024:5.0f} MB, load {load:4.1f}{left}", flush=True)


if __name__ == "__main__":
    main()
