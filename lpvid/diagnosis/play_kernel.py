"""Compiled play operator, the memory of where a signal turned; arrays only."""

from __future__ import annotations

import numpy as np

from lpvid._compiling import njit


@njit()
def play(signal: np.ndarray, half_width: float, out: np.ndarray) -> None:
    """The output moves only when the signal pushes it at either end of a gap of 2·half_width, first in its middle."""
    y = signal[0]
    for k in range(signal.size):
        y = min(max(y, signal[k] - half_width), signal[k] + half_width)
        out[k] = y
