"""Errors of a fleet's model along its files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.plot.style import BLUE, INK, VERMILION, label, look, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lpvid.fleet.differing import Differing


def errors(found: Mapping[str, Mapping[str, Any]], apart: Differing) -> Figure:
    """Free-run ESR of each file, sorted, those that differ marked.

    Parameters
    ----------
    found : mapping of str to mapping
        With ``esr``; None where the run diverges, which is left out.
    apart : Differing

    Returns
    -------
    matplotlib.figure.Figure
    """
    finite = sorted((e["esr"], n) for n, e in found.items() if e["esr"] is not None)
    values = np.array([v for v, _ in finite])
    marked = np.array([n in apart.named for _, n in finite])
    with look():
        figure, axes = panels(1, height=3.0)
        ax = axes[0, 0]
        place = np.arange(values.size)
        ax.semilogy(place[~marked], values[~marked], ".", color=BLUE, label="like the fleet")
        ax.semilogy(place[marked], values[marked], "o", color=VERMILION, markersize=5, label="differs")
        for k in np.flatnonzero(marked)[-8:]:
            ax.annotate(finite[k][1], (k, values[k]), xytext=(-5, 0), textcoords="offset points", ha="right",
                        va="center", fontsize=8)
        ax.axhline(np.exp(apart.centre), color=INK, linewidth=0.8, linestyle="--", label="median")
        ax.set_xlabel("file, by its error")
        ax.set_ylabel(label("free-run ESR", "1"))
        ax.legend(loc="upper left")
    return figure
