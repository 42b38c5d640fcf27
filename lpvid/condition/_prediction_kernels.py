"""Compiled linear prediction; arrays only."""

from __future__ import annotations

import numpy as np

from lpvid._compiling import njit

EXACT = 1e-26
"""share of a signal's power below which its prediction leaves nothing but rounding"""


@njit()
def go_on(x: np.ndarray, order: int, out: np.ndarray) -> None:
    """Into out: the samples that follow x, predicted by Burg's lattice of an order, or a lower that leaves nothing.

    Stage m turns the errors f, b of the prediction from before and from behind into f + k_m b, b + k_m f of one sample
    more, k_m that which makes both least: within ±1. Run from f = 0 at its top it gives the next sample; as a lattice
    it is stable however close its poles lie.
    """
    forward, backward = x.copy(), x.copy()
    reflections, state = np.zeros(order), np.zeros(order + 1)
    floor = EXACT * np.sum(x * x)
    state[0], used = x[-1], 0
    for m in range(1, order + 1):
        product, power = 0.0, 0.0
        for i in range(m, x.size):
            product += forward[i] * backward[i - 1]
            power += forward[i] * forward[i] + backward[i - 1] * backward[i - 1]
        if power <= floor:
            break
        k = min(max(-2.0 * product / power, -1.0), 1.0)
        for i in range(x.size - 1, m - 1, -1):
            f, b = forward[i], backward[i - 1]
            forward[i] = f + k * b
            backward[i] = b + k * f
        reflections[m - 1], state[m], used = k, backward[-1], m
    for t in range(out.size):
        f = 0.0
        for m in range(used, 0, -1):
            f -= reflections[m - 1] * state[m - 1]
            state[m] = state[m - 1] + reflections[m - 1] * f
        state[0] = f
        out[t] = f
