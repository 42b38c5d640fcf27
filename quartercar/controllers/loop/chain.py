"""Chain: sensors, observer, law and inverse damper model of many cars, from the true motion to the command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid.errors import InputError
from quartercar.controllers.contract import SIGNALS, Controller, Setting, start_together
from quartercar.controllers.loop.inverse import Inverse, InverseSettings
from quartercar.controllers.loop.observer import KalmanObserver, ObserverSettings
from quartercar.controllers.loop.sensing import SETS, MeasurementSet, Sensing
from quartercar.vehicle.nonlinear import Coil

ALWAYS = ("current", "lowest_force", "highest_force", "demanded", "attained", "road_ahead")
"""Signals that every loop has, whatever is measured."""
ESTIMATED = ("suspension_deflection", "body_velocity", "tyre_deflection", "wheel_velocity", "suspension_velocity")
"""Signals that the observer adds."""


@dataclass(frozen=True)
class ChainSettings:
    """What lies between a car's motion and its coil.

    Attributes
    ----------
    sensors : MeasurementSet
    observer : ObserverSettings
    inverse : InverseSettings
    """

    sensors: MeasurementSet = field(default_factory=lambda: SETS["stroke-body"])
    observer: ObserverSettings = field(default_factory=ObserverSettings)
    inverse: InverseSettings = field(default_factory=InverseSettings)


class ControllerChain:
    """Controllers of many cars on their way.

    Parameters
    ----------
    controllers : sequence of Controller
        One for each car; all demand the same thing.
    setting : Setting
    coil : Coil
    settings : ChainSettings
    generators : sequence of numpy.random.Generator
        Noise of each car.
    samples : int
        How many there will be at most.

    Attributes
    ----------
    clipped, out_of_reach : (cars,) arrays
        Samples so far whose command stood at a limit; whose demand the damper could not meet.

    Raises
    ------
    InputError
        A law that reads what this measurement set does not provide.
    """

    def __init__(self, controllers: Sequence[Controller], setting: Setting, coil: Coil, settings: ChainSettings,
                 generators: Sequence[np.random.Generator], samples: int) -> None:
        self._sensing = Sensing(settings.sensors, setting.sample_time, generators, samples)
        sensors = settings.sensors
        self._observer = None if sensors.ideal else KalmanObserver(setting, sensors, settings.observer)
        described = {*ALWAYS, *settings.sensors.signals, *(ESTIMATED if self._observer else ())}
        for law in controllers:
            missing = [n for n in law.reads if n not in described]
            if missing:
                raise InputError(f"{law.name} reads {', '.join(missing)}, which '{settings.sensors.name}' does not "
                                 "provide", got=", ".join(n for n in SIGNALS if n in described and n not in ALWAYS),
                                 mend="the measurement set 'stroke-body-wheel' or 'ideal'")
        self._inverse = Inverse(setting, coil, settings.inverse)
        error = np.zeros((4, 4)) if self._observer is None else self._observer.covariance[:4, :4]
        self._law = start_together(controllers, replace(setting, road_level=settings.observer.road_level,
                                                        estimate_error=error))
        self._by_force = controllers[0].demands == "force"
        zero = np.zeros(setting.cars)
        self._asked, self._had, self._before = zero, zero, zero
        self._currents, self._period = setting.currents, setting.sample_time
        self._blind = np.zeros((setting.cars, 0))
        self._coming = self._blind
        self.clipped, self.out_of_reach = zero.copy(), zero.copy()

    def step(self, true: dict[str, np.ndarray], ahead: np.ndarray | None = None) -> np.ndarray:
        """(cars,) command from here to the coming sample, from the true signals of this one (`sensing.TRUE`).

        Parameters
        ----------
        true : mapping of str to (cars,) array
        ahead : (cars, P) array, optional
            What is known of the coming road, as `contract.SIGNALS` has it.

        Returns
        -------
        (cars,) array
            Current [A], within the setting's limits.
        """
        return self.react(self._sensing(true), ahead)

    def react(self, readings: Mapping[str, np.ndarray], ahead: np.ndarray | None = None) -> np.ndarray:
        """(cars,) command from here to the coming sample, from what the sensors show at this one.

        Parameters
        ----------
        readings : mapping of str to (cars,) array
            Of the sensors, by the names of `sensing.TRUE`, SI.
        ahead : (cars, P) array, optional
            What is known of the coming road, as `contract.SIGNALS` has it [m]; None for nothing.

        Returns
        -------
        (cars,) array
            Current [A], within the setting's limits.
        """
        inverse, seen = self._inverse, dict(readings)
        if self._observer is not None:
            expected = inverse.attained
            passed = self._coming[:, 0] / self._period if self._coming.shape[1] else None
            seen |= self._observer(seen, 0.5 * (self._before + expected), expected, passed)
        self._coming = self._blind if ahead is None else ahead
        z, v = seen["suspension_deflection"], seen["suspension_velocity"]
        inverse.look(z, v)
        seen |= {"current": inverse.current, "lowest_force": inverse.lowest, "highest_force": inverse.highest,
                 "demanded": self._asked, "attained": self._had, "road_ahead": self._coming}
        demand = self._law.step(seen)
        command = inverse.choose(demand) if self._by_force else inverse.take(demand)
        self._before, self._asked = inverse.force, demand
        self._had = inverse.attained if self._by_force else command
        low, high = self._currents
        self.clipped += (command <= low) | (command >= high)
        self.out_of_reach += inverse.limited
        return command

    @property
    def demand(self) -> np.ndarray:
        """(cars,) what the laws demanded last."""
        return self._asked

    @property
    def model_force(self) -> np.ndarray:
        """(cars,) force that the damper's model has at the sample last reacted to [N]."""
        return self._inverse.force

    def counted(self) -> dict[str, np.ndarray]:
        """(cars,) what the law counted.

        Returns
        -------
        dict of (cars,) arrays
            Counts by name, as `Law.counted` has them.
        """
        return self._law.counted()
