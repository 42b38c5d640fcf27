"""What a damper would do at each of a few currents: the models that stand behind an inverse."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from quartercar.dampers.contract import Damper
from quartercar.dampers.families import StaticDamper
from quartercar.vehicle.batch import lag_coil
from quartercar.vehicle.filter_bank import bank, filter_of
from quartercar.vehicle.nonlinear import Coil

SPEEDS = np.concatenate([-np.geomspace(3.0, 1e-3, 60), [0.0], np.geomspace(1e-3, 3.0, 60)])
"""velocities at which a characteristic is tabulated [m/s]"""


class Forces(ABC):
    """A damper's model along the motion that is measured, for many cars.

    Forces are about the static equilibrium, positive in extension.

    Attributes
    ----------
    force : (cars,) array
        That the damper is thought to have now [N].
    lag : Coil
        What the damper's own model puts between current and force.
    """

    lag: Coil = Coil()

    def __init__(self, cars: int) -> None:
        self.force = np.zeros(cars)

    @abstractmethod
    def commit(self, z: np.ndarray, v: np.ndarray, current: np.ndarray) -> None:
        """The motion at this sample, and the (filtered) current that the damper has now; sets `force`.

        Parameters
        ----------
        z, v : (cars,) arrays
            Deflection [m] and velocity [m/s] of the suspension, positive in extension.
        current : (cars,) array
            Behind the coil's lag and the damper's own, in the damper's unit.
        """

    @abstractmethod
    def candidates(self, z: np.ndarray, v: np.ndarray, currents: np.ndarray) -> np.ndarray:
        """(cars, G) force to come at each of (G,) currents, were the motion held [N].

        Parameters
        ----------
        z, v : (cars,) arrays
            Deflection [m] and velocity [m/s] of the suspension, positive in extension.
        currents : (G,) array
            Rising, in the damper's unit.

        Returns
        -------
        (cars, G) array
            About the static equilibrium [N].
        """


class StaticForces(Forces):
    """A law without memory.

    Attributes
    ----------
    rest : float
        Its force at rest, which is left out [N].
    """

    def __init__(self, damper: StaticDamper, cars: int) -> None:
        super().__init__(cars)
        self._damper, self._vector = damper, damper.vector
        self.rest = float(damper.conservative_force(np.zeros(1))[0])

    def commit(self, z: np.ndarray, v: np.ndarray, current: np.ndarray) -> None:
        self.force = self._damper.law(z, v, current, self._vector) - self.rest

    def candidates(self, z: np.ndarray, v: np.ndarray, currents: np.ndarray) -> np.ndarray:
        size = currents.size
        out = self._damper.law(np.repeat(z, size), np.repeat(v, size), np.tile(currents, z.size), self._vector)
        return out.reshape(z.size, size) - self.rest


class TabulatedForces(Forces):
    """The static characteristic of any damper, with its spring beside it; what its dynamics add is left out.

    Attributes
    ----------
    speeds : (S,) array
        [m/s].
    table : (S, G) array
        Force at the speeds and currents [N].
    stiffness, rest : float
        Spring [N/m], and the force at rest, which is left out [N].
    """

    def __init__(self, damper: Damper, cars: int, currents: np.ndarray) -> None:
        super().__init__(cars)
        self._currents, self.speeds = currents, SPEEDS
        self.table = np.column_stack([damper.static_force(SPEEDS, float(i), 0.0) for i in currents])
        spring = np.asarray(damper.conservative_force(np.array([0.0, 0.01])), dtype=float)
        self.rest, self.stiffness = float(spring[0]), float(spring[1] - spring[0]) / 0.01

    def _rows(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(cars, currents) force at each tabulated current; straight on beyond the last speeds."""
        place = np.clip(np.searchsorted(SPEEDS, v) - 1, 0, SPEEDS.size - 2)
        share = ((v - SPEEDS[place]) / (SPEEDS[place + 1] - SPEEDS[place]))[:, None]
        rows = self.table[place] * (1 - share) + self.table[place + 1] * share
        return rows + self.stiffness * z[:, None] - self.rest

    def commit(self, z: np.ndarray, v: np.ndarray, current: np.ndarray) -> None:
        self.force = along(self._rows(z, v), self._currents, current)

    def candidates(self, z: np.ndarray, v: np.ndarray, currents: np.ndarray) -> np.ndarray:
        return self._rows(z, v)


class FilterForces(Forces):
    """An identified transfer function or state space, run along the measured motion.

    What each current would do is its settled characteristic, or the force some samples ahead.

    Attributes
    ----------
    rest : float
        Its force at rest, which is left out [N].
    started : float
        What the filter began with, settled at the lowest current [N].
    settled : TabulatedForces or None
        The settled characteristic, where that is what counts.
    """

    def __init__(self, damper: Damper, cars: int, currents: np.ndarray, steps: int) -> None:
        super().__init__(cars)
        model = filter_of(damper)
        assert model is not None
        self.lag = lag_coil(model)
        self.rest = float(damper.conservative_force(np.zeros(1))[0])
        self._bank, self._steps = bank(model, cars), steps
        self._bank.begin(np.full(cars, currents[0]))
        self.settled = None if steps else TabulatedForces(damper, cars, currents)
        self.started = float(self._bank.force[0])
        self.force = self._bank.force - self.rest

    def commit(self, z: np.ndarray, v: np.ndarray, current: np.ndarray) -> None:
        self._bank.approach(current)
        self._bank.commit(z, v)
        self.force = self._bank.force - self.rest

    def candidates(self, z: np.ndarray, v: np.ndarray, currents: np.ndarray) -> np.ndarray:
        if self.settled is not None:
            return self.settled.candidates(z, v, currents)
        return self._bank.ahead(z, v, currents, self._steps) - self.rest


class ViscousForces(Forces):
    """A car without a damper model: its viscous one, which no current moves.

    Parameters
    ----------
    damping : float
        Of the passive car [N·s/m].
    cars : int
        How many run side by side.
    """

    def __init__(self, damping: float, cars: int) -> None:
        super().__init__(cars)
        self._damping = damping

    def commit(self, z: np.ndarray, v: np.ndarray, current: np.ndarray) -> None:
        self.force = self._damping * v

    def candidates(self, z: np.ndarray, v: np.ndarray, currents: np.ndarray) -> np.ndarray:
        return np.repeat((self._damping * v)[:, None], currents.size, axis=1)


def along(rows: np.ndarray, grid: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(n,) each row of (n, G) values on a rising grid, interpolated at its own point.

    Parameters
    ----------
    rows : (n, G) array
        Values on the grid.
    grid : (G,) array
        Rising, at least two points.
    at : (n,) array
        One point for each row; beyond the ends of the grid the value is that of the end.

    Returns
    -------
    (n,) array
        In the unit of `rows`.

    Examples
    --------
    >>> along(np.array([[0.0, 2.0], [1.0, 5.0]]), np.array([0.0, 1.0]), np.array([0.5, 2.0]))
    array([1., 5.])
    """
    place = np.clip(np.searchsorted(grid, at) - 1, 0, grid.size - 2)
    share = np.clip((at - grid[place]) / (grid[place + 1] - grid[place]), 0.0, 1.0)
    row = np.arange(len(rows))
    return rows[row, place] * (1 - share) + rows[row, place + 1] * share


def forces_of(damper: Damper | None, damping: float, cars: int, currents: np.ndarray, steps: int) -> Forces:
    """The model behind an inverse of this damper; `steps` only counts for an identified transfer function.

    Parameters
    ----------
    damper : Damper or None
        None for a viscous car.
    damping : float
        Of the passive car [N·s/m]; counts only without a damper.
    cars : int
        How many run side by side.
    currents : (G,) array
        At which candidates will be asked for, rising; the first is the one that an identified model starts settled at.
    steps : int
        Samples that an identified model looks ahead; 0 for its settled characteristic.

    Returns
    -------
    Forces
        `ViscousForces`, `StaticForces`, `FilterForces`, or `TabulatedForces` for all other models.
    """
    if damper is None:
        return ViscousForces(damping, cars)
    if isinstance(damper, StaticDamper):
        return StaticForces(damper, cars)
    if filter_of(damper) is not None:
        return FilterForces(damper, cars, currents, steps)
    return TabulatedForces(damper, cars, currents)
