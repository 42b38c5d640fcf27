"""What the parameters' uncertainty does to the frequency response and to the free run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.analysis.bands import Band
from lpvid.plot.comparison import Comparison
from lpvid.plot.style import CYCLE, MEASURED, MODEL, label, legend_above, look, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLOSE_UP = 400
"""Samples of the free run that are drawn."""
BEYOND = 3.0
"""Factor by which the axis of a frequency response reaches beyond the estimates."""


def frequency_bands(bands: Sequence[Band], responses: Sequence[np.ndarray], said: Sequence[str],
                    quantity: str, input: int = 0) -> Figure:
    """Magnitude of frozen frequency responses with their bands, first output over one input.

    Parameters
    ----------
    bands : sequence of Band
        One for each scheduling value.
    responses : sequence of (n, n_outputs, n_inputs) arrays
        Of the estimate itself, at the bands' frequencies.
    said : sequence of str
        The scheduling values in words.
    quantity : str
        What the magnitude is, with its unit.
    input : int
        Place of the input.

    Returns
    -------
    matplotlib.figure.Figure
    """
    with look():
        figure, axes = panels(1, height=3.2)
        ax = axes[0, 0]
        for band, response, words, colour in zip(bands, responses, said, CYCLE, strict=False):
            ax.fill_between(band.axis, band.low[:, 0, input], band.high[:, 0, input], color=colour, alpha=0.25,
                            linewidth=0)
            ax.plot(band.axis, np.abs(response)[:, 0, input], color=colour, linewidth=1.3, label=words)
        ax.set_xscale("log")
        ax.set_yscale("log")
        shown = np.concatenate([np.abs(r)[:, 0, input] for r in responses])
        shown = shown[np.isfinite(shown) & (shown > 0)]
        if shown.size:  # a band may reach far beyond, where some draws have a pole on the unit circle
            ax.set_ylim(float(shown.min()) / BEYOND, float(shown.max()) * BEYOND)
        ax.set_xlim(float(bands[0].axis[0]), float(bands[0].axis[-1]))
        ax.set_xlabel(label("frequency", "Hz"))
        ax.set_ylabel(quantity)
        legend_above(ax, 3)
    return figure


def free_run_band(shown: Comparison, band: Band) -> Figure:
    """Free run with its band and the measured output, over the stretch where the band is widest.

    Parameters
    ----------
    shown : Comparison
    band : Band
        On the first samples of the same record.

    Returns
    -------
    matplotlib.figure.Figure
    """
    width = (band.high - band.low)[:, 0]
    size = min(CLOSE_UP, width.size)
    sums = np.cumsum(np.insert(width, 0, 0.0))
    first = int(np.argmax(sums[size:] - sums[:-size])) if width.size > size else 0
    window = slice(first, first + size)
    with look():
        figure, axes = panels(1, height=2.8)
        ax = axes[0, 0]
        t = band.axis[window]
        ax.fill_between(t, band.low[window, 0], band.high[window, 0], color=MODEL, alpha=0.3, linewidth=0,
                        label=f"{band.level:.0%} band, {band.draws} draws")
        ax.plot(t, shown.measured[window], color=MEASURED, linewidth=0.8, label="measured")
        ax.plot(t, shown.free_run.output[window, 0], color=MODEL, linewidth=0.9, label="free run")
        ax.set_xlabel(label("time", "s"))
        ax.set_ylabel(label(shown.output, shown.unit))
        ax.margins(x=0.005)
        ax.set_ylim(*_limits(shown.measured[window], shown.free_run.output[window, 0], band, window))
        legend_above(ax, 3)
    return figure


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
