"""Limits of double precision: what a number derived from them must do."""

from __future__ import annotations

import numpy as np

from lpvid.rounding import EPS, EXPLODED, HALF_DIGITS, STEP, TINY, VANISHING


def test_an_exploded_simulation_has_a_finite_cost() -> None:
    assert np.isfinite(np.full(10**6, EXPLODED) ** 2).all() and np.isfinite(np.sum(np.full(10**6, EXPLODED) ** 2))


def test_below_the_vanishing_size_a_square_loses_its_digits() -> None:
    assert VANISHING**2 >= TINY * (1 - HALF_DIGITS) and (VANISHING * 1e-9) ** 2 / 1e-18 != VANISHING**2
    assert np.isfinite(1 / TINY)


def test_a_difference_of_this_step_keeps_a_third_of_the_digits() -> None:
    x = np.linspace(-3.0, 3.0, 101)
    assert np.abs((np.sin(x + STEP) - np.sin(x)) / STEP - np.cos(x)).max() < STEP
    assert np.abs((np.sin(x + STEP) - np.sin(x - STEP)) / (2 * STEP) - np.cos(x)).max() < 10 * STEP**2
    assert EPS < STEP**2 < HALF_DIGITS < STEP
