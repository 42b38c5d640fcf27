"""Compiled play operator; arrays only."""

from __future__ import annotations

import numpy as np

from lpvid.toolkit import njit


@njit()
def play(signal: np.ndarray, half_width: float, out: np.ndarray) -> None:
    """The output moves only with the signal at either end of a gap of 2·half_width, in whose middle it starts.

    Parameters
    ----------
    signal : (n,) array
    half_width : float
        Half of the gap, in the unit of the signal.
    out : (n,) array
        Filled with the output.
    """
    y = signal[0]
    for k in range(signal.size):
        y = min(max(y, signal[k] - half_width), signal[k] + half_width)
        out[k] = y
