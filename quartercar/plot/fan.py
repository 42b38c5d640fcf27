"""The fitted law by current: force over constant velocity, a curve for each current, with the measured points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.plot.colours import INK, MUTED
from lpvid.plot.style import Ax, Drawn, drawn, label, limits_of, look, panels, visible_scale, zero_lines
from lpvid.units import driver
from quartercar.plot.comparing import current_levels, current_span

if TYPE_CHECKING:
    from lpvid.record import Record
    from quartercar.dampers.evaluation.compared import Compared

CURVES = 5
"""Currents with a curve, at most, where the records rest on none."""
POINTS = 4000
"""Measured points of one panel."""
GRID = 201
"""Velocities of a curve."""


def force_velocity_fan(rows: Sequence[Compared], records: Sequence[Record], polarity: int = 1,
                       ax: Ax = None) -> Drawn:
    """Static force of models over velocity, a panel for each model and a curve for each current.

    F(v, i) once everything has settled, at the displacement that the model calls zero; the points are measured, with
    the hysteresis and the gas force that the curve leaves out, and have the colour of their current.

    Parameters
    ----------
    rows : sequence of Compared
        Panels.
    records : sequence of Record
        Measured: velocity [m/s], force [N], and a current where the law has one.
    polarity : {1, -1}
        -1 where these records measure the force against the velocity: the curves are turned as the points are.
    ax : sequence of matplotlib.axes.Axes, optional
        Where to draw, one for each model; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    velocity, force, current = _measured(records)
    levels = _shown_levels(records)
    unit = records[0].unit("current") if current is not None else ""
    grid = float(np.abs(velocity).max()) * np.linspace(-1, 1, GRID)
    ends = (min(levels), max(levels)) if len(levels) > 1 else (levels[0] - 0.5, levels[0] + 0.5) if levels else (0, 1)
    scale = Normalize(*ends)
    with look():
        colours = visible_scale()
        figure, axes = panels(1, len(rows), height=3.9, width=max(6.4, min(9.9, 3.9 * len(rows))), ax=ax)
        for ax, row in zip(axes[0], rows, strict=True):
            shade = MUTED if current is None else colours(scale(current))
            ax.scatter(velocity, force, c=shade, s=2.0, alpha=0.35, linewidths=0, rasterized=True, zorder=1)
            laws = [polarity * np.asarray(row.damper.static_force(grid, level, 0.0), dtype=float)
                    for level in levels or (0.0,)]
            for level, law in zip(levels or (0.0,), laws, strict=True):
                ax.plot(grid, law, color="white", linewidth=3.2, zorder=2)
                ax.plot(grid, law, color=colours(scale(level)) if levels else INK, linewidth=1.8, zorder=3)
            zero_lines(ax)
            ax.set_ylim(*limits_of(force, np.concatenate(laws), 0.12))
            ax.xaxis.set_major_locator(MaxNLocator(4, symmetric=True))
            ax.set_xlabel(label("velocity", "m/s"))
            ax.set_title(row.name)
        axes[0, 0].set_ylabel(label("force", "N"))
        for ax in axes[0, 1:]:
            ax.tick_params(labelleft=False)
        if len(levels) > 1:
            figure.colorbar(ScalarMappable(scale, colours), ax=axes[0].tolist(), label=label(driver(unit), unit),
                            fraction=0.04, pad=0.02, ticks=levels)
    return drawn(axes)


def _measured(records: Sequence[Record]) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    step = max(1, sum(r.n_samples for r in records) // POINTS)
    parts = [np.concatenate([r[name][::step] for r in records]) for name in ("velocity", "force")]
    known = all(r.has("current") for r in records)
    return parts[0], parts[1], np.concatenate([r["current"][::step] for r in records]) if known else None


def _shown_levels(records: Sequence[Record]) -> list[float]:
    """Currents on which the records rest, or evenly spread ones."""
    found = current_levels(records)
    if found is None or len(found) > 1 or current_span(records) == 0.0:
        return found or []
    current = np.concatenate([r["current"] for r in records])
    low, high = float(current.min()), float(current.max())
    return [float(v) for v in np.linspace(low, high, CURVES)] if high - low > 0.02 * max(abs(low), abs(high)) else found
