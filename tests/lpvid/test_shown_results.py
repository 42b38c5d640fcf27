"""What a notebook's cell shows of a result: its text in few lines, not the arrays inside."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv

MODEL = lpv.LPVTransferFunction.siso([[-0.5, 0.1]], [[0, 0], [1, 0]], lpv.Polynomial("p", 1), 0.1)
SYSTEM = lpv.realize(MODEL, "augmented").model
CONTINUOUS = lpv.LPVStateSpace([[[0.0, 1], [-4, -1]], [[0, 0], [-1, 0]]], [[[0.0], [1]], [[0], [0]]],
                               [[[1.0, 0]], [[0, 0]]], np.zeros((2, 1, 1)), lpv.Polynomial("p", 1), None,
                               lpv.Scheduling("p", -1.0, 1.0))
DRAWN = [MODEL.replace(a=MODEL.a * share) for share in (0.9, 1.0, 1.1)]
RESULTS = {
    "pole_locus": lambda: lpv.pole_locus(MODEL), "critical_scheduling": lambda: lpv.critical_scheduling(MODEL),
    "frozen_stability": lambda: lpv.frozen_stability(MODEL), "h2_norm": lambda: lpv.h2_norm(CONTINUOUS, rate=0.0),
    "decay_rate": lambda: lpv.decay_rate(CONTINUOUS, rate=0.0),
    "bound certificate": lambda: lpv.h2_norm(CONTINUOUS, rate=0.0).certificate,
    "gain certificate": lambda: lpv.l2_gain(CONTINUOUS, rate=0.0, trajectories=False).certificate,
    "frequency_band": lambda: lpv.frequency_band(DRAWN, [0.5], np.linspace(0.1, 4.0, 30)),
    "pole_band": lambda: lpv.pole_band(DRAWN), "stability_probability": lambda: lpv.stability_probability(DRAWN),
    "reduce_order": lambda: lpv.reduce_order(SYSTEM, 1), "to_gridded": lambda: lpv.to_gridded(SYSTEM),
    "discretise": lambda: lpv.discretise(CONTINUOUS, 0.1, lpv.Tustin()),
}


@pytest.mark.parametrize("result", RESULTS)
def test_a_result_shows_its_text(result):
    found = RESULTS[result]()
    for text in (repr(found), str(found)):
        assert "array(" not in text and "matrices=" not in text
        assert len(text) < 1200 and len(text.splitlines()) <= 12
