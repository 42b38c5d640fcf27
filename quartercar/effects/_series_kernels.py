"""Compiled parts of elements in series with a law; arrays only."""

from __future__ import annotations

import numpy as np

from lpvid._compiling import njit


@njit()
def newton_step(gap: np.ndarray, slope: np.ndarray, stiffness: np.ndarray, soft: np.ndarray, step: float,
                out: np.ndarray) -> None:
    """Forward substitution of dF_k (1 + c_x D'_k + 1.5 c_k D'_k/h) − c_k (2 D'_{k−1} dF_{k−1} − ½ D'_{k−2} dF_{k−2})/h = gap.

    Parameters
    ----------
    gap : (n,) array
        core − F at the present iterate.
    slope, stiffness : (n,) arrays
        ∂core/∂v and ∂core/∂x.
    soft : (n,) array
        D'(F).
    step : float
        h.
    out : (n,) array
        dF.
    """
    out[0] = gap[0] / (1.0 + stiffness[0] * soft[0])
    for k in range(1, gap.size):
        lead = 1.5 if k > 1 else 1.0
        right = gap[k]
        if k > 1:
            right += slope[k] * (2.0 * soft[k - 1] * out[k - 1] - 0.5 * soft[k - 2] * out[k - 2]) / step
        else:
            right += slope[k] * soft[0] * out[0] / step
        out[k] = right / (1.0 + stiffness[k] * soft[k] + lead * slope[k] * soft[k] / step)


@njit()
def backward_rate(deflection: np.ndarray, step: float, out: np.ndarray) -> None:
    """Second-order backward difference, first-order at the second sample, zero at the first."""
    out[0] = 0.0
    if deflection.size > 1:
        out[1] = (deflection[1] - deflection[0]) / step
    for k in range(2, deflection.size):
        out[k] = (1.5 * deflection[k] - 2.0 * deflection[k - 1] + 0.5 * deflection[k - 2]) / step
