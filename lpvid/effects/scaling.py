"""Scaling: the natural size of a quantity of a unit, from the data by dimensional analysis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.baselines.signals import Signals

Dimension = tuple[float, float, float, float]
"""exponents of the output's unit, of a length, of a time and of a current"""
BASE = ("N", "m", "s", "A")
"""units of the output, of a length, of a time and of a current"""
DERIVED = {"Hz": "1/s", "kg": "N*s^2/m", "J": "N*m"}
"""a mass is a force over an acceleration, a joule a force along a displacement"""


@dataclass(frozen=True)
class Scales:
    """Natural sizes of the data.

    Attributes
    ----------
    force : float
        Root mean square of the output about its mean [its unit].
    displacement : float
        Root mean square of the displacement, or of the integral of the velocity where none was measured [m].
    time : float
        Displacement over the velocity's root mean square [s]: a radian of the motion.
    current : float
        Largest modulus [A].
    period : float
        Of the clock [s]: a lag or a delay lies between it and `time`.
    work : float
        ∫|F v|dt of the longest record [J], the scale of a fade.
    """

    force: float
    displacement: float
    time: float
    current: float
    period: float
    work: float

    @classmethod
    def of(cls, signals: Sequence[Signals]) -> Scales:
        """Of all records together.

        Parameters
        ----------
        signals : sequence of Signals
            Of one rate.

        Returns
        -------
        Scales
            Zero for what was not measured.
        """
        force = _rms([s.output for s in signals])
        speeds = [s["velocity"] for s in signals if s.has("velocity")]
        speed = _rms(speeds, centred=False)
        displacement = _rms([s["displacement"] for s in signals if s.has("displacement")]) or _rms(
            [_integral(s["velocity"], s.sample_time) for s in signals if s.has("velocity")])
        currents = [float(np.abs(s["current"]).max()) for s in signals if s.has("current")]
        work = max((float(np.sum(np.abs(s.output * s["velocity"]))) * s.sample_time
                    for s in signals if s.has("velocity")), default=0.0)
        return cls(force, displacement, displacement / speed if speed > 0 else 0.0, max(currents, default=0.0),
                   signals[0].sample_time, work)

    def size(self, unit: str) -> float | None:
        """Natural size of a quantity of a unit; None for one without unit, or where the data do not determine it.

        Parameters
        ----------
        unit : str
            As `dimension_of` reads it; ``1/J`` is over the work.

        Returns
        -------
        float or None
            In that unit.

        Examples
        --------
        >>> data = Scales(force=500.0, displacement=0.01, time=0.1, current=1.0, period=0.002, work=1e3)
        >>> data.size("N"), data.size("m/N"), round(data.size("N*s^2/m^2"), 9), data.size("1/J"), data.size("K")
        (500.0, 2e-05, 50000.0, 0.001, None)
        """
        if unit == "1/J":
            return 1 / self.work if self.work > 0 else None
        dimension = dimension_of(unit)
        if dimension is None or not any(dimension):
            return None
        base = (self.force, self.displacement, self.time, self.current)
        if any(e and not b > 0 for e, b in zip(dimension, base, strict=True)):
            return None
        return float(np.prod([b**e for b, e in zip(base, dimension, strict=True)]))


def dimension_of(unit: str) -> Dimension | None:
    """Exponents of a unit written like ``N*s^2/m^2``; None where a part of it is not known.

    Parameters
    ----------
    unit : str
        Factors with ``*``, ``/`` and ``^``; the first part stands above the line, every one behind a ``/`` below.

    Returns
    -------
    (float, float, float, float) or None
        All zero for a pure number.

    Examples
    --------
    >>> dimension_of("m/s"), dimension_of("1/A^2"), dimension_of("")
    ((0.0, 1.0, -1.0, 0.0), (0.0, 0.0, 0.0, -2.0), (0.0, 0.0, 0.0, 0.0))
    """
    total = np.zeros(len(BASE))
    for k, part in enumerate(unit.split("/")):
        for factor in part.split("*") if part not in ("", "1") else []:
            name, _, power = factor.partition("^")
            if name in BASE:
                dimension: Sequence[float] | None = [float(name == b) for b in BASE]
            else:
                dimension = dimension_of(DERIVED[name]) if name in DERIVED else None
            if dimension is None:
                return None
            total += (1 if k == 0 else -1) * float(power or 1) * np.array(dimension)
    return tuple(float(v) for v in total)  # type: ignore[return-value]


def _rms(values: Sequence[np.ndarray], centred: bool = True) -> float:
    if not values:
        return 0.0
    pooled = np.concatenate([v - v.mean() if centred else v for v in values])
    return float(np.sqrt(np.mean(pooled**2)))


def _integral(velocity: np.ndarray, period: float) -> np.ndarray:
    """Integral of a velocity without its mean and a quadratic trend."""
    displacement = np.cumsum(velocity - velocity.mean()) * period
    n = np.linspace(-1.0, 1.0, displacement.size)
    return displacement - np.polyval(np.polyfit(n, displacement, 2), n)
