"""Departures of a fleet's files from the model of all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.plot.colours import BLUE, VERMILION
from lpvid.plot.style import Ax, Drawn, drawn, label, legend_above, look, panels

if TYPE_CHECKING:

    from lpvid.fleet.differing import Differing


DECADE = 10.0
"""An axis is logarithmic where its values reach over more: with less it has a single power of ten, and no scale."""


def departures(found: Mapping[str, Mapping[str, Any]], apart: Differing, ax: Ax = None) -> Drawn:
    """Score of each file against the free-run ESR of the fleet's model along it; those that differ marked by name.

    Parameters
    ----------
    found : mapping of str to mapping
        With ``esr``; a file whose run diverges is left out.
    apart : Differing
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes, or array of them
    """
    names = [n for n, e in found.items() if e["esr"] is not None and np.isfinite(apart.score[n])]
    x = np.array([found[n]["esr"] for n in names])
    y = np.array([apart.score[n] for n in names])
    marked = np.array([n in apart.named for n in names], dtype=bool)
    with look():
        axes = panels(1, height=3.4, ax=ax)[1]
        ax = axes[0, 0]
        ax.plot(x[~marked], y[~marked], ".", color=BLUE, label="like the fleet")
        if marked.any():
            ax.plot(x[marked], y[marked], "o", color=VERMILION, markersize=5, label="differs")
        for k in np.flatnonzero(marked)[:12]:
            ax.annotate(names[k], (x[k], y[k]), xytext=(5, 0), textcoords="offset points", va="center", fontsize=8)
        ax.set_xlabel(label("free-run ESR of the fleet's model, training", "1"))
        if x.size and x.max() > DECADE * x.min():
            ax.set_xscale("log")
        if y.size and np.abs(y).max() > DECADE:
            ax.set_yscale("symlog", linthresh=1.0)
        ax.set_ylabel(label("distance from the fleet, typical is about 1", "1"))
        ax.margins(x=0.12)
        legend_above(ax, 2)
    return drawn(axes)
