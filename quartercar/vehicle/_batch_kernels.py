"""Compiled step of many quarter cars; arrays only."""

from __future__ import annotations

import numpy as np

from lpvid.toolkit import njit
from quartercar.vehicle._nonlinear_kernels import advance


@njit()
def advance_all(ends, state, road_in, force_in, here, there, step, coefficients, stop, tyre, x, held):
    """Every car to its next sample, in place: x (cars, 4), held (cars, 3); roads (cars,) at both ends of the sample.

    coefficients: (cars, steps per sample, S, 8); the rest as in `_nonlinear_car_kernels.advance`.
    """
    profile, out = np.empty(2), np.empty((1, 6))
    for car in range(x.shape[0]):
        profile[0], profile[1] = here[car], there[car]
        advance(ends, state, road_in, force_in, profile, step, coefficients[car:car + 1], stop, tyre, x[car],
                held[car], out)
