"""Signals: what is kept along signals that were made of others, and how long."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from lpvid.baselines.budgets import LONG, REPLACED
from lpvid.baselines.signals import Remembered, Signals

SHORT = LONG // REPLACED**2


def of_length(n: int) -> Signals:
    return Signals(0.01, {"current": np.linspace(0.0, 1.0, n)}, np.zeros(n))


@pytest.mark.parametrize(("n", "runs"), [(SHORT, 1), (SHORT + 1, 3)], ids=["short", "long"])
def test_a_simulation_along_the_same_other_signals_runs_once_where_they_are_short(n: int, runs: int) -> None:
    counted: list[str] = []

    def simulate(s: Signals) -> np.ndarray:
        counted.append(s.name)
        return 2 * s["current"]

    s, core = of_length(n), Remembered(simulate, "twice")
    for _ in range(3):
        np.testing.assert_array_equal(s.along_others("half", 0.5, lambda: s.replace(current=0.5 * s["current"]), core),
                                      s["current"])
    assert len(counted) == runs


def test_of_other_signals_the_last_ones_are_kept_and_what_refers_to_the_rest_is_cleared() -> None:
    s = of_length(SHORT)
    made = [s.remembered("scaled", k, lambda k=k: s.replace(current=k * s["current"])) for k in range(REPLACED + 2)]
    for other in made[-REPLACED:]:
        other.cached("self", lambda o=other: o)  # a circle, as by `evaluated`
    assert [k for k in range(REPLACED + 2) if k in s.cache["scaled"]] == list(range(2, REPLACED + 2))
    gone = [weakref.ref(o) for o in made]
    gc.disable()
    try:
        del made, other
        for k in range(REPLACED):
            s.remembered("scaled", -k - 1, lambda: s.replace())
        assert not any(ref() for ref in gone)  # without the collector of circles
    finally:
        gc.enable()
