"""Poles over the scheduling: the z-plane, and the largest modulus with its uncertainty and the critical values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lpvid.analysis.critical import CriticalScheduling
from lpvid.analysis.pole_locus import PoleLocus
from lpvid.analysis.uncertainty import PoleBand
from lpvid.plot.colours import BLUE, INK, MUTED, VERMILION
from lpvid.plot.style import Ax, Drawn, drawn, label, look, panels, visible_scale

CROWD = 400
"""Poles of a locus above which they are drawn as pixels: a mark of its own for each would fill the page."""

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def locus(found: PoleLocus, band: PoleBand | None = None, critical: CriticalScheduling | None = None,
          ax: Ax = None) -> Drawn:
    """Frozen poles of a discrete or continuous model over one scheduling variable.

    Parameters
    ----------
    found : PoleLocus
    band : PoleBand, optional
        Uncertainty from the parameter covariance.
    critical : CriticalScheduling, optional
        Critical values, drawn where they fall into the range shown.
    ax : (2,) array of Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    (2,) array of matplotlib.axes.Axes
        Left the plane of the poles, right the largest modulus (or real part), below it damping or frequency.
    """
    with look():
        figure, axes = panels(1, 2, height=4.3, ax=ax)
        _plane(figure, axes[0, 0], found, band)
        _margin(axes[0, 1], found, band, critical)
    return drawn(axes)


def poles(values: np.ndarray, discrete: bool = True, ax: Ax = None) -> Drawn:
    """The poles of a model without scheduling variables.

    Parameters
    ----------
    values : (n,) complex array
        z in discrete time, s [rad/s] in continuous time.
    discrete : bool
    ax : Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
    """
    with look():
        ax = panels(1, height=4.0, width=4.6, ax=ax)[1][0, 0]
        pole_plane(ax, discrete)
        ax.plot(np.real(values), np.imag(values), "x", color=BLUE, markersize=7)
        ax.set_title("Poles")
    return ax


def pole_plane(ax: Axes, discrete: bool) -> None:
    """The plane of poles: axes of both, and the unit circle where time is discrete.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    discrete : bool
    """
    if discrete:
        angle = np.linspace(0, 2 * np.pi, 361)
        ax.plot(np.cos(angle), np.sin(angle), color=INK, linewidth=0.9, label="stability limit: the unit circle")
        ax.set_aspect("equal", adjustable="datalim")
    ax.axhline(0, color=MUTED, linewidth=0.5)
    ax.axvline(0, color=MUTED, linewidth=0.5)
    ax.set_xlabel("Re z [1]" if discrete else "Re s [1/s]")
    ax.set_ylabel("Im z [1]" if discrete else "Im s [1/s]")


def _plane(figure: Figure, ax: Axes, found: PoleLocus, band: PoleBand | None) -> None:
    pole_plane(ax, found.is_discrete)
    if band is not None and band.cloud.size:
        cloud = band.cloud[:, :: max(1, band.cloud.shape[1] // 25)].ravel()
        ax.plot(np.real(cloud), np.imag(cloud), ".", color=MUTED, alpha=0.18, markersize=2.0, rasterized=True,
                label=f"poles of {band.draws} models drawn from the covariance")
    colours = np.repeat(found.p[:, None], found.poles.shape[1], axis=1)
    marks = ax.scatter(np.real(found.poles).ravel(), np.imag(found.poles).ravel(), c=colours.ravel(), s=9,
                       cmap=visible_scale(), zorder=3, linewidths=0, rasterized=found.poles.size > CROWD,
                       label="poles of this model")
    figure.colorbar(marks, ax=ax, label=label(found.variable, found.unit), fraction=0.046, pad=0.03)
    ax.set_title("Frozen poles")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=1, borderaxespad=0.0, markerscale=2)
    for handle in ax.get_legend().legend_handles:  # type: ignore[union-attr]
        handle.set_alpha(1.0)  # type: ignore[union-attr]


def _margin(ax: Axes, found: PoleLocus, band: PoleBand | None, critical: CriticalScheduling | None) -> None:
    what = "largest |z|" if found.is_discrete else "largest Re s"
    limit = 1.0 if found.is_discrete else 0.0
    if band is not None:
        ax.fill_between(band.p, band.low, band.high, color=BLUE, alpha=0.2, linewidth=0,
                        label=f"{band.level:.0%} band, {band.draws} draws")
    ax.plot(found.p, found.max_modulus, color=BLUE, linewidth=1.6, label=what)
    ax.axhline(limit, color=VERMILION, linewidth=1.2, linestyle="--", label="stability limit")
    values = [] if critical is None else [v for v in critical.values if v.variable == found.variable]
    low, high = float(found.p[0]), float(found.p[-1])
    for i, value in enumerate(v for v in values if low <= v.value <= high):
        ax.plot([value.value], [limit], "o", color=VERMILION, markersize=6, zorder=4,
                label="critical value" if i == 0 else None)
    ax.set_xlabel(label(found.variable, found.unit))
    ax.set_ylabel(f"{what} [{'1' if found.is_discrete else '1/s'}]")
    ax.set_title("Distance to instability")
    ax.set_xlim(low, high)
    ax.margins(y=0.12)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, borderaxespad=0.0)


