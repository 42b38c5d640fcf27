"""How small a fault a fleet finds, from the specimens' spread alone: share of faulty files named, by size.

    python tests/benchmarks/fleet_power.py [--count 200] [--cause gas-stiffness] [--sizes 1,1.5,2,3,4] [--each 20]

The fleet is that of `fleet_study.py`: the rig's damper with 3 % spread of each coefficient. Of each size some files are
made and compared with the healthy ones one at a time, each as the only faulty file of its fleet: it is named where
`differing` gives it a q of at most 0.05. Beside that the share of fleets of healthy files alone in which anybody is
named. No diagnosis, no cluster. The size at which nine of ten are named is what a study may hide and expect to find.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from fleet_study import COEFFICIENTS, SPREAD

import lpvid as lpv
from lpvid.fleet.differing import differing_parameters, differing_residuals, either, residual_level, shift
from lpvid.identification.regression import Factor
from lpvid.identification.streaming import merged_factor, stream_factor
from quartercar.rig import EXPERIMENTS, Rig, RigDamper, effect

FDR = 0.05
STRUCTURE = lpv.ARX(2, 2, 0, ("velocity", "displacement"), "force", lpv.Polynomial(("current",), degree=1), affine=1)


def specimen(seed: int, duration: float, cause: str | None, size: float) -> lpv.Record:
    """A record of one damper; virtual."""
    rng = np.random.default_rng(seed)
    plain = RigDamper()
    damper = replace(plain, **{n: getattr(plain, n) * (1 + SPREAD * rng.normal()) for n in COEFFICIENTS})
    causes = () if cause is None else (effect(cause, size),)
    rig = replace(Rig(), damper=damper, effects=causes)
    return rig.run(replace(EXPERIMENTS["test-1"], duration=duration), seed=seed)


def named(factors: dict[str, Factor]) -> tuple[str, ...]:
    """Files that differ, as `run_fleet` finds them."""
    kept = list(factors)
    for _ in range(5):
        whole = merged_factor([factors[n] for n in kept])
        k = whole.columns
        theta = np.linalg.solve(whole.r[:k, :k], whole.r[:k, k:])
        by_parameters = differing_parameters({n: shift(f, theta) for n, f in factors.items()}, FDR)
        assert by_parameters is not None
        apart = either(by_parameters, differing_residuals({n: residual_level(f) for n, f in factors.items()}, FDR))
        following = [n for n in factors if n not in apart.named]
        if following == kept:
            break
        kept = following
    return apart.named


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--cause", default="gas-stiffness")
    parser.add_argument("--sizes", default="1,1.5,2,2.5,3,3.5")
    parser.add_argument("--each", type=int, default=20)
    parser.add_argument("--duration", type=float, default=8.0)
    given = parser.parse_args()
    begun = time.process_time()
    box = lpv.Scheduling(("current",), (0.0,), (2.5,), units=("A",))

    def factor(seed: int, cause: str | None = None, size: float = 0.0) -> Factor:
        return stream_factor([specimen(seed, given.duration, cause, size)], STRUCTURE, box).factor

    healthy = {f"healthy-{k}": factor(10_000 + k) for k in range(given.count)}
    print(f"{given.count} healthy files: named {len(named(healthy))}; {time.process_time() - begun:.0f} s of processor",
          flush=True)
    rest = dict(list(healthy.items())[1:])
    for size in map(float, given.sizes.split(",")):
        found = [named({**rest, "faulty": factor(20_000 + k, given.cause, size)}) for k in range(given.each)]
        right, wrong = sum("faulty" in f for f in found), [len(set(f) - {"faulty"}) for f in found]
        print(f"{given.cause} of size {size:g}: named {right} of {given.each}; healthy files named beside it "
              f"{np.mean(wrong):.2f} a fleet; {time.process_time() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()
