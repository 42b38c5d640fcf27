"""Motion so far out of step that the baseline gives up: no direction from its fit leads to the cause."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

import lpvid as lpv
from lpvid.record import Record

PERIOD, LAG = 0.002, 0.021
UNITS = {"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"}


@pytest.mark.slow
def test_a_filter_that_turns_the_motion_round_is_found_from_afar(rng: np.random.Generator) -> None:
    """Three poles of 21 ms: tones of 3 to 9 Hz come late by 60 to 150 degrees."""
    t = PERIOD * np.arange(5000)
    tones = [(a, 2 * np.pi * f, p) for p, (a, f) in enumerate(((4e-3, 3.1), (3e-3, 5.3), (2e-3, 8.7)))]
    x = sum(a * np.sin(w * t + p) for a, w, p in tones)
    v = sum(a * w * np.cos(w * t + p) for a, w, p in tones)
    current = np.repeat(rng.choice([0.0, 0.5, 1.0, 1.5, 2.0], 50), 100)
    force = (100 + 400 * current) * np.tanh(30 * v + 200 * x) + 800 * v + 2000 * x
    poles = bilinear([1], np.polymul([LAG**2, LAG, 1], [LAG, 1]), 1 / PERIOD)
    channels = {"displacement": lfilter(*poles, x), "velocity": lfilter(*poles, v), "current": current,
                "force": force + 5.0 * rng.standard_normal(t.size)}
    record = Record({c: y[1000:] for c, y in channels.items()}, PERIOD, name="run", units=UNITS)
    found = lpv.diagnose(record, "guo")
    assert [c.name for c in found.causes] == ["one-sided-filter"]
    assert found.after.esr_held_out < 0.001
