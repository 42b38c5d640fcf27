"""The LPV structure that a diagnosis extends."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.effects.lpv_extension import common_structure


@pytest.mark.parametrize(("low", "high", "scheduled"), [(0.0, 0.04, True), (0.0, 1.0, True), (3.0, 3.059, False),
                                                        (0.5, 0.5, False)])
def test_a_current_schedules_where_a_model_can_be_scheduled_on_it(low: float, high: float, scheduled: bool) -> None:
    """0.04 A are all of a small coil's current, and 0.059 A of 3 A are 2 %: what counts is the share, not ampere."""
    n = 400
    rng = np.random.default_rng(0)
    channels = {"velocity": (rng.standard_normal(n), "m/s"), "force": (rng.standard_normal(n), "N"),
                "current": (np.linspace(low, high, n), "A")}
    record = lpv.Record({k: lpv.Channel(*v) for k, v in channels.items()}, 0.01, name="run")
    found = common_structure([record], "force")
    assert found is not None and found.basis.names == (("current",) if scheduled else ())
