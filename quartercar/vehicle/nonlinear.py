"""QuarterCar: two masses, a spring with bump stops, a tyre that can lift off, and any damper between them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lpvid.errors import InputError
from lpvid.tables import quantity
from lpvid.toolkit import checks
from quartercar.dampers.contract import Damper, LinearElements
from quartercar.parameters import CarParameters
from quartercar.vehicle.integrator import LinearPart
from quartercar.vehicle.linear import GRAVITY, LinearCar
from quartercar.vehicle.result import CarRun


@dataclass(frozen=True)
class BumpStops:
    """Stiff springs at both ends of the suspension's room: k_b(z_d − d_r)_+ − k_b(−z_d − d_c)_+.

    Attributes
    ----------
    stiffness : float
        k_b [N/m].
    compression, rebound : float
        d_c, d_r: room from the static position to either stop [m].
    """

    stiffness: float = quantity(2e5, "N/m", "of a stop")
    compression: float = quantity(0.06, "m", "room in compression")
    rebound: float = quantity(0.06, "m", "room in rebound")

    def __post_init__(self) -> None:
        for name in ("stiffness", "compression", "rebound"):
            object.__setattr__(self, name, checks.positive(getattr(self, name), f"{name} of a bump stop"))

    def force(self, deflection: np.ndarray) -> np.ndarray:
        """Force at deflections [N], positive in extension.

        Parameters
        ----------
        deflection : array
            z_d from the static position, positive in extension, of any shape [m].

        Returns
        -------
        array
            Of the same shape; zero between the stops.
        """
        z = np.asarray(deflection, dtype=float)
        return self.stiffness * (np.maximum(z - self.rebound, 0.0) - np.maximum(-z - self.compression, 0.0))

    def energy(self, deflection: np.ndarray) -> np.ndarray:
        """Stored energy at deflections [J].

        Parameters
        ----------
        deflection : array
            z_d from the static position, positive in extension, of any shape [m].

        Returns
        -------
        array
            Of the same shape; zero between the stops.
        """
        return 0.5 * self.force(deflection) ** 2 / self.stiffness


@dataclass(frozen=True)
class Coil:
    """What a commanded current becomes: limited, then i̇ = (u − i)/τ, exact for a command held between samples.

    Attributes
    ----------
    rise_time, fall_time : float
        τ while the command lies above, below the current [s]; 0 for a current that follows at once.
    lowest, highest : float
        Limits of the command, in the damper's `current_unit`.
    """

    rise_time: float = quantity(0.0, "s", "while the command lies above the current")
    fall_time: float = quantity(0.0, "s", "while it lies below")
    lowest: float = 0.0
    highest: float = np.inf

    def __post_init__(self) -> None:
        if not (self.rise_time >= 0 and self.fall_time >= 0):
            raise InputError("time constants of a coil must not be negative", got=f"{self.rise_time}, {self.fall_time}")
        if not self.lowest <= self.highest:
            raise InputError("the current's limits run from low to high", got=f"{self.lowest} to {self.highest}")

    def limited(self, command: np.ndarray) -> np.ndarray:
        """The command within the limits.

        Parameters
        ----------
        command : array
            In the damper's `current_unit`, of any shape.

        Returns
        -------
        array
            Of the same shape.
        """
        return np.clip(command, self.lowest, self.highest)

    def follow(self, current: float, command: float, times: np.ndarray) -> np.ndarray:
        """Current at times after a limited command began to be held [s].

        Parameters
        ----------
        current : float
            When the command began to be held.
        command : float
            Already limited.
        times : (n,) array
            From then on [s].

        Returns
        -------
        (n,) array
            In the unit of the command.

        Examples
        --------
        >>> Coil(rise_time=0.01).follow(0.0, 1.0, np.array([0.0, 0.01])).round(4)
        array([0.    , 0.6321])
        """
        tau = self.rise_time if command > current else self.fall_time
        if tau == 0:
            return np.full(times.shape, command)
        return command + (current - command) * np.exp(-times / tau)

    def follow_all(self, current: np.ndarray, command: np.ndarray, times: np.ndarray | float) -> np.ndarray:
        """The same for many coils at once.

        Parameters
        ----------
        current, command : array
            As in `follow`, one of each for every coil.
        times : array or float
            From then on [s]; broadcast against the currents.

        Returns
        -------
        array
            In the unit of the command.
        """
        tau = np.where(command > current, self.rise_time, self.fall_time)
        left = np.where(tau > 0, np.exp(-times / np.where(tau > 0, tau, 1.0)), 0.0)
        return command + (current - command) * left


@dataclass(frozen=True, eq=False)
class QuarterCar:
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
    damper : Damper or None
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

    parameters: CarParameters
    damper: Damper | None = None
    stops: BumpStops | None = None
    coil: Coil = field(default_factory=Coil)
    lift_off: bool = True
    longest_step: float = 5e-4

    def __post_init__(self) -> None:
        checks.positive(self.longest_step, "longest_step", "s")
        checks.instance(self.parameters, CarParameters, "a car has CarParameters", "quartercar.parameters.MEGANE")
        if self.damper is not None and not isinstance(self.damper, Damper):
            raise InputError("the damper of a car is a model of quartercar.dampers", got=type(self.damper).__name__,
                             mend="None for the viscous one of the parameters")

    @property
    def static_load(self) -> float:
        """(m_s + m_us) g [N]."""
        return (self.parameters.sprung_mass + self.parameters.unsprung_mass) * GRAVITY

    @property
    def linear_part(self) -> LinearPart:
        """Masses and springs; a linear damper is part of them, its mass as an inerter."""
        p, own = self.parameters, LinearElements()
        if self.damper_is_linear:
            known = None if self.damper is None else self.damper.linear_elements
            own = LinearElements(p.damping) if known is None else known
        return LinearPart(p.sprung_mass, p.unsprung_mass, own.mass, p.spring_stiffness + own.stiffness, own.damping,
                          p.tyre_stiffness, p.tyre_damping)

    @property
    def damper_is_linear(self) -> bool:
        """The damper is part of `linear_part`: the viscous one of the parameters, or one of linear elements."""
        return self.damper is None or self.damper.linear_elements is not None

    @property
    def preload(self) -> float:
        """What the damper carries at rest [N]."""
        return 0.0 if self.damper is None else float(np.atleast_1d(self.damper.conservative_force(np.zeros(1)))[0])

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness and room of the stops; stiffness, damping and largest force of the tyre, for the kernels."""
        p, stops = self.parameters, self.stops
        room = [0.0, np.inf, np.inf] if stops is None else [stops.stiffness, stops.compression, stops.rebound]
        load = self.static_load if self.lift_off else np.inf
        return np.array(room), np.array([p.tyre_stiffness, p.tyre_damping, load])

    def passive(self) -> LinearCar:
        """The linear car of the same parameters, with their passive damper.

        Returns
        -------
        LinearCar
            Without stops, lift-off and the nonlinear damper.
        """
        return LinearCar(self.parameters)

    def start(self, sample_time: float, road: float = 0.0, current: float = 0.0):
        """At rest on a road of this elevation, ready to be driven on piece by piece; see `stepper.CarStepper`.

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
        from quartercar.vehicle.stepper import CarStepper

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
