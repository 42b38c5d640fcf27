"""What every kind of design shows: signals, frequencies, a ride over a bump."""

from __future__ import annotations

import numpy as np

from lpvid.synthesis.result import Synthesis
from quartercar.controllers.contract import Controller
from quartercar.rides.simulation import Ride, RideSettings, ride
from quartercar.roads.ride_roads import Bump
from quartercar.vehicle.nonlinear import QuarterCar

SHOWN = ("body_acceleration", "tyre_force", "suspension_deflection")
"""Signals whose frozen gains are drawn."""
FREQUENCIES = np.geomspace(0.3, 30.0, 160)
"""[Hz]"""


def names_of(synthesis: Synthesis, which: str) -> str:
    """Inputs or outputs of the closed loop, in a list of words."""
    return ", ".join(s.name for s in getattr(synthesis.closed_loop, which))


def over_bump(car: QuarterCar, controller: Controller, settings: RideSettings | None = None,
              road: Bump | None = None) -> tuple[Ride, Ride]:
    """The nonlinear car over a bump: under a controller, and passive at the lowest current."""
    from quartercar.controllers.laws.passive import Passive

    road = road or Bump(duration=2.5)
    laws: list[Controller] = [controller, Passive(values={"fixed_current": car.coil.lowest})]
    with_law, passive = (ride(car, road, law, 0, settings) for law in laws)
    return with_law, passive
