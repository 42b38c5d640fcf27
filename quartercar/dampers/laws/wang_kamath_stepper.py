"""Steps of the phase transition model inside a simulation."""

from __future__ import annotations

import numpy as np

from quartercar.dampers.laws._wang_kamath_kernels import wang_kamath_step
from quartercar.dampers.stepper import FINE, Move


def wang_kamath_move(damper, step: float) -> Move:
    """Steps of the phase transition model by its own compiled integration."""
    vector = damper.vector

    def move(state, here, there):
        theta = np.ascontiguousarray(damper.coefficients(np.array([here[2], there[2]]), vector))
        f, g = wang_kamath_step(float(state[0]), float(state[1]), here[1], there[1], step, FINE, theta)
        return np.array([f, g]), float(damper.scale(np.array([there[2]]), vector)[0]) * f

    return move
