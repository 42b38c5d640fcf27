"""A free run that is wrong because of its start is told from one of a wrong model."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.report.validation import verdict
from lpvid.simulation import simulate
from lpvid.validation import validate

POLES = (0.999, 0.998)
"""the past outputs are differentiated twice: noise of a sample becomes 1/((1 − 0.999)(1 − 0.998)) times as much"""
SLOW = lpv.LPVTransferFunction.siso(np.poly(POLES)[1:, None].tolist(), [[0.0], [1e-3]], lpv.Polynomial(), 0.01,
                                    inputs=("u",), outputs=("y",))


def measured(rng: np.random.Generator, noise: float, n: int = 3000) -> lpv.Record:
    record = lpv.Record({"u": rng.normal(size=n)}, 0.01)
    y = simulate(SLOW, record, "zero").output[:, 0]
    return lpv.Record({"u": record["u"], "y": y + noise * y.std() * rng.normal(size=n)}, 0.01)


def test_the_error_of_the_start_is_named_with_both_figures(rng):
    record = measured(rng, 0.05)
    found = validate(SLOW, record)
    late = found.from_estimated_past
    assert late is not None and found.overall.free_run.esr > 1
    run, y = simulate(SLOW, record, "estimate").output[SLOW.start:, 0], record["y"][SLOW.start:]
    assert late.esr == pytest.approx(np.sum((y - run) ** 2) / np.sum((y - y.mean()) ** 2))
    note = next(n for n in found.notes if "is that of its start" in n)
    assert f"fit {found.overall.free_run.fit_percent:.1f} %" in note and f"fit {late.fit_percent:.1f} %" in note
    assert "the error is that of the start" in verdict(found) and "explains nothing" not in verdict(found)
    assert found.to_dict()["from_estimated_past"]["esr"] == late.esr
    assert found.to_dict()["overall"]["free_run"]["esr"] == found.overall.free_run.esr


def test_a_good_start_and_a_wrong_model_are_not_blamed_on_the_start(rng):
    clean = measured(rng, 0.0)
    assert validate(SLOW, clean).from_estimated_past is None
    wrong = SLOW.replace(b=-SLOW.b)
    assert validate(wrong, clean).from_estimated_past is None
    fast = lpv.LPVTransferFunction.siso([[-0.5]], [[0.0], [1.0]], lpv.Polynomial(), 0.01, inputs=("u",), outputs=("y",))
    noisy = lpv.Record({"u": clean["u"], "y": simulate(fast, clean,
                                                       "zero").output[:, 0] + 0.1 * rng.normal(size=3000)}, 0.01)
    assert validate(fast, noisy).from_estimated_past is None
