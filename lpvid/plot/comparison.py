"""A model beside the measurement: free run over time, loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.plot.colours import BLUE, CYCLE, MEASURED, MODEL, MUTED
from lpvid.plot.style import (
    WIDTH,
    Ax,
    Drawn,
    drawn,
    finish_cloud,
    label,
    largest_window,
    legend_above,
    limits_of,
    look,
    panels,
    robust_limits,
    thinned,
)
from lpvid.record import Record
from lpvid.simulation import Model, Simulation, predict, simulate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WINDOW = 400
"""Samples in the close-up."""
CLOUD = 6000
"""Points of a loop drawn at most."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A record with the model's free run and one-step prediction along it.

    Attributes
    ----------
    record : Record
    label : str
        "training" or "held-out".
    free_run, one_step : Simulation
    output, unit : str
        First output.
    """

    record: Record
    label: str
    free_run: Simulation
    one_step: Simulation
    output: str
    unit: str

    @property
    def origin(self) -> str:
        """What a legend calls the data: measured, or virtual where the record states that it was simulated."""
        return "virtual" if any(n.startswith("synthetic") for n in self.record.notes) else "measured"

    @property
    def start(self) -> int:
        """First predicted sample."""
        return max(self.free_run.start, self.one_step.start)

    @property
    def measured(self) -> np.ndarray:
        """(n,) measured output."""
        return self.record[self.output]

    @property
    def error(self) -> np.ndarray:
        """(n,) measured minus free run; NaN before the start."""
        difference = self.measured - self.free_run.output[:, 0]
        difference[: self.free_run.start] = np.nan
        return difference

    @property
    def innovation(self) -> np.ndarray:
        """(n − start,) one-step residuals."""
        return (self.measured - self.one_step.output[:, 0])[self.one_step.start:]


def compare(model: Model, record: Record, label: str) -> Comparison:
    """Run a model along a record, freely and one step ahead.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    record : Record
        Uniform, finite, at the model's rate.
    label : str

    Returns
    -------
    Comparison
    """
    output = model.outputs[0]
    return Comparison(record, label, simulate(model, record), predict(model, record, 1), output.name, output.unit)


def free_run(shown: Comparison, scheduling: Sequence[str] = (), ax: Ax = None) -> Drawn:
    """Measured output and free run over the whole record, and over the stretch with the largest error.

    Parameters
    ----------
    shown : Comparison
    scheduling : sequence of str
        Scheduling variables drawn below the close-up (at most two).
    ax : array of Axes, optional
        Where to draw: two, and one for each scheduling variable; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    names = list(scheduling)[:2]
    t, y, run, error = shown.record.times, shown.measured, shown.free_run.output[:, 0], shown.error
    window, foreign = worst_stretch(error), ax is not None
    with look():
        figure, axes = panels(2 + len(names), heights=[1.9, 2.5, *([0.95] * len(names))], ax=ax)
        ax = axes[0, 0]
        ax.plot(*thinned(t, y), color=MEASURED, linewidth=0.7, label=shown.origin)
        ax.plot(*thinned(t, run), color=MODEL, linewidth=0.7, alpha=0.85, label="free run")
        ax.axvspan(float(t[window.start]), float(t[window.stop - 1]), color=BLUE, alpha=0.10, linewidth=0,
                   label="close-up below")
        ax.set_title(f"{shown.record.name} ({shown.label})")
        legend_above(ax)
        ax.set_ylabel(label(shown.output, shown.unit))
        ax.set_ylim(*limits_of(y, run, 0.1))
        ax.margins(x=0.005)
        _close_up(axes[1, 0], shown, window)
        for axis, name in zip(axes[2:, 0], names, strict=True):
            axis.plot(t[window], shown.record[name][window], color=BLUE, drawstyle="steps-post")
            axis.set_ylabel(label(name, shown.record.unit(name)))
            if not foreign:
                axis.sharex(axes[1, 0])
            axis.set_ylim(*robust_limits(shown.record[name]))
        axes[-1, 0].set_xlabel("time [s]")
        figure.align_ylabels()
    return drawn(axes)


def _close_up(ax: Axes, shown: Comparison, window: slice) -> None:
    t = shown.record.times[window]
    ax.plot(t, shown.measured[window], color=MEASURED, linewidth=1.4, label=shown.origin)
    ax.plot(t, shown.free_run.output[window, 0], color=MODEL, linewidth=1.2, label="free run")
    ax.fill_between(t, 0, shown.error[window], color=MUTED, alpha=0.35, linewidth=0, label="error")
    ax.set_title("The stretch with the largest error")
    legend_above(ax)
    ax.set_ylabel(label(shown.output, shown.unit))
    both = np.concatenate([shown.measured[window], shown.error[window]])
    ax.set_ylim(*limits_of(both, shown.free_run.output[window, 0], 0.12))
    ax.set_xlim(float(t[0]), float(t[-1]))


def overlay(shown: Sequence[tuple[str, Comparison]], ax: Ax = None) -> Drawn:
    """Free runs of several models over one measured record, whole and where the first of them is worst.

    Parameters
    ----------
    shown : sequence of (str, Comparison)
        Names and runs along the same record, each at its model's rate; measured as the first has it.
    ax : (2,) array of Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    (2,) array of matplotlib.axes.Axes
    """
    first = shown[0][1]
    t, window = first.record.times, worst_stretch(first.error)
    ends = float(t[window.start]), float(t[window.stop - 1])
    with look():
        axes = panels(2, heights=[1.9, 2.7], ax=ax)[1]
        for ax, close in zip(axes[:, 0], (False, True), strict=True):
            keep = window if close else slice(None)
            ax.plot(*thinned(t[keep], first.measured[keep]), color=MEASURED, linewidth=1.4 if close else 0.7,
                    label=first.origin)
            runs = []
            for k, (name, c) in enumerate(shown):
                own = c.record.times
                inside = (own >= ends[0]) & (own <= ends[1]) if close else np.ones(own.size, dtype=bool)
                run = c.free_run.output[inside, 0]
                runs.append(run)
                ax.plot(*thinned(own[inside], run), color=CYCLE[(k + 1) % len(CYCLE)], linewidth=1.1 if close else 0.6,
                        label=name)
            ax.set_ylim(*limits_of(first.measured[keep], np.concatenate(runs), 0.1))
            ax.set_ylabel(label(first.output, first.unit))
            ax.margins(x=0.005)
        axes[0, 0].axvspan(*ends, color=BLUE, alpha=0.10, linewidth=0)
        axes[0, 0].set_title(f"{first.record.name} ({first.label}), free run")
        axes[1, 0].set_title(f"The stretch with the largest error of {shown[0][0]}")
        legend_above(axes[1, 0], len(shown) + 1)
        axes[1, 0].set_xlabel("time [s]")
    return drawn(axes)


def loops(shown: Sequence[Comparison], against: Sequence[str], ax: Ax = None) -> Drawn | None:
    """Measured and free-run output against other channels (force-velocity, force-displacement).

    Parameters
    ----------
    shown : sequence of Comparison
    against : sequence of str
        Channels for the horizontal axes; those a record lacks are left out.
    ax : Axes or array of one for each channel, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or array of them, or None
        None when no such channel was recorded.
    """
    names = [n for n in against if all(c.record.has(n) and n != c.output for c in shown)]
    if not names or not shown:
        return None
    step = max(1, sum(c.record.n_samples for c in shown) // CLOUD)
    with look():
        axes = panels(1, len(names), height=3.5, width=WIDTH if len(names) > 1 else 5.6, ax=ax)[1]
        for ax, name in zip(axes[0], names, strict=True):
            for i, c in enumerate(shown):
                keep = slice(c.start, None, step)
                for values, colour, stated in ((c.measured, MEASURED, c.origin),
                                             (c.free_run.output[:, 0], MODEL, "free run")):
                    ax.plot(c.record[name][keep], values[keep], ".", color=colour, markersize=1.8, alpha=0.5,
                            rasterized=True, label=stated if i == 0 else None)
            limits = limits_of(np.concatenate([c.measured for c in shown]),
                               np.concatenate([c.free_run.output[:, 0] for c in shown]), 0.1)
            finish_cloud(ax, label(name, shown[0].record.unit(name)), label(shown[0].output, shown[0].unit), limits)
    return drawn(axes)


def worst_stretch(error: np.ndarray) -> slice:
    """The window of `WINDOW` samples with the largest mean square error; the first one when the run diverged.

    Parameters
    ----------
    error : (n,) array
        Measured less simulated; not finite from where the run diverged.

    Returns
    -------
    slice
        The whole error, where it is shorter than the window.
    """
    if not np.isfinite(error[-1]):
        size = min(WINDOW, error.size)
        diverged = int(np.flatnonzero(np.isfinite(error))[-1]) if np.isfinite(error).any() else 0
        first = max(0, min(diverged - size // 2, error.size - size))
        return slice(first, first + size)
    return largest_window(np.where(np.isfinite(error), error, 0.0) ** 2, WINDOW)
