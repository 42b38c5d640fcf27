"""What the current does: spread between the softest and the hardest setting, linearity, rebound over compression."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from quartercar.characterisation.forces import StandardForce


@dataclass(frozen=True)
class CurrentSpread:
    """Place of one current between soft and hard at one speed.

    Attributes
    ----------
    specimen : str
    direction : {1, −1}
    speed : float
        [m/s].
    current : float
    share, share_std : float
        (F − F_soft)/(F_hard − F_soft), 0 at the softest current and 1 at the hardest.
    off_line : float
        `share` less the current's place between the two, (I − I_soft)/(I_hard − I_soft).
    """

    specimen: str
    direction: int
    speed: float
    current: float
    share: float
    share_std: float
    off_line: float


@dataclass(frozen=True)
class ReboundRatio:
    """Rebound over compression force at one speed and current.

    Attributes
    ----------
    specimen : str
    current : float or None
    speed : float
        [m/s].
    ratio, std : float
        F_rebound/|F_compression| as measured, its standard error.
    without_gas : float or None
        The same with the gas force taken off both; None where it is not known.
    """

    specimen: str
    current: float | None
    speed: float
    ratio: float
    std: float
    without_gas: float | None

    @property
    def pushed(self) -> bool:
        """Whether the gas pushes more than a direction damps: its force has the sign of the other, and no ratio."""
        return self.ratio <= 0


def spreads_of(forces: Sequence[StandardForce]) -> tuple[CurrentSpread, ...]:
    """Spread over the currents of each specimen, direction and speed that has two or more.

    Soft and hard are the currents of least and largest force in this direction at this speed. The standard error counts
    the errors of the three forces.

    Parameters
    ----------
    forces : sequence of StandardForce
        Those without a force or a current are left out.

    Returns
    -------
    tuple of CurrentSpread
        Of rising current within each; none where force or current is the same at both ends.
    """
    rows = []
    for specimen, direction, speed in dict.fromkeys((f.specimen, f.direction, f.speed) for f in forces):
        own = [(direction * f.force, f.current, f.std or 0.0) for f in forces if f.force is not None
               and f.current is not None and (f.specimen, f.direction, f.speed) == (specimen, direction, speed)]
        if len(own) < 2:
            continue
        soft, hard = min(own), max(own)
        span, reach = hard[0] - soft[0], hard[1] - soft[1]
        if span == 0 or reach == 0:
            continue
        for row in sorted(own, key=lambda row: row[1]):
            share = (row[0] - soft[0]) / span
            error = 0.0 if row in (soft, hard) else float(np.linalg.norm(
                (row[2] / span, (1 - share) * soft[2] / span, share * hard[2] / span)))
            off_line = share - (row[1] - soft[1]) / reach
            rows.append(CurrentSpread(specimen, direction, speed, row[1], share, error, off_line))
    return tuple(rows)


def ratios_of(forces: Sequence[StandardForce], gas: Mapping[str, float]) -> tuple[ReboundRatio, ...]:
    """Rebound over compression at every speed and current that has both.

    Parameters
    ----------
    forces : sequence of StandardForce
    gas : mapping of specimen to float
        Gas force outwards [N] at its softest creep test, where it has one: damping that differs between the directions
        is in it, and least there.

    Returns
    -------
    tuple of ReboundRatio
    """
    rows = []
    found = {(f.specimen, f.current, f.speed, f.direction): f for f in forces if f.force is not None}
    for (specimen, current, speed, direction), out in found.items():
        back = found.get((specimen, current, speed, -1))
        if direction != 1 or back is None or out.force is None or not back.force:
            continue
        ratio = out.force / -back.force
        error = abs(ratio) * float(np.hypot((out.std or 0.0) / out.force if out.force else 0.0,
                                            (back.std or 0.0) / back.force))
        outwards = gas.get(specimen)
        free = None if outwards is None or back.force + outwards == 0 else (
            (out.force + outwards) / -(back.force + outwards))
        rows.append(ReboundRatio(specimen, current, speed, ratio, error, free))
    return tuple(rows)


def worst_off_line(spreads: Sequence[CurrentSpread]) -> CurrentSpread | None:
    """The spread that lies furthest from a straight line over the current.

    Parameters
    ----------
    spreads : sequence of CurrentSpread

    Returns
    -------
    CurrentSpread or None
        None of none.
    """
    return max(spreads, key=lambda s: abs(s.off_line), default=None)
