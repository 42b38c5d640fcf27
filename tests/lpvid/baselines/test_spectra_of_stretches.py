"""Spectra along stretches that are cut together: they are those of the records, without the kinks between stretches."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.baselines.signals import Signals, in_turn
from lpvid.baselines.spectra import before_filter, derivative, low_passed
from lpvid.baselines.stretches import cut_together

PERIOD, SAMPLES, SIZE, TRANSITION = 1 / 512, 5120, 600, 64
LAG, DAMPING = 0.007, 0.7071
FACTORS = (2 * DAMPING * LAG, LAG**2)


def records(rng: np.random.Generator, level: float) -> tuple[list[Signals], list[np.ndarray]]:
    """Two motions of other bands behind a low-pass, with the sensor's noise; and the motions themselves."""
    time, found, moved = PERIOD * np.arange(SAMPLES), [], []
    for slow, fast in ((1.3, 4.1), (2.2, 9.3)):
        moved.append(np.sin(2 * np.pi * slow * time) + 0.5 * np.sin(2 * np.pi * fast * time + 1.0))
        read = low_passed(moved[-1], PERIOD, LAG, DAMPING) + level * rng.standard_normal(SAMPLES)
        found.append(Signals(PERIOD, {"velocity": read}, read, f"run-{slow}"))
    return list(in_turn(found)), moved


@pytest.mark.parametrize("function, of", [
    (lambda s: before_filter(s, "velocity", FACTORS), lambda x: x),
    (lambda s: derivative(s, "velocity"), lambda x: np.gradient(low_passed(x, PERIOD, LAG, DAMPING), PERIOD)),
], ids=["before its filter", "its derivative"])
def test_noise_is_not_amplified_where_the_records_do_not_move(function, of, rng: np.random.Generator) -> None:
    """Inside of four stretches of two records, the error is no more than twice that along the whole records."""
    whole, moved = records(rng, 0.002)
    places = [(0, 700), (0, 3100), (1, 300), (1, 4200)]
    together = cut_together([(whole[k], a, a + SIZE) for k, a in places], [(0.0, 0.25)] * 4, TRANSITION)
    inside = slice(2 * TRANSITION, SIZE - TRANSITION)
    found, along = function(together).reshape(4, SIZE), [function(s) for s in whole]
    wanted = [of(x) for x in moved]
    error = [np.std((found[j] - wanted[k][a: a + SIZE])[inside]) for j, (k, a) in enumerate(places)]
    least = [np.std((along[k] - wanted[k])[a: a + SIZE][inside]) for k, a in places]
    assert np.mean(error) < 2 * np.mean(least) + 1e-3
