"""Passivity: whether a damper only ever takes energy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid import _checks

if TYPE_CHECKING:
    from quartercar.dampers.contract import Damper

SPEEDS = 401
"""points of the velocity grid."""
CURRENTS = 5
"""points of the current grid."""
AMPLITUDES = (0.002, 0.01, 0.03)
"""[m]"""
FREQUENCIES = (1.0, 5.0, 12.0)
"""[Hz]"""
FORGIVEN = 1e-6
"""share of the largest power, or of the energy exchanged, below which a loss is rounding."""


@dataclass(frozen=True)
class Passivity:
    """Whether a damper takes energy: at every constant velocity, and over every steady cycle.

    Attributes
    ----------
    passive : bool
    static_power : float or None
        Least F·v without the conservative force over the grid of velocities and currents [W]; None where the model has
        no static force.
    static_at : (float, float)
        Velocity [m/s] and current of that least power.
    work : float
        Least work of a steady cycle as a share of the energy exchanged in it, −1 to 1.
    work_at : (float, float, float)
        Amplitude [m], frequency [Hz] and current of that cycle.
    speed : float
        The grid reached ± this [m/s].
    unit : str
        Of the current.
    """

    passive: bool
    static_power: float | None
    static_at: tuple[float, float]
    work: float
    work_at: tuple[float, float, float]
    speed: float
    unit: str

    @property
    def says(self) -> str:
        """Where it gives energy, in a sentence; empty where it never does."""
        if self.passive:
            return ""
        if self.work < -FORGIVEN:
            amplitude, frequency, current = self.work_at
            return (f"a steady cycle of {1e3 * amplitude:.3g} mm at {frequency:.3g} Hz and {current:.3g} {self.unit} "
                    f"gives {-100 * self.work:.2g} % of the energy exchanged")
        velocity, current = self.static_at
        return f"it gives {-(self.static_power or 0.0):.3g} W at {velocity:.3g} m/s and {current:.3g} {self.unit}"

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return {"passive": self.passive, "says": self.says, "least_power": self.static_power,
                "least_power_at": list(self.static_at), "least_work_share": self.work,
                "least_work_at": list(self.work_at), "speed": self.speed}

    def __str__(self) -> str:
        return f"passive up to {self.speed:g} m/s" if self.passive else f"NOT passive: {self.says}"


def check_passivity(damper: Damper, speed: float = 2.0) -> Passivity:
    """Power at constant velocities and work of steady cycles, without the force of displacement alone.

    Parameters
    ----------
    damper : Damper
    speed : float
        Reach of the velocity grid [m/s].

    Examples
    --------
    >>> from quartercar.dampers.linear import Linear
    >>> print(check_passivity(Linear()))
    passive up to 2 m/s
    """
    _checks.positive(speed, "speed", "m/s")
    currents = current_grid(damper)
    power, static_at = _static(damper, speed, currents)
    work, work_at = _cycles(damper, speed, currents)
    bad = (power is not None and power < 0) or work < -FORGIVEN
    return Passivity(not bad, power, static_at, work, work_at, speed, damper.current_unit)


def current_grid(damper: Damper) -> np.ndarray:
    """Currents over the fitted range; 0 for a damper without one."""
    if damper.current_range is None or "current" not in damper.reads:
        return np.zeros(1)
    low, high = damper.current_range
    return np.linspace(low, high, CURRENTS) if high > low else np.array([low])


def _static(damper: Damper, speed: float, currents: np.ndarray) -> tuple[float | None, tuple[float, float]]:
    """Least power over the grid; losses within rounding of the largest power count as zero."""
    velocity = np.linspace(-speed, speed, SPEEDS)
    gas = float(damper.conservative_force(np.zeros(1))[0])
    least, at, most = 0.0, (0.0, float(currents[0])), 0.0
    for current in currents:
        power = (damper.static_force(velocity, float(current), 0.0) - gas) * velocity
        k = int(np.argmin(power))
        most = max(most, float(np.abs(power).max()))
        if power[k] < least:
            least, at = float(power[k]), (float(velocity[k]), float(current))
    return (least if least < -FORGIVEN * most else 0.0), at


def _cycles(damper: Damper, speed: float, currents: np.ndarray) -> tuple[float, tuple[float, float, float]]:
    """Least work of a steady cycle as a share of the energy exchanged in it."""
    worst, at = 1.0, (AMPLITUDES[0], FREQUENCIES[0], float(currents[0]))
    for current in (currents[0], currents[-1]) if currents.size > 1 else currents:
        for amplitude in AMPLITUDES:
            for frequency in FREQUENCIES:
                if 2 * np.pi * frequency * amplitude > speed:
                    continue
                cycle = damper.cycle(amplitude, frequency, float(current))
                force = cycle.force - damper.conservative_force(cycle.displacement)
                exchanged = float(np.trapezoid(np.abs(force * cycle.velocity)))
                share = float(np.trapezoid(force * cycle.velocity)) / exchanged if exchanged > 0 else 0.0
                if share < worst:
                    worst, at = share, (amplitude, frequency, float(current))
    return worst, at
