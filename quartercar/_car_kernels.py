"""Compiled quarter car with one dissipative element beside a linear rest; arrays only."""

from __future__ import annotations

import math

import numpy as np

from lpvid._compiling import njit


@njit()
def run_with_friction(ad: np.ndarray, b0: np.ndarray, b1: np.ndarray, bf: np.ndarray, pick: np.ndarray,
                      inputs: np.ndarray, friction: float, smooth: float, x: np.ndarray, out: np.ndarray) -> None:
    """x⁺ = Ad x + B0 u_k + B1 u_{k+1} + bf f, f = F_c tanh(w/ε) with w = pickᵀx⁺ the rate across the friction.

    The friction over a step is that of its end (implicit): w = w₀ + (pickᵀbf) f(w) has one root, for pickᵀbf ≤ 0, which
    Newton's method finds inside its bracket. The linear part is exact for inputs that are linear between samples.

    Parameters
    ----------
    ad, b0, b1 : (s, s), (s, m), (s, m) arrays
    bf, pick : (s,) arrays
    inputs : (n, m) array
    friction, smooth : float
        F_c [N], ε [m/s].
    x : (s,) array
        State at the first sample; that at the last on return.
    out : (n, s) array
        States.
    """
    n, size = inputs.shape[0], x.size
    gain = 0.0
    for j in range(size):
        gain += pick[j] * bf[j]
    free = np.empty(size)
    out[0] = x
    for k in range(1, n):
        w0 = 0.0
        for i in range(size):
            total = 0.0
            for j in range(size):
                total += ad[i, j] * x[j]
            for j in range(inputs.shape[1]):
                total += b0[i, j] * inputs[k - 1, j] + b1[i, j] * inputs[k, j]
            free[i] = total
            w0 += pick[i] * total
        f = 0.0
        if friction > 0.0:
            low, high = min(w0 + gain * friction, w0 - gain * friction), max(w0 + gain * friction,
                                                                            w0 - gain * friction)
            w = min(max(0.0, low), high) if low < 0.0 < high else w0
            for _ in range(60):
                t = math.tanh(w / smooth)
                gap = w - w0 - gain * friction * t
                if gap > 0.0:
                    high = w
                else:
                    low = w
                new = w - gap / (1.0 - gain * friction * (1.0 - t * t) / smooth)
                if not low <= new <= high:
                    new = 0.5 * (low + high)
                if abs(new - w) <= 1e-14 + 1e-12 * abs(w):
                    w = new
                    break
                w = new
            f = friction * math.tanh(w / smooth)
        for i in range(size):
            x[i] = free[i] + bf[i] * f
        out[k] = x
