"""Which gain is verified for a plant whose stiffness moves, and how much does a bound on its speed lower it?"""

from __future__ import annotations

import sys

import numpy as np

import lpvid as lpv
from lpvid.plot import show
from lpvid.plot.style import look, panels

ACTUATOR = 0.3  # weight of the force: how much stroke a newton is worth


def platform(rate: float | None) -> lpv.GeneralizedPlant:
    """A mass on a spring whose stiffness moves between 1 and 9 N/m, at most at `rate` [N/m/s]."""
    a = [[[0, 1], [0, -0.2]], [[0, 0], [-1, 0]]]              # A(stiffness) = a[0] + a[1] stiffness
    b = [[[0, 0, 0], [1, 0, 1]], np.zeros((2, 3))]            # push, noise, force
    c = [[[1, 0], [0, 0], [1, 0]], np.zeros((3, 2))]          # stroke, effort, sensor
    d = [[[0, 0, 0], [0, 0, ACTUATOR], [0, 0.1, 0]], np.zeros((3, 3))]
    system = lpv.LPVStateSpace(
        a, b, c, d, lpv.Polynomial("stiffness", degree=1), sample_time=None,
        scheduling=lpv.Scheduling(("stiffness",), (1.0,), (9.0,), rate=(rate,), units=("N/m",)),
        inputs=(lpv.Signal("push", "N"), lpv.Signal("noise", "m"), lpv.Signal("force", "N")),
        outputs=(lpv.Signal("stroke", "m"), lpv.Signal("effort"), lpv.Signal("sensor", "m")))
    return lpv.GeneralizedPlant(system, controls=["force"], measurements=["sensor"])


def main(figure: str | None = None) -> dict[str, float]:
    """Print what each design guarantees; returns the verified gains."""
    designs = {
        "any speed": (platform(None), lpv.OutputFeedback()),
        "slow": (platform(0.1), lpv.OutputFeedback(lyapunov=lpv.Polynomial("stiffness", 1), points=5)),
        "scaled small gain": (platform(None), lpv.LFTFeedback()),
        "calm poles": (platform(None), lpv.MultiObjective(regions=[lpv.HalfPlane(0.3), lpv.Disc(0.0, 60.0)])),
    }
    gains = {}
    for name, (plant, design) in designs.items():
        result = lpv.synthesize(plant, design)
        print(f"{name}\n{result}\n")
        gains[name] = result.gamma_verified if result.solved else float("inf")
        if result.certificate is not None:
            assert lpv.verify(result.certificate, result.closed_loop).holds
    with look():
        canvas, ((axes,),) = panels(1, 1, height=2.4)
        axes.barh(list(gains), list(gains.values()), height=0.5)
        axes.set(xlabel="verified gain from push and noise to stroke and effort [1]")
        show(canvas, figure)
    return gains


if __name__ == "__main__":
    main(*sys.argv[1:])
