"""Figures of diagnosis, synthesis and fleet: drawn on new axes or on the caller's, all curves within their limits."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.plot import controllers, diagnosis, fleet, synthesis

NAMES = ("error_maps", "error_shapes", "error_courses", "suspects", "loops", "close_up", "controller_gains",
         "worst_trajectory", "frozen_gains", "weighted_channels", "step_responses", "departures")


def runs(over: float = 1.4) -> list[diagnosis.BeforeAfter]:
    """A baseline whose force goes beyond the measured one by `over`."""
    t = np.arange(2000) / 500.0
    x = 0.01 * np.sin(2 * np.pi * 1.3 * t) + 0.002 * np.sin(2 * np.pi * 7.0 * t)
    v, current = np.gradient(x, t), 1.0 + np.sin(t)
    force = 900 * v * (1 + current)
    channels = {"displacement": x, "velocity": v, "current": current}
    return [diagnosis.BeforeAfter("run", "held-out", 0.002, channels, force, over * force, 0.98 * force, "force", "N")]


def over_a_box() -> lpv.LPVStateSpace:
    """Two inputs, two outputs, a pole that moves."""
    return lpv.LPVStateSpace([[[-2.0]], [[0.5]]], [[[1.0, 0.5]], [[0.0, 0.0]]], [[[1.0], [2.0]], [[0.0], [0.0]]],
                             [[[0.0, 0.0], [0.1, 0.0]], [[0.0, 0.0], [0.0, 0.0]]], lpv.Polynomial("p", degree=1), None,
                             inputs=("road", "noise"), outputs=("comfort", "effort"),
                             scheduling=lpv.Scheduling(("p",), (-1.0,), (1.0,)))


@pytest.fixture(scope="module")
def drawings() -> dict[str, Callable[[Any], Any]]:
    shown, loop = runs(), over_a_box()
    worst: Any = SimpleNamespace(points=np.array([[0.0], [1.0], [-1.0]]), period=2.0, names=("p",), units=("",))
    files = {n: {"esr": 0.01 * (k + 1)} for k, n in enumerate("abc")}
    apart: Any = SimpleNamespace(score={"a": 0.5, "b": 1.0, "c": 9.0}, named=("c",))
    return {
        "error_maps": lambda ax: diagnosis.error_maps(shown, True, ax=ax),
        "error_shapes": lambda ax: diagnosis.error_shapes(shown, True, ax=ax),
        "error_courses": lambda ax: diagnosis.error_courses(shown, 1.0, True, ax=ax),
        "suspects": lambda ax: diagnosis.suspects([("a", 20.0, "named"), ("b", 2.0, "rejected")], ax=ax),
        "loops": lambda ax: diagnosis.loops(shown, True, ax=ax),
        "close_up": lambda ax: diagnosis.close_up(shown, True, ax=ax),
        "controller_gains": lambda ax: controllers.controller_gains(loop, ax=ax),
        "worst_trajectory": lambda ax: controllers.worst_trajectory(worst, ax=ax),
        "frozen_gains": lambda ax: synthesis.frozen_gains(loop, 3.0, ax=ax),
        "weighted_channels": lambda ax: synthesis.weighted_channels(loop, {"comfort": 1.0, "effort": 0.1}, 3.0, ax=ax),
        "step_responses": lambda ax: synthesis.step_responses(loop, ax=ax),
        "departures": lambda ax: fleet.departures(files, apart, ax=ax),
    }


@pytest.mark.parametrize("name", NAMES)
def test_the_callers_axes_hold_what_new_ones_do(drawings: dict[str, Callable[[Any], Any]], name: str) -> None:
    draw = drawings[name]
    made = np.atleast_1d(np.asarray(draw(None), dtype=object)).ravel()
    assert all(isinstance(ax, Axes) for ax in made)
    given = Figure().subplots(1, made.size, squeeze=False).ravel()
    back = np.atleast_1d(np.asarray(draw(given), dtype=object)).ravel()
    assert list(back) == list(given)
    for new, old in zip(back, made, strict=True):
        assert len(new.lines) == len(old.lines) and len(new.collections) == len(old.collections)
        for a, b in zip(new.lines, old.lines, strict=True):
            np.testing.assert_array_equal(np.asarray(a.get_ydata()), np.asarray(b.get_ydata()))
    with pytest.raises(InputError, match="is drawn on"):
        draw(Figure().subplots(1, made.size + 1, squeeze=False))


@pytest.mark.parametrize("figure", ["loops", "close_up"])
def test_no_run_leaves_the_frame(drawings: dict[str, Callable[[Any], Any]], figure: str) -> None:
    """The baseline goes 1.4 times as far as the measurement."""
    ax = np.ravel(drawings[figure](None))[0]
    low, high = ax.get_ylim()
    for line in ax.lines:
        assert low <= np.min(line.get_ydata()) and np.max(line.get_ydata()) <= high
