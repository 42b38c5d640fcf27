"""Characteristic lines: what a series of steady sine tests shows of force over speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from quartercar.dampers.contract import Damper


@dataclass(frozen=True, eq=False)
class CharacteristicLine:
    """One steady cycle per amplitude, at one frequency.

    The largest force and the largest velocity of a cycle are not simultaneous where the oil is compressible; the force
    at ÿ = 0 is read where the velocity is largest. Both are given.

    Attributes
    ----------
    amplitude, speed : (n,) array
        [m], largest velocity [m/s].
    highest, lowest : (n,) array
        Largest and smallest force [N].
    extending, retracting : (n,) array
        Force at the largest and at the smallest velocity [N].
    work, lag_area : (n,) array
        ∮F dx [J] and |∮F dv| [W], the area of the loop over velocity, which is 0 for a damper without memory.
    """

    amplitude: np.ndarray
    speed: np.ndarray
    highest: np.ndarray
    lowest: np.ndarray
    extending: np.ndarray
    retracting: np.ndarray
    work: np.ndarray
    lag_area: np.ndarray


def characteristic_line(damper: Damper, amplitudes: Sequence[float] | np.ndarray,
                        frequency: float) -> CharacteristicLine:
    """Run the steady cycles of a series of amplitudes [m] at a frequency [Hz].

    Parameters
    ----------
    damper : Damper
        At current 0.
    amplitudes : (n,) array
        X of each cycle [m].
    frequency : float
        Of all cycles [Hz].

    Returns
    -------
    CharacteristicLine
        In the order of `amplitudes`.

    Examples
    --------
    >>> from quartercar.dampers.laws.linear import Linear
    >>> viscous = Linear(values={"damping": 1000.0, "stiffness": 0.0, "mass": 0.0, "offset": 0.0})
    >>> line = characteristic_line(viscous, [0.01], 2.0)
    >>> round(float(line.highest[0] / line.speed[0]), 6), round(float(line.lag_area[0]), 6)
    (1000.0, 0.0)
    """
    rows = []
    for amplitude in amplitudes:
        cycle = damper.cycle(amplitude, frequency)
        v, force = cycle.velocity, cycle.force
        rows.append((amplitude, v.max(), force.max(), force.min(), force[v.argmax()], force[v.argmin()], cycle.work,
                     abs(np.trapezoid(force, v))))
    return CharacteristicLine(*(np.array(column, dtype=float) for column in zip(*rows, strict=True)))
