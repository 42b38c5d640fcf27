"""Is a gain table for an ECU as good as a full-order controller on an active quarter car whose damping moves?"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import lpvid as lpv
from lpvid.plot import show
from lpvid.plot.style import look, panels

BODY, WHEEL, SPRING, TYRE = 315.0, 37.5, 29500.0, 208000.0  # kg, kg, N/m, N/m


def car() -> lpv.GeneralizedPlant:
    """States: stroke, body speed, tyre deflection, wheel speed; the damping [N s/m] moves at will."""
    a = np.zeros((2, 4, 4))
    a[0] = [[0, 1, 0, -1], [-SPRING / BODY, 0, 0, 0], [0, 0, 0, 1], [SPRING / WHEEL, 0, -TYRE / WHEEL, 0]]
    a[1] = [[0, 0, 0, 0], [0, -1 / BODY, 0, 1 / BODY], [0, 0, 0, 0], [0, 1 / WHEEL, 0, -1 / WHEEL]]
    b, c, d = np.zeros((2, 4, 3)), np.zeros((2, 6, 4)), np.zeros((2, 6, 3))
    b[0] = [[0, 0, 0], [0, 0, 1e3 / BODY], [-1, 0, 0], [0, 0, -1e3 / WHEEL]]
    c[:, 0], d[0, 0, 2] = a[:, 1] / 10, 1e3 / BODY / 10                    # comfort: 10 m/s² count as one
    c[0, 1, 0], c[0, 2, 2], d[0, 3, 2] = 20.0, 50.0, 0.5                   # 5 cm, 2 cm, 2 kN
    c[0, 4], c[0, 5], d[0, 4, 1], d[0, 5, 1] = [0, 1, 0, -1], [0, 1, 0, 0], 0.02, 0.01
    system = lpv.LPVStateSpace(a, b, c, d, lpv.Polynomial("damping", 1), None,
                               lpv.Scheduling(("damping",), (500.0,), (3000.0,), units=("N s/m",)),
                               inputs=("road", "noise", "force"),
                               outputs=("comfort", "stroke", "tyre", "effort", "stroke speed", "body speed"))
    return lpv.GeneralizedPlant(system, ["force"], ["stroke speed", "body speed"])


def main(table: str | Path | None = None, figure: str | None = None) -> dict[str, float]:
    """Verified gains of both; the table is written if a path is given."""
    plant = car()
    full = lpv.synthesize(plant, lpv.OutputFeedback())
    few = lpv.synthesize(plant, lpv.FixedStructure(lpv.StaticGain(), start=full, starts=1, points=4))
    print(f"full order\n{full}\n\ngain table\n{few}\n{lpv.gain_surface(few.required())}")
    surface = lpv.gain_surface(few.required())
    if table is not None:
        surface.to_csv(table, 6)
    points, values = surface.table(41)
    with look():
        canvas, ((axes,),) = panels(1, 1, height=2.6)
        for label, line in zip(surface.labels, values.T, strict=True):
            axes.plot(points[:, 0], line, label=label)
        axes.set(xlabel="damping [N s/m]", ylabel="gain [kN s/m]")
        axes.legend()
        show(canvas, figure)
    return {"full order": full.gamma_verified or np.inf, "gain table": few.gamma_verified or np.inf}


if __name__ == "__main__":
    main(*sys.argv[1:])
