"""Figures of several damper models beside each other: ESR, force over time, force over velocity."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.plot.colours import BLUE, CYCLE, INK, MEASURED, MODEL, MUTED, VERMILION
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
    plain_decades,
    robust_limits,
    zero_lines,
)
from lpvid.units import driver
from quartercar.dampers.contract import ExtrapolationWarning

if TYPE_CHECKING:
    from lpvid.record import Record
    from quartercar.dampers.evaluation.compared import Compared, Comparison

SIDE_BY_SIDE = 6
"""models beside each other in one experiment, at most"""
DRAWN = 3
"""models drawn over time"""
EXCERPT = 1.2
"""length of the excerpt [s], or this many periods of the motion's busiest frequency if longer"""
PERIODS = 4
LEVELS = 4
"""currents shown beside each other"""
NEAR = 0.05
"""share of the current's span that counts as one level"""
RARE, APART = 0.02, 2
"""share of the samples below which a level is not shown; levels apart by no more than this many bins are one"""
CLOUD = 2500
"""points of one panel"""


def ranking(found: Comparison, ax: Ax = None) -> Drawn:
    """Free-run ESR of every model on a logarithmic axis: held-out as a dot, training as a hollow mark.

    A logarithmic axis has no zero, so that the length of a bar would give no information: the place of a dot does.

    Parameters
    ----------
    found : Comparison
    ax : matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes
    """
    rows = [r for r in found.rows if r.held_out.total.esr is not None]
    lost = [r for r in found.rows if r.held_out.total.esr is None]
    names = [*(r.name for r in rows), *(f"{r.name} (diverged)" for r in lost)]
    held, trained = ([getattr(r, part).total.esr for r in rows] for part in ("held_out", "training"))
    with look():
        axes = panels(1, height=1.0 + 0.27 * len(names), ax=ax)[1]
        ax = axes[0, 0]
        for i, (late, early) in enumerate(zip(held, trained, strict=True)):
            if early is not None:
                ax.plot([early, late], [i, i], color=MUTED, linewidth=0.8, zorder=1)
            ax.annotate(f"{late:.3g}", (max(v for v in (late, early) if v is not None), i), xytext=(8, 0),
                        textcoords="offset points", va="center", fontsize=7.5)
        ax.plot(held, np.arange(len(rows)), "o", color=BLUE, markersize=7, label="held-out", zorder=3)
        known = [(i, t) for i, t in enumerate(trained) if t is not None]
        ax.plot([t for _, t in known], [i for i, _ in known], "D", color="white", markeredgecolor=VERMILION,
                markersize=5, label="training", zorder=2)
        ax.set_xscale("log")
        every = [v for v in (*held, *(t for _, t in known)) if v > 0]
        ax.set_xlim(0.7 * min(every, default=1e-3), 1.8 * max(every, default=1.0))
        plain_decades(ax.xaxis)
        ax.set_ylim(len(names) - 0.4, -0.6)
        ax.set_yticks(np.arange(len(names)), names)
        ax.set_xlabel("free-run ESR [1]")
        legend_above(ax, 2)
    return drawn(axes)


def experiments_by_model(found: Comparison, ax: Ax = None) -> Drawn | None:
    """Held-out free-run ESR by experiment, a dot for each of the best models.

    Parameters
    ----------
    found : Comparison
    ax : matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or None
        None where there is one experiment.
    """
    rows = [r for r in found.rows if r.held_out.total.esr is not None][:SIDE_BY_SIDE]
    names = [name for name, _ in rows[0].held_out.experiments] if rows else []
    if len(names) < 2:
        return None
    values = np.array([[np.nan if run.esr is None else run.esr for _, run in r.held_out.experiments] for r in rows])
    tall = max(map(len, names)) > 12
    with look():
        axes = panels(1, height=3.4, ax=ax)[1]
        ax = axes[0, 0]
        for k, (row, colour) in enumerate(zip(rows, CYCLE, strict=False)):
            at = np.arange(len(names)) + (k - 0.5 * (len(rows) - 1)) * 0.6 / len(rows)
            ax.plot(at, values[k], "osD^vP"[k % 6], color=colour, markersize=6, label=row.name)
        ax.set_yscale("log")
        known = values[np.isfinite(values) & (values > 0)]
        if known.size:
            ax.set_ylim(0.7 * float(known.min()), 1.5 * float(known.max()))
        plain_decades(ax.yaxis)
        ax.set_xticks(np.arange(len(names)), names, rotation=30 if tall else 0, ha="right" if tall else "center")
        for edge in np.arange(len(names) - 1) + 0.5:
            ax.axvline(edge, color=MUTED, linewidth=0.4)
        ax.grid(visible=False, axis="x")
        ax.set_ylabel("free-run ESR [1]")
        legend_above(ax, 3)
    return drawn(axes)


def force_over_time(found: Comparison, ax: Ax = None) -> Drawn:
    """Measured force and the best models' free runs over an excerpt of a held-out record, with the current below.

    Parameters
    ----------
    found : Comparison
    ax : sequence of matplotlib.axes.Axes, optional
        Where to draw: force, error, and the current where it moves; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    record = livelier(found.data.held_out)
    window = _excerpt(record)
    rows = [r for r in found.rows if r.held_out.total.esr is not None][:DRAWN] or list(found.rows[:1])
    moving = not _is_still(record, current_span(found.data.held_out))
    t = record.times[window]
    force = record["force"]
    with look():
        figure, axes = panels(3 if moving else 2, heights=[2.6, 1.3, *([0.9] if moving else [])], sharex=True,
                              ax=ax)
        over, under = axes[0, 0], axes[1, 0]
        over.plot(t, force[window], color=MEASURED, linewidth=1.8, label="measured")
        for row, colour in zip(rows, (VERMILION, BLUE, CYCLE[2]), strict=False):
            run = free_run_of(row, record)
            over.plot(t, run[window], color=colour, linewidth=1.1, label=row.name)
            under.plot(t, (force - run)[window], color=colour, linewidth=0.9)
        over.set_ylim(*limits_of(force[window], np.concatenate([free_run_of(r, record)[window] for r in rows]), 0.15))
        over.set_ylabel(label("force", "N"))
        over.set_title(f"{record.name}, held-out")
        legend_above(over, 4)
        under.axhline(0, color=INK, linewidth=0.5)
        under.set_ylabel(label("error", "N"))
        if moving:
            axes[2, 0].plot(t, record["current"][window], color=MUTED, drawstyle="steps-post")
            unit = record.unit("current")
            axes[2, 0].set_ylabel(label(driver(unit), unit))
            axes[2, 0].set_ylim(*robust_limits(record["current"], 0.1))
        axes[-1, 0].set_xlabel(label("time", "s"))
        axes[-1, 0].set_xlim(float(t[0]), float(t[-1]))
        figure.align_ylabels(axes[:, 0])
    return drawn(axes)


def livelier(records: Sequence[Record]) -> Record:
    """The record that shows most: one whose current moves, with few jumps, then the one of the largest force.

    Parameters
    ----------
    records : sequence of Record
        At least one, with a force [N].

    Returns
    -------
    Record
        One of them; where no current moves, the one whose force has the largest standard deviation.
    """
    span = current_span(records)

    def worth(record: Record) -> tuple[bool, float, float]:
        if _is_still(record, span):
            return False, 0.0, float(record["force"].std())
        jumps = float(np.mean(np.abs(np.diff(record["current"])) > NEAR * span))
        return True, -round(jumps, 2), float(record["force"].std())

    return max(records, key=worth)


def _is_still(record: Record, span: float) -> bool:
    """Whether the current rests but for its noise; `span` is that of all records."""
    return not record.has("current") or float(np.ptp(record["current"])) <= max(
        NEAR * span, 0.02 * float(np.abs(record["current"]).max()))


def _excerpt(record: Record) -> slice:
    """A stretch in which the force is about as lively as in the whole record."""
    from scipy.signal import welch

    assert record.sample_time is not None
    frequency, power = welch(record["velocity"], 1 / record.sample_time, nperseg=min(4096, record.n_samples))
    seconds = max(EXCERPT, PERIODS / max(float(frequency[np.argmax(power)]), 1e-3))
    size = min(record.n_samples, max(round(seconds / record.sample_time), 16))
    force = record["force"]
    starts = np.unique(np.linspace(0, record.n_samples - size, 24).round().astype(int))
    lively = [float(force[a: a + size].std()) for a in starts]
    first = int(starts[int(np.argsort(lively)[(3 * len(lively)) // 4])])
    return slice(first, first + size)


def force_over_velocity(found: Comparison, ax: Ax = None) -> Drawn:
    """Force-velocity loops of the best model over the measured ones, a panel for each of at most four currents.

    Parameters
    ----------
    found : Comparison
    ax : sequence of matplotlib.axes.Axes, optional
        Where to draw, one for each current on which the records rest; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    row = found.best
    span = current_span(found.data.held_out)
    still = [r for r in found.data.held_out if _is_still(r, span)]
    records = still if len(still) > 1 else found.data.held_out  # a switching current leaves transients in every loop
    runs = [(r, free_run_of(row, r)) for r in records]
    levels = current_levels(records)
    unit = records[0].unit("current") if levels is not None else ""
    with look():
        figure, axes = panels(1, 1 if levels is None else len(levels), height=3.3,
                              width=5.6 if levels is None else max(5.6, min(9.9, 3.3 * len(levels))), ax=ax)
        foreign = ax is not None
        forces = np.concatenate([r["force"] for r, _ in runs])
        speed = max(float(np.abs(r["velocity"]).max()) for r, _ in runs)
        for ax, level in zip(axes[0], levels or [None], strict=True):
            v, measured, model = _near(runs, level, span)
            step = max(1, v.size // CLOUD)
            ax.plot(v[::step], measured[::step], ".", markersize=2.0, color=MEASURED, alpha=0.45, rasterized=True,
                    label="measured")
            ax.plot(v[::step], model[::step], ".", markersize=2.0, color=MODEL, alpha=0.45, rasterized=True,
                    label=row.name)
            zero_lines(ax)
            ax.set_xlim(-1.05 * speed, 1.05 * speed)
            ax.set_ylim(*limits_of(forces, np.concatenate([run for _, run in runs]), 0.06))
            ax.set_xlabel(label("velocity", "m/s"))
            if level is not None:
                ax.set_title(f"{round(level, 2) + 0.0:g} {unit}")
        axes[0, 0].set_ylabel(label("force", "N"))
        for ax in axes[0, 1:]:
            ax.tick_params(labelleft=False)
        legend_outside(figure, axes[0, 0], foreign, 2, markerscale=4)
    return drawn(axes)


def current_levels(records: Sequence[Record]) -> list[float] | None:
    """At most four currents on which the records rest for long; None without a current.

    Parameters
    ----------
    records : sequence of Record
        All with a current, or none.

    Returns
    -------
    list of float, or None
        Medians of the most frequent bins, rising, in the unit of the current; one value where the current does not
        move.
    """
    if not records[0].has("current"):
        return None
    current = np.concatenate([r["current"] for r in records])
    low, high = float(current.min()), float(current.max())
    if high - low <= 0.02 * max(abs(low), abs(high)):
        return [float(np.median(current))]
    counts, edges = np.histogram(current, bins=round(1 / NEAR), range=(low, high))
    chosen: list[int] = []
    for b in map(int, np.argsort(-counts, kind="stable")):
        if counts[b] >= RARE * current.size and all(abs(b - c) > APART for c in chosen):
            chosen.append(b)
    spread = np.unique(np.linspace(0, len(chosen) - 1, min(LEVELS, len(chosen))).round().astype(int))
    shown = [sorted(chosen)[k] for k in spread]
    return [float(np.median(current[(current >= edges[b]) & (current <= edges[b + 1])])) for b in shown]


def current_span(records: Sequence[Record]) -> float:
    """Range of the current over all records.

    Parameters
    ----------
    records : sequence of Record
        At least one.

    Returns
    -------
    float
        Largest less smallest sample, in the unit of the current; 0 where a record has none.
    """
    if not all(r.has("current") for r in records):
        return 0.0
    return float(max(r["current"].max() for r in records) - min(r["current"].min() for r in records))


def _near(runs: Sequence[tuple[Record, np.ndarray]], level: float | None,
          span: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocity, measured and simulated force of the samples whose current is near a level."""
    parts = []
    for record, run in runs:
        keep = np.isfinite(run) if level is None else (
            np.isfinite(run) & (np.abs(record["current"] - level) <= 0.5 * NEAR * span + 1e-12))
        parts.append((record["velocity"][keep], record["force"][keep], run[keep]))
    v, f, m = (np.concatenate([p[k] for p in parts]) for k in range(3))
    return v, f, m


def free_run_of(row: Compared, record: Record) -> np.ndarray:
    """(n,) free run in the polarity of the record.

    Parameters
    ----------
    row : Compared
        A fitted damper.
    record : Record
        With the inputs that the damper reads.

    Returns
    -------
    (n,) array
        Force [N]; currents outside the fitted range raise no warning.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExtrapolationWarning)  # a flag of the row
        return row.damper.simulate(record).output[:, 0]


