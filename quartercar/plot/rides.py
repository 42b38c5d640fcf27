"""Figures of a ride comparison: what each law trades, and what it does over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.plot.colours import CYCLE, INK, MUTED
from lpvid.plot.style import Ax, Drawn, drawn, label, legend_outside, look, panels, robust_limits, thinned

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from quartercar.rides.bound import Bound
    from quartercar.rides.comparison import Interval, LawRow, RideComparison
    from quartercar.vehicle.result import CarRun

MARKERS = "osD^vP"
EXCERPT = 2.0
"""length of the excerpt [s]"""
FRAME = 15.0
"""per cent above the best law, or the reference, at which the frame ends"""
SHOWN = 3
"""laws drawn over time"""
LABELS = {"comfort": ("weighted acceleration", "m/s²", 1.0), "tyre_load": ("tyre load, rms", "N", 1.0),
          "stroke": ("stroke, rms", "mm", 1e3)}
SIGNALS = {"body_acceleration": ("body", "m/s²", 1.0), "tyre_load": ("tyre load", "kN", 1e-3),
           "suspension_deflection": ("stroke", "mm", 1e3), "current": ("current", "", 1.0)}
"""What is drawn of a ride over time: title, unit (empty for the run's own) and scale."""


LINE = 0.055
"""Height of a name in a panel [share of the panel]: 7.5 points times 1.3 of leading, in 2.5 inches."""


def trade_offs(found: RideComparison, bounds: Sequence[Bound] = (), ax: Ax = None) -> Drawn:
    """Comfort against tyre load and against stroke, road by road, relative to the reference; the front is joined.

    Parameters
    ----------
    found : RideComparison
    bounds : sequence of Bound
        Drawn as stars.
    ax : sequence of matplotlib.axes.Axes, optional
        Where to draw, two for each road; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    with look():
        foreign = ax is not None
        figure, axes = panels(len(found.roads), 2, height=3.4, ax=ax)
        for row, road in zip(axes, found.roads, strict=True):
            reference = found.row(found.reference, road)
            for ax, other in zip(row, ("tyre_load", "stroke"), strict=True):
                _points(ax, found, road, other, [b for b in bounds if b.road == road and b.laws])
                stated = ", ".join(f"{LABELS[n][2] * reference.interval(n).mean:.4g} {LABELS[n][1]}"
                                 for n in ("comfort", other))
                ax.set_title(f"{road}\n(0, 0): {found.reference}, {stated}", fontsize=8.5)
            _front(row[0], found, road)
        legend_outside(figure, axes[0, 0], foreign, 6, "upper", handlelength=1.2, columnspacing=1.4)
    return drawn(axes)


def _points(ax: Axes, found: RideComparison, road: str, other: str, bounds: Sequence[Bound]) -> None:
    reference = found.row(found.reference, road)
    reach: list[tuple[float, float]] = []
    points: list[tuple[str, float, float, str]] = []
    for k, row in enumerate(found.on(road)):
        colour, marker = CYCLE[k % len(CYCLE)], MARKERS[(k // len(CYCLE)) % len(MARKERS)]
        (x, wide), (y, tall) = (_percent(row.against(reference, n)) for n in ("comfort", other))
        unreal = row.passive is False
        ax.errorbar(x, y, tall, wide, fmt=marker, color=colour, markersize=7, label=row.name, elinewidth=0.8,
                    alpha=0.95, markeredgecolor=colour if unreal else "white", markeredgewidth=0.6,
                    markerfacecolor="white" if unreal else colour)
        reach += [(x - wide, y - tall), (x + wide, y + tall)]
        points.append((row.name + (" (gives energy: not to be had)" if unreal else ""), x, y, colour))
    reach += [place for b in bounds for place in _stars(ax, b, other)]
    ends = np.array(reach)
    for set_limits, values in ((ax.set_xlim, ends[:, 0]), (ax.set_ylim, ends[:, 1])):
        low, high = robust_limits(values)
        set_limits(low, min(high, max(float(values.min()), 0.0) + FRAME))
    _names(ax, points)
    ax.axhline(0.0, color=MUTED, linewidth=0.6, zorder=0)
    ax.axvline(0.0, color=MUTED, linewidth=0.6, zorder=0)
    for axis, name in ((ax.set_xlabel, "comfort"), (ax.set_ylabel, other)):
        axis(label(f"{LABELS[name][0]}, difference", "%"))


def _names(ax: Axes, points: Sequence[tuple[str, float, float, str]]) -> None:
    """The name of every law above or below its bar, or at the edge of the frame with an arrow where it lies outside."""
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    free = [(k + 0.5) * LINE for k in range(int(1 / LINE))]
    for name, x, y, colour in sorted(points, key=lambda p: p[2]):
        out = x > right or y > high
        at = (min(x, right), min(y, high))
        across, up = (at[0] - left) / (right - left), (at[1] - low) / (high - low)
        place = min(free, key=lambda row: (abs(row - up) < 0.5 * LINE, abs(row - up)), default=up)
        free = [row for row in free if row != place]
        late = across > 0.5
        ax.annotate(f"{name} →" if out else name, at, xytext=(across + (-0.025 if late else 0.025), place),
                    textcoords="axes fraction", fontsize=7.5, color=colour, ha="right" if late else "left", va="center",
                    bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5},
                    arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.4})


def _stars(ax: Axes, bound: Bound, other: str) -> list[tuple[float, float]]:
    """The best currents of each aim, filled at the objective, joined; their places. No ends against stroke."""
    places = {}
    for aim in bound.best if other == "tyre_load" else ("objective",):
        gaps = [bound.against_reference(aim, m) for m in ("comfort", other)]
        places[aim] = tuple(100 * g.mean for g in gaps if g is not None)
    x, y = np.array(sorted(places.values())).T
    ax.plot(x, y, color=INK, linewidth=0.7, linestyle=":", zorder=1)
    ax.plot(x, y, "*", color="white", markeredgecolor=INK, markersize=9, zorder=2)
    ax.plot(*places["objective"], "*", color=INK, markersize=12, label="clairvoyant bound", zorder=3)
    return list(places.values())


def _percent(interval: Interval) -> tuple[float, float]:
    """Mean and half width."""
    return 100 * interval.mean, 0.0 if interval.high is None else 100 * (interval.high - interval.mean)


def _front(ax: Axes, found: RideComparison, road: str) -> None:
    reference = found.row(found.reference, road)
    best = sorted(tuple(_percent(row.against(reference, n))[0] for n in ("comfort", "tyre_load"))
                  for row in found.on(road) if row.name in found.front[road])
    if len(best) > 1:
        x, y = np.array(best).T
        ax.step(x, y, where="post", color=INK, linewidth=0.9, linestyle="--", zorder=0)


def over_time(found: RideComparison, road: str, ax: Ax = None) -> Drawn:
    """Body acceleration, tyre load, stroke and current of a few laws around the liveliest moment of the first seed.

    Parameters
    ----------
    found : RideComparison
    road : str
    ax : four matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    (4,) array of matplotlib.axes.Axes
    """
    rows = shown_laws(found, road)
    start = _liveliest(rows[0])
    with look():
        axes = panels(len(SIGNALS), heights=[1.9, 1.6, 1.6, 1.4], sharex=True, ax=ax)[1]
        for k, row in enumerate(rows):
            run = row.rides[0].run
            inside = (run.time >= start) & (run.time <= start + EXCERPT)
            draw_signals(axes[:, 0], run, inside, label=row.name, color=(INK, *CYCLE)[k % 7], linewidth=1.0)
        axes[0, 0].set_title(f"{road}, seed {rows[0].rides[0].seed}")
        axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=4, borderaxespad=0.0)
        axes[-1, 0].set_xlabel(label("time", "s"))
    return drawn(axes)


def draw_signals(axes: Iterable[Axes], run: CarRun, inside: np.ndarray, **drawing: Any) -> None:
    """The `SIGNALS` of a run over time, one below the other.

    Parameters
    ----------
    axes : iterable of matplotlib.axes.Axes
        One for each signal.
    run : CarRun
    inside : (n,) bool array
        Samples to draw.
    **drawing
        As for `Axes.plot`.
    """
    for ax, (name, (title, unit, scale)) in zip(axes, SIGNALS.items(), strict=True):
        ax.plot(*thinned(run.time[inside], scale * run[name][inside]), **drawing)
        ax.set_ylabel(label(title, unit or run.units[name]))


def signal_panels(runs: Mapping[str, CarRun]) -> dict[str, dict[str, np.ndarray]]:
    """The `SIGNALS` of several runs, by panel and by name of the run.

    Parameters
    ----------
    runs : mapping of str to CarRun

    Returns
    -------
    dict of str to dict of str to (n,) array
        Panels by label, curves by the name of their run.
    """
    own = next(iter(runs.values())).units["current"]
    return {label(title, unit or own): {n: scale * run[signal] for n, run in runs.items()}
            for signal, (title, unit, scale) in SIGNALS.items()}


def shown_laws(found: RideComparison, road: str) -> list[LawRow]:
    """The reference, a passive car, and the most comfortable of the others.

    Parameters
    ----------
    found : RideComparison
        With at least one law on the road.
    road : str
        Name of one of its roads.

    Returns
    -------
    list of LawRow
        At most `SHOWN`.
    """
    rows = found.on(road)
    first = [r for r in rows if r.name in ("passive", found.reference)]
    rest = sorted((r for r in rows if r not in first), key=lambda r: r.interval("comfort").mean)
    return [*first, *rest[:max(1, SHOWN - len(first))]][:SHOWN]


def _liveliest(row: LawRow) -> float:
    run = row.rides[0].run
    total = np.cumsum(run["body_acceleration"] ** 2)
    width = min(int(EXCERPT / run.sample_time), run.n_samples - 1)
    return float(run.time[int(np.argmax(total[width:] - total[:-width]))])
