"""Figures of a controller and of what its loop meets: gains over the scheduling, the worst trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lpvid.model.state_space import LPVStateSpace
from lpvid.plot.colours import CYCLE
from lpvid.plot.style import Ax, Drawn, drawn, label, legend_outside, look, panels, shades
from lpvid.plot.synthesis import frequencies_of, line_of, responses
from lpvid.units import quotient

if TYPE_CHECKING:

    from lpvid.analysis.worst_case import WorstCase

LEVELS = 33
"""Values of the scheduling at which gains are drawn."""
ENTRIES = 6
"""Pairs of measurement and control that are drawn."""


def controller_gains(controller: LPVStateSpace, ax: Ax = None) -> Drawn:
    """Gains from measurements to controls: over frequency, and at three frequencies over the scheduling.

    Left |K_ij(jω)| at frozen values from corner to corner of the box, or across the hull of the design; right |K_ij| at
    the lowest, the middle and the highest frequency shown, over the first scheduling variable (the others move with
    it). Without scheduling the left alone.

    Parameters
    ----------
    controller : LPVStateSpace
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes, or array of them
    """
    omega = frequencies_of(controller)
    points, pairs = line_of(controller), _pairs(controller)
    box = controller.box
    with look():
        foreign = ax is not None
        figure, axes = panels(len(pairs), 2 if box.names else 1, height=2.4, ax=ax)
        for p, shade in zip(points, shades(len(points)), strict=True):
            gains = np.abs(responses(controller, p, omega))
            name = f"{box.names[0]} = {p[0]:.4g}" if box.names else None
            for row, (i, j) in zip(axes, pairs, strict=True):
                row[0].loglog(omega / (2 * np.pi), np.maximum(gains[:, i, j], 1e-300), color=shade, linewidth=1.3,
                              label=name)
        for row, (i, j) in zip(axes, pairs, strict=True):
            stated = f"{controller.inputs[j].name} to {controller.outputs[i].name}"
            row[0].set_title(stated)
            row[0].set_ylabel(label("gain", _unit(controller, i, j)))
            if box.names:
                _over_scheduling(row[1], controller, omega[[0, len(omega) // 2, -1]], i, j)
                row[1].set_ylabel(label("gain", _unit(controller, i, j)))
        axes[-1, 0].set_xlabel(label("frequency", "Hz"))
        if box.names:
            axes[-1, 1].set_xlabel(label(box.names[0], box.units[0] or "1"))
            legend_outside(figure, axes[0, 0], foreign, min(len(points), 4), "upper")
    return drawn(axes)


def worst_trajectory(worst: WorstCase, ax: Ax = None) -> Drawn:
    """The scheduling with which the loop reaches the largest gain that was found, over one period.

    Parameters
    ----------
    worst : WorstCase
        Periodic.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes, or array of them
    """
    rows = np.vstack([worst.points, worst.points[:1]])
    time = np.linspace(0.0, worst.period, len(rows))
    with look():
        axes = panels(len(worst.names), 1, height=1.7, sharex=True, ax=ax)[1]
        for k, (name, unit) in enumerate(zip(worst.names, worst.units, strict=True)):
            axes[k, 0].plot(time, rows[:, k], color=CYCLE[k % len(CYCLE)])
            axes[k, 0].set_ylabel(label(name, unit or "1"))
        axes[-1, 0].set_xlabel(label("time within the period", "s"))
    return drawn(axes)


def _over_scheduling(ax, controller: LPVStateSpace, omega: np.ndarray, i: int, j: int) -> None:
    points = line_of(controller, LEVELS)
    gains = np.array([np.abs(responses(controller, p, omega))[:, i, j] for p in points])
    for k, hertz in enumerate(omega / (2 * np.pi)):
        ax.semilogy(points[:, 0], np.maximum(gains[:, k], 1e-300), color=CYCLE[k],
                    label=f"{hertz:.0f} Hz" if hertz >= 100 else f"{hertz:.3g} Hz")
    ax.set_title("over the scheduling")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _pairs(controller: LPVStateSpace) -> list[tuple[int, int]]:
    """Controls and measurements, at most `ENTRIES` pairs."""
    return [(i, j) for i in range(len(controller.outputs)) for j in range(len(controller.inputs))][:ENTRIES]


def _unit(controller: LPVStateSpace, i: int, j: int) -> str:
    return quotient(controller.outputs[i].unit, controller.inputs[j].unit)
