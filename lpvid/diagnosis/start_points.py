"""Start points: parameters of an effect from which it is refitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.budgets import MOST_STARTS
from lpvid.diagnosis.screening import Direction
from lpvid.effects.effect import Effect

LEAST_GAIN_SHARE = 0.6
"""least gain of a start point as a share of the largest"""


def start_points(effect: Effect, found: Sequence[Direction]) -> list[np.ndarray]:
    """Start points of an effect, at least one: the grid points that fit the residual best.

    First the point of the largest reduction of the error without scaling, for a large effect. Then the points of the
    largest reduction when scaled; the strength of a smooth effect is scaled down accordingly.

    Parameters
    ----------
    effect : Effect
    found : sequence of Direction
        Of any effects; those of this one that are visible count.

    Returns
    -------
    list of (k,) arrays
        At most `MOST_STARTS`; the first grid point where nothing is visible.
    """
    own = sorted((d for d in found if d.effect.name == effect.name and d.visible),
                  key=lambda d: d.gain, reverse=True)
    chosen: list[np.ndarray] = []
    unscaled = max(own, key=lambda d: d.unscaled_gain, default=None)
    if unscaled is not None and unscaled.unscaled_gain > 0:
        chosen.append(unscaled.values)
    for d in own:
        values = scaled(d)
        if len(chosen) < MOST_STARTS and d.gain > LEAST_GAIN_SHARE * own[0].gain and \
                all(not np.allclose(values, c) for c in chosen):
            chosen.append(values)
    start = np.array([effect.parameters[0].grid[0], *effect.neutral[1:]])
    return chosen or [d.values for d in found if d.effect.name == effect.name][:1] or [start]


def scaled(d: Direction) -> np.ndarray:
    """Parameters of a direction with its strengths scaled to the error that is left, but never scaled up.

    Parameters
    ----------
    d : Direction

    Returns
    -------
    (k,) array
        In the units of the effect's parameters.
    """
    if not d.effect.smooth or not 0 < d.share < 1:
        return d.values
    values, neutral, k = d.values.copy(), d.effect.neutral, d.effect.strengths
    values[:k] = neutral[:k] + d.share * (values[:k] - neutral[:k])
    return values
