"""What `quartercar` draws on new axes it draws on the caller's too, and returns them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.drawings import check_on_given_axes
from matplotlib.axes import Axes

from lpvid import plot as lpv_plot
from quartercar import plot
from quartercar.controllers import Passive, Skyhook
from quartercar.dampers import compare
from quartercar.design import plot as design_plot
from quartercar.design.figures import FREQUENCIES, SHOWN
from quartercar.parameters import MEGANE
from quartercar.plot.ride_spectra import spectra
from quartercar.plot.rides import over_time, trade_offs
from quartercar.rides.comparison import compare_rides
from quartercar.rides.default_damper import identified_damper
from quartercar.roads.ride_roads import Bump
from quartercar.vehicle.nonlinear import Coil, QuarterCar

RATE = 500.0


def record(level: float, seed: int) -> Any:
    """A damper at one current, of tanh form."""
    import lpvid as lpv

    t = np.arange(1500) / RATE
    x = 0.008 * np.sin(2 * np.pi * 1.3 * t) + 0.003 * np.sin(2 * np.pi * 4.1 * t + seed)
    v = np.gradient(x, t)
    force = (300 + 500 * level) * np.tanh(18 * v) + 800 * v + np.random.default_rng(seed).standard_normal(t.size)
    channels: Any = {"displacement": x, "velocity": v, "current": np.full(t.size, level), "force": force}
    return lpv.Record(channels, sample_time=1 / RATE, name=f"test-{seed}",
                      units={"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"})


@pytest.fixture(scope="module")
def drawings() -> dict[str, Callable[[Any], Any]]:
    """Every drawing function of `quartercar`, of a caller's axes."""
    records = [record(level, seed) for seed, level in enumerate((0.0, 0.7, 1.4))]
    fitted = compare(records, ["linear", "guo"], records)
    runs: list[Any] = [SimpleNamespace(output=0.9 * r["force"][:, None], start=4) for r in records]
    shown = [lpv_plot.Comparison(r, "held-out", run, run, "force", "N") for r, run in zip(records, runs, strict=True)]
    car = QuarterCar(parameters=MEGANE, damper=identified_damper(), coil=Coil(highest=2.5))
    bump = Bump(duration=1.0)
    rides = compare_rides(car, (bump,), {"passive": Passive(), "skyhook": Skyhook()}, (0,))
    road = rides.roads[0]
    rode = [row.rides[0] for row in rides.on(road)]
    curves = dict.fromkeys(SHOWN, 1.0 / (1.0 + FREQUENCIES))
    flat = SimpleNamespace(comfort_gain=np.sqrt, wheel_gain=np.sqrt)
    design: Any = SimpleNamespace(task=SimpleNamespace(weights=flat), passive_gains=curves, baseline="passive", car=car,
                                  gains=((0.0, curves), (1.0, curves)))
    rough = np.cumsum(np.random.default_rng(0).standard_normal(8000)) * 3e-4
    long = QuarterCar(MEGANE).run(rough, 1 / RATE)
    return {
        "experiments": lambda ax: plot.experiments([("1", 0.01, 0.1), ("2", None, 0.3)], 0.02, ax=ax),
        "loops_by_current": lambda ax: plot.loops_by_current(shown, ax=ax),
        "overview": lambda ax: plot.overview(shown[0], shown, ax=ax),
        "ranking": lambda ax: plot.ranking(fitted, ax=ax),
        "experiments_by_model": lambda ax: plot.experiments_by_model(fitted, ax=ax),
        "force_over_time": lambda ax: plot.force_over_time(fitted, ax=ax),
        "force_over_velocity": lambda ax: plot.force_over_velocity(fitted, ax=ax),
        "force_velocity_fan": lambda ax: plot.force_velocity_fan(fitted.rows, records, ax=ax),
        "trade_offs": lambda ax: trade_offs(rides, ax=ax),
        "over_time": lambda ax: over_time(rides, road, ax=ax),
        "spectra": lambda ax: spectra([("a", long)], ax=ax),
        "weights": lambda ax: design_plot.weights(design, ax=ax),
        "gains": lambda ax: design_plot.gains(design, ax=ax),
        "sensitivity": lambda ax: design_plot.sensitivity(design, ax=ax),
        "actuator_use": lambda ax: design_plot.actuator_use(design, rode[0], ax=ax),
        "bump": lambda ax: design_plot.bump((rode[0], rode[1]), ax=ax),
    }


@pytest.mark.seconds
def test_every_function_is_among_them(drawings):
    assert set(plot.__all__) - {"livelier"} <= set(drawings)


@pytest.mark.thinned(16, "seconds")
@pytest.mark.parametrize("name", [
    "experiments", "loops_by_current", "overview", "ranking", "experiments_by_model", "force_over_time",
    "force_over_velocity", "force_velocity_fan", "trade_offs", "over_time", "spectra", "weights", "gains",
    "sensitivity", "actuator_use", "bump"])
def test_the_callers_axes_hold_what_new_ones_do(drawings, name):
    check_on_given_axes(drawings[name])


@pytest.mark.parametrize("share", [0.8, 1.5])
def test_loops_show_the_measured_and_the_simulated_force_whole(share):
    """Limits come from both signals: a model that goes half as far again is not cut off."""
    records = [record(level, seed) for seed, level in enumerate((0.0, 1.4))]
    runs: list[Any] = [SimpleNamespace(output=share * r["force"][:, None], start=4) for r in records]
    shown = [lpv_plot.Comparison(r, "held-out", run, run, "force", "N") for r, run in zip(records, runs, strict=True)]
    for ax in np.ravel(plot.loops_by_current(shown)):
        low, high = ax.get_ylim()
        assert all(low <= np.min(y.get_ydata()) and np.max(y.get_ydata()) <= high for y in ax.lines)


@pytest.mark.seconds
def test_labels_of_the_fan_do_not_overlap():
    """Three panels side by side, at the width of a page."""
    records = [record(level, seed) for seed, level in enumerate((0.0, 0.7, 1.4))]
    fitted = compare(records, ["linear", "guo", "power-law"], records)
    axes = np.ravel(plot.force_velocity_fan(fitted.rows, records))
    canvas = axes[0].figure.canvas
    canvas.draw()
    for ax in axes:
        boxes = [t.get_window_extent(canvas.get_renderer()) for t in ax.get_xticklabels() if t.get_text()]
        assert all(a.x1 < b.x0 for a, b in pairwise(boxes))


@pytest.mark.seconds
def test_fits_and_comparisons_have_cards():
    records = [record(level, seed) for seed, level in enumerate((0.0, 1.4))]
    found = compare(records, ["linear", "guo"], records)
    for noun in (found, found.best.fit):
        card = noun._repr_html_()
        assert "base64" in card and "prefers-color-scheme:dark" in card and len(card) < 150_000
        assert isinstance(noun.plot(), Axes)
