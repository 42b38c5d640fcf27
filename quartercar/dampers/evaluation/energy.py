"""Steady sine cycles of a damper: loops and work per cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive
from quartercar.dampers.simulated import SimulatedDamper

POINTS = 2000
"""samples of a cycle"""
FEWEST, MOST = 2, 40
"""cycles run before the last one is read"""
SETTLED = 1e-6
"""relative change of the work from cycle to cycle at which it counts as steady"""
SETTLED_SAMPLED = 1e-3
"""the same for a model that runs at its own sample time, whose samples fall elsewhere in every cycle"""


@dataclass(frozen=True, eq=False)
class Cycle:
    """One steady cycle of x = X sin 2πft at a constant current.

    Attributes
    ----------
    displacement, velocity, force : (n + 1,) array
        Over one period, the end being the start again [m], [m/s], [N].
    work : float
        ∮F dx, positive where energy is taken from the motion [J].
    settled : bool
        Whether the work had stopped changing from cycle to cycle.
    """

    displacement: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    work: float
    settled: bool


def steady_cycle(damper: SimulatedDamper, amplitude: float, frequency: float, current: float = 0.0) -> Cycle:
    """Run sine cycles until the work per cycle no longer changes.

    W = ∮F dx = ∫F v dt, by the trapezoidal rule, which converges faster than any power for a smooth periodic integrand.

    Parameters
    ----------
    damper : SimulatedDamper
    amplitude : float
        X [m].
    frequency : float
        f [Hz].
    current : float
        Constant, in the model's `current_unit`.

    Returns
    -------
    Cycle

    Examples
    --------
    >>> from quartercar.dampers.laws.linear import Linear
    >>> viscous = Linear(values={"damping": 1000.0, "stiffness": 0.0, "mass": 0.0, "offset": 0.0})
    >>> round(steady_cycle(viscous, 0.01, 2.0).work / (np.pi * 1000 * 2 * np.pi * 2 * 0.01**2), 9)
    1.0
    """
    checks.positive(amplitude, "amplitude", "m")
    omega = 2 * np.pi * checks.positive(frequency, "frequency", "Hz")
    period, cycles, last = 1.0 / frequency, FEWEST, np.nan
    while True:
        t = period / POINTS * np.arange(cycles * POINTS + 1)
        drive = Drive(period / POINTS, amplitude * omega * np.cos(omega * t), amplitude * np.sin(omega * t),
                      np.full(t.size, float(current)))
        force = _force(damper, drive, amplitude, omega)
        v = drive.velocity[-POINTS - 1:]
        works = [float(np.trapezoid(force[k: k + POINTS + 1] * drive.velocity[k: k + POINTS + 1], dx=period / POINTS))
                 for k in (len(t) - 1 - 2 * POINTS, len(t) - 1 - POINTS)]
        scale = float(np.trapezoid(np.abs(force[-POINTS - 1:] * v), dx=period / POINTS))
        settled = abs(works[1] - works[0]) <= (SETTLED_SAMPLED if damper.clock else SETTLED) * max(scale, 1e-300)
        if settled or cycles >= MOST or not np.isfinite(works[1]) or works[1] == last:
            break
        cycles, last = min(2 * cycles, MOST), works[1]
    return Cycle(drive.displacement[-POINTS - 1:], v, force[-POINTS - 1:], works[1], settled)


def _force(damper: SimulatedDamper, drive: Drive, amplitude: float, omega: float) -> np.ndarray:
    """Force along the drive; a model with a clock of its own runs by that, and a spline gives what lies in between."""
    if damper.clock is None:
        return damper.response(drive, damper.vector)
    from scipy.interpolate import CubicSpline

    t = damper.clock * np.arange(int(np.ceil(drive.times[-1] / damper.clock)) + 2)
    own = Drive(damper.clock, amplitude * omega * np.cos(omega * t), amplitude * np.sin(omega * t),
                np.full(t.size, drive.current[0]))
    force = damper.response(own, damper.vector)
    return CubicSpline(t, force)(drive.times) if np.isfinite(force).all() else np.full(drive.n_samples, np.nan)
