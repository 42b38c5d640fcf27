"""What a simulation gets wrong, before and after its extension: maps, spectra, candidates, loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from lpvid.condition.resampling import finite_runs
from lpvid.plot.colours import BLUE, GREEN, INK, MEASURED, MODEL, MUTED, ORANGE, VERMILION
from lpvid.plot.style import (
    WIDTH,
    Ax,
    Drawn,
    drawn,
    finish_cloud,
    label,
    largest_window,
    legend_above,
    limits_of,
    look,
    panels,
    thinned,
)
from lpvid.units import driver

if TYPE_CHECKING:
    pass

BINS = 24
"""cells of a map in each direction"""
FEWEST = 5
"""samples without which a cell stays empty"""
WINDOW = 300
"""samples in the close-up"""
CLOUD = 5000
"""points of a loop drawn at most"""
BEFORE, AFTER = BLUE, MODEL
STAGES = ((BEFORE, "baseline"), (AFTER, "extended model"))
ROLES_UNITS = {"velocity": "m/s", "displacement": "m", "current": "A", "acceleration": "m/s²", "temperature": "K",
               "road": "m", "unsprung": "m", "actuator": "N"}
COLOURS = {"named": VERMILION, "rival": ORANGE, "rejected": MUTED, "not needed": BLUE, "within noise": "#c3ccd6"}
"""of the candidates, by their outcome"""


@dataclass(frozen=True, eq=False)
class BeforeAfter:
    """One record with the baseline's and the extended model's free runs.

    Attributes
    ----------
    name, label : str
    sample_time : float
    channels : mapping of str to (n,) array
    measured, before, after : (n,) arrays
    output, unit : str
    units : mapping of str to str
        Of the channels: a voltage that stands for the current is in V.
    origin : str
        "measured", or "virtual" for records of a rig's model.
    """

    name: str
    label: str
    sample_time: float
    channels: Mapping[str, np.ndarray]
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    output: str
    unit: str
    units: Mapping[str, str] = field(default_factory=dict)
    origin: str = "measured"

    def unit_of(self, role: str) -> str:
        """Unit of a driving channel; the role's own where the record gives none.

        Parameters
        ----------
        role : str
            A key of `ROLES_UNITS`.

        Returns
        -------
        str
            SI, without brackets.
        """
        return self.units.get(role) or ROLES_UNITS[role]

    def axis_label(self, role: str) -> str:
        """Name and unit of a driving channel for an axis; a voltage that stands for the current is called one.

        Parameters
        ----------
        role : str
            A key of `ROLES_UNITS`.

        Returns
        -------
        str
        """
        unit = self.unit_of(role)
        return label(driver(unit) if role == "current" else role, unit)

    @property
    def errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Measured less simulated, before and after."""
        return self.measured - self.before, self.measured - self.after

    @property
    def baseline_error(self) -> tuple[bool, float]:
        """Whether the baseline diverges, then its mean square error before: what records are compared by."""
        error = self.errors[0]
        known = error[np.isfinite(error)]
        return known.size < error.size, float(np.mean(known**2)) if known.size else 0.0

    @property
    def times(self) -> np.ndarray:
        """(n,) [s]."""
        return self.sample_time * np.arange(self.measured.size)


def most_wrong(shown: Sequence[BeforeAfter]) -> BeforeAfter:
    """The record on which the baseline is most wrong.

    Parameters
    ----------
    shown : sequence of BeforeAfter
        At least one.

    Returns
    -------
    BeforeAfter
        One on which the baseline diverges before any other, else that of the largest mean square error.
    """
    return max(shown, key=lambda s: s.baseline_error)


def error_maps(shown: Sequence[BeforeAfter], extended: bool, ax: Ax = None) -> Drawn | None:
    """Root mean square error over velocity and current, and over velocity and displacement; before and after alike.

    Parameters
    ----------
    shown : sequence of BeforeAfter
    extended : bool
        Whether anything was added, so that an after differs from the before.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or array of them, or None
        One row per pair, one column per stage; None where no pair was recorded and moves.
    """
    pairs = [p for p in (("velocity", "current"), ("velocity", "displacement"), ("unsprung", "road"))
             if all(n in s.channels for n in p for s in shown) and all(np.ptp(_joined(shown, n)) > 0 for n in p)]
    if not pairs:
        return None
    stages = ("before", "after") if extended else ("before",)
    with look():
        figure, axes = panels(len(pairs), len(stages), height=2.9, width=WIDTH if extended else 5.6, ax=ax)
        for row, pair in enumerate(pairs):
            tables = [_table(shown, pair, k) for k in range(len(stages))]
            top = max((float(t[2][np.isfinite(t[2])].max()) for t in tables if np.isfinite(t[2]).any()), default=1.0)
            for ax, (x, y, cells), stage in zip(axes[row], tables, stages, strict=True):
                mesh = ax.pcolormesh(x, y, cells.T, cmap="magma_r", vmin=0.0, vmax=top, rasterized=True)
                ax.set_title(f"error {stage}")
                ax.set_xlabel(shown[0].axis_label(pair[0]))
                ax.set_ylabel(shown[0].axis_label(pair[1]))
                ax.grid(False)
            figure.colorbar(mesh, ax=list(axes[row]), label=label("rms error", shown[0].unit), pad=0.01)
    return drawn(axes)


def _joined(shown: Sequence[BeforeAfter], name: str) -> np.ndarray:
    return np.concatenate([s.channels[name] for s in shown])


def _table(shown: Sequence[BeforeAfter], pair: tuple[str, str], stage: int) -> tuple[np.ndarray, ...]:
    """Cell edges and the root mean square error in each cell; NaN where there are few samples that the run reaches."""
    x, y = (_joined(shown, n) for n in pair)
    e = np.concatenate([s.errors[stage] for s in shown])
    edges, known = [_edges(v) for v in (x, y)], np.isfinite(e)
    count = np.histogram2d(x[known], y[known], edges)[0]
    power = np.histogram2d(x[known], y[known], edges, weights=e[known] ** 2)[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        cells = np.where(count >= FEWEST, np.sqrt(power / count), np.nan)
    return (*edges, cells)


def _edges(values: np.ndarray) -> np.ndarray:
    low, high = (float(q) for q in np.quantile(values, [0.001, 0.999]))
    return np.linspace(low, high, BINS + 1) if high > low else np.linspace(values.min(), values.max(), BINS + 1)


def error_shapes(shown: Sequence[BeforeAfter], extended: bool, ax: Ax = None) -> Drawn | None:
    """Mean error over each input, with the band of its middle half: the shape of what the simulation lacks.

    Parameters
    ----------
    shown : sequence of BeforeAfter
    extended : bool
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or array of them, or None
        One panel per input, at most three; None where no input moves.
    """
    names = [n for n in ("velocity", "displacement", "current", "unsprung", "temperature")
             if all(n in s.channels for s in shown) and np.ptp(_joined(shown, n)) > 0][:3]
    if not names:
        return None
    with look():
        axes = panels(1, len(names), height=2.8, ax=ax)[1]
        for ax, name in zip(axes[0], names, strict=True):
            x = _joined(shown, name)
            edges = np.unique(np.quantile(x, np.linspace(0.002, 0.998, BINS + 1)))
            place = np.digitize(x, edges) - 1
            for k, (colour, stated) in enumerate(STAGES[: 2 if extended else 1]):
                e = np.concatenate([s.errors[k] for s in shown])
                at_cell = np.where(np.isfinite(e), place, -1)  # none where a run has diverged
                cells = [(x[at_cell == j], e[at_cell == j]) for j in range(edges.size - 1)
                         if np.sum(at_cell == j) >= FEWEST]
                at = [float(c.mean()) for c, _ in cells]
                low, high = np.array([np.quantile(v, [0.25, 0.75]) for _, v in cells]).reshape(-1, 2).T
                ax.fill_between(at, low, high, color=colour, alpha=0.2, linewidth=0)
                ax.plot(at, [float(v.mean()) for _, v in cells], color=colour, label=stated)
            ax.axhline(0, color=INK, linewidth=0.5)
            ax.locator_params(axis="x", nbins=5)
            ax.set_xlabel(shown[0].axis_label(name))
            legend_above(ax, 2)
        axes[0, 0].set_ylabel(label("mean error", shown[0].unit))
    return drawn(axes)


def error_courses(shown: Sequence[BeforeAfter], floor: float | None, extended: bool, ax: Ax = None) -> Drawn:
    """Error over time (rms of stretches) and over frequency, before and after, with the noise level where known.

    Parameters
    ----------
    shown : sequence of BeforeAfter
        The course over time is that of the first, the spectrum that of the longest; of a run that diverges up to
        there.
    floor : float or None
        Noise [unit of the output]; None where it is not known.
    extended : bool
        Whether anything was added, so that an after differs from the before.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw, two axes; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
        Time, then frequency.
    """
    first = shown[0]
    with look():
        axes = panels(1, 2, height=2.9, ax=ax)[1]
        time, frequency = axes[0]
        for k, (colour, stated) in enumerate(STAGES[: 2 if extended else 1]):
            t, rms = _stretches(first, first.errors[k])
            time.plot(t, rms, color=colour, label=stated, drawstyle="steps-mid")
            f, density = _density(shown, k)
            frequency.loglog(f, density, color=colour, label=stated, linewidth=0.9)
        if floor is not None:
            time.axhline(floor, color=INK, linewidth=0.8, linestyle="--", label="noise level")
        time.set_ylim(bottom=0.0)
        time.set_xlabel(f"time [s] in {first.name}")  # above the axes it would run into the legend
        time.set_ylabel(label("rms error", first.unit))
        frequency.set_xlabel("frequency [Hz]")
        frequency.set_ylabel(f"error density [{first.unit}/√Hz]")
        for ax in (time, frequency):
            legend_above(ax, 3)
    return drawn(axes)


def _stretches(s: BeforeAfter, error: np.ndarray, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Middle [s] and root mean square of stretches; NaN from where a run has diverged."""
    size = max(error.size // count, 1)
    pieces = error[: error.size // size * size].reshape(-1, size)
    known = np.isfinite(pieces).all(axis=1)
    rms = np.full(len(pieces), np.nan)
    rms[known] = np.sqrt(np.mean(pieces[known] ** 2, axis=1))
    return (np.arange(len(pieces)) + 0.5) * size * s.sample_time, rms


def _density(shown: Sequence[BeforeAfter], stage: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequency [Hz] and error density of the longest run; of one that diverges, of its longest finite stretch."""
    from scipy.signal import welch

    longest = max(shown, key=lambda s: s.measured.size)
    error = longest.errors[stage]
    first, last = max(finite_runs(error), key=lambda run: run[1] - run[0], default=(0, 0))
    if last - first < 2:
        return np.empty(0), np.empty(0)
    f, p = welch(error[first:last], 1 / longest.sample_time, nperseg=min(1024, last - first))
    return f[1:], np.sqrt(p[1:])


def suspects(rows: Sequence[tuple[str, float, str]], most: int = 16, ax: Ax = None) -> Drawn | None:
    """How much likelier each candidate makes the data, one bar each, coloured by what became of it.

    Parameters
    ----------
    rows : sequence of (name, log-likelihood ratio, fate)
        Fate is a key of `COLOURS`.
    most : int
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or None
        None without rows.
    """
    kept = sorted(rows, key=lambda r: -r[1])[:most]
    if not kept:
        return None
    with look():
        axes = panels(1, heights=[0.9 + 0.235 * len(kept)], ax=ax)[1]
        ax = axes[0, 0]
        values = np.maximum([r[1] for r in kept], 0.3)
        place = np.arange(len(kept))[::-1]
        ax.barh(place, values, color=[COLOURS[r[2]] for r in kept], height=0.7)
        ax.set_yticks(place, [r[0] for r in kept])
        ax.set_xscale("log")
        ax.set_xlim(0.3, 2.5 * float(values.max()))
        ax.set_xlabel("likelihood ratio alone, beside the baseline's own parameters [1]")
        ax.grid(axis="y", visible=False)
        from matplotlib.patches import Patch

        fates = [f for f in COLOURS if any(r[2] == f for r in kept)]
        ax.legend(handles=[Patch(color=COLOURS[f], label=f) for f in fates], loc="lower right",
                  bbox_to_anchor=(1.0, 1.0), ncols=len(fates))
    return drawn(axes)


def loops(shown: Sequence[BeforeAfter], extended: bool, ax: Ax = None) -> Drawn | None:
    """Output over velocity, measured and simulated: the baseline on the left, the extended model on the right.

    Parameters
    ----------
    shown : sequence of BeforeAfter
        Records without a velocity are passed over.
    extended : bool
        Whether anything was added, so that an after differs from the before.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or array of them, or None
        None where no record has a velocity.
    """
    having = [s for s in shown if "velocity" in s.channels]
    if not having:
        return None
    step = max(1, sum(s.measured.size for s in having) // CLOUD)
    with look():
        axes = panels(1, 2 if extended else 1, height=3.6, width=WIDTH if extended else 5.6, ax=ax)[1]
        runs = [run for s in having for run in ((s.before, s.after) if extended else (s.before,))]
        limits = limits_of(np.concatenate([s.measured for s in having]), np.concatenate(runs), 0.1)
        for k, (ax, stated) in enumerate(zip(axes[0], ("baseline", "extended model"), strict=False)):
            for i, s in enumerate(having):
                run = (s.before, s.after)[k]
                for y, colour, name in ((s.measured, MEASURED, s.origin), (run, (BEFORE, AFTER)[k], stated)):
                    ax.plot(s.channels["velocity"][::step], y[::step], ".", color=colour, markersize=1.8, alpha=0.45,
                            rasterized=True, label=name if i == 0 else None)
            finish_cloud(ax, label("velocity", "m/s"), label(having[0].output, having[0].unit), limits)
    return drawn(axes)


def close_up(shown: Sequence[BeforeAfter], extended: bool, ax: Ax = None) -> Drawn:
    """The stretch in which the baseline is most wrong: measured, baseline, extended model, and what moves.

    Parameters
    ----------
    shown : sequence of BeforeAfter
        The one that is drawn is `most_wrong`.
    extended : bool
        Whether anything was added, so that an after differs from the before.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw, two axes and one for current and velocity each where they move; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
        Output, error, then what moves.
    """
    s = most_wrong(shown)
    window = _worst(s.errors[0])
    t = s.times[window]
    extra = [n for n in ("current", "velocity") if n in s.channels and np.ptp(s.channels[n][window]) > 0]
    with look():
        figure, axes = panels(2 + len(extra), heights=[2.9, 1.4, *([0.95] * len(extra))], sharex=True, ax=ax)
        ax = axes[0, 0]
        ax.plot(t, s.measured[window], color=MEASURED, linewidth=1.5, label=s.origin)
        ax.plot(t, s.before[window], color=BEFORE, label="baseline")
        if extended:
            ax.plot(t, s.after[window], color=AFTER, label="extended model")
        ax.set_ylabel(label(s.output, s.unit))
        ax.set_title(f"{s.name} ({s.label})")
        runs = [run[window] for run in ((s.before, s.after) if extended else (s.before,))]
        ax.set_ylim(*limits_of(s.measured[window], np.concatenate(runs), 0.1))
        legend_above(ax, 3)
        for error, colour in list(zip(s.errors, (BEFORE, AFTER), strict=True))[: 2 if extended else 1]:
            axes[1, 0].plot(t, error[window], color=colour)
        axes[1, 0].axhline(0, color=INK, linewidth=0.5)
        axes[1, 0].set_ylabel(label("error", s.unit))
        for axis, name in zip(axes[2:, 0], extra, strict=True):
            axis.plot(*thinned(t, s.channels[name][window]), color=GREEN)
            axis.set_ylabel(s.axis_label(name))
        axes[-1, 0].set_xlabel("time [s]")
        axes[-1, 0].margins(x=0.005)
        figure.align_ylabels()
    return drawn(axes)


def _worst(error: np.ndarray) -> slice:
    head = min(error.size // 20, error.size - min(WINDOW, error.size))
    return largest_window(np.where(np.isfinite(error), error, 0.0) ** 2, WINDOW, head)
