"""Frozen frequency and step responses of models, with bands where their parameters' uncertainty is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.plot.colours import CYCLE, MUTED
from lpvid.plot.style import WIDTH, Ax, Drawn, drawn, label, legend_outside, look, panels, plain_decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BEYOND = 3.0
"""Factor by which an axis reaches beyond the estimates: some draws have a pole on the unit circle."""
DASHES = ("-", "--", "-.", ":", "-")


@dataclass(frozen=True, eq=False)
class FrozenResponse:
    """A frozen response of one model at one scheduling value, first output.

    Attributes
    ----------
    name : str
        In the legend.
    values : (n, n_inputs) array
        Complex over frequency, or real over time.
    drawn : (draws, n, n_inputs) array or None
        The same of models drawn from the parameters' covariance.
    """

    name: str
    values: np.ndarray
    drawn: np.ndarray | None = None


def bode(hertz: np.ndarray, shown: Sequence[FrozenResponse], inputs: Sequence[str], units: Sequence[str], output: str,
         level: float = 0.95, ax: Ax = None) -> Drawn:
    """Magnitude and phase, one column for each input, and how wide the band of the magnitude is.

    The lowest row has half the band over the estimate, in per cent: a band narrower than its line is seen there.

    Parameters
    ----------
    hertz : (n,) array
    shown : sequence of FrozenResponse
    inputs : sequence of str
    units : sequence of str
        Of the magnitude, for each input.
    output : str
    level : float
        Of the bands.
    ax : array of Axes, optional
        Where to draw: a column for each input, of three rows with bands and two without; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    banded = any(r.drawn is not None for r in shown)
    columns, foreign = len(inputs), ax is not None
    with look():
        figure, axes = panels(3 if banded else 2, columns, heights=[2.5, 1.7, *([1.3] if banded else [])],
                              width=WIDTH if columns > 1 else 8.0, sharex=True, ax=ax)
        for j, (name, unit) in enumerate(zip(inputs, units, strict=True)):
            top = axes[0, j]
            top.set_yscale("log")
            _reach(top, [np.abs(r.values[:, j]) for r in shown])
            for response, colour, dash in zip(shown, CYCLE, DASHES, strict=False):
                _bode_curve(axes[:, j], hertz, response, j, colour, dash, level)
            top.set_title(f"{output} / {name}")
            top.set_ylabel(label("magnitude", unit))
            axes[1, j].set_ylabel(label("phase", "°"))
            if banded:
                axes[2, j].set_yscale("log")
                axes[2, j].set_ylabel(f"{level:.0%} band\n[± %]")
                plain_decades(axes[2, j].yaxis)
            axes[-1, j].set_xlabel(label("frequency", "Hz"))
            for row in axes[:, j]:  # the rows of a new figure share it
                row.set_xscale("log")
                row.set_xlim(float(hertz[0]), float(hertz[-1]))
        legend_outside(figure, axes[0, 0], foreign, 3)
    return drawn(axes)


def _bode_curve(column: np.ndarray, hertz: np.ndarray, response: FrozenResponse, j: int, colour: str, dash: str,
                level: float) -> None:
    values = response.values[:, j]
    size, phase = np.abs(values), np.degrees(np.unwrap(np.angle(values)))
    if response.drawn is not None:
        zero = values == 0
        draws = response.drawn[:, :, j]
        ratio = np.where(np.isfinite(draws), draws, np.nan) / np.where(zero, 1.0, values)
        low, high = (np.where(zero, np.nan, edge) for edge in _band(np.abs(ratio), level))
        turn = [np.where(zero, np.nan, edge) for edge in _band(np.degrees(np.angle(ratio)), level)]
        top = column[0].get_ylim()[1]
        low_size, high_size = (np.minimum(edge * size, top) for edge in (low, high))
        column[0].fill_between(hertz, low_size, high_size, color=colour, alpha=0.28, linewidth=0)
        column[1].fill_between(hertz, phase + turn[0], phase + turn[1], color=colour, alpha=0.28, linewidth=0)
        column[2].plot(hertz, np.maximum(50 * (high - low), 1e-6), color=colour, linewidth=1.1, linestyle=dash)
    column[0].plot(hertz, size, color=colour, linewidth=1.2, linestyle=dash, label=response.name)
    column[1].plot(hertz, phase, color=colour, linewidth=1.2, linestyle=dash)


def steps(time: np.ndarray, shown: Sequence[FrozenResponse], inputs: Sequence[str], units: Sequence[str], output: str,
          level: float = 0.95, ax: Ax = None) -> Drawn:
    """Responses to a unit step in each input, with their bands, one panel each; other arguments as for `bode`.

    Parameters
    ----------
    time : (n,) array
        From the step on [s].
    shown : sequence of FrozenResponse
        Their values are (n, inputs) arrays of step responses.
    inputs, units, output, level, ax
        As for `bode`; units are those of the response per unit of the input.

    Returns
    -------
    matplotlib.axes.Axes or array of them
        One per input.
    """
    foreign = ax is not None
    with look():
        figure, axes = panels(1, len(inputs), height=2.7, width=WIDTH if len(inputs) > 1 else 8.0, ax=ax)
        for j, (name, unit) in enumerate(zip(inputs, units, strict=True)):
            ax = axes[0, j]
            bottom, top = _room([r.values[:, j] for r in shown])
            for response, colour, dash in zip(shown, CYCLE, DASHES, strict=False):
                if response.drawn is not None:
                    edges = _band(response.drawn[:, :, j], level)
                    low, high = np.clip(edges, bottom, top)  # drawn models that are unstable leave every panel
                    ax.fill_between(time, low, high, color=colour, alpha=0.28, linewidth=0)
                ax.plot(time, response.values[:, j], color=colour, linewidth=1.2, linestyle=dash, label=response.name)
            ax.set_ylim(bottom, top)
            ax.axhline(0, color=MUTED, linewidth=0.5)
            ax.set_title(f"{output}, unit step in {name}")
            ax.set_ylabel(label("response", unit))
            ax.set_xlabel(label("time", "s"))
            ax.set_xlim(float(time[0]), float(time[-1]))
        legend_outside(figure, axes[0, 0], foreign, 3)
    return drawn(axes)


def _reach(ax: Axes, curves: Sequence[np.ndarray]) -> None:
    shown = np.concatenate(curves)
    shown = shown[np.isfinite(shown) & (shown > 0)]
    if shown.size:
        ax.set_ylim(float(shown.min()) / BEYOND, float(shown.max()) * BEYOND)


def _room(curves: Sequence[np.ndarray]) -> tuple[float, float]:
    """Ends of an axis that holds these curves and zero, with room for their bands; whatever the curves, finite."""
    shown = np.concatenate(curves)
    shown = shown[np.isfinite(shown)]
    low, high = min(float(shown.min(initial=0.0)), 0.0), max(float(shown.max(initial=0.0)), 0.0)
    room = 0.35 * (high - low) or 1.0
    return low - room, high + room


def _band(drawn: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Pointwise ends of a band over draws, (draws, n) array; infinite where the draws next to an end are.

    A draw that has no value any more (∞ − ∞ of an unstable one) lies beyond either end.
    """
    tail, lost = 0.5 * (1 - level), np.isnan(drawn)
    return (_quantile(np.where(lost, -np.inf, drawn), tail, 0), _quantile(np.where(lost, np.inf, drawn), 1 - tail, 1))


def _quantile(drawn: np.ndarray, share: float, outer: int) -> np.ndarray:
    """Linear between the two draws about that share, and the outer one of them where either is infinite."""
    ordered, place = np.sort(drawn, axis=0), share * (len(drawn) - 1)
    pair = ordered[int(place)], ordered[min(int(place) + 1, len(drawn) - 1)]
    finite = np.isfinite(pair[0]) & np.isfinite(pair[1])
    below, above = (np.where(finite, x, 0.0) for x in pair)
    part = place - int(place)
    return np.where(finite, (1 - part) * below + part * above, pair[outer])
