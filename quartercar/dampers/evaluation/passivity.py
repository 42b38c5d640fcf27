"""Passivity: whether a damper only ever takes energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.codec import Encoded
from lpvid.toolkit import checks
from quartercar.dampers.evaluation.energy import steady_cycle
from quartercar.dampers.simulated import SimulatedDamper

SPEEDS = 400
"""points of the velocity grid on either side of zero, denser towards it."""
CURRENTS = 5
"""points of the current grid."""
AMPLITUDES = (0.002, 0.01, 0.03)
"""[m]"""
FREQUENCIES = (1.0, 5.0, 12.0)
"""[Hz]"""
ROUNDING = 1e-6
"""share of the largest power, or of the energy exchanged, below which a loss is rounding."""
NEAR_ZERO = 0.01
"""share of the grid's reach within which a static loss is stored energy, if no cycle gives energy."""


@dataclass(frozen=True)
class Passivity(Encoded):
    """Whether a damper takes energy: at every constant velocity, and over every steady cycle.

    Attributes
    ----------
    passive : bool
    power : float
        Least F·v over the grid of velocities and currents, the force of displacement alone left out [W]; 0 where it is
        negative nowhere.
    power_at : (float, float)
        Velocity [m/s] and current of that least power.
    work_share : float
        Least work of a steady cycle, as a share of the energy exchanged in it: 1 for one that only takes, −1 for one
        that only gives.
    work_at : (float, float, float)
        Amplitude [m], frequency [Hz] and current of that cycle.
    speed : float
        The grid reached ± this [m/s].
    stored : bool
        Whether power is given near zero velocity only and no cycle gives any, by a law with displacement or memory:
        energy stored before.
    unit : str or None
        Of the current; None where the law reads none.
    known : float or None
        Largest speed of the training records [m/s]; None where that is not known.
    """

    JSON = ("passive", ("says", "description"), ("least_power", "power"), ("least_power_at", "power_at"), "stored",
            "speed", ("least_work_share", "work_share"), ("least_work_at", "work_at"))

    passive: bool
    power: float
    power_at: tuple[float, float]
    work_share: float
    work_at: tuple[float, float, float]
    speed: float
    stored: bool
    unit: str | None
    known: float | None = None

    @property
    def description(self) -> str:
        """Where it gives energy, in a sentence; empty where it never does."""
        if self.work_share < -ROUNDING or not np.isfinite(self.work_share):
            amplitude, frequency, current = self.work_at
            what = (f"gives {-100 * self.work_share:.2g} % of the energy exchanged" if np.isfinite(self.work_share)
                    else "diverges")
            return (f"a steady cycle of {1e3 * amplitude:.3g} mm at {frequency:.3g} Hz{self._at(current)} {what}"
                    f"{self._beyond(2 * np.pi * frequency * amplitude)}")
        if self.power < 0:
            velocity, current = self.power_at
            return (f"it gives {-self.power:.3g} W at {velocity:.3g} m/s{self._at(current)}"
                    f"{self._beyond(abs(velocity))}")
        return ""

    def _at(self, current: float) -> str:
        """A current, where there is one."""
        unit = "" if self.unit in (None, "1") else f" {self.unit}"
        return "" if self.unit is None else f" and {current:.3g}{unit}"

    def _beyond(self, speed: float) -> str:
        """That a motion is faster than the training records."""
        if self.known is None or speed <= self.known:
            return ""
        return f" (up to {speed:.3g} m/s, beyond the {self.known:.3g} m/s of the training records)"

    def __str__(self) -> str:
        if not self.passive:
            return f"NOT passive: {self.description}"
        return f"passive up to {self.speed:g} m/s" + (f" ({self.description}: stored energy)" if self.stored else "")


def check_passivity(damper: SimulatedDamper, speed: float = 2.0) -> Passivity:
    """Power at constant velocities and work of steady cycles, without the force that depends on displacement alone.

    P = (F − F_gas) v ≥ 0 for |v| ≤ `speed` at displacement 0 over the usual currents, and W = ∮(F − F_gas) dx ≥ 0 over
    steady cycles of several amplitudes and frequencies no faster than `speed`, where energy may be stored on the way.
    The verdict is on the damper itself, whatever the polarity of the records it was fitted to.

    Parameters
    ----------
    damper : SimulatedDamper
    speed : float
        Reach of the velocity grid [m/s].

    Returns
    -------
    Passivity

    References
    ----------
    Equation sheet 7.6.

    Examples
    --------
    >>> from quartercar.dampers.laws.linear import Linear
    >>> print(check_passivity(Linear()))
    passive up to 2 m/s
    """
    checks.positive(speed, "speed", "m/s")
    currents = _current_grid(damper)
    with np.errstate(all="ignore"):
        power, power_at, reach = _static(damper, speed, currents)
        share, work_at = _cycles(damper, speed, currents)
    cyclic = bool(share >= -ROUNDING)
    can_store = damper.start > 0 or "displacement" in damper.reads
    stored = can_store and cyclic and power < 0 and reach <= NEAR_ZERO * speed
    return Passivity(cyclic and (power == 0 or stored), power, power_at, share, work_at, speed, stored,
                     damper.current_unit if "current" in damper.reads else None, damper.largest_speed)


def _current_grid(damper: SimulatedDamper) -> np.ndarray:
    """Currents over the fitted range, its rarest ends left out; 0 for a damper without one."""
    usual = damper.usual_currents
    if usual is None or "current" not in damper.reads:
        return np.zeros(1)
    low, high = usual
    return np.linspace(low, high, CURRENTS) if high > low else np.array([low])


def _static(damper: SimulatedDamper, speed: float, currents: np.ndarray) -> tuple[float, tuple[float, float], float]:
    """(least power or 0, where, largest speed at which power is given); losses within rounding count as none."""
    half = speed * np.linspace(0.0, 1.0, SPEEDS + 1)[1:] ** 2
    velocity = np.concatenate([-half[::-1], half])
    gas = float(damper.conservative_force(np.zeros(1))[0])
    power = np.array([(damper.static_force(velocity, float(i), 0.0) - gas) * velocity for i in currents])
    given = power < -ROUNDING * float(np.nanmax(np.abs(power), initial=0.0))
    if not given.any():
        return 0.0, (0.0, float(currents[0])), 0.0
    row, column = np.unravel_index(int(np.nanargmin(power)), power.shape)
    return (float(power[row, column]), (float(velocity[column]), float(currents[row])),
            float(np.abs(velocity[given.any(axis=0)]).max()))


def _cycles(damper: SimulatedDamper, speed: float, currents: np.ndarray) -> tuple[float, tuple[float, float, float]]:
    """(least share of work, where); NaN where a cycle diverges."""
    worst, at = 1.0, (AMPLITUDES[0], FREQUENCIES[0], float(currents[0]))
    for current in dict.fromkeys((float(currents[0]), float(currents[-1]))):
        for amplitude in AMPLITUDES:
            for frequency in FREQUENCIES:
                if 2 * np.pi * frequency * amplitude > speed:
                    continue
                share = _share(damper, amplitude, frequency, current)
                if not share >= worst:
                    worst, at = share, (amplitude, frequency, current)
                if not np.isfinite(share):
                    return share, at
    return worst, at


def _share(damper: SimulatedDamper, amplitude: float, frequency: float, current: float) -> float:
    cycle = steady_cycle(damper, amplitude, frequency, current)
    power = (cycle.force - damper.conservative_force(cycle.displacement)) * cycle.velocity
    exchanged = float(np.trapezoid(np.abs(power)))
    return float(np.trapezoid(power)) / exchanged if exchanged != 0 else 1.0
