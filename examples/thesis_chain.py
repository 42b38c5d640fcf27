"""Does the thesis's chain (order 4, first degree in current) reach its ESR of 0.04 on experiments it has not seen?"""

from __future__ import annotations

from collections.abc import Sequence

import lpvid as lpv
from quartercar.rig import EXPERIMENTS, Rig

TRAINING = ("test-1", "test-2", "test-3")
STRUCTURES = {
    "three zones (the thesis)": {"stage": "three-zone"},
    "tanh, affine, coil lag": {"stage": "tanh", "affine": 1, "schedule_filter": "rise-fall"},
}


def experiment(name: str, seed: int) -> list[lpv.Record]:
    """All runs of one experiment: one run, or one for every constant current."""
    levels = EXPERIMENTS[name].replicates if name in ("test-6", "test-7", "test-8") else 1
    return [Rig().run(EXPERIMENTS[name], seed, k) for k in range(levels)]


def main(tests: Sequence[str] = tuple(EXPERIMENTS)) -> dict[str, float]:
    """Free-run ESR of every experiment with roads and currents that were not used for fitting; returns the averages."""
    training = [r for name in TRAINING for r in experiment(name, seed=1)]
    held_out = {name: experiment(name, seed=2) for name in tests}
    averages = {}
    for title, settings in STRUCTURES.items():
        found = lpv.identify(training, lpv.ARX(na=4, nb=4, nk=0, input="velocity", output="force",
                                               basis=lpv.Polynomial("current", degree=1), **settings))
        print(f"{title}: free-run ESR, held-out")
        esr = {name: lpv.validate(found.model, runs).overall.free_run.esr for name, runs in held_out.items()}
        for name, value in esr.items():
            test = EXPERIMENTS[name]
            used = "same kind as the training" if name in TRAINING else "kind not used for fitting"
            what = f"{type(test.displacement).__name__} x {type(test.current).__name__}"
            print(f"  {name}  {what:<22}  {value:.4f}  ({used})")
        averages[title] = sum(esr.values()) / len(esr)
        print(f"  average {averages[title]:.4f}")
    return averages


if __name__ == "__main__":
    main()
