"""Milliseconds of CPU that one run, one derivative and one refit of every effect cost around a baseline.

    python tests/benchmarks/effect_times.py [--record rig|race|random] [--baseline linear] [--samples N]
                                            [--only backlash,…] [--beside asymmetry,…]

A run and a derivative are taken at parameters that were never asked for before, so that nothing is remembered; a
refit is what a search pays for one cause: from its second point of the grid, at most eight iterations, rough.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import replace  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402

import lpvid as lpv  # noqa: E402
from lpvid.baselines.named import named_baseline  # noqa: E402
from lpvid.diagnosis.evidence.engine import usable_of  # noqa: E402
from lpvid.diagnosis.problem import DiagnosisProblem, problem_of  # noqa: E402
from lpvid.diagnosis.refitting import descend  # noqa: E402
from lpvid.effects.composition import Composition  # noqa: E402
from lpvid.effects.preparing import prepare  # noqa: E402
from lpvid.effects.scaling import Scales  # noqa: E402
from lpvid.record import Record  # noqa: E402
from quartercar.effects import CATALOGUE  # noqa: E402
from quartercar.rig import EXPERIMENTS, Rig, RigDamper, effect  # noqa: E402

REPEATS, STEPS = 3, 8
SHARED = {"race": "race_damper_dyno/t1_2_2_24_24_s5_n10_100psi.csv", "random": "mr_damper_random/estimation.csv"}


def main() -> None:
    """One line for each effect, the dearest refit first."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", default="rig", choices=("rig", *SHARED))
    parser.add_argument("--baseline", default="linear")
    parser.add_argument("--only", default="")
    parser.add_argument("--beside", default="", help="causes that every composition holds besides")
    parser.add_argument("--samples", type=int, default=15360)
    options = parser.parse_args()
    records = prepare(_records(options.record, options.samples), (), CATALOGUE).training
    baseline = named_baseline(options.baseline, records).fit(records)
    problem = problem_of(records, baseline)
    usable, _ = usable_of(CATALOGUE, baseline, problem.signals)
    scale = Scales.of(problem.signals).size
    looked_at = {e.name: e.spread_points(problem.signals, scale) for e in usable}
    middle = {name: points[len(points) // 2] for name, points in looked_at.items()}
    beside = [e for e in usable if e.name in options.beside.split(",")]
    found = []
    for one in usable:
        if one in beside or (options.only and one.name not in options.only.split(",")):
            continue
        composition = Composition(baseline, (*beside, one))
        start = np.concatenate([baseline.vector, *(middle[e.name] for e in composition.effects)])
        found.append((one.name, *cost(problem, composition, start)))
    named = "+".join((options.baseline, *(e.name for e in beside)))
    print(f"{options.record}, {named}: {problem.n_samples} samples, {baseline.vector.size} parameters of the baseline")
    print(f"{'effect':24s} {'run':>11s} {'derivative':>11s} {'refit':>11s}   [ms]")
    for name, *times in sorted(found, key=lambda f: -f[3]):
        print(f"{name:24s} " + " ".join(f"{t:11.2f}" for t in times))
    for word, of in (("median", np.median), ("sum", np.sum)):
        print(f"{word:24s} " + " ".join(f"{of([f[k] for f in found]):11.2f}" for k in (1, 2, 3)))


def cost(problem: DiagnosisProblem, composition: Composition, start: np.ndarray) -> tuple[float, float, float]:
    """Milliseconds of a run, of a derivative and of a refit."""
    count = 0

    def fresh() -> np.ndarray:
        nonlocal count
        count += 1
        return start + 1e-6 * count * np.abs(start)

    def run() -> None:
        problem.errors(composition, fresh())

    def derivative() -> None:
        at = fresh()
        for s in problem.signals:
            composition.sensitivities(s, at)

    run()
    derivative()
    times = [1e3 * min(_seconds(f) for _ in range(REPEATS)) for f in (run, derivative)]
    refit = 1e3 * _seconds(lambda: descend(problem, composition, start, iterations=STEPS, rough=True))
    return times[0], times[1], refit


def _seconds(job: Callable[[], object]) -> float:
    begun = time.process_time()
    job()
    return time.process_time() - begun


def _records(kind: str, samples: int) -> list[Record]:
    if kind == "rig":
        rig = Rig(damper=RigDamper.static(), effects=(effect("series-compliance", 1.0),))
        return [rig.run(replace(EXPERIMENTS["test-1"], duration=samples / 512.0), 0)]
    return lpv.read(str(Path(os.environ["LPVID_DATA"]) / SHARED[kind]))


if __name__ == "__main__":
    main()
