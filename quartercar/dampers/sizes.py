"""Sizes: how strong, far and fast what a record shows is, so that a search starts and ends in that proportion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.units import base_exponents
from quartercar.dampers.drive import Drive, joined
from quartercar.dampers.parameter import Parameter

INVERSE = ("1/s", "Hz")
"""units of a rate"""


@dataclass(frozen=True)
class Sizes:
    """Natural sizes of a damper and of its records.

    A law's parameters state typical values and the range of a search for a damper of `TYPICAL` sizes. By similarity
    the same law in other sizes F, L, T of force, length and time has values that are larger by F^a L^b T^c, a, b and c
    the exponents of the unit: a fit in newtons and millimetres, of a toy or of a buffer is the same fit.

    A lag or a rate of its own (a current's, a poppet's) does not scale with the motion: what the records can show of it
    lies between a share of a sample and a share of their duration.

    Attributes
    ----------
    force : float
        Standard deviation of the force [N].
    length : float
        Root mean square of the displacement about its mean, of the path where there is no displacement [m].
    time : float
        `length` over the root mean square of the velocity [s].
    current : float
        Largest current, in its unit; that of `TYPICAL` where there is none.
    sample_time, duration : float
        Period, and length of the longest record [s].
    """

    force: float
    length: float
    time: float
    current: float
    sample_time: float
    duration: float

    @classmethod
    def of(cls, drives: Sequence[Drive]) -> Sizes:
        """Sizes of records; those of `TYPICAL` where nothing moves or no force is measured.

        Parameters
        ----------
        drives : sequence of Drive

        Returns
        -------
        Sizes
        """
        velocity, current = joined(drives, "velocity", "current")
        force = np.concatenate([np.zeros(1) if d.force is None else d.force - d.force.mean() for d in drives])
        length, speed = travel(drives), _rms(velocity)
        period = drives[0].sample_time
        return cls(_rms(force) or TYPICAL.force, length or TYPICAL.length,
                   length / speed if length and speed else TYPICAL.time,
                   float(np.abs(current).max(initial=0.0)) or TYPICAL.current, period,
                   period * max(d.n_samples for d in drives))

    def factor(self, unit: str) -> float:
        """What a number of a unit is larger by than in a damper of `TYPICAL` sizes.

        Parameters
        ----------
        unit : str
            SI.

        Returns
        -------
        float

        Examples
        --------
        >>> half = replace(TYPICAL, force=0.5 * TYPICAL.force)
        >>> half.factor("N*s/m"), half.factor("m"), half.factor("m/(N*s)")
        (0.5, 1.0, 2.0)
        """
        powers = base_exponents(unit.replace("V", "A"))  # a voltage stands for the current
        force, length, time, current = (a / b for a, b in zip(
            (self.force, self.length, self.time, self.current),
            (TYPICAL.force, TYPICAL.length, TYPICAL.time, TYPICAL.current), strict=True))
        mass = force * time**2 / length
        return (mass ** powers.get("kg", 0.0) * length ** powers.get("m", 0.0) * time ** powers.get("s", 0.0)
                * current ** powers.get("A", 0.0))

    def sized(self, parameter: Parameter) -> Parameter:
        """A parameter with the typical value that these sizes give, and with the range of a search as its bounds.

        Parameters
        ----------
        parameter : Parameter

        Returns
        -------
        Parameter
            Its default lies within its bounds; bounds of physics alone stay as they are.
        """
        typical, low, high = parameter.default, *(parameter.search or (-np.inf, np.inf))
        if parameter.search and parameter.unit in ("s", *INVERSE):
            fast, slow = self.sample_time / TYPICAL.sample_time, self.duration / TYPICAL.duration
            if parameter.unit in INVERSE:
                typical, low, high = typical / fast, low / slow, high / fast
            else:
                typical, low, high = typical * fast, low * fast, high * slow
        elif parameter.unit:
            by = self.factor(parameter.unit)
            typical, low, high = typical * by, low * by, high * by
        low, high = max(low, parameter.lower), min(high, parameter.upper)
        return replace(parameter, default=min(max(typical, low), high), lower=low, upper=high, search=None)


TYPICAL = Sizes(force=500.0, length=0.01, time=0.1, current=1.0, sample_time=1e-3, duration=10.0)
"""Damper and records for which the laws of `quartercar.dampers.laws` state typical values and ranges: of a passenger
car, at 1 to 2 Hz and a centimetre, with half a kilonewton, 10 s at 1 kHz."""


def travel(drives: Sequence[Drive]) -> float:
    """Root mean square of the displacements about their means, of the paths where there is none [m].

    Parameters
    ----------
    drives : sequence of Drive

    Returns
    -------
    float
        0 where nothing moves.
    """
    ways = [d.displacement if d.displacement.any() else path(d) for d in drives]
    return _rms(np.concatenate([w - w.mean() for w in ways]))


def path(drive: Drive) -> np.ndarray:
    """(n,) the integral of the velocity, its drift taken off [m].

    Parameters
    ----------
    drive : Drive
        Its velocity is read [m/s].

    Returns
    -------
    (n,) array
        Zero at both ends [m].
    """
    way = np.cumsum(drive.velocity) * drive.sample_time
    return way - np.linspace(way[0], way[-1], way.size)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
