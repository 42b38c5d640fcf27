"""How much better does a rear axle ride that is given the road of the front one, by sensors that cars have?

    python examples/preview.py [FIGURE]

The rear axle meets the front axle's road wheelbase/speed later. A Kalman filter with a register makes an estimate of it
from the front axle's stroke and body acceleration; `mpc` searches the current within the identified damper's limits
that is best for it, at every sample.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import quartercar as qc
from lpvid.plot import show
from quartercar.rides.config import build_car
from quartercar.rides.preview import preview_from_text
from quartercar.rides.simulation import RideSettings, drive
from quartercar.roads.ride_roads import IsoRoad

CASES = {"SH-ADD": ("sh-add", "none"), "MPC without preview": ("mpc", "none"),
         "preview LQ, front axle": ("preview-lqr", "wheelbase=2.7"),
         "LPV with register, front axle": ("preview-lpv", "wheelbase=2.7"), "MPC, front axle": ("mpc", "wheelbase=2.7"),
         "MPC, the profile itself": ("mpc", "wheelbase=2.7,front=known")}


def main(figure: Path | None = None, duration: float = 6.0, seeds: int = 2) -> dict[str, tuple[float, float]]:
    """Comfort [m/s²] and tyre load [N] of every case on ISO C at 20 m/s."""
    car, road = build_car(), IsoRoad("C", 20.0, duration)
    found: dict[str, tuple[float, float]] = {}
    for label, (name, preview) in CASES.items():
        law = qc.controllers.law_class(name)()
        rides = drive(car, road, [law] * seeds, range(seeds), RideSettings(preview=preview_from_text(preview)))
        comfort, tyre = (float(np.mean([getattr(r.figures, n) for r in rides])) for n in ("comfort", "tyre_load"))
        found[label] = comfort, tyre
        gap = [100 * (a / b - 1) for a, b in zip(found[label], found["SH-ADD"], strict=True)]
        off = rides[0].road_ahead_error
        stated = f", road ahead estimated to {1e3 * off:.1f} mm rms" if off else ""
        print(f"{label:<30}comfort {comfort:.3f} m/s^2 ({gap[0]:+.1f} %), tyre load {tyre:.0f} N ({gap[1]:+.1f} %)"
              f"{stated}")
    canvas = Figure(figsize=(6, 4), layout="constrained")
    axes = canvas.add_subplot(xlabel="comfort [m/s^2]", ylabel="tyre load [N]", title="ISO C at 20 m/s, virtual")
    for label, (comfort, tyre) in found.items():
        axes.plot(comfort, tyre, "o", label=label)
    axes.legend()
    show(canvas, figure)
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
