"""validate for files larger than memory: the figures of a whole record from its pieces."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid.condition.pieces import Cutter
from lpvid.errors import InputError
from lpvid.model.hull import outside_share
from lpvid.record import Record
from lpvid.simulation import Model
from lpvid.training_fingerprint import SAMPLES, seen_records
from lpvid.validation.figures import FigurePair, Figures, RecordFigures, figures_of
from lpvid.validation.lag_sums import LagSums
from lpvid.validation.report import OTHER_LAGS, Validation
from lpvid.validation.residuals import LAGS, ResidualTest, independence, whiteness
from lpvid.validation.streamed_runs import StreamedRuns


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


def pooled(parts: list[_Sums], kind: str, unit: str, start: int) -> Figures:
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


def validate_stream(model: Model, chunks: Iterable[Record], *, label: str = "held-out",
                    report_progress: Callable[[str], None] = lambda text: None) -> Validation:
    """Figures of a model on records that arrive one after the other; memory does not grow with their number.

    The free run goes on across the pieces of a record. Figures per record and pooled, and the tests of whiteness and of
    independence from the first input, are those of `validate` for the whole records. Where the run is wrong (regimes)
    is not looked for.

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
    cutter, seen, outside, familiar_to = Cutter(model.sample_time), 0, 0.0, []
    found: list[tuple[str, int, _Sums, _Sums, float]] = []

    for chunk in chunks:
        for piece, continues in cutter.cut(chunk, runs.channels):
            if not continues:
                runs.cut()
                tests.close()
                found.append((piece.name, 0, _Sums(), _Sums(), 0.0))
                familiar_to += seen_records(model.metadata, [piece.slice(0, SAMPLES)], names[0])
            name, length, free, one, share = found[-1]
            beyond = outside_share(model, piece.matrix(list(model.box.names))) * piece.n_samples
            found[-1] = (name, length + piece.n_samples, free, one, share + beyond)
            seen, outside = seen + piece.n_samples, outside + beyond
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
    if familiar_to and label == "held-out":
        label = "training" if len(familiar_to) == len(kept) else "partly training"
    unit, start, several = model.outputs[0].unit, model.start, Counter(row[0] for row in kept)
    numbers: Counter[str] = Counter()
    rows = []
    for name, length, free, one, share in kept:
        numbers[name] += 1
        shown = f"{name}#{numbers[name]}" if several[name] > 1 else name
        rows.append(RecordFigures(shown, length, free.figures("free-run", unit, start),
                                  one.figures("one-step", unit, start), share / length))
    pair = FigurePair(pooled([r[2] for r in kept], "free-run", unit, start),
                pooled([r[3] for r in kept], "one-step", unit, start))
    return Validation(label, pair, tuple(rows), tests.tests(), outside / seen,
                      (f"figures of a stream of {seen} samples; regimes are not looked for",))
