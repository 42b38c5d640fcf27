"""A fleet of 200 virtual dampers with five faulty ones among them, three workers of which two are killed.

    python tests/benchmarks/fleet_study.py OUT [--count 200] [--no-diagnosis]
    python tests/benchmarks/fleet_study.py OUT --count 12 --faults coulomb-friction,series-compliance --kill 1

The specimens are the rig's damper with 3 % spread of each coefficient (virtual data). Expected, written down before the
run: the five faulty ones and no other are named, and for each its cause first; nothing is lost to the killed workers.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import lpvid as lpv
from lpvid.fleet import plan_fleet, run_fleet
from quartercar.effects import CATALOGUE
from quartercar.rig import EXPERIMENTS, Rig, RigDamper, effect, write_csv

FAULTS = {"coulomb-friction": 1.5, "backlash": 1.0, "asymmetry": 1.0, "coil-lag": 1.0, "series-compliance": 1.0}
"""Causes and their sizes. Each is found by `fleet_power.py` in 8 of 8 files, by which they were chosen before a study.

A gas spring is none of them: up to size 2.5 (20 kN/m) one of 16 is found, and from size 3 on the gas is compressed
to nothing within the stroke of half the files (1.4 MN), which is no specimen."""
HANGING = """import builtins, io, time
plain = io.open
def waiting(file, *words, **more):
    while str(file).endswith("hanging.csv"):
        time.sleep(1.0)
    return plain(file, *words, **more)
builtins.open = io.open = waiting
"""
"""Makes opening one file never end, in every process that starts from now on, as a share that answers no more does."""
SPREAD = 0.03
COEFFICIENTS = ("viscous", "viscous_per_current", "yield_base", "yield_per_current")


def specimens(folder: Path, count: int, duration: float, faults: tuple[str, ...], seed: int = 7) -> dict[str, str]:
    """Write the records; the faulty ones by name."""
    rng = np.random.default_rng(seed)
    faulty = dict(zip(sorted(rng.choice(count, len(faults), replace=False).tolist()), faults, strict=True))
    experiment = replace(EXPERIMENTS["test-1"], duration=duration)
    names = {}
    for k in range(count):
        plain = RigDamper()
        damper = replace(plain, **{n: getattr(plain, n) * (1 + SPREAD * rng.normal()) for n in COEFFICIENTS})
        causes = (effect(faulty[k], FAULTS[faulty[k]]),) if k in faulty else ()
        name = f"damper-{k:03d}"
        path = folder / f"{name}.csv"
        if not path.exists():  # a study that is given again goes on
            write_csv(replace(Rig(), damper=damper, effects=causes).run(experiment, seed=1000 * (seed - 6) + k), path)
        if k in faulty:
            names[name] = faulty[k]
    return names


def stated(path: Path) -> str:
    """Verdict, families with their probabilities and rivals of a diagnosis."""
    if not path.exists():
        return "no diagnosis"
    found = json.loads(path.read_text(encoding="utf-8"))
    likely = ", ".join(f"{f['name']} {f['probability']:.2f}" for f in found.get("families", [])[:4])
    rivals = "; ".join(" or ".join(r["names"]) for r in found.get("rivals", []))
    return f"{found['verdict']}; families {likely or '-'}; rivals {rivals or '-'}"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7, help="of specimens, which are faulty, and noise")
    parser.add_argument("--duration", type=float, default=8.0)
    parser.add_argument("--no-diagnosis", action="store_true")
    parser.add_argument("--faults", default=",".join(FAULTS), help="of these, each in one specimen")
    parser.add_argument("--kill", type=int, default=2, help="workers that are killed")
    parser.add_argument("--baseline", default=None,
                        help="law that the diagnoses start from; left out, the one that suits healthy files best")
    parser.add_argument("--hang", action="store_true", help="also a file that never ends: it must be listed as failed")
    parser.add_argument("--time-limit", type=float, default=600.0, help="of a step of a file [s]")
    given = parser.parse_args()
    data = given.out / "data"
    data.mkdir(parents=True, exist_ok=True)
    truth = specimens(data, given.count, given.duration, tuple(given.faults.split(",")), given.seed)
    hanging = data / "hanging.csv"
    if given.hang:
        hanging.write_bytes((data / "damper-000.csv").read_bytes())
        (given.out / "sitecustomize.py").write_text(HANGING)
        os.environ["PYTHONPATH"] = os.pathsep.join([str(given.out.resolve()), os.environ.get("PYTHONPATH", "")])
    print("hidden:", truth)
    do = ("identify",) if given.no_diagnosis else ("identify", "diagnose")
    basis = lpv.Polynomial(("current",), degree=1)
    structure = lpv.ARX(2, 2, 0, ("velocity", "displacement"), "force", basis, affine=1)
    killed: list[int] = []

    def report_progress(text: str) -> None:
        if len(killed) < given.kill and f": {given.count // 3} of" in text:
            tasks = Path(f"/proc/{os.getpid()}/task")
            pids = {int(p) for t in tasks.iterdir() for p in (t / "children").read_text().split()}
            workers = [p for p in pids if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()]
            killed.append(workers[0])
            os.kill(workers[0], signal.SIGKILL)

    begun = time.perf_counter()
    plan = plan_fleet([f"{data}/*.csv"], given.out / "fleet", do=do, structure=structure, limit=given.time_limit,
                      baseline=given.baseline)
    found = run_fleet(plan, workers=3, report_progress=report_progress)
    print(found)
    assert found.differing is not None
    named = set(found.differing.named)
    print(f"killed workers: {len(killed)}; files done {given.count + given.hang - len(found.failed)} of "
          f"{given.count + given.hang}; not done: {', '.join(found.failed) or '-'}")
    print(f"named and faulty {len(named & set(truth))} of {len(truth)}, named and healthy {len(named - set(truth))}")
    for name, cause in truth.items():
        stated_causes = found.diagnoses.get(name)
        print(f"  {name}: hidden {cause}, diagnosed {stated_causes or '-'}")
        print(f"    {stated(given.out / 'fleet' / 'files' / name / 'diagnosis' / 'diagnosis.json')}")
    forms = {e.name: e.form_of or e.name for e in CATALOGUE}  # unequal edges are a form of the coil's lag
    by_form = {n: [forms.get(c, c) for c in found.causes.get(n, ())] for n in truth}
    print(f"cause named {sum(c in by_form[n] for n, c in truth.items())} of {len(truth)}, "
          f"it alone {sum([c] == by_form[n] for n, c in truth.items())}")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{time.perf_counter() - begun:.0f} s, peak memory of the driver {memory:.0f} MB")


if __name__ == "__main__":
    main()
