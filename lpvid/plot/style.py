"""One look for all figures: thin axes, labels with units, legends beside the data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.errors import InputError
from lpvid.plot.colours import FAINT, INK, MUTED, SCALE, VISIBLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

Ax = Any
"""Where a figure is drawn: one `matplotlib.axes.Axes`, an array or a sequence of them, or None for a new figure."""
Drawn = Any
"""What a drawing function returns: its `matplotlib.axes.Axes`, or an array of them in the order of `plt.subplots`."""
WIDTH = 9.9
"""Width of a figure in a report [inch]."""
DENSE = 4000
"""Samples drawn at most for one curve; more are thinned to the envelope of each bin."""

SETTINGS: Mapping[str, Any] = {
    "font.family": "DejaVu Sans", "font.size": 9.0, "axes.titlesize": 9.5, "axes.titleweight": "bold",
    "axes.titlelocation": "left", "axes.labelsize": 9.0, "axes.labelcolor": INK, "axes.edgecolor": MUTED,
    "axes.linewidth": 0.7, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "axes.axisbelow": True, "grid.color": FAINT, "grid.linewidth": 0.6, "text.color": INK, "xtick.color": MUTED,
    "ytick.color": MUTED, "xtick.labelsize": 8.0, "ytick.labelsize": 8.0, "legend.fontsize": 8.5,
    "legend.frameon": False, "lines.linewidth": 1.1, "lines.solid_capstyle": "round", "figure.dpi": 100,
    "savefig.dpi": 160, "figure.facecolor": "white", "axes.facecolor": "white", "axes.unicode_minus": True,
    "svg.hashsalt": "lpvid", "path.simplify": True, "path.simplify_threshold": 0.2, "agg.path.chunksize": 20_000,
}


@contextmanager
def look() -> Iterator[None]:
    """The common style of all figures inside the block.

    Yields
    ------
    None
        Figures that are made or saved inside have `SETTINGS`; those of the caller are as before behind it.
    """
    import matplotlib as mpl

    with mpl.rc_context(dict(SETTINGS)):  # type: ignore[arg-type]
        yield


def panels(rows: int, columns: int = 1, *, height: float = 2.2, width: float = WIDTH, sharex: bool = False,
           heights: list[float] | None = None, ax: Ax = None, count: int | None = None) -> tuple[Figure, np.ndarray]:
    """A figure with a (rows, columns) array of axes, laid out without overlap; or the caller's axes.

    Parameters
    ----------
    rows, columns : int
    height, width : float
        Of a row, and of the figure [inch].
    sharex : bool
    heights : list of float, optional
        Of each row [inch].
    ax : Axes, array or sequence of them, optional
        The caller's.
    count : int, optional
        How many panels are used, where the last row is not full: so many of the caller's axes are needed.

    Returns
    -------
    Figure, (rows, columns) array of Axes
        (1, count) with the caller's axes where the last row is not full.

    Raises
    ------
    InputError
        Another number of axes.
    """
    if ax is not None:
        given = np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
        needed = rows * columns if count is None else count
        if given.size != needed:
            raise InputError(f"this is drawn on {needed} axes", got=str(given.size),
                             mend=f"plt.subplots({rows}, {columns})" if needed > 1 else "one Axes")
        return given[0].figure, given.reshape((rows, columns) if needed == rows * columns else (1, needed))
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    total = height * rows if heights is None else sum(heights)
    figure = Figure(figsize=(width, total), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=sharex,
                           gridspec_kw=None if heights is None else {"height_ratios": heights})
    return figure, axes


def drawn(axes: np.ndarray, count: int | None = None) -> Drawn:
    """One Axes where there is one, else the array of them as `plt.subplots` has it, or the first `count` in a row.

    Parameters
    ----------
    axes : (rows, columns) array of Axes
        As `panels` returns it.
    count : int, optional
        How many are used; left out, all.

    Returns
    -------
    matplotlib.axes.Axes or array of them
        Without axes of length 1.
    """
    kept = axes if count is None or count == axes.size else axes.ravel()[:count]
    return kept.ravel()[0] if kept.size == 1 else np.squeeze(kept)


def figure_of(shown: Any) -> Figure:
    """The figure of what a drawing function returns; a figure is its own.

    Parameters
    ----------
    shown : Figure, Axes or array of Axes
        What a drawing function returned.

    Returns
    -------
    matplotlib.figure.Figure
        That of the first, where there are several.
    """
    from matplotlib.figure import Figure

    return shown if isinstance(shown, Figure) else np.atleast_1d(np.asarray(shown, dtype=object)).ravel()[0].figure


def label(name: str, unit: str) -> str:
    """Axis label with its unit.

    Parameters
    ----------
    name : str
        Of the quantity.
    unit : str
        Empty for a pure number, printed as 1.

    Returns
    -------
    str
        Unit in square brackets.
    """
    return f"{name} [{unit or '1'}]"


def visible_scale() -> Colormap:
    """The part of `SCALE` that can be seen on a light and on a dark page.

    Returns
    -------
    matplotlib.colors.Colormap
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps[SCALE](np.linspace(0.0, VISIBLE, 256)), SCALE)


def shades(count: int) -> np.ndarray:
    """Colours along `visible_scale`, evenly spread.

    Parameters
    ----------
    count : int

    Returns
    -------
    (count, 4) array
    """
    return visible_scale()(np.linspace(0.0, 1.0, count))


def plain_decades(axis: Axis) -> None:
    """Numbers of a logarithmic axis as 4, 6, 10, where matplotlib writes 4 × 10⁰ and 6 × 10⁰.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        Its scale is set.
    """
    from matplotlib.ticker import LogFormatter

    class Plain(LogFormatter):
        """Which ticks have a number is matplotlib's choice, how it is written not."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            return f"{x:g}" if super().__call__(x, pos) else ""

    axis.set_major_formatter(Plain(labelOnlyBase=False))
    axis.set_minor_formatter(Plain(labelOnlyBase=False))


def zero_lines(axes: Axes) -> None:
    """Thin lines where x and y are zero.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    """
    axes.axhline(0, color=INK, linewidth=0.5)
    axes.axvline(0, color=INK, linewidth=0.5)


def finish_cloud(axes: Axes, across: str, up: str, limits: tuple[float, float]) -> None:
    """Labels, zero lines, limits and legend of axes full of points, which the legend shows large and opaque.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    across, up : str
        Labels.
    limits : (float, float)
        Of the vertical axis.
    """
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    zero_lines(axes)
    axes.set_ylim(*limits)
    legend_above(axes, 2)
    for handle in axes.get_legend().legend_handles:  # type: ignore[union-attr]
        handle.set_markersize(6)  # type: ignore[union-attr]
        handle.set_alpha(1.0)  # type: ignore[union-attr]


def legend_above(axes: Axes, columns: int = 4) -> None:
    """A legend between title and plot, right-aligned: it never covers data.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        With labelled curves.
    columns : int
        Entries beside each other at most.
    """
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=columns, borderaxespad=0.0, handlelength=1.6,
                columnspacing=1.4)


def legend_outside(figure: Figure, axes: Axes, foreign: bool, columns: int, side: str = "lower", **more: Any) -> None:
    """One legend for all panels below or above them; on the caller's axes, whose layout is theirs, on the first.

    Parameters
    ----------
    figure : Figure
    axes : Axes
        Whose curves are named.
    foreign : bool
        Whether the axes are the caller's.
    columns : int
        At most.
    side : {"lower", "upper"}
    **more
        As for `Figure.legend`.
    """
    handles, names = axes.get_legend_handles_labels()
    if foreign:
        axes.legend(handles, names, **more)
    else:
        where: Any = f"outside {side} center"  # matplotlib's types lack "outside"
        figure.legend(handles, names, loc=where, ncols=min(len(names), columns), **more)


def thinned(x: np.ndarray, y: np.ndarray, most: int = DENSE) -> tuple[np.ndarray, np.ndarray]:
    """At most about `most` points that draw the same curve: minimum and maximum of each bin, in order of time.

    Parameters
    ----------
    x, y : (n,) arrays
    most : int

    Returns
    -------
    x, y : arrays

    Examples
    --------
    >>> x, y = thinned(np.arange(1000.0), np.sin(np.arange(1000.0)), most=100)
    >>> x.size, bool(y.max() == np.sin(np.arange(1000.0)).max())
    (100, True)
    """
    values = np.asarray(y, dtype=float)
    keep, _ = extremes(values, most)
    return x[keep], values[keep]


def extremes(values: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """Places of the lowest and the highest sample of every bin, in order, and the samples in a bin.

    Parameters
    ----------
    values : (n,) array
    most : int
        Places at most, about.

    Returns
    -------
    places : (m,) int array
        Two for each bin; all n where they are no more than `most`.
    size : int
        1 where nothing is left out.

    Examples
    --------
    >>> extremes(np.array([0.0, 5.0, 1.0, -2.0, 7.0, 3.0]), most=4)
    (array([0, 1, 3, 4]), 3)
    """
    if values.size <= most or values.size < 4:
        return np.arange(values.size), 1
    size = -(-2 * values.size // max(most, 2))
    bins = -(-values.size // size)
    padded = np.concatenate([values, np.full(bins * size - values.size, np.nan)]).reshape(bins, size)
    finite = np.isfinite(padded)
    low = np.argmin(np.where(finite, padded, np.inf), axis=1)
    high = np.argmax(np.where(finite, padded, -np.inf), axis=1)
    places = np.sort(np.column_stack([low, high]) + size * np.arange(bins)[:, None], axis=1).ravel()
    return np.minimum(places, values.size - 1), size


def largest_window(values: np.ndarray, most: int, first: int = 0) -> slice:
    """The stretch of `most` samples, or of all where there are fewer, with the largest sum.

    Parameters
    ----------
    values : (n,) array
    most : int
        Samples of the stretch.
    first : int
        Where it begins at the earliest.

    Returns
    -------
    slice
    """
    size = min(most, values.size)
    sums = np.cumsum(np.insert(values, 0, 0.0))
    begin = first + int(np.argmax((sums[size:] - sums[:-size])[first:]))
    return slice(begin, begin + size)


def robust_limits(values: np.ndarray, margin: float = 0.06) -> tuple[float, float]:
    """Axis limits around all finite values with a margin; a constant gets room as well.

    Parameters
    ----------
    values : array
        NaN and infinities are passed over.
    margin : float
        Share of the range that is added at each end.

    Returns
    -------
    low, high : float
        (−1, 1) where no value is finite.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return -1.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    room = margin * (high - low) or 0.05 * abs(high) or 1.0
    return low - room, high + room


def limits_of(measured: np.ndarray, model: np.ndarray, margin: float) -> tuple[float, float]:
    """Limits that show both signals whole; a model that leaves the measured range by more than its width, as one that
    diverges, is cut off there, so that the measurement stays readable.

    Parameters
    ----------
    measured : (n,) array
        It is always shown whole.
    model : (m,) array
        In the same unit; values that are not finite are passed over.
    margin : float
        Share of the range that is added at each end.

    Returns
    -------
    low, high : float
        In the unit of the signals.
    """
    low, high = robust_limits(measured, margin)
    width = high - low
    known = model[np.isfinite(model)]
    if not known.size:
        return low, high
    inside, room = np.clip(known, low - width, high + width), width * margin / (1 + 2 * margin)
    return min(low, float(inside.min()) - room), max(high, float(inside.max()) + room)
