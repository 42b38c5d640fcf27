"""Passivity margin: damping in steady sine motion over scheduling and frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lpvid.analysis.passivity_margin import BAND, PassivityMargin
from lpvid.plot.colours import CYCLE, INK, VERMILION
from lpvid.plot.style import Ax, Drawn, drawn, label, legend_above, look, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINES = 5
"""Scheduling values that are drawn as lines."""


def passivity(found: PassivityMargin, ax: Ax = None) -> Drawn:
    """Least damping over the amplitudes, by frequency and scheduling.

    Parameters
    ----------
    found : PassivityMargin
    ax : Axes or array of two, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or array of them
        Left a map over the first scheduling variable, with the limit of passivity; right, or alone, lines.
    """
    maps = len(found.names) == 1 and len(found.scheduling) > 1 and bool(np.isfinite(found.damping).all())
    with look():
        figure, axes = panels(1, 2 if maps else 1, height=3.4, ax=ax)
        if maps:
            _map(figure, axes[0, 0], found)
        _lines(axes[0, -1], found)
    return drawn(axes)


def _map(figure: Figure, ax, found: PassivityMargin) -> None:
    size = float(np.abs(found.damping).max()) or 1.0
    shades = ax.pcolormesh(found.frequencies, found.scheduling[:, 0], found.damping, cmap="RdBu", vmin=-size, vmax=size,
                          shading="nearest", rasterized=True)
    figure.colorbar(shades, ax=ax, label=label("damping", found.unit), fraction=0.046, pad=0.03)
    if found.mask.any() and not found.mask.all():
        ax.contour(found.frequencies, found.scheduling[:, 0], found.damping, [0.0], colors=INK, linewidths=0.9)
    _frequency(ax, found)
    ax.set_ylabel(label(found.names[0], found.units[0]))
    ax.set_title("Least damping")


def _lines(ax, found: PassivityMargin) -> None:
    chosen = np.unique(np.linspace(0, len(found.scheduling) - 1, LINES).round().astype(int))
    for row, colour in zip(chosen, CYCLE, strict=False):
        stated = ", ".join(f"{v:.3g} {u}".rstrip() for v, u in zip(found.scheduling[row], found.units, strict=True))
        ax.plot(found.frequencies, np.where(np.isfinite(found.damping[row]), found.damping[row], np.nan), color=colour,
                linewidth=1.3, label=stated or "damping")
    ax.axhline(0.0, color=VERMILION, linewidth=1.0, linestyle="--", label="limit of passivity")
    _frequency(ax, found)
    ax.set_ylabel(label("least damping", found.unit))
    legend_above(ax, 3)


def _frequency(ax, found: PassivityMargin) -> None:
    ax.set_xscale("log")
    ax.set_xlim(float(found.frequencies[found.frequencies > 0][0]), float(found.frequencies[-1]))
    if found.frequencies[0] < BAND < found.frequencies[-1]:
        ax.axvline(BAND, color=INK, linewidth=0.7, linestyle=":", label=f"{BAND:g} Hz, body and wheel below")
    ax.set_xlabel(label("frequency", "Hz"))
