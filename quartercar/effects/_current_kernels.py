"""Compiled filters of a current: first-order lag with unequal edges; arrays only."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit


@njit()
def lag_held(current: np.ndarray, rise: float, fall: float, step: float, after: float, out: np.ndarray) -> None:
    """Lag of a current that is held between samples, seen `after` of a step behind each change."""
    y = current[0]
    for k in range(current.size):
        gap = y - current[k]
        tau = rise if gap < 0.0 else fall
        if tau > 0.0:
            out[k] = current[k] + gap * math.exp(-after * step / tau)
            y = current[k] + gap * math.exp(-step / tau)
        else:
            out[k] = current[k]
            y = current[k]


@njit()
def lag_linear(current: np.ndarray, rise: float, fall: float, step: float, out: np.ndarray) -> None:
    """Lag of a current that runs linearly between samples: exact for either time constant."""
    y = current[0]
    out[0] = y
    for k in range(1, current.size):
        slope = (current[k] - current[k - 1]) / step
        tau = rise if current[k] > y else fall
        if tau > 1e-9 * step:
            decay = math.exp(-step / tau)
            y = current[k] - slope * tau + (y - current[k - 1] + slope * tau) * decay
        else:
            y = current[k]
        out[k] = y
