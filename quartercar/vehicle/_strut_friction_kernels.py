"""Compiled quarter car with one dissipative element beside a linear rest; arrays only."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import copy_values, njit


@njit()
def run_with_friction(ad: np.ndarray, b0: np.ndarray, b1: np.ndarray, bf: np.ndarray, pick: np.ndarray,
                      inputs: np.ndarray, parts: int, friction: float, smooth: float, x: np.ndarray,
                      out: np.ndarray) -> None:
    """x⁺ = Ad x + B0 u + B1 u⁺ + bf f, f = F_c tanh(w/ε) with w = pickᵀx⁺ the rate across the friction.

    The friction over a step is that of its end (implicit), so that a stuck strut stays put whatever the step. The
    linear part is exact for inputs that are linear between samples.

    Parameters
    ----------
    ad, b0, b1 : (s, s), (s, m), (s, m) arrays
        For a step of the sampling period over `parts`.
    bf, pick : (s,) arrays
    inputs : (n, m) array
    parts : int
        Steps within a sample.
    friction, smooth : float
        F_c [N], ε [m/s].
    x : (s,) array
        State at the first sample; that at the last on return.
    out : (n, s) array
        States.
    """
    n, size, width = inputs.shape[0], x.size, inputs.shape[1]
    gain = 0.0
    for j in range(size):
        gain += pick[j] * bf[j]
    free = np.empty(size)
    copy_values(x, out[0])
    for k in range(1, n):
        for part in range(parts):
            early, late = part / parts, (part + 1) / parts
            w0 = 0.0
            for i in range(size):
                total = 0.0
                for j in range(size):
                    total += ad[i, j] * x[j]
                for j in range(width):
                    rise = inputs[k, j] - inputs[k - 1, j]
                    total += b0[i, j] * (inputs[k - 1, j] + early * rise) + b1[i, j] * (inputs[k - 1, j] + late * rise)
                free[i] = total
                w0 += pick[i] * total
            f = 0.0
            if friction > 0.0:
                f = friction * math.tanh(_end_rate(w0, gain * friction, smooth) / smooth)
            for i in range(size):
                x[i] = free[i] + bf[i] * f
        copy_values(x, out[k])


@njit()
def _end_rate(w0: float, push: float, smooth: float) -> float:
    """The root of w = w0 + push tanh(w/ε), push ≤ 0: Newton's method inside its bracket."""
    low, high = min(w0 + push, w0 - push), max(w0 + push, w0 - push)
    w = min(max(0.0, low), high) if low < 0.0 < high else w0
    for _ in range(60):
        t = math.tanh(w / smooth)
        gap = w - w0 - push * t
        if gap > 0.0:
            high = w
        else:
            low = w
        new = w - gap / (1.0 - push * (1.0 - t * t) / smooth)
        if not low <= new <= high:
            new = 0.5 * (low + high)
        if abs(new - w) <= 1e-14 + 1e-12 * abs(w):
            return new
        w = new
    return w
