"""validate for files larger than memory: the figures of a whole record from its pieces."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid.condition.pieces import Cutter
from lpvid.errors import InputError
from lpvid.model.hull import outside_share
from lpvid.model.quasi import SelfScheduled
from lpvid.model.scheduling_stage import SchedulingStage, memory
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Channel, Record
from lpvid.remark import ReadAs, of_records
from lpvid.simulation import Model, predict, simulate
from lpvid.training_fingerprint import RangeComparison, recalled
from lpvid.training_rows import RowComparison
from lpvid.validation.figures import FigurePair, Figures, RecordFigures, figures_of
from lpvid.validation.residuals import LAGS, OTHER_LAGS, ResidualTest, independence, whiteness
from lpvid.validation.result import Validation


class StreamedRuns:
    """Carries what the next piece needs: the last samples, the free run's last outputs, the filter's past.

    Parameters
    ----------
    model : LPVTransferFunction
        With equation or output noise, and a basis that does not read ahead.

    Raises
    ------
    InputError
        Another kind of model.
    """

    def __init__(self, model: Model) -> None:
        if not isinstance(model, LPVTransferFunction) or isinstance(model, SelfScheduled) or \
                model.noise.kind not in ("equation", "output"):
            raise InputError("a stream runs along transfer functions with equation or output noise",
                             got=repr(model)[:60], mend="read the records whole: lpv.read(...)")
        if model.basis.lags[0] < 0:
            raise InputError("a stream cannot read the scheduling ahead of time", mend="read the records whole")
        self.stage = model.scheduling_stage
        self.model = model if self.stage is None else model.replace(scheduling_stage=None)
        assert model.sample_time is not None
        self.reach = 0 if self.stage is None else memory(self.stage, model.sample_time)
        self.channels = tuple(dict.fromkeys((*(s.name for s in (*model.inputs, *model.outputs)), *model.box.names)))
        self.cut()

    def cut(self) -> None:
        """What comes next does not continue what came before."""
        self.tail: Record | None = None
        self.past = np.zeros((0, self.model.n_outputs))
        self.raw = np.zeros((0, len(self.model.box.names)))
        self.diverged = False

    def run(self, piece: Record) -> tuple[np.ndarray, np.ndarray, int, int | None] | None:
        """The next piece of a record.

        Parameters
        ----------
        piece : Record
            Uniform and finite, with the model's channels; it goes on where the one before ended.

        Returns
        -------
        (free, one_step, first, diverged_at) or None
            Outputs of the samples from `first` of the piece on; None while the piece is too short to begin with.
        """
        piece = self._filtered(piece)
        start = self.model.start
        whole = piece if self.tail is None else _joined(self.tail, piece, self.channels)
        if whole.n_samples <= start:
            self.tail = whole
            return None
        fresh = self.past.shape[0] == 0 and not self.diverged
        first = max(start - (whole.n_samples - piece.n_samples), 0)
        step = predict(self.model, whole, 1)
        if self.diverged:
            free, at = np.full_like(step.output, np.nan), 0
        else:
            run = simulate(self.model, whole, "measured" if fresh or not start else self.past)
            free, at = run.output, run.diverged_at
            self.diverged = at is not None
        if start:
            self.past = np.array(free[-start:])
            self.tail = whole.slice(whole.n_samples - start, whole.n_samples)
        return free[start:], step.output[start:], first, None if at is None else max(at - start, 0)

    def _filtered(self, piece: Record) -> Record:
        """The piece with the scheduling as the coefficients see it."""
        stage = self.stage
        if not isinstance(stage, SchedulingStage):
            return piece
        names = list(self.model.box.names)
        raw = np.vstack([self.raw, piece.matrix(names)])
        assert self.model.sample_time is not None
        p = stage.apply(raw, self.model.sample_time)[len(self.raw):]
        self.raw = raw[max(len(raw) - self.reach, 0):]
        channels = {n: Channel(piece[n], piece.unit(n)) for n in self.channels}
        channels |= {n: Channel(p[:, k], piece.unit(n)) for k, n in enumerate(names)}
        return replace(piece, channels=channels, time=None, roles={})


def _joined(tail: Record, piece: Record, names: tuple[str, ...]) -> Record:
    values = {n: Channel(np.concatenate([tail[n], piece[n]]), piece.unit(n)) for n in names}
    return Record(values, sample_time=piece.sample_time, name=piece.name)


BLOCK = 16_384
"""Samples multiplied at once: two of them fit into a core's cache."""


class LagSums:
    """Σ_j (x(j+k) − x̄)(y(j) − ȳ) for k = 0 … lags, record by record, each about its own means.

    With S_k = Σ_j x(j+k) y(j) over a record of n samples, the centred sum is S_k − x̄ Σ_{j<n−k} y(j) − ȳ Σ_{j≥k} x(j)
    + (n − k) x̄ ȳ: the first and last `lags` samples are kept. Both signals are taken from their first piece's means,
    which keeps the differences free of cancellation.

    Parameters
    ----------
    lags : int
    shortest : int
        Records of no more samples count for nothing.

    Examples
    --------
    >>> sums = LagSums(1, 0)
    >>> for part in ([1.0, 2.0], [4.0, 1.0]):
    ...     sums.add(np.array(part), np.array(part))
    >>> sums.close(), sums.total
    (True, array([ 6., -2.]))
    """

    def __init__(self, lags: int, shortest: int) -> None:
        self.lags, self.shortest = lags, shortest
        self.total, self.n = np.zeros(lags + 1), 0
        self._clear()

    def _clear(self) -> None:
        self.count, self.sums = 0, np.zeros(self.lags + 1)
        self.pivot = (0.0, 0.0)
        self.x_sum = self.y_sum = 0.0
        self.head, self.tail_y = np.zeros(0), np.zeros(0)

    def add(self, x: np.ndarray, y: np.ndarray) -> None:
        """The next samples of a record.

        Parameters
        ----------
        x, y : (n,) arrays
            Of the same times; may be empty.
        """
        if not x.size:
            return
        if not self.count:
            self.pivot = (float(x.mean()), float(y.mean()))
        for first in range(0, x.size, BLOCK):
            part = slice(first, first + BLOCK)
            self._block(x[part] - self.pivot[0], y[part] - self.pivot[1])

    def _block(self, x: np.ndarray, y: np.ndarray) -> None:
        past = np.concatenate([self.tail_y, y])
        before = self.tail_y.size
        for k in range(self.lags + 1):
            reach = min(k, before)  # x(j) meets y(j − k), the first `k − reach` of which stand before the record
            skip = k - reach
            self.sums[k] += x[skip:] @ past[before - reach: past.size - k] if x.size > skip else 0.0
        if self.head.size < self.lags:
            self.head = np.concatenate([self.head, x[: self.lags - self.head.size]])
        self.tail_y = past[max(past.size - self.lags, 0):] if self.lags else past[:0]
        self.x_sum, self.y_sum = self.x_sum + float(x.sum()), self.y_sum + float(y.sum())
        self.count += x.size

    def close(self) -> bool:
        """The end of a record; whether it was long enough to count.

        Returns
        -------
        bool
        """
        n = self.count
        long = n > self.shortest
        if long:
            k = np.arange(self.lags + 1)
            first = np.concatenate([[0.0], np.cumsum(self.head)])[np.minimum(k, self.head.size)]
            last = np.concatenate([[0.0], np.cumsum(self.tail_y[::-1])])[np.minimum(k, self.tail_y.size)]
            mx, my = self.x_sum / n, self.y_sum / n
            centred = self.sums - mx * (self.y_sum - last) - my * (self.x_sum - first) + (n - k) * mx * my
            self.total += np.where(k < n, centred, 0.0)
            self.n += n
        self._clear()
        return long


@dataclass
class _Sums:
    """Of one kind of run along one record: figures need each record's own mean."""

    count: int = 0
    mean: np.ndarray = field(default_factory=lambda: np.zeros(0))
    power: np.ndarray = field(default_factory=lambda: np.zeros(0))
    error: np.ndarray = field(default_factory=lambda: np.zeros(0))
    total: float = 0.0
    diverged: int | None = None

    def add(self, y: np.ndarray, model: np.ndarray, at: int | None) -> None:
        """Measured and modelled samples (Chan, Golub & LeVeque 1983)."""
        if at is not None and self.diverged is None:
            self.diverged = self.count + at
        mean = y.mean(axis=0)
        power, error = np.sum((y - mean) ** 2, axis=0), np.sum((y - model) ** 2, axis=0)
        power[np.ptp(y, axis=0) == 0] = 0.0
        n, both = self.count, self.count + len(y)
        shift = mean - self.mean if n else np.zeros(mean.size)
        self.power = self.power + power + shift**2 * n * len(y) / both if n else power
        self.error = self.error + error if n else error
        self.mean = self.mean + shift * len(y) / both if n else mean
        self.total += float(np.sum(y[:, 0] - model[:, 0]))
        self.count = both

    def figures(self, kind: str, unit: str, start: int) -> Figures:
        """Of the record so far."""
        at = None if self.diverged is None else self.diverged + start
        return figures_of(kind, (self.error, self.power, self.total), self.count, unit, at)


def _pooled(parts: list[_Sums], kind: str, unit: str, start: int) -> Figures:
    """Numerators and denominators summed over records."""
    at = next((p.diverged + start for p in parts if p.diverged is not None), None)
    sums = (np.sum([p.error for p in parts], axis=0), np.sum([p.power for p in parts], axis=0),
            sum(p.total for p in parts))
    return figures_of(kind, sums, sum(p.count for p in parts), unit, at)


class _Residuals:
    """Covariances of the one-step residual, and with the first input."""

    def __init__(self) -> None:
        reach = 4 * LAGS
        self.own, self.cross, self.input = (LagSums(k, reach) for k in (reach, LAGS - 1, reach + LAGS))
        self.short = False

    def add(self, e: np.ndarray, u: np.ndarray | None) -> None:
        self.own.add(e, e)
        if u is not None:
            self.cross.add(e, u)
            self.input.add(u, u)

    def close(self) -> None:
        self.short |= 0 < self.own.count <= 4 * max(OTHER_LAGS)
        for sums in (self.own, self.cross, self.input):
            sums.close()

    def tests(self) -> tuple[ResidualTest, ...]:
        """As `residual_tests` gives them for whole records."""
        n = self.own.n
        if not n:
            return ()
        r = self.own.total / n
        found = [whiteness(r[: LAGS + 1], n, LAGS)]
        if self.cross.n and self.input.total[0] > 0:
            found.append(independence(self.cross.total / n, r, self.input.total / n, n))
        for other in OTHER_LAGS:
            if not (self.short and other == max(OTHER_LAGS)):
                found.append(replace(whiteness(r[: other + 1], n, other), name=f"whiteness over {other} lags"))
        return tuple(found)


def validate_stream(model: Model, chunks: Iterable[Record], *, label: str | None = None,
                    report_progress: Callable[[str], None] = lambda text: None) -> Validation:
    """Figures of a model on records that arrive one after the other; memory does not grow with their number.

    The free run goes on across the pieces of a record. Figures per record and pooled, and the tests of whiteness and of
    independence from the first input, are those of `validate` for the whole records, and so are the remarks on inputs
    beyond the training range and on units. Where the run is wrong (regimes) is not looked for.

    Parameters
    ----------
    model : LPVTransferFunction
        With equation or output noise.
    chunks : iterable of Record
        At the model's rate, e.g. ``read_chunks("hours.parquet")``.
    label : str
        As for `validate`.
    report_progress : callable
        Receives progress.

    Returns
    -------
    Validation

    Raises
    ------
    InputError
        Another kind of model, another rate, no stretch long enough.

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso([[-0.5, 0.0]], [[0, 0], [1.0, 0.5]], Polynomial("p", degree=1), 0.1)
    >>> u, p = np.arange(60.0) % 7, np.arange(60.0) % 5 / 4
    >>> y = np.zeros(60)
    >>> for k in range(1, 60):
    ...     y[k] = 0.5 * y[k - 1] + (1.0 + 0.5 * p[k]) * u[k - 1]
    >>> whole = Record({"u1": u, "p": p, "y1": y}, sample_time=0.1)
    >>> found = validate_stream(model, [whole.slice(0, 20), whole.slice(20, 60)])
    >>> found.overall.free_run.n_samples, bool(found.overall.free_run.esr < 1e-20)
    (59, True)
    """
    runs, tests = StreamedRuns(model), _Residuals()
    names = [s.name for s in model.outputs]
    assert model.sample_time is not None
    cutter, seen, outside = Cutter(model.sample_time), 0, 0.0
    found: list[tuple[str, int, _Sums, _Sums, float]] = []
    compared, rows_of = RangeComparison(model.metadata), RowComparison(model.metadata)
    read_as: dict[tuple[str, tuple[str, ...]], None] = {}

    for raw in chunks:
        chunk = recalled([raw], model.metadata)[0]
        read_as[chunk.name, chunk.notes] = None
        for piece, continues in cutter.cut(chunk, runs.channels):
            if not continues:
                runs.cut()
                tests.close()
                found.append((piece.name, 0, _Sums(), _Sums(), 0.0))
            name, length, free, one, share = found[-1]
            beyond = outside_share(model, piece.matrix(list(model.box.names))) * piece.n_samples
            found[-1] = (name, length + piece.n_samples, free, one, share + beyond)
            seen, outside = seen + piece.n_samples, outside + beyond
            compared.add(piece)
            rows_of.add(piece[names[0]], piece.name, continues)
            ran = runs.run(piece)
            if ran is None:
                continue
            simulated, predicted, first, at = ran
            y = piece.matrix(names)[first:]
            free.add(y, simulated[-len(y):], at)
            one.add(y, predicted[-len(y):], None)
            tests.add(y[:, 0] - predicted[-len(y):, 0], piece[model.inputs[0].name][first:] if model.inputs else None)
        report_progress(f"{seen:,} samples")
    tests.close()
    kept = [row for row in found if row[2].count]
    if not kept:
        raise InputError("no stretch of the stream is long enough", got=f"{seen} samples", mend="give longer records")
    notes = (f"figures of a stream of {seen} samples; regimes are not looked for",)
    label, stated = rows_of.labelled(label)
    notes += stated
    notes += of_records(read_as, ReadAs)
    notes += compared.beyond([s.name for s in model.inputs]) + compared.doubts(runs.channels)
    unit, start, several = model.outputs[0].unit, model.start, Counter(row[0] for row in kept)
    numbers: Counter[str] = Counter()
    rows = []
    for name, length, free, one, share in kept:
        numbers[name] += 1
        shown = f"{name}#{numbers[name]}" if several[name] > 1 else name
        rows.append(RecordFigures(shown, length, free.figures("free-run", unit, start),
                                  one.figures("one-step", unit, start), share / length))
    pair = FigurePair(_pooled([r[2] for r in kept], "free-run", unit, start),
                _pooled([r[3] for r in kept], "one-step", unit, start))
    return Validation(label, pair, tuple(rows), tests.tests(), outside / seen, notes)
