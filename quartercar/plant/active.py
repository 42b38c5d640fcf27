"""Where a damper's settled force gives energy: the currents and speeds at which its law is active."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quartercar.dampers.contract import Damper

SPEEDS = 61
CURRENTS = 11
ROUNDING = 1e-6
"""share of the largest power below which a loss is rounding, as in `dampers.passivity`"""


@dataclass(frozen=True)
class ActiveRegion:
    """The smallest ranges around all points at which F·v < 0, the force of displacement alone left out.

    Attributes
    ----------
    currents : (float, float)
        In `unit`.
    speeds : (float, float)
        |v| [m/s].
    power : float
        Least F·v [W].
    share : float
        Of the points of the grid.
    unit : str
        Of the current.
    seen : float or None
        Largest speed of the training records [m/s].
    """

    currents: tuple[float, float]
    speeds: tuple[float, float]
    power: float
    share: float
    unit: str
    seen: float | None

    def __str__(self) -> str:
        (low, high), (slow, fast) = self.currents, self.speeds
        unit = "" if self.unit == "1" else f" {self.unit}"
        at = f"{low:.3g}{unit}" if low == high else f"{low:.3g} to {high:.3g}{unit}"
        seen = "" if self.seen is None else f"; its records reached {self.seen:.3g} m/s"
        return f"it gives energy at {at} between {slow:.3g} and {fast:.3g} m/s{seen}"


def active_region(damper: Damper, currents: tuple[float, float], speed: float = 0.5) -> ActiveRegion | None:
    """Where a damper's settled force points along the motion; None where it never does.

    Parameters
    ----------
    damper : Damper
    currents : (float, float)
        Range of the coil.
    speed : float
        Largest speed looked at [m/s]; a point at which the force does not settle counts as active.
    """
    half = speed * np.linspace(0.0, 1.0, SPEEDS // 2 + 1)[1:]
    v = np.concatenate([-half[::-1], half])
    grid = np.linspace(*currents, CURRENTS) if "current" in damper.reads else np.array(currents[:1])
    rest = float(np.atleast_1d(damper.conservative_force(np.zeros(1)))[0])
    with np.errstate(all="ignore"):
        power = np.array([(damper.static_force(v, float(i)) - rest) * v for i in grid])
    finite = np.isfinite(power)
    largest = float(np.abs(power[finite]).max(initial=0.0))
    active = ~finite | (power < -ROUNDING * largest)
    if not active.any():
        return None
    rows, columns = np.nonzero(active)
    speeds = np.abs(v[columns])
    reached = damper.trained("velocity")
    return ActiveRegion((float(grid[rows].min()), float(grid[rows].max())), (float(speeds.min()), float(speeds.max())),
                        float(power[finite].min(initial=0.0)), float(active.mean()), damper.current_unit,
                        None if reached is None else max(map(abs, reached)))

