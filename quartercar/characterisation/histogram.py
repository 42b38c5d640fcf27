"""Histogram: how long a damper moves at each speed on a car or in random motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quartercar.characterisation.runs import RecordPiece
from quartercar.characterisation.settings import HISTOGRAM

WIDTH = 0.01
"""Width of a class [m/s]: 50 over ±250 mm/s."""
LOW = 0.05
"""Speed below which handling damping acts, by the usual division [m/s]."""


@dataclass(frozen=True, eq=False)
class VelocityHistogram:
    """Time at each velocity, of one record without periodic motion.

    Attributes
    ----------
    record, specimen : str
    edges : (51,) array
        −250 … 250 mm/s [m/s].
    share : (50,) array
        Of the time.
    below, above : float
        Shares of the time outside.
    slow : float
        Share with |v| < 50 mm/s.
    rms, largest : float
        [m/s].
    quantiles : tuple of float
        1, 5, 50, 95, 99 % of v [m/s].
    power : float or None
        Mean dissipated power [W]; None without force.
    duration : float
        [s].
    """

    record: str
    specimen: str
    edges: np.ndarray
    share: np.ndarray
    below: float
    above: float
    slow: float
    rms: float
    largest: float
    quantiles: tuple[float, ...]
    power: float | None
    duration: float


def _histogram_of(run: RecordPiece) -> VelocityHistogram:
    """Count the velocity of a run in classes of 10 mm/s."""
    v = run.velocity
    edges = np.linspace(-HISTOGRAM, HISTOGRAM, round(2 * HISTOGRAM / WIDTH) + 1)
    count = np.histogram(v, edges)[0]
    above, below = float(np.mean(v > HISTOGRAM)), float(np.mean(v < -HISTOGRAM))
    power = float(np.mean(run.force * v)) if run.has_force else None
    return VelocityHistogram(run.name, run.specimen, edges, count / v.size, below, above,
                             float(np.mean(np.abs(v) < LOW)), float(np.sqrt(np.mean(v**2))), float(np.abs(v).max()),
                             tuple(float(q) for q in np.quantile(v, (0.01, 0.05, 0.5, 0.95, 0.99))), power,
                             v.size * run.period)


def histograms_of(runs: Sequence[RecordPiece], periodic: set[int]) -> tuple[VelocityHistogram, ...]:
    """One for every run, but for those (by `id`) that are periodic.

    Parameters
    ----------
    runs : sequence of RecordPiece
    periodic : set of int

    Returns
    -------
    tuple of VelocityHistogram
        In the order of the runs.
    """
    return tuple(_histogram_of(r) for r in runs if id(r) not in periodic)
