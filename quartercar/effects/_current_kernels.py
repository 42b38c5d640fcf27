"""Compiled filters of a current: first-order lag with unequal edges; arrays only.

The field builds up while its magnitude grows and decays while it shrinks, whatever its sign: where the current changes
sign, the field decays to zero first and builds up from there.
"""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit


@njit()
def lag_held(current: np.ndarray, rise: float, fall: float, step: float, after: float, out: np.ndarray) -> None:
    """Lag of a current that is held between samples, taken a share `after` of a step after each sample."""
    y = current[0]
    for k in range(current.size):
        out[k] = _settled(y, current[k], rise, fall, after * step)
        y = _settled(y, current[k], rise, fall, step)


@njit()
def _grows(y: float, current: float) -> bool:
    """Whether |y| grows on the way to a current."""
    return current > y if y > 0.0 or (y == 0.0 and current > 0.0) else current < y


@njit()
def _settled(y: float, current: float, rise: float, fall: float, time: float) -> float:
    """A lagged current `y` after a time in which the current is held."""
    tau = rise if _grows(y, current) else fall
    if y * current < 0.0:
        passed = tau * math.log1p(-y / current) if tau > 0.0 else 0.0
        if passed < time:
            y, time, tau = 0.0, time - passed, rise
    return current + (y - current) * math.exp(-time / tau) if tau > 0.0 else current


@njit()
def lag_linear(current: np.ndarray, rise: float, fall: float, step: float, out: np.ndarray) -> None:
    """Lag of a current that runs linearly between samples: exact for either time constant."""
    y = current[0]
    out[0] = y
    for k in range(1, current.size):
        before, slope = current[k - 1], (current[k] - current[k - 1]) / step
        tau = rise if _grows(y, current[k]) else fall
        end = _followed(y, before, current[k], slope, tau, step, step)
        if y * end < 0.0:
            low, high, middle = 0.0, step, 0.5 * step
            while low < middle < high:  # to the last digit
                if y * _followed(y, before, before + slope * middle, slope, tau, middle, step) > 0.0:
                    low = middle
                else:
                    high = middle
                middle = 0.5 * (low + high)
            end = _followed(0.0, before + slope * high, current[k], slope, rise, step - high, step)
        y = end
        out[k] = y


@njit()
def _followed(y: float, first: float, last: float, slope: float, tau: float, time: float, step: float) -> float:
    """A lagged current `y` after a time in which the current runs from `first` to `last`."""
    if tau > 0.0:
        return last - slope * tau + (y - first + slope * tau) * math.exp(-time / tau)
    return last
