"""Figures of diagnosis, synthesis and fleet: drawn on new axes or on the caller's, all curves within their limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.drawings import check_on_given_axes

import lpvid as lpv
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


@pytest.mark.seconds
@pytest.mark.parametrize("name", NAMES)
def test_the_callers_axes_hold_what_new_ones_do(drawings: dict[str, Callable[[Any], Any]], name: str) -> None:
    check_on_given_axes(drawings[name])


@pytest.mark.parametrize("figure", ["loops", "close_up"])
def test_no_run_leaves_the_frame(drawings: dict[str, Callable[[Any], Any]], figure: str) -> None:
    """The baseline goes 1.4 times as far as the measurement."""
    ax = np.ravel(drawings[figure](None))[0]
    low, high = ax.get_ylim()
    for line in ax.lines:
        assert low <= np.min(line.get_ydata()) and np.max(line.get_ydata()) <= high


def diverging(at: int) -> diagnosis.BeforeAfter:
    """As `runs`, but that its baseline diverges at a sample and is NaN from there on."""
    (whole,) = runs()
    before = whole.before.copy()
    before[at:] = np.nan
    return replace(whole, name="diverged", before=before)


@pytest.mark.parametrize("at", [0, 1, 1000])
def test_a_baseline_that_diverges_is_the_most_wrong(at: int) -> None:
    (worse,) = runs(3.0)
    assert diagnosis.most_wrong([worse, diverging(at), *runs()]).name == "diverged"
    assert diagnosis.most_wrong([*runs(), worse]) is worse
    assert diagnosis.close_up([worse, diverging(at)], True)[0].get_title(loc="left") == "diverged (held-out)"


def test_figures_of_a_run_that_diverges_show_what_came_before() -> None:
    """Up to there they are those of the record cut short."""
    cut, (whole,) = diverging(1000), runs()
    short = replace(whole, channels={n: v[:1000] for n, v in whole.channels.items()}, measured=whole.measured[:1000],
                    before=whole.before[:1000], after=whole.after[:1000])
    time, frequency = diagnosis.error_courses([cut], None, False)
    over_time = np.asarray(time.lines[0].get_ydata())
    full = np.asarray(diagnosis.error_courses([whole], None, False)[0].lines[0].get_ydata())
    reached = np.isfinite(over_time)
    np.testing.assert_array_equal(over_time[reached], full[reached])
    assert over_time.size == full.size and reached.sum() == over_time.size * 1000 // 2000
    expected = diagnosis.error_courses([short], None, False)[1].lines[0]
    np.testing.assert_array_equal(frequency.lines[0].get_ydata(), expected.get_ydata())
    for ax in np.ravel(diagnosis.error_shapes([cut], False)):
        assert np.isfinite(ax.lines[0].get_ydata()).all() and len(ax.lines[0].get_ydata()) > diagnosis.BINS // 2
    even = replace(whole, before=np.where(np.arange(2000) < 1000, whole.measured - 10.0, np.nan))
    cells = np.ma.filled(np.ravel(diagnosis.error_maps([even], False))[0].collections[0].get_array(), np.nan)
    assert np.isfinite(cells).any()
    np.testing.assert_allclose(cells[np.isfinite(cells)], 10.0, rtol=1e-12)


@pytest.mark.seconds
def test_figures_of_a_baseline_that_diverges_at_once_are_drawn() -> None:
    shown = [diverging(0)]
    for draw in (diagnosis.error_maps, diagnosis.error_shapes, diagnosis.loops, diagnosis.close_up):
        assert draw(shown, True) is not None
    time, frequency = diagnosis.error_courses(shown, 1.0, True)
    assert not time.get_title(loc="left") and time.get_xlabel().endswith(shown[0].name)  # a title met the legend
    assert not np.isfinite(time.lines[0].get_ydata()).any() and np.isfinite(time.lines[1].get_ydata()).all()
    assert len(frequency.lines[0].get_ydata()) == 0 and len(frequency.lines[1].get_ydata()) > 0
