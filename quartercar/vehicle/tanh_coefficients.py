"""Dampers that a compiled car can step: laws of one form, with coefficients by the current."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from quartercar.dampers.contract import Damper
from quartercar.dampers.laws.kwok import Kwok
from quartercar.dampers.laws.tanh_law import TanhLaw

Form = Callable[[np.ndarray], np.ndarray]
"""(n,) currents -> (n, 8) of F = a_0 + a_1 v + a_2 x + a_3 tanh(a_4 v + a_5 x + a_6 tanh(x/a_7))."""


def law_form(damper: Damper) -> Form | None:
    """The coefficients of a law by the current; None for a damper that is not of this form."""
    if isinstance(damper, TanhLaw):
        return lambda current: _tanh(damper, current)
    if isinstance(damper, Kwok):
        return lambda current: _kwok(damper, current)
    return None


def _tanh(damper: TanhLaw, current: np.ndarray) -> np.ndarray:
    vector, zero, one = damper.vector, np.zeros(current.size), np.ones(current.size)
    still = damper.factors(zero, one, current, vector)  # x = 0, v = 1: the coefficients of v
    moved = damper.factors(one, zero, current, vector)  # x = 1, v = 0: κ and κ'
    out = np.zeros((current.size, 8))
    out[:, 0] = vector[-1] if damper.offset else 0.0
    out[:, 1], out[:, 2] = still.post_yield, still.post_yield * moved.post_lagged
    out[:, 3] = still.yield_force
    out[:, 4], out[:, 5], out[:, 7] = still.sharpness, still.sharpness * moved.lagged, 1.0
    return out


def _kwok(damper: Kwok, current: np.ndarray) -> np.ndarray:
    vector = damper.vector
    c, k, alpha, delta, offset = damper.coefficients(current, vector)
    out = np.zeros((current.size, 8))
    for column, values in enumerate((offset, c, k, alpha, np.full(current.size, vector[-1]))):
        out[:, column] = values
    out[:, 6], out[:, 7] = delta, damper.turning_stroke
    return out
