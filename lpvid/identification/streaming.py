"""Identification from data that do not fit into memory: chunk after chunk into one triangular factor."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid._memory import keep_for_reuse
from lpvid._threads import single_thread
from lpvid.condition.pieces import Cutter
from lpvid.errors import InputError, TooFewSamples
from lpvid.files.streaming import Chunks, read_ahead
from lpvid.identification.arx import ARX
from lpvid.identification.checkpoint import Checkpoint
from lpvid.identification.moving_box import MovingBox, can_follow, carried_over
from lpvid.identification.recursive import Recursive, RecursiveEstimator, packaged
from lpvid.identification.regression import CHUNK, Factor, rows_of
from lpvid.identification.result import Identification
from lpvid.identification.row_stream import RowStream
from lpvid.identification.stream_facts import Facts, box_of, located
from lpvid.record import Channel, Record
from lpvid.scheduling import Polynomial, Scheduling
from lpvid.training_fingerprint import of_files
from lpvid.training_rows import TrainingRows


def identify_stream(chunks: Iterable[Record], structure: ARX | Recursive, *, box: Scheduling | None = None,
                    checkpoint: str | os.PathLike | None = None,
                    report_progress: Callable[[str], None] = lambda text: None) -> Identification:
    """Fit a structure to records that arrive one after the other; memory does not grow with their number.

    A chunk that bears the last one's name and starts one sample after its end continues it: the lags reach across the
    border, and the estimate is that of the whole record. Any other chunk starts a record of its own. Chunks are cut at
    missing samples as `identify` cuts records.

    Parameters
    ----------
    chunks : iterable of Record
        E.g. ``read_chunks("run.csv", rows=100_000)``. It is run through once where the basis is polynomial: R follows
        the range of the scheduling exactly (`moving_box`). Other bases and `Recursive` need the range first, and so
        without `box` no generator.
    structure : ARX or Recursive
        Stages as objects or None.
    box : Scheduling, optional
        Range of the scheduling variables, to which the basis is normalised; left out, that of the data.
    checkpoint : path, optional
        File that keeps the state after every chunk. Where it holds that of the same structure and data, the work goes
        on behind the last chunk; it is removed at the end.
    report_progress : callable
        Receives progress.

    Returns
    -------
    Identification
        Without training figures, which `identify` gives for `Chunks`. The notes give the one-step ESR.

    Raises
    ------
    InputError
        As for `identify`; a generator without `box` where the range must be known first.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> u = rng.normal(size=300)
    >>> y = np.concatenate([[0.0], 0.5 * u[:-1]])
    >>> whole = Record({"u": u, "y": y}, sample_time=0.01)
    >>> found = identify_stream([whole.slice(0, 100), whole.slice(100, 300)], ARX(na=1, nb=1, input="u", output="y"))
    >>> found.parameters.round(6) + 0.0, found.n_samples
    (array([0. , 0.5]), 299)
    """
    arx = structure.structure if isinstance(structure, Recursive) else structure
    if not isinstance(arx, ARX):
        raise InputError("only ARX and Recursive can be identified from a stream", got=type(structure).__name__)
    if isinstance(chunks, Chunks):
        chunks = chunks.only(arx.channels)
    kept = None if checkpoint is None else Checkpoint(checkpoint, {
        "structure": structure.to_dict(), "box": None if box is None else box.to_dict(),
        "data": chunks.version if isinstance(chunks, Chunks) else ""})
    known = None if kept is None else kept.load()
    if known is not None and known[0].get("box"):
        box = Scheduling.from_dict(known[0]["box"])
    if box is None and (isinstance(structure, Recursive) or not can_follow(arx)):
        box = _scan(chunks, arx, report_progress)
    fold, facts = _folded(chunks, structure, arx, box, kept, known, report_progress)
    box = fold.final_box() if box is None else box
    facts.refuse_still()
    found = fold.result(facts.named_heads(), box)
    if kept is not None:
        kept.remove()
    esr = fold.one_step_esr(facts)
    note = f"identified from a stream of {facts.samples} samples in {facts.records} record(s)"
    found = _remembered(found, facts)
    return found.replace(notes=(*found.notes, note + ("" if esr is None else f"; one-step ESR {esr:.4g}")))


def _folded(chunks: Iterable[Record], structure: ARX | Recursive, arx: ARX, box: Scheduling | None,
            kept: Checkpoint | None, known: tuple[dict[str, Any], dict[str, np.ndarray]] | None,
            report_progress: Callable[[str], None],
            ) -> tuple[_Batch | _Running, Facts]:
    """Everything from the last checkpoint on, folded into one estimate; without a box, R follows the scheduling."""
    keep_for_reuse()
    facts, cutter, place = Facts(arx), Cutter(), None
    fold: _Batch | _Running | None = None

    def begun(period: float) -> _Batch | _Running:
        if isinstance(structure, Recursive):
            assert box is not None
            return _Running(RecursiveEstimator(structure, box, period))
        return _Batch(arx, box, period)

    if known is not None and known[0].get("place") is not None:
        meta, arrays = known
        facts.restore(meta["facts"], arrays)
        cutter, place = Cutter(**meta["cutter"]), meta["place"]
        fold = begun(cutter.period or 0.0)
        fold.restore(meta["fold"], arrays)
        report_progress(f"going on behind {facts.samples:,} samples")
    with single_thread():
        for after, chunk in read_ahead(located(chunks, place)):
            for piece, continues in cutter.cut(chunk, arx.channels):
                if fold is None:
                    fold = begun(cutter.period or 0.0)
                if not continues:
                    fold.cut()
                fold.take(piece)
                facts.add(piece, continues)
            if kept is not None and fold is not None:
                plain, arrays = facts.state()
                own, more = fold.state()
                kept.save({"box": None if box is None else box.to_dict(), "place": after, "cutter": vars(cutter),
                           "facts": plain, "fold": own},
                          {**arrays, **more})
            report_progress(f"{facts.samples:,} samples")
        if fold is None:
            raise InputError("no usable samples in the stream", mend="check the channels in use for missing samples")
        fold.cut()
    return fold, facts


def _remembered(found: Identification, facts: Facts) -> Identification:
    """Restore what the model states of its training data: prints of rows, ranges, roles."""
    model = found.model
    training = {**model.metadata.get("training", {}), "rows": facts.rows.to_dict(), "ranges": facts.ranges,
                "usual": facts.usual}
    metadata = {**model.metadata, "training": training, **of_files(facts.named_heads(), list(facts.ranges))}
    return found.replace(model=model.replace(metadata=metadata))


@dataclass(frozen=True, eq=False)
class StreamFactor:
    """What a least squares problem keeps of a stream: R of [X Y] and a few facts; several are combined by QR.

    Attributes
    ----------
    factor : Factor
    samples : int
    sample_time : float
        Mean period [s].
    heads : tuple of Record
        One sample of each record, with names and units.
    power, mean : (n_outputs,) arrays
        Sum of squares about the mean, and mean, of each output.
    rows : TrainingRows
        Prints of rows of the first output, by which a model recognises them.
    ranges : dict of str to [float, float]
        Lowest and highest value by channel.
    """

    factor: Factor
    samples: int
    sample_time: float
    heads: tuple[Record, ...]
    power: np.ndarray
    mean: np.ndarray
    rows: TrainingRows
    ranges: dict[str, list[float]]


def stream_factor(chunks: Iterable[Record], structure: ARX, box: Scheduling) -> StreamFactor:
    """R of [X Y] over a stream, for an ARX whose scheduling variables are normalised to `box`.

    Factors of several streams with one structure, box and period are put together by `merged_factor`: the R of stacked
    R's is that of all rows (TSQR; Demmel, Grigori, Hoemmen & Langou 2012).

    Parameters
    ----------
    chunks, structure, box
        As for `identify_stream`.

    Returns
    -------
    StreamFactor

    Raises
    ------
    InputError
        As for `identify_stream`.
    """
    batch, facts = _folded(chunks, structure, structure, box, None, None, lambda text: None)
    assert isinstance(batch, _Batch)
    heads = facts.named_heads()
    assert heads[0].sample_time is not None
    return StreamFactor(batch.factor, facts.samples, heads[0].sample_time, tuple(heads), facts.power, facts.mean,
                        facts.rows, facts.ranges)


def merged_factor(factors: Sequence[Factor], width: int = 64) -> Factor:
    """R of all rows behind several factors of one structure, by a tree of QR's over `width` at a time.

    The tree follows the order given, so that the result does not depend on who computed which factor.

    Parameters
    ----------
    factors : sequence of Factor
    width : int

    Returns
    -------
    Factor

    Raises
    ------
    InputError
        No factors, or factors of different structures.
    """
    if not factors:
        raise InputError("nothing to put together", got="no factors")
    if len({(f.columns, f.r.shape) for f in factors}) > 1:
        raise InputError("the factors are of different structures",
                         got=", ".join(sorted({f"{f.columns} parameters" for f in factors})))
    level = [f.r for f in factors]
    while True:
        groups = [np.vstack(level[k: k + width]) for k in range(0, len(level), width)]
        level = [np.asarray(np.linalg.qr(rows, mode="r")) for rows in groups]
        if len(level) == 1:
            return Factor(level[0], sum(f.rows for f in factors), factors[0].columns)


# -- folding ---------------------------------------------------------------------------------------------------------
class _Batch:
    """One QR over all rows: written into its workspace from each piece and the samples before it that lags reach.

    A scheduling filter and a basis that reads ahead go through a `RowStream`, which keeps what they need.
    """

    def __init__(self, arx: ARX, box: Scheduling | None, period: float) -> None:
        from lpvid._kernels import ChunkedQR

        self.moving = MovingBox.of(arx) if box is None else None
        self.bound = arx if box is None else replace(arx, basis=arx.basis.bound(box))
        self.stream = RowStream(self.bound, period)
        self.data = None if box is None else self.bound._data(box, None)
        self.qr = ChunkedQR(self.stream.size + self.stream.n_outputs, CHUNK)
        self.plain = self.stream.filter is None and not self.stream.ahead
        self.tail: Record | None = None

    def _follow(self, moving: MovingBox) -> None:
        """Bind the structure to a box that has grown, and carry R over."""
        old, self.bound = self.bound, moving.bound
        if self.qr.rows_seen:
            assert isinstance(old.basis, Polynomial) and isinstance(self.bound.basis, Polynomial)
            self.qr.resume(carried_over(self.qr.r, old.places(), old.basis, self.bound.basis), self.qr.rows_seen)
        self.stream.structure, self.data = self.bound, self.bound._data(moving.box, None)

    def final_box(self) -> Scheduling:
        """The box around everything; InputError where a variable did not move."""
        assert self.moving is not None
        basis = self.moving.arx.basis
        return box_of(basis.names, basis.degree, self.moving.low, self.moving.high, self.moving.units)

    def take(self, piece: Record) -> None:
        if self.moving is not None and self.moving.grown(piece):
            self._follow(self.moving)
        assert self.data is not None
        if not self.plain:
            for rows in self.stream.blocks(piece):
                self._absorb(rows)
            return
        whole = piece if self.tail is None else _joined(self.tail, piece, self.bound.channels)
        for count in rows_of(whole, self.data, self.qr.block):
            self.qr.absorb(count)
        if self.data.start:
            self.tail = whole.slice(max(whole.n_samples - self.data.start, 0), whole.n_samples)

    def cut(self) -> None:
        self.tail = None
        if not self.plain:
            self._absorb(self.stream.close())

    def _absorb(self, rows: np.ndarray) -> None:
        for first in range(0, rows.shape[1], CHUNK):
            part = rows[:, first: first + CHUNK]
            self.qr.block[:, : part.shape[1]] = part
            self.qr.absorb(part.shape[1])

    @property
    def factor(self) -> Factor:
        return Factor(self.qr.r, self.qr.rows_seen, self.stream.size)

    def result(self, heads: list[Record], box: Scheduling) -> Identification:
        if self.qr.rows_seen <= self.stream.size:
            raise TooFewSamples(f"{self.qr.rows_seen} equations cannot determine {self.stream.size} parameters per "
                                "output", mend="give longer records, or lower the orders or the degree")
        return self.bound.solved(heads, box, self.factor)

    def one_step_esr(self, facts: Facts) -> float | None:
        """Of ordinary least squares; None where ridge or weights make the residual sum another."""
        if self.bound.ridge or self.bound.weight is not None or not np.all(facts.power > 0):
            return None
        k = self.stream.size
        return float(np.mean(np.sum(self.qr.r[k:, k:] ** 2, axis=0) / facts.power))

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        tail = {} if self.tail is None else {f"tail:{n}": self.tail[n] for n in self.bound.channels}
        moving = None if self.moving is None else {"low": self.moving.low.tolist(), "high": self.moving.high.tolist(),
                                                   "units": list(self.moving.units)}
        return {"rows": self.qr.rows_seen, "stream": None if self.plain else self.stream.state(), "moving": moving}, \
            {"r": self.qr.r, **tail}

    def restore(self, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        if self.moving is not None:
            found = meta["moving"]
            self.moving = replace(self.moving, low=np.array(found["low"]), high=np.array(found["high"]),
                                  units=tuple(found["units"]))
            self._follow(self.moving)
        self.qr.resume(arrays["r"], meta["rows"])
        tail = {n.removeprefix("tail:"): Channel(v) for n, v in arrays.items() if n.startswith("tail:")}
        self.tail = Record(tail, sample_time=self.stream.sample_time) if tail else None
        if meta["stream"] is not None:
            self.stream.restore(meta["stream"])


def _joined(tail: Record, piece: Record, channels: Sequence[str]) -> Record:
    """The piece behind the samples before it."""
    values = {n: Channel(_checks.owned(np.concatenate([tail[n], piece[n]]))) for n in channels}
    return Record(values, sample_time=piece.sample_time, name=piece.name)


class _Running:
    """A recursive estimate."""

    def __init__(self, estimator: RecursiveEstimator) -> None:
        self.estimator = estimator

    def final_box(self) -> Scheduling:
        return self.estimator.box

    def take(self, piece: Record) -> None:
        self.estimator.go_on(piece)

    def cut(self) -> None:
        self.estimator.cut()

    def result(self, heads: list[Record], box: Scheduling) -> Identification:
        return packaged(self.estimator, heads)

    def one_step_esr(self, facts: Facts) -> None:
        return None

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        return self.estimator.state(), {}

    def restore(self, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        self.estimator = RecursiveEstimator.restore(self.estimator.structure, meta)


def _scan(chunks: Iterable[Record], arx: ARX, report_progress: Callable[[str], None]) -> Scheduling:
    """The box around the scheduling of the whole stream."""
    names = arx.basis.names
    if not names:
        return Scheduling((), (), ())
    if iter(chunks) is chunks:
        raise InputError("the range of the scheduling variables must be known before the fit",
                         why="a generator can be run through only once",
                         mend="give box=Scheduling(names, lower, upper), or read_chunks(...), which can be run twice")
    low, high = np.full(len(names), np.inf), np.full(len(names), -np.inf)
    units: tuple[str, ...] = ()
    cutter, seen = Cutter(), 0
    for chunk in chunks:
        for piece, _ in cutter.cut(chunk, arx.channels):
            p = piece.matrix(names)
            low, high = np.minimum(low, p.min(axis=0)), np.maximum(high, p.max(axis=0))
            units, seen = tuple(piece.unit(n) for n in names), seen + piece.n_samples
        report_progress(f"range of the scheduling: {seen:,} samples")
    return box_of(names, arx.basis.degree, low, high, units)
