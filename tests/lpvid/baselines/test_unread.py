"""Advice on a current that moves and that a baseline does not read."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lpvid.baselines.unread import unread_current
from lpvid.record import Channel, Record

STEPS = np.repeat([0.0, 1.0, 2.0, 0.5], 100)


@pytest.mark.parametrize(("current", "read", "stated"), [
    (STEPS, False, True),
    (STEPS, True, False),
    (np.full(400, 1.0), False, False),
    (1.0 + 0.05 * np.random.default_rng(0).standard_normal(400), False, False),  # noise about a held current
])
def test_a_moving_current_that_is_not_read_is_pointed_out(current: np.ndarray, read: bool, stated: bool) -> None:
    baseline = SimpleNamespace(channels=("velocity", "current") if read else ("velocity",), name="linear")
    record = Record({"velocity": Channel(np.zeros(400), "m/s"), "current": Channel(current, "A")}, 0.01, name="run")
    found = unread_current(baseline, [record, record])  # type: ignore[arg-type]
    assert bool(found) is stated and (not stated or "between 0 and 2 and linear does not read it" in found[0])
    bare = Record({"velocity": Channel(np.zeros(400), "m/s")}, 0.01, name="bare")
    assert not unread_current(baseline, [record, bare])  # type: ignore[arg-type]
