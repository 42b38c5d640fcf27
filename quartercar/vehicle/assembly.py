"""CarAssembly: what a quarter car is built of; its motion is `nonlinear.QuarterCar`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lpvid.errors import InputError
from lpvid.tables import quantity
from lpvid.toolkit import checks
from quartercar.dampers.contract import Damper, LinearElements
from quartercar.parameters import CarParameters
from quartercar.vehicle.integrator import LinearPart
from quartercar.vehicle.linear import GRAVITY


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
class CarAssembly:
    """Masses, springs, tyre, damper and coil of a quarter car, and what follows from them at rest.

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
