"""Fixed structure against full order on five plants: verified gains and processor time.

    python tests/benchmarks/fixed_structure_study.py [NAME ...]

helicopter, scherer, spring, car (a quarter car, mm and kN are the same) noisy (poles at 2e-7 and
1e-5 rad/s) with two states, noisy-1 with one.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.published_plants import helicopter, near_integrators, quarter_car
from helpers.synthesis_plants import scherer, spring

import lpvid as lpv

CASES = {
    "helicopter": (helicopter, lpv.FixedStructure(starts=2)),
    "scherer": (scherer, lpv.FixedStructure(lpv.LowOrder(1), starts=1)),
    "spring": (spring, lpv.FixedStructure(lpv.PID(filter=0.1, integral=False), starts=2, points=3)),
    "car": (quarter_car, lpv.FixedStructure(lpv.LowOrder(1), starts=1, points=3)),
    "noisy": (lambda: near_integrators(1e-1), lpv.FixedStructure(lpv.LowOrder(2), starts=2)),
    "noisy-1": (lambda: near_integrators(1e-1), lpv.FixedStructure(lpv.LowOrder(1), starts=2)),
}


def timed(plant: lpv.GeneralizedPlant, design: lpv.OutputFeedback | lpv.FixedStructure) -> str:
    """Gain, order of the controller and time, as cells of the table."""
    started = time.process_time()
    found = lpv.synthesize(plant, design)
    seconds = time.process_time() - started
    if found.controller is None:
        return f"{found.verdict} | | {seconds:.1f}"
    return f"{found.gamma_verified:.4g} | {found.controller.order} | {seconds:.1f}"


def main() -> None:
    print("| plant | structure | gain | states | s | gain, full order | states | s |\n"
          "|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:] or CASES:
        make, design = CASES[name]
        print(f"| {name} | {design.structure} | {timed(make(), design)} | {timed(make(), lpv.OutputFeedback())} |",
              flush=True)


if __name__ == "__main__":
    main()
