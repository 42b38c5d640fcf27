"""Which weight is active where: the performance signals that make up a closed loop's gain at its worst frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.analysis.frozen_norms import h_infinity_norm, response_at
from lpvid.model.hull import corners_of, hull_of
from lpvid.model.state_space import LPVStateSpace

MOST = 9
"""Scheduling points that are looked at: the corners of the box and its middle, of at most three variables."""
NEAR = 0.95
"""share of the largest frozen gain from which on a point is where the design is limited"""


@dataclass(frozen=True)
class Limit:
    """The largest frozen gain at one value of the scheduling.

    With G(jω) v = σ u, |u_i|² is the share of performance signal i in ‖z‖² for the worst input at ω, |v_j|² that of
    disturbance j in ‖w‖².

    Parameters
    ----------
    at : tuple of (str, float, str)
        Name, value and unit of each scheduling variable.
    gain : float
        σ
    frequency : float
        [Hz]; in continuous time it may be infinite.
    signals, disturbances : tuple of (str, float)
        With their shares, largest first.
    """

    at: tuple[tuple[str, float, str], ...]
    gain: float
    frequency: float
    signals: tuple[tuple[str, float], ...]
    disturbances: tuple[tuple[str, float], ...]

    @property
    def where(self) -> str:
        """The scheduling in words; empty where nothing varies."""
        return ", ".join(f"{n} = {v:.4g} {u}".rstrip() for n, v, u in self.at)

    @property
    def speed(self) -> str:
        """The frequency in words."""
        return "infinite frequency" if math.isinf(self.frequency) else f"{self.frequency:.3g} Hz"

    def to_dict(self) -> dict[str, Any]:
        """Plain data.

        Returns
        -------
        dict
            Scheduling values, gain, frequency [rad/s] (None where infinite), shares of signals and disturbances.
        """
        return {"at": {n: v for n, v, _ in self.at}, "gain": self.gain,
                "frequency": None if math.isinf(self.frequency) else self.frequency, "signals": dict(self.signals),
                "disturbances": dict(self.disturbances)}

    def __str__(self) -> str:
        names = " and ".join(n for n, share in self.signals if share >= 0.5 * self.signals[0][1])
        return f"{names} at {self.speed}{f' with {self.where}' if self.at else ''}"


def limits(loop: LPVStateSpace) -> tuple[Limit, ...]:
    """Where and by which signals the gain of a closed loop is reached, at the corners and the middle of its box.

    Of the hull that its metadata name, where it was designed for one. The scheduling is held still: a moving one may
    reach more.

    Parameters
    ----------
    loop : LPVStateSpace
        From disturbances to weighted performance signals, frozen-stable.

    Returns
    -------
    tuple of Limit
        Of largest gain first.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.scheduling import Polynomial
    >>> loop = LPVStateSpace([[[-1.0]]], [[[1.0]]], [[[3.0], [0.0]]], [[[0.0], [0.5]]], Polynomial((), 0), None,
    ...                      inputs=(Signal("road"),), outputs=(Signal("comfort"), Signal("effort")))
    >>> print(limits(loop)[0], round(limits(loop)[0].gain, 3))
    comfort at 0 Hz 3.041
    """
    points = corners_of(loop, MOST - 1)
    if loop.box.names:
        points = np.vstack([points, loop.box.centre if hull_of(loop) is None else points.mean(axis=0)])
    return tuple(sorted((_at(loop, p) for p in points), key=lambda limit: -limit.gain))


def limiting(found: tuple[Limit, ...], level: float | None) -> str:
    """The design log in a sentence: what limits γ, and how much of the verified bound the held loop reaches.

    Parameters
    ----------
    found : tuple of Limit
        Largest gain first.
    level : float or None
        The verified bound.

    Returns
    -------
    str
        Without a full stop; empty where nothing was found.
    """
    if not found:
        return ""
    most = found[0].gain
    described = list(dict.fromkeys(str(x) for x in found if x.gain >= NEAR * most))[:2]
    stated = f"{'; '.join(described)} limit{'s' if len(described) == 1 else ''} gamma"
    return stated if not level else f"{stated}: {most:.4g} of the verified {level:.4g} with the scheduling held"


def _at(loop: LPVStateSpace, point: np.ndarray) -> Limit:
    system = loop.frozen(point)
    _, omega = h_infinity_norm(system, loop.is_discrete)
    if math.isinf(omega):
        response = system[3].astype(complex)
    else:
        response = response_at(system, np.exp(1j * omega) if loop.is_discrete else 1j * omega)
    u, s, vt = np.linalg.svd(response)
    hertz = omega / (2 * math.pi) / (loop.sample_time or 1.0)
    box = loop.box
    at = tuple((n, float(v), unit) for n, v, unit in zip(box.names, point, box.units, strict=True))
    return Limit(at, float(s[0]), float(hertz), _shared(loop.outputs, u[:, 0]), _shared(loop.inputs, vt[0]))


def _shared(signals: tuple, vector: np.ndarray) -> tuple[tuple[str, float], ...]:
    shares = np.abs(vector) ** 2
    return tuple((signals[i].name, float(shares[i])) for i in np.argsort(-shares, kind="stable"))
