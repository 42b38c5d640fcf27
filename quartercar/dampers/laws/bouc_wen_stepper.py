"""Steps of the modified Bouc-Wen model inside a simulation."""

from __future__ import annotations

import math

import numpy as np

from quartercar.dampers.laws._bouc_wen_kernels import advance, node_rate
from quartercar.dampers.stepper import FINE, Move


def bouc_wen_move(damper, step: float) -> Move:
    """Steps of the modified Bouc-Wen model by its own compiled integration."""
    theta, (stiffness, gas) = damper.coefficients(damper.vector)
    c0a, c0b, k0, c1a, c1b, aa, ab, beta, gamma, delta, n, eta = map(float, theta)
    h = step / FINE

    def move(state, here, there):
        y, z = float(state[0]), float(state[1])
        w = float(state[2]) if damper.scheduled else 0.0
        dx, dv = (there[0] - here[0]) / FINE, (there[1] - here[1]) / FINE
        i0, i1 = max(here[2], 0.0), max(there[2], 0.0)
        for j in range(FINE):
            old, w = w, lagged(w, i0 + (i1 - i0) * j / FINE, i0 + (i1 - i0) * (j + 1) / FINE, h, eta)
            mid = 0.5 * (old + w)
            y, z = advance(y, z, here[0] + j * dx, here[0] + (j + 1) * dx, here[1] + j * dv, here[1] + (j + 1) * dv, h,
                           c0a + c0b * mid, k0, c1a + c1b * mid, aa + ab * mid, beta, gamma, delta, n)
        c1 = c1a + c1b * w
        rate = node_rate(y, z, there[0], there[1], c0a + c0b * w, k0, c1, aa + ab * w)
        return np.array([y, z, w][: len(state)]), c1 * rate + stiffness * there[0] + gas

    return move


def lagged(w: float, u0: float, u1: float, h: float, rate: float) -> float:
    """ẇ = −η(w − u) over h, exact for a linear u; at once where η is 0."""
    if rate <= 0.0:
        return u1
    behind = (u1 - u0) / (h * rate)
    return u1 - behind + (w - u0 + behind) * math.exp(-h * rate)
