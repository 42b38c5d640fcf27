"""What every kind of design has and shows: controller, signals, frequencies, a ride over a bump."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lpvid.synthesis.result import Synthesis
from quartercar.controllers.contract import Controller, Setting
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


@dataclass(frozen=True, eq=False)
class SuspensionDesign(ABC):
    """What designs on the nominal and on the identified plant share.

    Attributes
    ----------
    car : QuarterCar
    law : object
        With the weights.
    task : object
        What is designed, with plant and weights.
    synthesis : Synthesis
    setting : Setting
    """

    car: QuarterCar
    law: Any
    task: Any
    synthesis: Synthesis
    setting: Setting

    @cached_property
    def controller(self) -> Any:
        """As it runs, at the loop's rate; NumericalError where the synthesis failed."""
        return self.law.designed(self.setting)

    @property
    @abstractmethod
    def promise(self) -> str:
        """The verdict on a synthesis that is solved, in a sentence."""

    @abstractmethod
    def plant_facts(self) -> dict[str, Any]:
        """What synthesis.json holds of the plant.

        Returns
        -------
        dict
            Plain values by name.
        """

    @property
    def verdict(self) -> str:
        """In a sentence."""
        s = self.synthesis
        return self.promise if s.solved else f"No controller: {s.why}. Mend: {s.mend}."

    @property
    def verified_where(self) -> str:
        """Where in the scheduling the gain is verified."""
        return "on the whole scheduling box" if self.synthesis.between_grid else "at grid points only"

    def bump(self, settings: RideSettings | None = None, road: Bump | None = None) -> tuple[Ride, Ride]:
        """The nonlinear car over a bump: under the controller, and passive at the lowest current.

        Parameters
        ----------
        settings : RideSettings, optional
            Sensors, observer and inverse; the defaults where left out.
        road : Bump, optional
            The default bump over 2.5 s where left out.

        Returns
        -------
        (Ride, Ride)
            Under the controller, and passive; same seed.

        Raises
        ------
        NumericalError
            A synthesis that failed.
        """
        from quartercar.controllers.laws.passive import Passive

        road = road or Bump(duration=2.5)
        laws: list[Controller] = [self.controller, Passive(values={"fixed_current": self.car.coil.lowest})]
        with_law, passive = (ride(self.car, road, law, 0, settings) for law in laws)
        return with_law, passive

    def to_dict(self) -> dict[str, Any]:
        """synthesis.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"schema": "quartercar/design/1", "summary": self.verdict, **self.synthesis.to_dict(),
                "law": self.law.to_dict(), **self.plant_facts()}

    def __str__(self) -> str:
        return f"{self.verdict}\n{self.synthesis!r}\n{self.law!r}"
