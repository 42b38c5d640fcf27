"""Drift: how the force at mid stroke changes with temperature, or with time where that was not measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quartercar.characterisation.cycles import Block
from quartercar.characterisation.points import peak_point

ENOUGH = 5
"""cycles from which a trend is fitted: three for a line with an error, and the first may hold the start"""
WARMING = 2.0
"""standard deviations of the temperature's cycle means about their smooth course by which it must have changed"""


@dataclass(frozen=True)
class Drift:
    """One block and direction.

    Attributes
    ----------
    specimen : str
    current : float or None
    record, test : str
    direction : {1, −1}
    speed, force : float
        At mid stroke, means [m/s], [N].
    change, change_std : float
        Change of |F| from the first settled cycle to the last along the fitted line, as a share of it.
    cycles : int
    duration : float
        Of the settled cycles [s].
    coolest, warmest : float or None
        Cycle means of the temperature [K].
    per_kelvin, per_kelvin_std : float or None
        Slope of |F| over the temperature, as a share of |F| [1/K]; None without a temperature that rose.
    """

    specimen: str
    current: float | None
    record: str
    test: str
    direction: int
    speed: float
    force: float
    change: float
    change_std: float
    cycles: int
    duration: float
    coolest: float | None
    warmest: float | None
    per_kelvin: float | None
    per_kelvin_std: float | None


def drift_of(block: Block, direction: int) -> Drift | None:
    """Trend of the peak-velocity force over the settled cycles; None with fewer than five.

    Parameters
    ----------
    block : Block
        With a force.
    direction : {1, −1}
        1 in rebound.

    Returns
    -------
    Drift or None
        None also where a cycle has no point in this direction, or the mean force is zero.
    """
    point = peak_point(block, direction)
    if point is None or len(block.settled) < ENOUGH or len(point.by_cycle) != len(block.cycles):
        return None
    force = direction * point.by_cycle[block.is_settled]
    n, mean = force.size, float(force.mean())
    if mean == 0:
        return None
    slope, error = _line(np.arange(n, dtype=float), force)
    run, first = block.run, block.settled[0]
    temperature = _temperatures(block)
    per = per_std = coolest = warmest = None
    if temperature is not None:
        coolest, warmest = float(temperature.min()), float(temperature.max())
        rough = float(np.std(np.diff(temperature))) / np.sqrt(2)
        if warmest - coolest > WARMING * 2 * rough and warmest > coolest:
            k, k_std = _line(temperature, force)
            per, per_std = k / mean, k_std / abs(mean)
    return Drift(run.specimen, run.level, run.name, block.label, direction, point.speed, direction * mean,
                 slope * (n - 1) / mean, error * (n - 1) / abs(mean), n,
                 (block.last.stop - first.start) * run.period, coolest, warmest, per, per_std)


def _temperatures(block: Block) -> np.ndarray | None:
    values = block.run.temperature
    if values is None:
        return None
    means = np.array([np.nanmean(values[c.span]) if np.isfinite(values[c.span]).any() else np.nan
                      for c in block.settled])
    return means if np.isfinite(means).all() else None


def _line(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope and its standard error."""
    off = x - x.mean()
    power = float(off @ off)
    if power == 0:
        return 0.0, 0.0
    slope = float(off @ y) / power
    rest = y - y.mean() - slope * off
    return slope, float(np.sqrt(rest @ rest / max(x.size - 2, 1) / power))
