"""AdmissibleForce: which forces a semi-active damper can give at a velocity, and the distance of a demand from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.dampers.contract import Damper
from quartercar.lpv_models.car_part import passive_sense
from quartercar.lpv_models.yielding import CURRENTS

SPEEDS = 241
CURRENT_LEVELS = 11


@dataclass(frozen=True, eq=False)
class AdmissibleForce:
    """𝒟(v) = {F : F_min(v) ≤ F ≤ F_max(v)}, the forces at constant velocities over all currents (E5).

    Forces without the damper's preload, which the car's spring carries. A table over the velocity, linear in between;
    beyond its ends the last slope goes on.

    Attributes
    ----------
    velocity : (n,) array
        [m/s], rising, symmetric about zero.
    least, most : (n,) arrays
        [N].

    Examples
    --------
    >>> from quartercar.dampers import Guo6
    >>> band = AdmissibleForce.of(Guo6(span=(0.0, 2.5)))
    >>> low, high = band(np.array([-0.5, 0.5]))
    >>> bool(low[0] < high[0] < 0 < low[1] < high[1])
    True
    """

    velocity: np.ndarray
    least: np.ndarray
    most: np.ndarray

    def __post_init__(self) -> None:
        for name in ("velocity", "least", "most"):
            array = checks.finite(checks.frozen_array(getattr(self, name), name, ndim=1), name)
            object.__setattr__(self, name, array)
        if not len(self.velocity) == len(self.least) == len(self.most) >= 3:
            raise InputError("a table of admissible forces has one least and one largest force for each velocity")

    @classmethod
    def of(cls, damper: Damper, currents: tuple[float, float] = CURRENTS, speed: float = 1.5) -> AdmissibleForce:
        """From the forces at rest of a damper model, up to a speed [m/s].

        Parameters
        ----------
        damper : Damper
            One whose force acts against the motion.
        currents : (float, float)
            Limits of the command [A]; 11 currents between them are evaluated.
        speed : float
            Largest speed of the table [m/s], positive.

        Returns
        -------
        AdmissibleForce
            At 241 velocities that lie closer near zero.

        Raises
        ------
        InputError
            A model of reversed polarity, or a force that is not finite.
        """
        passive_sense(damper)
        v = np.sinh(np.linspace(-4.0, 4.0, SPEEDS)) / np.sinh(4.0) * checks.positive(speed, "speed", "m/s")
        rest = float(np.atleast_1d(damper.conservative_force(np.zeros(1)))[0])
        rows = np.array([damper.static_force(v, float(i)) for i in np.linspace(*currents, CURRENT_LEVELS)]) - rest
        return cls(v, rows.min(axis=0), rows.max(axis=0))

    def __call__(self, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(F_min, F_max) at velocities [N]."""
        v = np.asarray(velocity, dtype=float)
        return self._at(v, self.least), self._at(v, self.most)

    def _at(self, v: np.ndarray, table: np.ndarray) -> np.ndarray:
        x = self.velocity
        inside = np.interp(v, x, table)
        below, above = np.minimum(v - x[0], 0.0), np.maximum(v - x[-1], 0.0)
        return (inside + below * (table[1] - table[0]) / (x[1] - x[0])
                + above * (table[-1] - table[-2]) / (x[-1] - x[-2]))

    def clip(self, force: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """sat_𝒟(F) [N].

        Parameters
        ----------
        force : (n,) array
            Demanded, about the static equilibrium [N].
        velocity : (n,) array
            v_d [m/s].

        Returns
        -------
        (n,) array
            Nearest admissible force [N].
        """
        low, high = self(velocity)
        return np.clip(force, low, high)

    def distance(self, force: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """ε = |F − sat_𝒟(F)| [N].

        Parameters
        ----------
        force : (n,) array
            Demanded, about the static equilibrium [N].
        velocity : (n,) array
            v_d [m/s].

        Returns
        -------
        (n,) array
            Not negative [N]; zero for an admissible force.
        """
        return np.abs(force - self.clip(force, velocity))

    def nominal(self, share: float = 0.0) -> float:
        """Damping of a straight line through the band: its lower side at share 0, its upper at 1 [N·s/m].

        The secant at 0.3 m/s, the mean over both directions.

        Parameters
        ----------
        share : float
            Place between the sides of least and greatest damping; values outside 0 to 1 lie beyond them.

        Returns
        -------
        float
            c_nom [N·s/m]; negative where the damper gives energy.
        """
        v = np.array([0.3, -0.3])
        low, high = self(v)
        weak = np.where(v > 0, low, high)
        strong = np.where(v > 0, high, low)
        return float(np.mean((weak + share * (strong - weak)) / v))
