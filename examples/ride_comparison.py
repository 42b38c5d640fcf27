"""Which control law rides best on a rough road and over a bump, with sensors that a production car has?"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import quartercar as qc
from lpvid.plot import show
from quartercar.plot.rides import trade_offs
from quartercar.rides.comparison import RideComparison, compare_rides
from quartercar.rides.default_damper import identified_damper
from quartercar.rides.tuning import Trial, tune
from quartercar.roads.ride_roads import Bump, IsoRoad, RideRoad
from quartercar.vehicle.nonlinear import BumpStops, Coil

LAWS = ("passive", "skyhook-linear", "add", "sh-add", "clipped-optimal")
TUNED_ON = (100_000, 100_001)
"""Seeds of the roads on which laws are tuned; the comparison's are others."""


def main(seeds: int = 8, budget: int = 16, roads: Sequence[RideRoad] = (IsoRoad("C", 20.0, 10.0), Bump()),
         laws: Sequence[str] = LAWS, figure: str | None = None) -> RideComparison:
    """Tune every law with the same budget, then drive all of them over the same roads with other seeds."""
    car = qc.QuarterCar(qc.parameters.MEGANE, identified_damper(), BumpStops(), Coil(highest=2.5))

    # one ride first, with everything in the loop: noisy sensors, observer, inverse damper model, coil
    print(qc.ride(car, roads[0], qc.controllers.SkyhookAccelerationDriven()))

    trial = Trial(car, tuple(roads), TUNED_ON)
    references = trial.references()
    tuned = {}
    for name in laws:
        found = tune(qc.controllers.law_class(name)(), trial, budget, references=references)
        print(found)
        tuned[name] = found.controller

    comparison = compare_rides(car, roads, tuned, range(seeds))
    print(comparison)
    show(trade_offs(comparison), figure)
    return comparison


if __name__ == "__main__":
    main(figure=sys.argv[1] if len(sys.argv) > 1 else None)
