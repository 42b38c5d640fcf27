"""What the parameters' uncertainty does to the free run."""

from __future__ import annotations

import numpy as np

from lpvid.analysis.bands import Band
from lpvid.plot.colours import MEASURED, MODEL
from lpvid.plot.comparison import Comparison
from lpvid.plot.style import Ax, Drawn, drawn, label, largest_window, legend_above, look, panels

CLOSE_UP = 400
"""Samples of the free run that are drawn."""


def free_run_band(shown: Comparison, band: Band, ax: Ax = None) -> Drawn:
    """Free run with its band and the measured output, over the stretch where the band is widest.

    Parameters
    ----------
    shown : Comparison
    band : Band
        On the first samples of the same record.
    ax : (2,) array of Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    (2,) array of matplotlib.axes.Axes
    """
    width = (band.high - band.low)[:, 0]
    window = largest_window(width, CLOSE_UP)
    with look():
        axes = panels(2, heights=[2.6, 1.3], sharex=True, ax=ax)[1]
        ax = axes[0, 0]
        t = band.axis[window]
        ax.fill_between(t, band.low[window, 0], band.high[window, 0], color=MODEL, alpha=0.3, linewidth=0,
                        label=f"{band.level:.0%} band, {band.draws} draws")
        ax.plot(t, shown.measured[window], color=MEASURED, linewidth=0.8, label=shown.origin)
        ax.plot(t, shown.free_run.output[window, 0], color=MODEL, linewidth=0.9, label="free run")
        ax.set_ylabel(label(shown.output, shown.unit))
        ax.margins(x=0.005)
        below = axes[1, 0]
        below.fill_between(t, band.low[window, 0] - shown.free_run.output[window, 0],
                           band.high[window, 0] - shown.free_run.output[window, 0], color=MODEL, alpha=0.3, linewidth=0)
        below.axhline(0, color=MODEL, linewidth=0.8)
        below.set_ylabel(label("band", shown.unit))
        below.set_xlabel(label("time", "s"))
        ax.set_ylim(*_limits(shown.measured[window], shown.free_run.output[window, 0], band, window))
        legend_above(ax, 3)
    return drawn(axes)


def _limits(measured: np.ndarray, free_run: np.ndarray, band: Band, window: slice) -> tuple[float, float]:
    """Of the force axis: both signals, and the band as far as one more height of theirs on either side.

    A few drawn models that almost diverge widen the band by orders of magnitude; the curves would be a flat line.
    """
    both = np.concatenate([measured, free_run])
    both = both[np.isfinite(both)]
    low, high = float(both.min()), float(both.max())
    room = (high - low) or 1.0
    bottom = max(min(float(np.nanmin(band.low[window, 0])), low), low - room)
    top = min(max(float(np.nanmax(band.high[window, 0])), high), high + room)
    return bottom - 0.05 * (top - bottom), top + 0.05 * (top - bottom)
