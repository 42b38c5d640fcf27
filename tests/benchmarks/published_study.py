"""Published designs through the public API: verdict, verified gain, least bound and processor time of each.

    python tests/benchmarks/published_study.py [WORD]

A word leaves only the cases whose name has it. A figure is checked before it is printed: certificate, and
the largest frozen gain of the closed loop by singular values on a grid of frequencies.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.published_plants import near_integrators, quarter_car, two_disks
from helpers.synthesis_plants import missile, sb10fd, scherer, wu

import lpvid as lpv

CASES = [
    ("two disks, one Lyapunov matrix", "1.130", two_disks, lpv.OutputFeedback()),
    ("two disks, LFT", "1.3361", two_disks, lpv.LFTFeedback()),
    ("two disks, H2", "1.5998", lambda: two_disks("h2"), lpv.MultiObjective(lpv.H2(), feedthrough=False)),
    ("Wu 1996, rate 5", ".9250", lambda: wu(5.0), lpv.OutputFeedback(lpv.Fourier("rho", 1), varying="both")),
    ("missile autopilot", ".197", missile, lpv.OutputFeedback()),
    ("Scherer 1997", "9.508", scherer, lpv.OutputFeedback()),
    ("SB10FD", "10.184", sb10fd, lpv.OutputFeedback()),
    *((f"near-integrators, noise {noise:g}", least, lambda noise=noise: near_integrators(noise), lpv.OutputFeedback())
      for noise, least in ((0.0, "4.4825"), (1e-3, "4.50"), (1e-2, "4.67"), (1e-1, "5.29"))),
    ("quarter car, m and N, LFT", "1.931", lambda: quarter_car(1.0, 1.0), lpv.LFTFeedback()),
    ("quarter car, mm and kN, LFT", "1.931", lambda: quarter_car(1e-3, 1e3), lpv.LFTFeedback()),
    ("quarter car, m and N, output feedback", "–", lambda: quarter_car(1.0, 1.0), lpv.OutputFeedback()),
    ("quarter car, mm and kN, output feedback", "–", lambda: quarter_car(1e-3, 1e3), lpv.OutputFeedback()),
]


def held(loop: lpv.LPVStateSpace) -> float:
    """Largest frozen gain on grids of scheduling and frequency."""
    worst = 0.0
    points = loop.box.grid({0: 1, 1: 11, 2: 5}.get(len(loop.box.names), 3))
    for p in np.where([n.endswith("_rate") for n in loop.box.names], 0.0, points):  # what is held has no rate
        a, b, c, d = loop.frozen(p)
        poles = np.abs(np.linalg.eigvals(a))
        if not np.linalg.eigvals(a).real.max() < 0:
            return np.inf
        grid = np.concatenate([[0.0], np.geomspace(max(poles.min(), 1e-9) / 10, 10 * poles.max(), 600)])
        worst = max(worst, *(np.linalg.norm(c @ np.linalg.solve(1j * w * np.eye(len(a)) - a, b) + d, 2) for w in grid))
    return worst


def main() -> None:
    """The table."""
    print("| case | published | verdict | verified | least bound | reached, held | certificate | seconds |")
    print("|---|---|---|---|---|---|---|---|")
    for name, published, plant, design in CASES:
        if not all(word in name for word in sys.argv[1:]):
            continue
        started = time.process_time()
        found = lpv.synthesize(plant(), design)
        seconds = time.process_time() - started
        h2 = [f for f in found.figures if f["criterion"] != "H-infinity"]
        level = h2[0]["verified"] if h2 else found.gamma_verified
        checked = None if found.certificate is None else lpv.verify(found.certificate, found.closed_loop).holds
        reached = "–" if h2 or found.closed_loop is None else f"{held(found.closed_loop):.5g}"
        least = "–" if found.infimum is None else f"{found.infimum:.5g}"
        cells = (name, published, found.verdict, f"{level:.5g}", least, reached, str(checked), f"{seconds:.1f}")
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
