"""What measured records look like: traces and spectra, before any model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.plot.colours import BLUE, CYCLE, INK
from lpvid.plot.style import Ax, Drawn, drawn, label, legend_outside, look, panels, robust_limits, thinned, zero_lines
from lpvid.record import Record

MOST_CHANNELS = 6
MOST_RECORDS = 6
LONGEST_NAME = 16
"""characters of a channel's name beside an axis"""


def channel_traces(record: Record, channels: Sequence[str] | None = None, ax: Ax = None) -> Drawn:
    """Every channel of a record over time, one panel each.

    Parameters
    ----------
    record : Record
        As read; missing samples leave a gap in the line.
    channels : sequence of str, optional
        Which, at most six; the first six by default.
    ax : Axes or array of one for each channel, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or array of them
    """
    names = [record.resolve(c) for c in (channels or record.channels)][:MOST_CHANNELS]
    with look():
        figure, axes = panels(len(names), height=1.25, sharex=True, ax=ax)
        for ax, name in zip(axes[:, 0], names, strict=True):
            x, y = thinned(record.times, record[name])
            ax.plot(x, y, color=BLUE, linewidth=0.8)
            ax.set_ylim(*robust_limits(record[name]))
            ax.set_ylabel(label(_short(name), record.unit(name)), rotation=90)
            ax.margins(x=0.005)
        figure.align_ylabels()
        axes[-1, 0].set_xlabel("time [s]")
        axes[0, 0].set_title(f"{record.name}: {record.n_samples} samples over {record.duration:.4g} s")
    return drawn(axes)


def spectra(records: Sequence[Record], channels: Sequence[str], ax: Ax = None) -> Drawn | None:
    """Amplitude spectral density of channels, one panel each, one line per record (Welch, Hann window).

    Parameters
    ----------
    records : sequence of Record
        Only their longest finite stretch on a uniform clock is used.
    channels : sequence of str
    ax : Axes or array of one for each channel, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or array of them, or None
        None when no record has a stretch long enough.
    """
    names = list(channels)[:MOST_CHANNELS]
    found = {name: [(r, *pair) for r in records[:MOST_RECORDS] if (pair := _density(r, name)) is not None]
             for name in names}
    found = {name: rows for name, rows in found.items() if rows}
    if not found:
        return None
    columns, foreign = min(2, len(found)), ax is not None
    with look():
        figure, axes = panels(-(-len(found) // columns), columns, height=2.3, ax=ax, count=len(found))
        for ax, (name, rows) in zip(axes.ravel(), found.items(), strict=False):
            for (record, f, density), colour in zip(rows, CYCLE if len(rows) > 1 else (INK,), strict=False):
                ax.loglog(f[1:], density[1:], color=colour, linewidth=0.9, label=record.name)
            ax.set_title(name)
            ax.set_xlabel("frequency [Hz]")
            ax.set_ylabel(f"density [{rows[0][0].unit(name) or '1'}/√Hz]")
            ax.margins(x=0)
        for ax in axes.ravel()[len(found):]:
            ax.set_visible(False)
        if max(map(len, found.values())) > 1:
            legend_outside(figure, axes[0, 0], foreign, 6)
    return drawn(axes, len(found))


def strokes(named: Sequence[tuple[str, np.ndarray, np.ndarray, np.ndarray]], ax: Ax = None) -> Drawn:
    """Force over velocity and over displacement, as measured, coloured by record.

    Parameters
    ----------
    named : sequence of (name, displacement [m], velocity [m/s], force [N])
        At most six are drawn.
    ax : (2,) array of Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    (2,) array of matplotlib.axes.Axes
    """
    shown = list(named)[:MOST_RECORDS]
    step, foreign = max(1, sum(row[3].size for row in shown) // 8000), ax is not None
    with look():
        figure, axes = panels(1, 2, height=3.6, ax=ax)
        for (name, displacement, velocity, force), colour in zip(shown, CYCLE, strict=False):
            for ax, x in zip(axes[0], (velocity, displacement), strict=True):
                ax.plot(x[::step], force[::step], ".", markersize=1.8, color=colour, rasterized=True, label=name,
                        alpha=0.55)
        for ax, stated in zip(axes[0], (label("velocity", "m/s"), label("displacement", "m")), strict=True):
            ax.set_xlabel(stated)
            ax.set_ylabel(label("force", "N"))
            zero_lines(ax)
        if len(shown) > 1:
            legend_outside(figure, axes[0, 0], foreign, 6, markerscale=4)
    return drawn(axes)


def _density(record: Record, name: str) -> tuple[np.ndarray, np.ndarray] | None:
    from scipy.signal import welch

    from lpvid.condition.resampling import finite_runs

    if not record.has(name) or not record.time_base.steady or not record.time_base.period > 0:
        return None
    values = record[name]
    runs = finite_runs(values)
    if not runs:
        return None
    first, last = max(runs, key=lambda run: run[1] - run[0])
    stretch = values[first:last]
    if stretch.size < 64 or not np.ptp(stretch) > 0:
        return None
    f, power = welch(stretch, fs=1 / record.time_base.period, nperseg=min(1024, stretch.size), detrend="constant")
    return f, np.sqrt(power)


def _short(name: str) -> str:
    return name if len(name) <= LONGEST_NAME else name[: LONGEST_NAME - 1] + "…"
