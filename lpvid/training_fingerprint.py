"""What a model keeps of its training data: the range of every channel, its roles, how the files were read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lpvid.caveat import Caveat
from lpvid.condition.preparing import STAND_IN
from lpvid.condition.recalling import READING, TIME_ROLE, channel_of
from lpvid.record import Record

USUAL = (0.01, 0.99)
"""quantiles between which a scheduling variable is usual, once it is smoothed by a running median."""
RINGING = 9
"""samples of that median: an anti-alias filter rings at a step for about two samples each way."""
CHUNK = 100_000
"""samples smoothed at once."""
SLACK = 0.01
"""share of its range by which a channel may leave it before that counts as extrapolation"""


# -- ranges ----------------------------------------------------------------------------------------------------------
def ranges(records: Sequence[Record], names: Sequence[str]) -> dict[str, list[float]]:
    """Least and largest sample of each channel, SI, for ``metadata["training"]["ranges"]``.

    Parameters
    ----------
    records : sequence of Record
        As fitted: cut and resampled.
    names : sequence of str
        Channels or roles.

    Returns
    -------
    dict of str to [float, float]
    """
    return {n: [min(float(r[n].min()) for r in records), max(float(r[n].max()) for r in records)] for n in names}


@dataclass
class _Covered:
    """What has been counted of one channel: samples, those outside the training range, least and largest, its unit."""

    count: int = 0
    outside: int = 0
    least: float = np.inf
    largest: float = -np.inf
    unit: str = ""


class RangeComparison:
    """The ranges of channels beside those of a model's training data, record by record or piece by piece.

    Parameters
    ----------
    metadata : mapping
        Of the model.
    """

    def __init__(self, metadata: Mapping) -> None:
        self.known: Mapping = metadata.get("training", {}).get("ranges", {})
        self.covered: dict[str, _Covered] = {}
        self.unstated: dict[str, _Covered] = {}

    def add(self, record: Record) -> None:
        """Count the samples of every channel whose training range is known; outside are those beyond it by `SLACK`.

        Parameters
        ----------
        record : Record
            A whole one, or the next piece of one.
        """
        for name, (low, high) in self.known.items():
            if not record.has(name) or not record.n_samples:
                continue
            values = record[name]
            tables = (self.covered, self.unstated) if _unstated(record, name) else (self.covered,)
            for table in tables:
                own = table.setdefault(name, _Covered(unit=record.unit(name)))
                own.count += values.size
                slack = SLACK * (high - low)
                own.outside += int(np.sum((values < low - slack) | (values > high + slack)))
                own.least, own.largest = min(own.least, float(values.min())), max(own.largest, float(values.max()))

    def beyond(self, names: Sequence[str]) -> tuple[str, ...]:
        """`beyond_training` of what was added.

        Parameters
        ----------
        names : sequence of str
            Channels.

        Returns
        -------
        tuple of str
        """
        return tuple(
            Caveat(f"{100 * c.outside / c.count:.3g} % of '{n}' lies outside the range of the training data: "
                   f"{c.least:.4g} to {c.largest:.4g} {c.unit}".rstrip()
                   + f", training {self.known[n][0]:.4g} to {self.known[n][1]:.4g}")
            for n in names if (c := self.covered.get(n)) is not None and c.outside)

    def doubts(self, names: Sequence[str]) -> tuple[str, ...]:
        """`unit_doubt` of what was added.

        Parameters
        ----------
        names : sequence of str
            Channels.

        Returns
        -------
        tuple of str
        """
        stated = []
        for name in names:
            own = self.unstated.get(name)
            if own is None:
                continue
            largest, usual = (max(abs(float(x)) for x in ends) for ends in ((own.least, own.largest), self.known[name]))
            decades = np.log10(largest / usual) if largest > 0 and usual > 0 else 0.0
            if 2.5 < abs(decades) < 3.5:
                share, example = ("1000 times", "mm for m") if decades > 0 else ("1/1000 of", "kN for N")
                stated.append(f"'{name}' states no unit and reaches {largest:.4g}, about {share} the {usual:.4g} of "
                              f"the training data: is it in another unit than SI, such as {example}?")
        return tuple(stated)


def _compared_ranges(records: Sequence[Record], metadata: Mapping) -> RangeComparison:
    found = RangeComparison(metadata)
    for record in records:
        found.add(record)
    return found


def beyond_training(records: Sequence[Record], metadata: Mapping, names: Sequence[str]) -> tuple[str, ...]:
    """A sentence for each channel that leaves the range of the training data: how often and how far.

    A free run in a range that the estimate has not seen is extrapolation. Where a unit differs, as mm read as m, the
    two ranges stand beside each other.

    Parameters
    ----------
    records : sequence of Record
    metadata : mapping
        Of the model.
    names : sequence of str
        Channels.

    Returns
    -------
    tuple of str
    """
    return _compared_ranges(records, metadata).beyond(names)


def unstated_units(records: Sequence[Record], names: Sequence[str]) -> tuple[str, ...]:
    """One sentence about the channels whose file states no unit, so that they were taken as SI; none without any.

    Parameters
    ----------
    records : sequence of Record
        As read.
    names : sequence of str
        Channels or roles in use.

    Returns
    -------
    tuple of str
        At most one.
    """
    bare = list(dict.fromkeys(n for n in names for r in records if r.has(n) and _unstated(r, n)))
    if not bare:
        return ()
    listed = ", ".join(f"'{n}'" for n in bare)
    return (f"no unit is stated for {listed}: taken as SI; the header 'name [unit]' or --role 'name=name [unit]' "
            "states it",)


def unstated_of(model: Any, records: Sequence[Record]) -> tuple[str, ...]:
    """`unstated_units` of the channels that a model reads.

    Parameters
    ----------
    model : object
        With inputs, outputs and a box.
    records : sequence of Record
        In the model's roles.

    Returns
    -------
    tuple of str
        At most one.
    """
    return unstated_units(records, (*(s.name for s in (*model.inputs, *model.outputs)), *model.box.names))


def unit_doubt(records: Sequence[Record], metadata: Mapping, names: Sequence[str]) -> tuple[str, ...]:
    """A sentence for each channel without a unit that is about 1000 times as large, or as small, as in training.

    About: nearer to 1000 than to 100 or 10 000, counted in decades.

    Parameters
    ----------
    records : sequence of Record
    metadata : mapping
        Of the model.
    names : sequence of str
        Channels.

    Returns
    -------
    tuple of str
    """
    return _compared_ranges(records, metadata).doubts(names)


def _unstated(record: Record, name: str) -> bool:
    channel = record.channel(name)
    return channel.source_unit is None and not channel.unit


def usual_range(columns: Sequence[np.ndarray]) -> list[float]:
    """Lowest and highest value at which a variable is driven, without the ripple of filters and the rarest samples.

    Parameters
    ----------
    columns : sequence of (n,) arrays
        One per record, in the unit of the variable.

    Returns
    -------
    [float, float]
        The quantiles `USUAL` of the smoothed values.

    Examples
    --------
    >>> steps = np.repeat([0.0, 2.0, 0.0, 2.0], 50)
    >>> steps[[49, 50, 99, 100]] += [-0.2, 0.2, 0.2, -0.2]
    >>> usual_range([steps])
    [0.0, 2.0]
    """
    return [float(c) for c in np.quantile(np.concatenate([_smoothed(c) for c in columns]), USUAL)]


def _smoothed(column: np.ndarray) -> np.ndarray:
    """Running median, the end values held, chunk by chunk: its windows are copied."""
    padded = np.pad(column, RINGING // 2, "edge")
    pieces = (padded[k: k + CHUNK + RINGING - 1] for k in range(0, len(column), CHUNK))
    return np.concatenate([np.median(sliding_window_view(p, RINGING), axis=1) for p in pieces])


# -- roles -----------------------------------------------------------------------------------------------------------
def roles(record: Record, names: Sequence[str]) -> dict[str, str]:
    """Role to channel of the file, for ``metadata["roles"]``: every name that a model reads, and every role given.

    A voltage that is read where there is no current stands for it, as in `condition.preparing.with_current`.

    Parameters
    ----------
    record : Record
        One of the training records, with the roles that the user gave.
    names : sequence of str
        Channels or roles that the model reads and simulates.

    Returns
    -------
    dict of str to str

    Examples
    --------
    >>> run = Record({"v": [0.0, 1.0], "voltage": [0.0, 0.0], "F": [0.0, 1.0]}, 0.1, roles={"velocity": "v"})
    >>> roles(run, ["velocity", "voltage", "F"])
    {'velocity': 'v', 'voltage': 'voltage', 'F': 'F', 'current': 'voltage'}
    """
    found = {n: record.resolve(n) for n in names}
    read = set(found.values())
    found |= {role: channel for role, channel in record.roles.items() if channel in read and role not in found}
    if STAND_IN in read and "current" not in found and not record.has("current"):
        found["current"] = STAND_IN
    return found


def of_files(records: Record | Sequence[Record], names: Sequence[str]) -> dict[str, Any]:
    """What a model keeps of the files of its training data: ``roles``, and ``reading`` where roles stated more.

    Parameters
    ----------
    records : Record or sequence of Record
        The training records, with the roles that the user gave. ``roles`` are those of the first.
    names : sequence of str
        As for `roles`.

    Returns
    -------
    dict
        Entries of the metadata; of ``reading`` the clock, and the units of the channels that the model reads: a mapping
        of str to str, or a list of them where the records were read differently.

    Examples
    --------
    >>> run = Record({"s": [0.0, 1.0], "F": [0.0, 1.0]}, 0.1, reading={"time": "Zeit", "displacement": "s [mm]"})
    >>> of_files(run, ["s"])["reading"], of_files(run, ["F"])["reading"]
    ({'time': 'Zeit', 'displacement': 's [mm]'}, {'time': 'Zeit'})
    """
    listed = (records,) if isinstance(records, Record) else records
    readings: list[dict[str, str]] = []
    for record in listed:
        read = {record.resolve(n) for n in names if record.has(n)} | set(roles(listed[0], names).values())
        reading = {role: text for role, text in record.reading.items()
                   if role == TIME_ROLE or channel_of(text, record.channels)[0] in read}
        if reading and reading not in readings:
            readings.append(reading)
    kept: dict[str, Any] = {READING: readings[0] if len(readings) == 1 else readings} if readings else {}
    return {"roles": roles(listed[0], names), **kept}


def with_sources(names: Sequence[str], metadata: Mapping) -> tuple[str, ...]:
    """Names with the channels that they had in a model's training data: what to read of files that may have either.

    Parameters
    ----------
    names : sequence of str
        Channels or roles.
    metadata : mapping
        The model's.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> with_sources(["velocity", "force"], {"roles": {"velocity": "v", "force": "force"}})
    ('velocity', 'force', 'v')
    """
    known = metadata.get("roles", {})
    return tuple(dict.fromkeys((*names, *(str(known[n]) for n in names if n in known))))


def recalled(records: Sequence[Record], metadata: Mapping) -> list[Record]:
    """Records with the roles of a model's training data, wherever a record lacks the role and has its channel.

    Parameters
    ----------
    records : sequence of Record
    metadata : mapping
        The model's.

    Returns
    -------
    list of Record
    """
    known = metadata.get("roles", {})
    if not isinstance(known, Mapping):
        return list(records)
    found = []
    for record in records:
        lacking = {str(r): str(c) for r, c in known.items() if not record.has(str(r)) and record.has(str(c))}
        found.append(record.with_roles({r: record.resolve(c) for r, c in lacking.items()}) if lacking else record)
    return found
