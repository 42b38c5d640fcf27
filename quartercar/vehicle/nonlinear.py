"""QuarterCar: two masses, a spring with bump stops, a tyre that can lift off, and any damper between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.vehicle.assembly import BumpStops, CarAssembly, Coil
from quartercar.vehicle.linear import LinearCar
from quartercar.vehicle.result import CarRun
from quartercar.vehicle.stepper import CarStepper

__all__ = ["BumpStops", "Coil", "QuarterCar"]


@dataclass(frozen=True, eq=False)
class QuarterCar(CarAssembly):
    """A nonlinear quarter car about its static equilibrium, z up, damper force F positive in extension.

    ::

        m_s z̈_s   = −k_s z_d − stops(z_d) − F(z_d, ż_d, i)              z_d = z_s − z_us
        m_us z̈_us =  k_s z_d + stops(z_d) + F(z_d, ż_d, i) − F_t
        F_t = min(k_t (z_us − z_r) + c_t (ż_us − ż_r), (m_s + m_us) g)   the tyre never pulls on the road

    Equation sheet, 4.1, with the sign of the lift-off put right: the tyre's force on the road is the static load less
    F_t, so that it is F_t's upper bound that makes a wheel in the air. The linear part is stepped exactly, the strut's
    force implicitly. A force that the damper has at rest (gas) is carried by the spring: it belongs to the static
    equilibrium and acts on no mass, but `damper_force` shows it.

    Attributes
    ----------
    parameters : CarParameters
        Its `damping` is that of the passive car and counts only where there is no `damper`.
    damper : a damper or None
        Any model of `quartercar.dampers`, in its own sense whatever the polarity of its records.
    stops : BumpStops or None
    coil : Coil
    lift_off : bool
        False for a tyre that can pull without limit.
    longest_step : float
        Longest integration step [s]; a damper with a clock of its own is stepped at that.

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> run = QuarterCar(MEGANE).run(np.r_[0.0, np.full(2000, 0.02)], 1e-3)
    >>> round(float(run["body_displacement"].max()), 4), round(float(run["body_displacement"][-1]), 4)
    (0.0318, 0.0196)
    """

    def passive(self) -> LinearCar:
        """The linear car of the same parameters, with their passive damper.

        Returns
        -------
        LinearCar
            Without stops, lift-off and the nonlinear damper.
        """
        return LinearCar(self.parameters)

    def start(self, sample_time: float, road: float = 0.0, current: float = 0.0) -> CarStepper:
        """At rest on a road of this elevation, ready to be driven on piece by piece.

        Parameters
        ----------
        sample_time : float
            From one sample of road and command to the next [s].
        road : float
            Elevation at the start [m].
        current : float
            Command before the start, in the damper's unit.

        Returns
        -------
        CarStepper
            Driven on by its `advance`.

        Raises
        ------
        InputError
            A sample time that is not positive; a damper that runs at another rate only.

        Warns
        -----
        ExtrapolationWarning
            A current outside the range of the damper's fit.
        """
        stepper = CarStepper(self, checks.positive(sample_time, "sample_time", "s"), road, current)
        stepper.warn_outside(np.array([current]))
        return stepper

    def run(self, road: np.ndarray, sample_time: float, current: np.ndarray | float = 0.0) -> CarRun:
        """Drive over a road, from rest at its first elevation.

        Parameters
        ----------
        road : (n,) array
            Elevation under the wheel, linear between samples [m].
        sample_time : float
            [s].
        current : float or (n,) array
            Commanded current, held from each sample to the next.

        Returns
        -------
        CarRun

        Raises
        ------
        InputError
            Arrays that do not fit or are not finite; a damper that runs at another rate only.

        Warns
        -----
        ExtrapolationWarning
            Currents outside the range of the damper's fit.
        """
        road = checks.finite(checks.frozen_array(road, "road", ndim=1), "road")
        if road.size < 2:
            raise InputError("a road has at least two samples", got=road.size)
        command = checks.frozen_array(current, "current")
        command = np.full(road.size, float(command)) if command.ndim == 0 else command
        command = checks.finite(checks.shaped(command, (road.size,), "current"), "current")
        from quartercar.vehicle.stepper import CarStepper

        sample_time = checks.positive(sample_time, "sample_time", "s")
        stepper = CarStepper(self, sample_time, float(road[0]), float(command[0]))
        stepper.warn_outside(command[:-1])
        states = stepper.advance(road[1:], command[:-1])
        return CarRun.of(self, stepper.sample_time, np.array(road), np.array(command), states)
