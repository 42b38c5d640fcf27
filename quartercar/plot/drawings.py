"""Drawings of dampers, runs of a car and comparisons of control laws, for `lpvid.plot.drawings`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.plot.colours import BLUE, CYCLE
from lpvid.plot.drawings import Drawing, drawing_of
from lpvid.plot.style import label, shades, thinned
from quartercar.dampers.contract import Damper
from quartercar.dampers.evaluation.compared import Comparison
from quartercar.dampers.fitting.result import DamperFit
from quartercar.rides.comparison import RideComparison
from quartercar.vehicle.result import CarRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = ("body_acceleration", "tyre_load", "suspension_deflection", "current")
"""Signals of a run of a car."""
CURRENTS = 5
"""Loops of a damper, over its range of the current."""
CYCLES, SAMPLES = 3, 400
"""Cycles of the sine that a damper is drawn with, of which the last is shown; samples of each."""
STROKE, FREQUENCY = 0.02, 1.5
"""Amplitude [m] and frequency [Hz] of that sine where the damper has no trained stroke or speed."""


@drawing_of.register
def _(drawn: Damper) -> Drawing:
    """Force over velocity along one sine, by current."""
    from lpvid.record import Channel, Record

    speed = (drawn.trained("velocity") or (0.0, 2 * np.pi * FREQUENCY * STROKE))[1]
    stroke = (drawn.trained("displacement") or (0.0, STROKE))[1] or STROKE
    frequency = speed / (2 * np.pi * stroke) or FREQUENCY
    period = drawn.clock or 1.0 / (SAMPLES * frequency)
    time = np.arange(round(CYCLES / (frequency * period))) * period
    x = stroke * np.sin(2 * np.pi * frequency * time)
    v = 2 * np.pi * frequency * stroke * np.cos(2 * np.pi * frequency * time)
    varies = "current" in drawn.reads
    low, high = drawn.current_range or (0.0, 1.0)
    levels = np.linspace(low, high, CURRENTS) if varies and high > low else [low]
    unit = "" if drawn.current_unit == "1" else drawn.current_unit

    def draw(axes: Sequence[Axes]) -> None:
        for shade, level in zip(shades(len(levels)), levels, strict=True):
            record = Record({"displacement": Channel(x, "m"), "velocity": Channel(v, "m/s"),
                             "current": Channel(np.full(v.size, float(level)), unit)}, sample_time=period)
            force = drawn.polarity * drawn.simulate(record).output[:, 0]
            last = slice(-round(1 / (frequency * period)), None)
            axes[0].plot(v[last], force[last], color=shade, label=f"{level:.3g} {unit}".strip() if varies else None)
        axes[0].set_xlabel(label("velocity", "m/s"))
        axes[0].set_ylabel(label("force", "N"))
        axes[0].set_title(f"{drawn.title}, sine of {1e3 * stroke:.3g} mm at {frequency:.3g} Hz, virtual")
        if varies:
            axes[0].legend()

    return 1, draw


@drawing_of.register
def _(drawn: DamperFit) -> Drawing | None:
    return drawing_of(drawn.damper)


@drawing_of.register
def _(drawn: Comparison) -> Drawing:
    def draw(axes: Sequence[Axes]) -> None:
        from quartercar.plot.comparing import ranking

        ranking(drawn, ax=axes[0])

    return 1, draw


@drawing_of.register
def _(drawn: CarRun) -> Drawing:
    names = [n for n in SHOWN if n in drawn.signals]

    def draw(axes: Sequence[Axes]) -> None:
        for ax, name in zip(axes, names, strict=True):
            ax.plot(*thinned(drawn.time, drawn[name]), color=BLUE, linewidth=0.8)
            ax.set_ylabel(label(name.replace("_", "\n"), drawn.units[name]))
        axes[-1].set_xlabel(label("time", "s"))

    return len(names), draw


@drawing_of.register
def _(drawn: RideComparison) -> Drawing:
    """Comfort against tyre load, each law against the reference on the first road."""
    road = drawn.roads[0]
    reference = drawn.row(drawn.reference, road)

    def draw(axes: Sequence[Axes]) -> None:
        for k, row in enumerate(drawn.on(road)):
            x, y = (100 * row.against(reference, n).mean for n in ("comfort", "tyre_load"))
            axes[0].plot([x], [y], "o", color=CYCLE[k % len(CYCLE)])
            axes[0].annotate(row.name, (x, y), xytext=(4, 4), textcoords="offset points", fontsize=8)
        axes[0].set_xlabel(label(f"comfort against {drawn.reference}", "%"))
        axes[0].set_ylabel(label("tyre load", "%"))
        axes[0].set_title(road)

    return 1, draw
