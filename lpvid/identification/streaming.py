"""Identification from data that do not fit into memory: chunk after chunk into one triangular factor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid._threads import single_thread
from lpvid.condition import segments
from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.errors import InputError
from lpvid.identification.arx import ARX
from lpvid.identification.recursive import Recursive, RecursiveEstimator, packaged
from lpvid.identification.regression import CHUNK, Factor
from lpvid.identification.result import Identification
from lpvid.identification.row_stream import RowStream
from lpvid.record import Record
from lpvid.scheduling import Scheduling


def identify_stream(chunks: Iterable[Record], structure: ARX | Recursive, *, box: Scheduling | None = None,
                    ) -> Identification:
    """Fit a structure to records that arrive one after the other; memory does not grow with their number.

    A chunk that bears the last one's name and starts one sample after its end continues it: the lags reach across the
    border, and the estimate is that of the whole record. Any other chunk starts a record of its own. Chunks are cut at
    missing samples as `identify` cuts records.

    Parameters
    ----------
    chunks : iterable of Record
        E.g. ``read_chunks("run.csv", rows=100_000)``. Without `box` it is run through twice, first for the range of the
        scheduling variables, and so must not be a generator.
    structure : ARX or Recursive
        Stages as objects or None.
    box : Scheduling, optional
        Range of the scheduling variables, to which the basis is normalised; spares the first run.

    Returns
    -------
    Identification
        Without training figures: `validate` gives them for data that fit into memory. The notes tell the one-step ESR.

    Raises
    ------
    InputError
        As for `identify`; a generator without `box`.

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
    recursive = structure if isinstance(structure, Recursive) else None
    arx = structure.structure if isinstance(structure, Recursive) else structure
    if not isinstance(arx, ARX):
        raise InputError("only ARX and Recursive can be identified from a stream", got=type(structure).__name__)
    if box is None:
        box = _scan(chunks, arx)
    bound = replace(arx, basis=arx.basis.bound(box))
    fold: _Batch | _Running | None = None
    seen = _Seen()
    with single_thread():
        for piece, continues in _pieces(chunks, arx.channels):
            if fold is None:
                assert piece.sample_time is not None
                fold = (_Batch(bound, RowStream(bound, piece.sample_time)) if recursive is None else
                        _Running(RecursiveEstimator(recursive, box, piece.sample_time)))
            if not continues:
                fold.cut()
            fold.take(piece)
            seen.add(piece, arx, continues)
        if fold is None:
            raise InputError("no usable samples in the stream", mend="check the channels in use for missing samples")
        fold.cut()
        seen.refuse_still(arx)
        heads = seen.named_heads()
        found = fold.result(heads, box)
    esr = fold.one_step_esr(seen)
    note = f"identified from a stream of {seen.samples} samples in {seen.records} record(s)"
    return found.replace(notes=(*found.notes, note + ("" if esr is None else f"; one-step ESR {esr:.4g}")))


@dataclass(frozen=True, eq=False)
class StreamFactor:
    """What a least squares problem keeps of a stream: R of [X Y] and a few facts; adds up by QR.

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
    """

    factor: Factor
    samples: int
    sample_time: float
    heads: tuple[Record, ...]
    power: np.ndarray
    mean: np.ndarray


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
    bound = replace(structure, basis=structure.basis.bound(box))
    batch: _Batch | None = None
    seen = _Seen()
    with single_thread():
        for piece, continues in _pieces(chunks, structure.channels):
            if batch is None:
                assert piece.sample_time is not None
                batch = _Batch(bound, RowStream(bound, piece.sample_time))
            if not continues:
                batch.cut()
            batch.take(piece)
            seen.add(piece, structure, continues)
        if batch is None:
            raise InputError("no usable samples in the stream", mend="check the channels in use for missing samples")
        batch.cut()
    heads = seen.named_heads()
    assert heads[0].sample_time is not None
    return StreamFactor(Factor(batch.qr.r, batch.qr.rows_seen, batch.stream.size), seen.samples, heads[0].sample_time,
                        tuple(heads), seen.power, seen.mean)


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
    """One QR over all rows."""

    def __init__(self, bound: ARX, stream: RowStream) -> None:
        from lpvid._kernels import ChunkedQR

        self.bound, self.stream = bound, stream
        self.qr = ChunkedQR(stream.size + stream.n_outputs, CHUNK)

    def take(self, piece: Record) -> None:
        for rows in self.stream.blocks(piece):
            self._absorb(rows)

    def cut(self) -> None:
        self._absorb(self.stream.close())

    def _absorb(self, rows: np.ndarray) -> None:
        head = self.qr.columns
        for first in range(0, rows.shape[1], CHUNK):
            part = rows[:, first: first + CHUNK]
            self.qr.block[:, head: head + part.shape[1]] = part
            self.qr.absorb(part.shape[1])

    def result(self, heads: list[Record], box: Scheduling) -> Identification:
        if self.qr.rows_seen <= self.stream.size:
            raise InputError(f"{self.qr.rows_seen} equations cannot determine {self.stream.size} parameters per output",
                             mend="give longer records, or lower the orders or the degree")
        return self.bound.solved(heads, box, Factor(self.qr.r, self.qr.rows_seen, self.stream.size))

    def one_step_esr(self, seen: _Seen) -> float | None:
        """Of ordinary least squares; None where ridge or weights make the residual sum another."""
        if self.bound.ridge or self.bound.weight is not None or not np.all(seen.power > 0):
            return None
        k = self.stream.size
        return float(np.mean(np.sum(self.qr.r[k:, k:] ** 2, axis=0) / seen.power))


class _Running:
    """A recursive estimate."""

    def __init__(self, estimator: RecursiveEstimator) -> None:
        self.estimator = estimator

    def take(self, piece: Record) -> None:
        self.estimator.go_on(piece)

    def cut(self) -> None:
        self.estimator.cut()

    def result(self, heads: list[Record], box: Scheduling) -> Identification:
        return packaged(self.estimator, heads)

    def one_step_esr(self, seen: _Seen) -> None:
        return None


# -- what was seen ---------------------------------------------------------------------------------------------------
@dataclass
class _Seen:
    """Running facts about the stream."""

    samples: int = 0
    records: int = 0
    duration: float = 0.0
    heads: dict[str, Record] = field(default_factory=dict)
    low: np.ndarray = field(default_factory=lambda: np.zeros(0))
    high: np.ndarray = field(default_factory=lambda: np.zeros(0))
    power: np.ndarray = field(default_factory=lambda: np.zeros(0))
    mean: np.ndarray = field(default_factory=lambda: np.zeros(0))
    count: int = 0

    def add(self, piece: Record, arx: ARX, continues: bool) -> None:
        assert piece.sample_time is not None
        values = piece.matrix((*arx.input, *arx.output))
        low, high = values.min(axis=0), values.max(axis=0)
        self.low = np.minimum(self.low, low) if self.samples else low
        self.high = np.maximum(self.high, high) if self.samples else high
        self.samples += piece.n_samples
        self.records += not continues
        self.duration += piece.n_samples * piece.sample_time
        self.heads.setdefault(piece.name, piece.slice(0, 1))
        y = values[0 if continues else arx.start:, len(arx.input):]
        if len(y):  # pairwise update of mean and sum of squares (Chan, Golub & LeVeque 1983)
            mean, total = y.mean(axis=0), self.count + len(y)
            own = np.sum((y - mean) ** 2, axis=0)
            shift = mean - self.mean if self.count else np.zeros(y.shape[1])
            self.power = own if not self.count else self.power + own + shift**2 * self.count * len(y) / total
            self.mean = mean if not self.count else self.mean + shift * len(y) / total
            self.count = total

    def refuse_still(self, arx: ARX) -> None:
        for name, low, high in zip((*arx.input, *arx.output), self.low, self.high, strict=True):
            if not high > low:
                raise InputError(f"channel '{name}' never moves", got=f"the constant {low:.6g}",
                                 why="nothing can be learnt from it", mend="leave it out, or check the sensor")

    def named_heads(self) -> list[Record]:
        """One short record for each name, at the mean rate."""
        period = self.duration / self.samples
        return [replace(head, time=None, sample_time=period, name=name) for name, head in self.heads.items()]


def _pieces(chunks: Iterable[Record], channels: tuple[str, ...]) -> Iterator[tuple[Record, bool]]:
    """Uniform, finite pieces in order, and whether each continues the one before."""
    last: tuple[str, float] | None = None  # name, and time at which the next sample would stand
    period: float | None = None
    for chunk in chunks:
        for piece in _finite_pieces(chunk, channels):
            step = piece.sample_time
            assert step is not None
            if period is not None and abs(step / period - 1) > RATE_TOLERANCE:
                raise InputError(f"record '{chunk.name}' changes its sampling rate",
                                 got=f"{1 / step:.6g} Hz after {1 / period:.6g} Hz", mend="resample it before")
            period = step if period is None else period
            continues = last is not None and last[0] == chunk.name and abs(piece.start - last[1]) < 0.5 * period
            yield piece, continues
            last = (chunk.name, piece.start + piece.n_samples * step)


def _finite_pieces(chunk: Record, channels: tuple[str, ...]) -> list[Record]:
    usable = np.isfinite(chunk.matrix(channels)).all(axis=1).any()
    sound = all(c.fault is None and c.unit_known and not np.isinf(c.values).any() for c in map(chunk.channel, channels))
    if not usable and sound:
        return []  # a stretch of missing samples only
    return [replace(piece, time=None, name=chunk.name) for piece in segments([chunk], channels, minimum=1)]


def _scan(chunks: Iterable[Record], arx: ARX) -> Scheduling:
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
    for piece, _ in _pieces(chunks, arx.channels):
        p = piece.matrix(names)
        low, high = np.minimum(low, p.min(axis=0)), np.maximum(high, p.max(axis=0))
        units = tuple(piece.unit(n) for n in names)
    if not units:
        raise InputError("no usable samples in the stream", mend="check the channels in use for missing samples")
    for name, lo, hi in zip(names, low, high, strict=True):
        if arx.basis.degree != 0 and hi - lo <= 1e-9 * max(abs(lo), abs(hi)):
            raise InputError(f"scheduling variable '{name}' is constant over the whole data set", got=f"{lo:.6g}",
                             why="a dependence on it cannot be identified",
                             mend="use degree 0, or add records at other levels")
    return Scheduling(names, tuple(low.tolist()), tuple(high.tolist()), units=units)
