"""Compiled presliding friction; arrays only."""

from __future__ import annotations

import math

import numpy as np

from lpvid._compiling import njit


@njit()
def bristles(velocity: np.ndarray, step: float, deflection: float, reversal: float, out: np.ndarray) -> None:
    """d dz/d|x| = tanh(v/ε) − z along a velocity that is linear between samples; a step is cut where it reverses.

    Over each piece the direction is that of its end that is not the reversal, so that z relaxes exactly.
    """
    z = math.tanh(velocity[0] / reversal)
    out[0] = z
    for k in range(1, velocity.size):
        before, after = velocity[k - 1], velocity[k]
        if before * after < 0.0:
            turn = step * before / (before - after)
            goal = math.tanh(before / reversal)
            z = goal + (z - goal) * math.exp(-0.5 * abs(before) * turn / deflection)
            goal = math.tanh(after / reversal)
            z = goal + (z - goal) * math.exp(-0.5 * abs(after) * (step - turn) / deflection)
        else:
            goal = math.tanh(0.5 * (before + after) / reversal)
            z = goal + (z - goal) * math.exp(-0.5 * abs(before + after) * step / deflection)
        out[k] = z
