"""At which current does a frozen damper model turn unstable, and is it stable while the current moves?"""

from __future__ import annotations

import sys
from pathlib import Path

import lpvid as lpv
from lpvid import plot

MODEL = lpv.LPVTransferFunction.siso(
    a=[[-1.63, 0.15], [0.964, -0.1745], [-0.149, 0.06372222], [-0.083, -0.01844444]],
    b=[[0, 0], [1.0, 0.0]], basis=lpv.Polynomial("current", degree=1), sample_time=1 / 512,
    scheduling=lpv.Scheduling(("current",), (0.0,), (2.5,), units=("A",)))


def main(figure: Path | None = None) -> float:
    """Print the stability statements and draw the locus; returns the upper critical current [A]."""
    critical = lpv.critical_scheduling(MODEL)
    print(critical)
    certificate = lpv.certify_stability(MODEL)
    print(certificate)
    print(lpv.verify(certificate, MODEL))
    if figure is not None:
        plot.locus(lpv.pole_locus(MODEL), critical=critical).savefig(figure)
    return max(c.value for c in critical.values)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
