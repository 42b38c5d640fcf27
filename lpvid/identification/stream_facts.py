"""What a stream has shown so far: its pieces, its length, ranges, first samples; memory does not grow with it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lpvid.condition.constancy import constant
from lpvid.errors import InputError
from lpvid.files.streaming import Chunks
from lpvid.identification.arx import ARX, is_constant
from lpvid.record import Channel, Record
from lpvid.scheduling import Scheduling
from lpvid.training_fingerprint import usual_range
from lpvid.training_rows import TrainingRows

BLOCK = 512
"""Samples of a stretch of scheduling that is kept for its usual range."""
BLOCKS = 256
"""Stretches kept at most; beyond them every second one goes, and half as many are taken."""


def located(chunks: Iterable[Record], place: Any) -> Iterator[tuple[Any, Record]]:
    """Chunks from a place on, each with the place behind it; None is the beginning.

    Parameters
    ----------
    chunks : iterable of Record
        Chunks of a file, or any other.
    place : object or None
        As given with an earlier chunk: a place in a file, or the number of chunks before.

    Yields
    ------
    (place, Record)
        Chunks up to and including that of `place` are left out.
    """
    if isinstance(chunks, Chunks):
        yield from chunks.located() if place is None else chunks.located(tuple(place))
        return
    for number, chunk in enumerate(chunks, 1):
        if place is None or number > place:
            yield number, chunk


@dataclass
class Facts:
    """Running facts about a stream.

    Attributes
    ----------
    arx : ARX
        For its channels and its longest past.
    samples, records : int
        Seen so far; a piece that continues its record counts for `samples` alone.
    duration : float
        [s].
    firsts : dict of str to Record
        First sample of every record name.
    rows : TrainingRows
        Prints of stretches of the output, by which the model recognises these data.
    ranges : dict of str to [float, float]
        Lowest and highest value by channel.
    power, mean : (n_outputs,) arrays
        Sum of squares of the outputs about their mean, and that mean.
    count : int
        Samples behind these two.
    blocks : list of (n, n_scheduling) arrays
        Stretches of the scheduling, from every `every`-th piece.
    every : int
        Doubled whenever the blocks become too many.
    passed : int
        Pieces looked at for blocks.
    """

    arx: ARX
    samples: int = 0
    records: int = 0
    duration: float = 0.0
    firsts: dict[str, Record] = field(default_factory=dict)
    rows: TrainingRows = field(default_factory=TrainingRows)
    ranges: dict[str, list[float]] = field(default_factory=dict)
    power: np.ndarray = field(default_factory=lambda: np.zeros(0))
    mean: np.ndarray = field(default_factory=lambda: np.zeros(0))
    count: int = 0
    blocks: list[np.ndarray] = field(default_factory=list)
    every: int = 1
    passed: int = 0

    def add(self, piece: Record, continues: bool) -> None:
        """Take in the next piece.

        Parameters
        ----------
        piece : Record
            Uniform and finite.
        continues : bool
            Whether it goes on where the piece before ended; otherwise the structure's longest past is left out of
            power and mean.
        """
        assert piece.sample_time is not None
        arx = self.arx
        for name in dict.fromkeys((*arx.input, *arx.output, *arx.basis.names)):
            low, high = float(piece[name].min()), float(piece[name].max())
            before = self.ranges.get(name, [low, high])
            self.ranges[name] = [min(before[0], low), max(before[1], high)]
        self.rows.sample_time = piece.sample_time if self.rows.sample_time is None else self.rows.sample_time
        self.rows.add(piece[arx.output[0]], continues)
        self.samples += piece.n_samples
        self.records += not continues
        self.duration += piece.n_samples * piece.sample_time
        if piece.name not in self.firsts:
            self.firsts[piece.name] = _copied(piece.slice(0, 1))
        self._block(piece)
        outputs = [piece[n][0 if continues else arx.start:] for n in arx.output]
        if outputs[0].size:  # pairwise update of mean and sum of squares (Chan, Golub & LeVeque 1983)
            y, total = outputs[0], self.count + outputs[0].size
            mean = np.array([y.mean() for y in outputs])
            own = np.array([np.dot(e, e) for e in (y - m for y, m in zip(outputs, mean, strict=True))])
            shift = mean - self.mean if self.count else np.zeros(mean.size)
            self.power = own if not self.count else self.power + own + shift**2 * self.count * y.size / total
            self.mean = mean if not self.count else self.mean + shift * y.size / total
            self.count = total

    def _block(self, piece: Record) -> None:
        """Keep a stretch of the scheduling from the middle of the piece."""
        if not self.arx.basis.names:
            return
        self.passed += 1
        if self.passed % self.every:
            return
        middle = max((piece.n_samples - BLOCK) // 2, 0)
        self.blocks.append(piece.matrix(self.arx.basis.names)[middle: middle + BLOCK].copy())
        if len(self.blocks) > BLOCKS:
            self.blocks, self.every = self.blocks[1::2], 2 * self.every

    def refuse_still(self) -> None:
        """Refuse a stream in which an input or output never moved.

        Raises
        ------
        InputError
            Names the channel and its constant value.
        """
        for name in (*self.arx.input, *self.arx.output):
            low, high = self.ranges[name]
            if not high > low:
                raise InputError(f"channel '{name}' never moves", got=f"the constant {low:.6g}",
                                 why="nothing can be learnt from it", mend="leave it out, or check the sensor")

    @property
    def usual(self) -> dict[str, list[float]]:
        """Usual range of each scheduling variable, from the stretches that are kept."""
        return {n: usual_range([b[:, k] for b in self.blocks]) for k, n in enumerate(self.arx.basis.names)}

    def named_heads(self) -> list[Record]:
        """One short record for each name, at the mean rate.

        Returns
        -------
        list of Record
            Of one sample each.
        """
        period = self.duration / self.samples
        return [replace(head, time=None, sample_time=period, name=name) for name, head in self.firsts.items()]

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Plain data and arrays, from which `restore` goes on.

        Returns
        -------
        dict, dict of arrays
            As a `Checkpoint` saves them.
        """
        firsts = {name: {"roles": dict(r.roles), "reading": dict(r.reading), "time": r.sample_time, "channels":
                         {k: [float(c.values[0]), c.unit] for k, c in r.channels.items()}}
                  for name, r in self.firsts.items()}
        return ({"samples": self.samples, "records": self.records, "duration": self.duration, "firsts": firsts,
                 "rows": self.rows.state(), "ranges": self.ranges, "count": self.count, "every": self.every,
                 "passed": self.passed, "blocks": len(self.blocks)},
                {"power": self.power, "mean": self.mean, **{f"block{k}": b for k, b in enumerate(self.blocks)}})

    def restore(self, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Go on from a `state`.

        Parameters
        ----------
        meta : dict
            Plain data.
        arrays : dict of arrays
        """
        for name in ("samples", "records", "duration", "ranges", "count", "every", "passed"):
            setattr(self, name, meta[name])
        self.rows = TrainingRows.restored(meta["rows"])
        self.power, self.mean = arrays["power"], arrays["mean"]
        self.blocks = [arrays[f"block{k}"] for k in range(meta["blocks"])]
        self.firsts = {name: Record({k: Channel(np.array([v]), unit) for k, (v, unit) in one["channels"].items()},
                                    sample_time=one["time"], roles=one["roles"], name=name,
                                    reading=one["reading"])
                       for name, one in meta["firsts"].items()}


def _copied(record: Record) -> Record:
    """The same samples in arrays of their own: a slice would hold the whole chunk."""
    return replace(record, channels={k: replace(c, values=c.values.copy()) for k, c in record.channels.items()},
                   time=None)


def box_of(names: tuple[str, ...], degree: int | None, low: np.ndarray, high: np.ndarray,
           units: tuple[str, ...]) -> Scheduling:
    """The box around the scheduling of a whole stream.

    Parameters
    ----------
    names : tuple of str
        Scheduling variables.
    degree : int or None
        Of the basis; a basis of degree 0 may have a constant variable.
    low, high : (n_scheduling,) arrays
        Lowest and highest values [units of the variables].
    units : tuple of str
        Empty where the stream held no usable sample.

    Returns
    -------
    Scheduling

    Raises
    ------
    InputError
        No usable sample, or a variable that is constant over the whole stream.
    """
    if not units:
        raise InputError("no usable samples in the stream", mend="check the channels in use for missing samples")
    for name, lo, hi, unit in zip(names, low, high, units, strict=True):
        if degree != 0 and constant(float(lo), float(hi), unit):
            raise is_constant(name, float(lo), float(hi), unit)
    return Scheduling(names, tuple(low.tolist()), tuple(high.tolist()), units=units)
