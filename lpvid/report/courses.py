"""Interactive time traces of records and of models along them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lpvid.plot.comparison import Comparison, worst_stretch
from lpvid.plot.style import label, limits_of
from lpvid.record import Record
from lpvid.report.traces import Curve, Panel, Traces

SIGNALS = 3
"""Inputs and scheduling variables drawn below a free run, at most."""
LOW = 80
"""Height of a panel with one signal beside the output [pixel]."""
OTHERS = ("other-1", "other-2", "other-3", "other-4", "other-5")


def free_run_traces(shown: Comparison, signals: Sequence[str], caption: str) -> Traces:
    """Measured output, free run and error over the whole record, with what drives and schedules the model.

    Parameters
    ----------
    shown : Comparison
    signals : sequence of str
        Channels in panels of their own, at most `SIGNALS`.
    caption : str

    Returns
    -------
    Traces
        The stretch with the largest error is marked.
    """
    record = shown.record
    t, y, run, error = record.times, shown.measured, shown.free_run.output[:, 0], shown.error
    limits = limits_of(y, np.concatenate([run, error]), 0.1)
    curves = (Curve(shown.origin, t, y), Curve("free run", t, run, "model"), Curve("error", t, error, "error"))
    panels = [Panel(label(shown.output, shown.unit), curves, limits, 260), *channel_panels(record, signals[:SIGNALS])]
    return Traces(tuple(panels), caption, f"Free run of {record.name} over time", marked=_marked(shown))


def overlay_traces(shown: Sequence[tuple[str, Comparison]], caption: str) -> Traces:
    """Free runs of several models over one record, and their errors.

    Parameters
    ----------
    shown : sequence of (str, Comparison)
        Names and runs along the same record, each at its model's rate; measured as the first has it.
    caption : str

    Returns
    -------
    Traces
        The stretch in which the first model is worst is marked.
    """
    first = shown[0][1]
    drawn = [(name, c, role) for (name, c), role in zip(shown, OTHERS, strict=False)]
    limits = limits_of(first.measured, np.concatenate([c.free_run.output[:, 0] for _, c, _ in drawn]), 0.1)
    runs = tuple(Curve(name, c.record.times, c.free_run.output[:, 0], role) for name, c, role in drawn)
    errors = tuple(Curve(name, c.record.times, c.error, role) for name, c, role in drawn)
    wide = limits[1] - limits[0]
    panels = (Panel(label(first.output, first.unit), (Curve(first.origin, first.record.times, first.measured), *runs),
                    limits, 260),
              Panel(label("error", first.unit), errors, (-wide, wide), 140))
    return Traces(panels, caption, f"Free runs of {len(drawn)} models along {first.record.name}",
                  marked=_marked(first))


def record_traces(record: Record, channels: Sequence[str], caption: str) -> Traces:
    """Channels of a record over time, one panel each, as read.

    Parameters
    ----------
    record : Record
        As read: gaps stay gaps.
    channels : sequence of str
        Names; those that the record lacks are passed over.
    caption : str
        Below the figure.

    Returns
    -------
    Traces
        Panels in the order of the names.
    """
    return Traces(channel_panels(record, channels, 110), caption, f"Channels of {record.name} over time")


def channel_panels(record: Record, channels: Sequence[str], height: int = LOW) -> tuple[Panel, ...]:
    """A panel for each channel; one that moves in few steps is drawn as steps.

    Parameters
    ----------
    record : Record
        As read: gaps stay gaps.
    channels : sequence of str
        Names; those that the record lacks are passed over.
    height : int
        Of each panel [pixel].

    Returns
    -------
    tuple of Panel
        Labelled with name and unit.
    """
    times = record.times  # of a uniform clock an array of its own at every call: one for all panels
    return tuple(Panel(label(name, record.unit(name)),
                       (Curve(name, times, record[name], "input", stepped=_steps(record[name])),),
                       height=height) for name in channels if record.has(name))


def signal_traces(time: np.ndarray, panels: Mapping[str, Mapping[str, np.ndarray]], caption: str,
                  roles: Sequence[str] = ("measured", *OTHERS)) -> Traces:
    """Signals by the label of their panel and their name, all on one clock; a name has one colour throughout.

    Parameters
    ----------
    time : (n,) array
        [s]
    panels : mapping of str to mapping of str to (n,) array
    caption : str
    roles : sequence of str
        Colours in the order in which names come up.

    Returns
    -------
    Traces
        Panels in the order of the mapping.
    """
    names = list(dict.fromkeys(n for signals in panels.values() for n in signals))
    colour = {n: roles[i % len(roles)] for i, n in enumerate(names)}
    drawn = tuple(Panel(stated, tuple(Curve(n, time, v, colour[n]) for n, v in signals.items()), height=150)
                  for stated, signals in panels.items())
    return Traces(drawn, caption)


def _steps(values: np.ndarray) -> bool:
    """Whether a signal holds its value from most samples to the next, as a command does."""
    finite = values[np.isfinite(values)]
    return finite.size > 2 and float(np.mean(np.diff(finite) == 0)) > 0.5


def _marked(shown: Comparison) -> tuple[float, float, str]:
    window = worst_stretch(shown.error)
    t = shown.record.times
    return float(t[window.start]), float(t[window.stop - 1]), "largest error"
