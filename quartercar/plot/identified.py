"""Figures of one identified model: experiments beside each other, loops by current."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.plot import Comparison
from lpvid.plot.colours import BLUE, MEASURED, MODEL, MUTED, VERMILION
from lpvid.plot.style import (
    Ax,
    Drawn,
    drawn,
    label,
    legend_above,
    legend_outside,
    limits_of,
    look,
    panels,
    visible_scale,
    zero_lines,
)

PANELS = 4
"""Currents shown side by side."""


def experiments(esr: Sequence[tuple[str, float | None, float | None]], target: float,
                ax: Ax = None) -> Drawn:
    """Free-run ESR of every experiment beside that of a plain model, on a logarithmic axis, with the target.

    Parameters
    ----------
    esr : sequence of (name, ESR, plain ESR)
        None for a run that diverged.
    target : float
    ax : matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
    """
    with look():
        axes = panels(1, height=3.0, ax=ax)[1]
        ax = axes[0, 0]
        place = np.arange(len(esr))
        for column, stated, colour, marker in ((1, "LPV-ARX with saturating input", BLUE, "o"),
                                             (2, "plain LPV-ARX", MUTED, "D")):
            values = np.array([np.nan if row[column] is None else row[column] for row in esr], dtype=float)
            ax.vlines(place, 1e-3, values, color=colour, linewidth=1.0, alpha=0.35)
            ax.plot(place, values, marker, color=colour, markersize=7 if column == 1 else 5, label=stated, zorder=3)
        ax.axhline(target, color=VERMILION, linestyle="--", linewidth=1.2, label=f"target {target:g}")
        ax.set_yscale("log")
        known = [v for row in esr for v in row[1:] if isinstance(v, float)]
        ax.set_ylim(0.5 * min([target, *known]), 1.6 * max([target, *known]))
        ax.set_xticks(place, [row[0] for row in esr])
        ax.grid(visible=False, axis="x")
        ax.set_ylabel("free-run ESR [1]")
        legend_above(ax, 3)
    return drawn(axes)


def loops_by_current(shown: Sequence[Comparison], current: str = "current",
                     velocity: str = "velocity", ax: Ax = None) -> Drawn | None:
    """Force-velocity loops of records at constant current, one panel each for at most four currents.

    Parameters
    ----------
    shown : sequence of Comparison
        Runs at one current each.
    current, velocity : str
    ax : sequence of matplotlib.axes.Axes, optional
        Where to draw, one for each current, at most four; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes, or None
        None without such records.
    """
    levels = sorted(((float(np.mean(c.record[current])), c) for c in shown), key=lambda pair: pair[0])
    if not levels:
        return None
    picks = np.unique(np.linspace(0, len(levels) - 1, min(PANELS, len(levels))).round().astype(int))
    chosen = [levels[i] for i in picks]
    with look():
        foreign = ax is not None
        figure, axes = panels(1, len(chosen), height=2.9, ax=ax)
        limits = limits_of(np.concatenate([c.measured for _, c in chosen]),
                           np.concatenate([c.free_run.output[c.start:, 0] for _, c in chosen]), 0.08)
        for ax, (level, c) in zip(axes[0], chosen, strict=True):
            keep = slice(c.start, None, max(1, c.record.n_samples // 2500))
            v = c.record[velocity][keep]
            ax.plot(v, c.measured[keep], ".", markersize=1.8, color=MEASURED, alpha=0.5, rasterized=True,
                    label=c.origin)
            ax.plot(v, c.free_run.output[keep, 0], ".", markersize=1.8, color=MODEL, alpha=0.5, rasterized=True,
                    label="free run")
            zero_lines(ax)
            ax.set_ylim(*limits)
            ax.set_title(f"{round(level, 2) + 0.0:.2f} {c.record.unit(current)}")
            ax.set_xlabel(label(velocity, c.record.unit(velocity)))
        axes[0, 0].set_ylabel(label(chosen[0][1].output, chosen[0][1].unit))
        for ax in axes[0, 1:]:
            ax.tick_params(labelleft=False)
        legend_outside(figure, axes[0, 0], foreign, 2, markerscale=4)
    return drawn(axes)


def overview(driven: Comparison, constant: Sequence[Comparison], current: str = "current",
             ax: Ax = None) -> Drawn:
    """One picture of a damper model: measured and simulated force over two seconds, and the loops by current.

    Parameters
    ----------
    driven : Comparison
        A run with a moving current.
    constant : sequence of Comparison
        Runs at one current each.
    current : str
    ax : two matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    (2,) array of matplotlib.axes.Axes
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    t = driven.record.times - driven.record.times[0]
    middle = t.size // 2
    window = slice(middle, min(t.size, middle + round(1.5 / float(t[1] - t[0]))))
    with look():
        figure, axes = panels(1, 2, height=3.4, ax=ax)
        left, right = axes[0]
        left.plot(t[window], driven.measured[window], color=MEASURED, linewidth=1.5, label=driven.origin)
        left.plot(t[window], driven.free_run.output[window, 0], color=MODEL, linewidth=1.2, label="free run")
        left.set_xlabel("time [s]")
        left.set_ylabel(label(driven.output, driven.unit))
        left.set_title("Moving current")
        left.margins(x=0)
        legend_above(left, 2)
        levels = [float(np.mean(c.record[current])) for c in constant]
        scale = Normalize(min(levels, default=0.0), max(levels, default=1.0))
        colours = visible_scale()
        unit = constant[0].record.unit(current) if constant else "A"
        for level, c in zip(levels, constant, strict=True):
            keep = slice(c.start, None, max(1, c.record.n_samples // 1500))
            v = c.record["velocity"][keep]
            right.plot(v, c.measured[keep], ".", markersize=1.6, color="#b8bec6", rasterized=True, zorder=1)
            right.plot(v, c.free_run.output[keep, 0], ".", markersize=1.6, color=colours(scale(level)), rasterized=True,
                       zorder=2)
        right.set_xlabel(label("velocity", "m/s"))
        right.set_title(f"Constant currents (grey: {driven.origin})")
        figure.colorbar(ScalarMappable(scale, colours), ax=right, label=label(current, unit))
    return drawn(axes)
