"""Processor seconds of a diagnosis, stage by stage: what one process does alone, and what forks share.

    python tests/benchmarks/serial_share.py [--duration 30] [--seed 1]

Processor seconds do not depend on what else the machine does, the clock does. The whole catalogue against `guo` runs
once on one processor and once on two (Linux), after a warm-up. Printed are the stages that go through forks, with the
seconds of this process and of its forks; the serial share (Amdahl), which is what is left on one processor; and the
longest path on two: the serial seconds, and of each stage those of the busier process.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
from collections import defaultdict  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import replace  # noqa: E402
from typing import Any  # noqa: E402

import lpvid as lpv  # noqa: E402
from lpvid.diagnosis import facade  # noqa: E402
from lpvid.diagnosis.evidence import visited  # noqa: E402
from quartercar.effects import CATALOGUE  # noqa: E402
from quartercar.rig import EXPERIMENTS, Rig  # noqa: E402


def spent() -> tuple[float, float]:
    """Processor seconds of this process, and of its forks that have ended."""
    t = os.times()
    return t.user + t.system, t.children_user + t.children_system


class Stages:
    """Seconds of this process and of its forks in calls of `in_forks`, by the function that calls it."""

    def __init__(self) -> None:
        self.rounds: list[tuple[str, float, float]] = []
        self.inside = 0

    def watched(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same call, its seconds noted; one inside another counts with that."""
        def noted(*given: Any) -> Any:
            frame = sys._getframe(1)
            caller = (frame.f_back if frame.f_code.co_name == "in_parallel" else frame).f_code.co_name  # type: ignore
            before, self.inside = spent(), self.inside + 1
            try:
                return call(*given)
            finally:
                self.inside -= 1
                if not self.inside:
                    after = spent()
                    self.rounds.append((caller, after[0] - before[0], after[1] - before[1]))
        return noted


def main() -> None:
    """Two tables and three figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    record = Rig().run(replace(EXPERIMENTS["test-1"], duration=given.duration), seed=given.seed)
    stages = Stages()
    visited.in_forks = stages.watched(visited.in_forks)  # pyright: ignore
    facade.in_forks = stages.watched(facade.in_forks)  # pyright: ignore
    lpv.diagnose(record, "guo", CATALOGUE)
    allowed = sorted(os.sched_getaffinity(0))
    whole = {}
    for count in (1, 2):
        os.sched_setaffinity(0, allowed[:count])
        stages.rounds.clear()
        before = spent()
        lpv.diagnose(record, "guo", CATALOGUE)
        own, forks = (b - a for a, b in zip(before, spent(), strict=True))
        sums: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0, 0.0])
        for name, here, there in stages.rounds:
            sums[name] = [a + b for a, b in zip(sums[name], (here, there, max(here, there)), strict=True)]
        serial = own - sum(s[0] for s in sums.values())
        path = serial + sum(s[2] for s in sums.values())
        whole[count] = own + forks
        print(f"{count} processor(s): {own + forks:.1f} s, {own:.1f} in the first process; serial {serial:.2f} s, "
              f"{serial / (own + forks):.1%}; longest path {path:.1f} s; load {os.getloadavg()[0]:.1f}")
        for name, (here, there, _) in sums.items():
            print(f"  {name:<16} {here:6.2f} s here, {there:6.2f} s in forks")
    print(f"one processor over the longest path on two: {whole[1] / path:.2f}; both processes' seconds over it: "
          f"{whole[2] / path:.2f}")


if __name__ == "__main__":
    main()
