"""Compiled features of a common error; arrays only."""

from __future__ import annotations

import numpy as np

from lpvid._compiling import njit


@njit()
def mixed(z: np.ndarray, picks: np.ndarray, gains: np.ndarray, shift: np.ndarray, factor: np.ndarray,
          decay: np.ndarray, out: np.ndarray) -> None:
    """Into out (u, n): a lag of z_factor · s(Σ gain z_pick + shift), s(x) = x/√(1 + x²).

    A factor of −1 stands for one; a decay of 0 for no lag, else y_k = decay y_(k−1) + (1 − decay) t_k from y_0 = t_0.
    """
    for u in range(out.shape[0]):
        state = 0.0
        for k in range(out.shape[1]):
            x = shift[u]
            for j in range(picks.shape[1]):
                x += gains[u, j] * z[picks[u, j], k]
            t = x / np.sqrt(1.0 + x * x)
            if factor[u] >= 0:
                t *= z[factor[u], k]
            state = t if k == 0 else decay[u] * state + (1.0 - decay[u]) * t
            out[u, k] = state


@njit()
def lagged(x: np.ndarray, decay: float, out: np.ndarray) -> None:
    """Into out: y_k = decay y_(k−1) + (1 − decay) x_k from y_0 = x_0."""
    state = x[0]
    for k in range(x.size):
        state = decay * state + (1.0 - decay) * x[k]
        out[k] = state
