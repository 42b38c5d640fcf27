"""Inverse: from a demanded damper force to the coil current that comes nearest to it, within the coil's limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.controllers.contract import Setting
from quartercar.controllers.loop.forces import Forces, along, forces_of
from quartercar.vehicle.nonlinear import Coil

ALIKE = 5.0
"""span of the attainable forces below which the current makes no difference and stays [N]"""


@dataclass(frozen=True)
class InverseSettings:
    """How a demand becomes a current.

    Attributes
    ----------
    points : int
        Currents at which the damper's model is evaluated; linear in between.
    steps : int
        Samples that an identified transfer function looks ahead; 0 inverts its settled characteristic, which follows
        the demand less closely but does not amplify what the sensors add.
    lag_compensated : bool
        Whether the command leads the current that is wanted so that the coil has it at the next sample.
    deadband : float
        |v_d| below which the current stays: its sign is noise, and every current has about the same force [m/s].
    """

    points: int = 11
    steps: int = 0
    lag_compensated: bool = False
    deadband: float = 5e-3

    def __post_init__(self) -> None:
        checks.count(self.points, "points of an inverse", at_least=2)
        checks.count(self.steps, "steps of an inverse")
        if checks.real(self.deadband, "deadband of an inverse") < 0:
            raise InputError("the deadband of an inverse must not be negative", got=f"{self.deadband:g} m/s")


class Inverse:
    """A running inverse damper model, for many cars.

    Per sample: `look` at the measured motion, then `choose` for a demanded force or `take` for a current.

    Parameters
    ----------
    setting : Setting
    coil : Coil
        That of the design model; its limits are those of the command.
    settings : InverseSettings

    Attributes
    ----------
    lowest, highest : (cars,) arrays
        Forces to be had at this instant by a current within the limits [N].
    current : (cars,) array
        That the coil is thought to carry [A].
    limited : (cars,) bool array
        Whether the last demand was out of reach.

    Examples
    --------
    >>> from quartercar.dampers import Guo
    >>> from quartercar.parameters import MEGANE
    >>> law = Guo(degree=1, span=(0.0, 2.0), hysteresis=False)
    >>> inverse = Inverse(Setting(1e-3, 1, MEGANE, law, (0.0, 2.0)), Coil(highest=2.0))
    >>> inverse.look(np.zeros(1), np.array([0.3]))
    >>> inverse.choose(law.force(0.0, 0.3, 1.2)).round(6)
    array([1.2])
    """

    def __init__(self, setting: Setting, coil: Coil, settings: InverseSettings | None = None) -> None:
        self._settings = settings or InverseSettings()
        low, high = setting.currents
        if not 0 <= low < high < np.inf:
            raise InputError("an inverse needs limits of the current", got=f"{low:g} to {high:g} A",
                             mend="give the car a coil with a highest current")
        self._grid = np.linspace(low, high, self._settings.points)
        self.current = np.full(setting.cars, low)
        self._forces: Forces = forces_of(setting.damper, setting.parameters.damping, setting.cars, self._grid,
                                         self._settings.steps)
        self._period = setting.sample_time
        self._coil, self._own = coil, self._forces.lag
        self._felt = self.current.copy()
        self._both = Coil(coil.rise_time + self._own.rise_time, coil.fall_time + self._own.fall_time)
        self._rows = np.zeros((setting.cars, self._grid.size))
        self.lowest, self.highest = np.zeros(setting.cars), np.zeros(setting.cars)
        self.limited = np.zeros(setting.cars, dtype=bool)
        self._still, self._wanted = self.limited.copy(), self.current.copy()

    @property
    def model(self) -> Forces:
        """The damper's model behind it."""
        return self._forces

    @property
    def force(self) -> np.ndarray:
        """(cars,) that the damper's model has at the sample last looked at [N]."""
        return self._forces.force

    def look(self, z: np.ndarray, v: np.ndarray) -> None:
        """The motion at this sample, measured or estimated.

        Parameters
        ----------
        z, v : (cars,) arrays
            Deflection [m] and velocity [m/s] of the suspension, positive in extension.
        """
        self._forces.commit(z, v, self._felt)
        self._rows = self._forces.candidates(z, v, self._grid)
        self.lowest, self.highest = self._rows.min(axis=1), self._rows.max(axis=1)
        self._still = np.abs(v) < self._settings.deadband

    def choose(self, demand: np.ndarray) -> np.ndarray:
        """(cars,) command for a demanded force [N]; `attained` then gives the force of it.

        Parameters
        ----------
        demand : (cars,) array
            About the static equilibrium, positive in extension [N].

        Returns
        -------
        (cars,) array
            Command within the limits [A]; while |v| lies in the deadband, that of the current wanted before.
        """
        wanted = np.where(self._still, self._wanted, nearest(self._rows, self._grid, demand, self._felt))
        self._wanted = wanted
        self.limited = (demand < self.lowest) | (demand > self.highest)
        command = self._ahead(wanted) if self._settings.lag_compensated else wanted
        self._hold(command)
        return command

    def take(self, current: np.ndarray) -> np.ndarray:
        """(cars,) command for a demanded current: within the limits, without lead.

        Parameters
        ----------
        current : (cars,) array
            Demanded [A].

        Returns
        -------
        (cars,) array
            Command [A]; `limited` where it differs from the demand.
        """
        command = np.clip(current, self._grid[0], self._grid[-1])
        self.limited = command != current
        self._hold(command)
        return command

    @property
    def attained(self) -> np.ndarray:
        """(cars,) force to come, by the model, after the last command [N]."""
        return along(self._rows, self._grid, self._felt)

    def _ahead(self, wanted: np.ndarray) -> np.ndarray:
        """The command that, held for a sample, brings the lagged current to what is required, or as near as it goes."""
        tau = np.where(wanted > self._felt, self._both.rise_time, self._both.fall_time)
        share = np.where(tau > 0, -np.expm1(-self._period / np.where(tau > 0, tau, 1.0)), 1.0)
        return np.clip(self._felt + (wanted - self._felt) / share, self._grid[0], self._grid[-1])

    def _hold(self, command: np.ndarray) -> None:
        self.current = self._coil.follow_all(self.current, command, self._period)
        self._felt = self._own.follow_all(self._felt, self.current, self._period)


def nearest(rows: np.ndarray, grid: np.ndarray, demand: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(n,) current whose force is nearest to the demand.

    Where several currents have the force (a damper that is not monotone in its current) the one nearest to that held;
    where none has it, the current of the nearest force; where all currents do nearly the same, the one held.

    Parameters
    ----------
    rows : (n, G) array
        Force at the currents of the grid.
    grid : (G,) array
    demand, held : (n,) arrays

    Returns
    -------
    (n,) array
        In the unit of `grid`, within it; `held` is returned as it is.

    Examples
    --------
    >>> rows = np.array([[0.0, 100.0, 0.0]])  # a damper whose force turns back
    >>> nearest(rows, np.array([0.0, 1.0, 2.0]), np.array([50.0]), np.array([1.8]))
    array([1.5])
    >>> nearest(rows, np.array([0.0, 1.0, 2.0]), np.array([500.0]), np.array([1.8]))
    array([1.])
    """
    gap = rows - demand[:, None]
    before, after = gap[:, :-1], gap[:, 1:]
    crosses = before * after <= 0
    drop = before - after
    flat = drop == 0
    share = np.where(flat, 0.5, before / np.where(flat, 1.0, drop))
    at = grid[:-1] + share * np.diff(grid)
    row = np.arange(len(rows))
    inside = at[row, np.argmin(np.where(crosses, np.abs(at - held[:, None]), np.inf), axis=1)]
    outside = grid[np.argmin(np.abs(gap), axis=1)]
    found = np.where(crosses.any(axis=1), inside, outside)
    return np.where(np.ptp(rows, axis=1) < ALIKE, held, found)
