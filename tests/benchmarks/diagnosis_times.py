"""Seconds that the whole catalogue takes on 30 s at 512 Hz, for every cause that the virtual rig can hide.

    python tests/benchmarks/diagnosis_times.py [--shard 0/2] [--only coil-lag,none] [--baseline guo] [--seed 0]

Several causes at once are joined by +: ``--only coulomb-friction+series-compliance+coil-lag``.

Each diagnosis runs on one core; the process is warmed up on another record first, so that no compilation is counted.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import time  # noqa: E402
from dataclasses import replace  # noqa: E402

import lpvid as lpv  # noqa: E402
from quartercar.effects import CATALOGUE  # noqa: E402
from quartercar.rig import CAUSES, EXPERIMENTS, Rig, RigDamper, effect  # noqa: E402

LIMIT, NOTHING = 30.0, 3.0
"""seconds for a hidden cause, and where nothing is hidden"""
MORE = {"cavitation": {"limit": 800.0}, "channel-sign": {}, "quantisation": {}}
"""sizes at which the rig's default motion shows a cause"""


def main() -> None:
    """One line for each cause."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shard", default="0/1")
    parser.add_argument("--only", default="")
    parser.add_argument("--baseline", default="guo")
    parser.add_argument("--experiment", default="test-1", choices=list(EXPERIMENTS))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    part, parts = map(int, options.shard.split("/"))
    names = options.only.split(",") if options.only else ["none", *(c.name for c in CAUSES)]
    experiment = replace(EXPERIMENTS[options.experiment], duration=30.0)
    warm = hiding("backlash").run(replace(experiment, duration=8.0), 1)
    lpv.diagnose(warm, options.baseline, CATALOGUE)
    for name in names[part::parts]:
        record = hiding(name).run(experiment, options.seed)
        wall, cpu = time.perf_counter(), time.process_time()
        found = lpv.diagnose(record, options.baseline, CATALOGUE)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        stated = ", ".join(c.name for c in found.causes) or "; ".join(" or ".join(r.names) for r in found.rivals)
        late = "  TOO LONG" if cpu > (NOTHING if name == "none" else LIMIT) else ""
        print(f"{name:20s} {wall:6.1f} s, {cpu:6.1f} s of CPU  {found.verdict:18s} {stated}{late}", flush=True)


def hiding(name: str) -> Rig:
    """The rig with causes joined by +, each at the size that the rig gives it by default."""
    names = [] if name == "none" else name.split("+")
    return Rig(damper=RigDamper.static(), effects=tuple(effect(n, 1.0, **MORE.get(n, {})) for n in names))


if __name__ == "__main__":
    main()
