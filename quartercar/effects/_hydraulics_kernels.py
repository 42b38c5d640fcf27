"""Compiled second-order element; arrays only."""

from __future__ import annotations

import cmath

import numpy as np

from lpvid.toolkit import njit


@njit()
def second_order(signal: np.ndarray, turn: float, damping: float, out: np.ndarray) -> None:
    """q'' + 2ζω q' + ω² q = ω² f, exact for f linear between samples, at rest at the first one; turn = ωh.

    With poles p (in units of 1/h), f = f_0 + s t: q = f_0 − 2ζs/turn + s t + Re-part of Σ A e^{pt}.
    """
    root = cmath.sqrt(complex(damping * damping - 1.0, 0.0))
    if abs(root) < 1e-6:
        root = complex(1e-6, 0.0)
    first, second = turn * (-damping + root), turn * (-damping - root)
    decay1, decay2 = cmath.exp(first), cmath.exp(second)
    q, rate = signal[0], 0.0
    out[0] = q
    for k in range(1, signal.size):
        slope = signal[k] - signal[k - 1]
        offset = signal[k - 1] - 2.0 * damping * slope / turn
        gap, gap_rate = q - offset, rate - slope
        b = (gap_rate - first * gap) / (second - first)
        a = gap - b
        q = offset + slope + (a * decay1 + b * decay2).real
        rate = slope + (a * first * decay1 + b * second * decay2).real
        out[k] = q
