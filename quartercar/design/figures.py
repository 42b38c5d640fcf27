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
    """Inputs or outputs of the closed loop, in a list of words.

    Parameters
    ----------
    synthesis : Synthesis
        One that is solved.
    which : {"inputs", "outputs"}
        Side of the closed loop.

    Returns
    -------
    str
        Names, separated by commas.
    """
    return ", ".join(s.name for s in getattr(synthesis.closed_loop, which))


def over_bump(car: QuarterCar, controller: Controller, settings: RideSettings | None = None,
              road: Bump | None = None) -> tuple[Ride, Ride]:
    """The nonlinear car over a bump: under a controller, and passive at the lowest current.

    Parameters
    ----------
    car : QuarterCar
        With a coil whose limits are finite.
    controller : Controller
        One that is designed.
    settings : RideSettings, optional
        Sensors, observer and inverse; the defaults where left out.
    road : Bump, optional
        The default bump over 2.5 s where left out.

    Returns
    -------
    (Ride, Ride)
        Under the controller, and passive; same seed.
    """
    from quartercar.controllers.laws.passive import Passive

    road = road or Bump(duration=2.5)
    laws: list[Controller] = [controller, Passive(values={"fixed_current": car.coil.lowest})]
    with_law, passive = (ride(car, road, law, 0, settings) for law in laws)
    return with_law, passive
