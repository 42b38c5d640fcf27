"""Where a damper gives energy: settled, by current and speed; along small sines, by current and frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from quartercar.dampers.blackbox.sampled import SampledDamper
from quartercar.dampers.contract import Damper

SPEEDS = 61
FREQUENCIES = 200
CURRENTS = 11
ROUNDING = 1e-6
"""share of the largest power below which a loss is rounding, as in `dampers.evaluation.passivity`"""


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

    Returns
    -------
    ActiveRegion or None
        Range of currents and speeds with an active point, and the least power there [W]; a damper that does not read
        the current is looked at once, at the lower limit.
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


@dataclass(frozen=True)
class ActiveFrequency:
    """Where a frozen model of a damper takes least from a small sine, Re F/v < 0.

    Attributes
    ----------
    current, frequency, damping : float
        In `unit`; [Hz]; Re F/v there [N·s/m].
    unit : str
        Of the current.
    """

    current: float
    frequency: float
    damping: float
    unit: str

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return (f"held at {self.current:.3g}{unit} it gives energy to a small sine of {self.frequency:.3g} Hz "
                f"(Re F/v = {self.damping:.4g} N*s/m)")


def active_frequency(damper: Damper, currents: tuple[float, float]) -> ActiveFrequency | None:
    """The current and frequency of the least Re F/v of an identified model, where that is negative; else None.

    ::

        F/v = G_v(e^jωT) + G_x(e^jωT)/(jω)      about rest, a static stage by its slope there

    on a grid up to the Nyquist frequency. None too for a model that schedules itself and for a law that is not sampled.

    Parameters
    ----------
    damper : Damper
        Anything but an identified transfer function or state space gives None.
    currents : (float, float)
        Range of the coil, in the damper's unit; a damper that does not read the current is looked at once, at the lower
        limit.

    Returns
    -------
    ActiveFrequency or None
        The least Re F/v over currents and frequencies; None where it is not negative.
    """
    if not isinstance(damper, SampledDamper) or damper.clock is None:
        return None
    model = damper.at_clock(damper.clock)
    if not isinstance(model, (LPVTransferFunction, LPVStateSpace)):
        return None
    f = np.geomspace(0.1, 0.5 / damper.clock, FREQUENCIES)
    grid = np.linspace(*currents, CURRENTS) if "current" in damper.reads else np.array(currents[:1])
    real = np.array([np.real(_mechanical(model, float(i), f, damper.clock)) for i in grid])
    row, column = np.unravel_index(int(np.argmin(real)), real.shape)
    if real[row, column] >= -ROUNDING * np.abs(real).max():
        return None
    return ActiveFrequency(float(grid[row]), float(f[column]), float(real[row, column]), damper.current_unit)


def _mechanical(model: LPVTransferFunction | LPVStateSpace, current: float, frequency: np.ndarray,
                period: float) -> np.ndarray:
    """(n,) F/v of the model with its current held, about rest."""
    point = np.full((1, len(model.box.names)), current)
    s = 2j * np.pi * frequency
    per_speed = {"velocity": np.ones(s.size, complex), "displacement": 1 / s}
    u = np.array([per_speed.get(x.name, np.zeros(s.size, complex)) for x in model.inputs])
    if model.input_stage is not None:
        nudge = 1e-7 * np.eye(len(model.inputs))
        there = model.input_stage.apply(nudge, np.repeat(point, len(nudge), axis=0))
        rest = model.input_stage.apply(0 * nudge, np.repeat(point, len(nudge), axis=0))
        u = ((there - rest) / 1e-7).T @ u
    z = np.exp(s * period)
    if isinstance(model, LPVTransferFunction):
        a, b, _ = model.coefficients(point[0])
        above = np.einsum("jm,kj,mk->k", b[:, 0], z[:, None] ** -np.arange(len(b)), u)
        return above / (1 + (z[:, None] ** -np.arange(1, len(a) + 1)) @ a[:, 0, 0])
    a, b, c, d = model.frozen(point[0])
    state = np.linalg.solve(z[:, None, None] * np.eye(model.order) - a, (b @ u).T[:, :, None])[:, :, 0]
    return state @ c[0] + d[0] @ u
