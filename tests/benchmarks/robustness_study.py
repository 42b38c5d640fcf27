"""Thirty random stable LPV systems, every route: points of free-run fit short of the true model, as a Markdown table.

Run ``python tests/benchmarks/robustness_study.py [number of systems]``; some minutes.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.random_systems import ROUTES, random_system, shortfall, time_invariant

NEAR = 3.0


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    every = {**ROUTES, "time-invariant": time_invariant}
    print("| system | order | variables | SNR, dB | noise | true model's fit, % | " + " | ".join(every) + " |")
    print("|" + "---|" * (6 + len(every)))
    short, seconds = np.zeros((count, len(every))), np.zeros((count, len(every)))
    for seed in range(count):
        system = random_system(seed)
        for i, route in enumerate(every.values()):
            start = time.perf_counter()
            short[seed, i] = shortfall(system, route)
            seconds[seed, i] = time.perf_counter() - start
        cells = " | ".join(f"{v:.2f}" for v in short[seed])
        print(f"| {seed} | {system.model.na} | {len(system.names)} | {system.snr:.1f} | "
              f"{'coloured' if system.coloured else 'white'} | {system.true_fit():.2f} | {cells} |", flush=True)
    for stated, values in ((f"within {NEAR:g} points", np.sum(short <= NEAR, axis=0)),
                         ("median", np.median(short, axis=0)), ("worst", short.max(axis=0)),
                         ("median time, s", np.median(seconds, axis=0))):
        print(f"| **{stated}** | | | | | | " + " | ".join(f"{v:.3g}" for v in values) + " |")


if __name__ == "__main__":
    main()
