"""Split records into training and held-out parts that do not share what they should not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from lpvid import _checks
from lpvid.condition.resampling import true_runs
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.record import Record


class EmptyFold(InputError):
    """A fold without samples to train on or to hold out: the records are too short for so many folds and such a gap."""


@dataclass(frozen=True)
class Repetition:
    """A signal repeats itself: x(t + seconds) = sign·x(t).

    Attributes
    ----------
    seconds : float
        Smallest lag of repetition [s].
    sign : int
        +1 periodic, −1 antiperiodic (it then also repeats after twice that lag).
    residual : float
        rms of what does not repeat, over the rms of the signal.
    """

    seconds: float
    sign: int
    residual: float


def split_tail(record: Record, fraction: float = 1 / 3) -> tuple[Record, Record]:
    """Training part and held-out tail; the last third starts at sample floor(2N/3).

    Parameters
    ----------
    record : Record
    fraction : float
        Share of the samples held out, between 0 and 1.

    Returns
    -------
    training, held_out : Record

    Raises
    ------
    InputError
        One of the parts would be empty.

    Examples
    --------
    >>> a, b = split_tail(Record({"x": np.arange(10.0)}, sample_time=1.0))
    >>> a.n_samples, b["x"].tolist()
    (6, [6.0, 7.0, 8.0, 9.0])
    """
    share = Fraction(_checks.real(fraction, "fraction")).limit_denominator(10_000)
    cut = int((1 - share) * record.n_samples)
    if not 0 < cut < record.n_samples:
        raise InputError(f"record '{record.name}' cannot be split: a held-out share must leave samples on both sides",
                         got=f"{fraction:g} of {record.n_samples} samples",
                         mend="another share, or a longer record")
    return record.slice(0, cut), record.slice(cut, record.n_samples)


def blocks(record: Record, seconds: float, gap: float = 0.0) -> list[Record]:
    """Consecutive blocks of `seconds`, `gap` seconds apart, named ``stem#1``, ``stem#2``, …; a short rest is left out.

    Parameters
    ----------
    record : Record
        Uniform.
    seconds, gap : float
        Length of each block and of what is left out between two [s].

    Returns
    -------
    list of Record

    Raises
    ------
    InputError
        A block longer than the record.
    """
    period = _uniform(record)
    length = max(round(_checks.positive(seconds, "seconds", "s") / period), 1)
    stride = length + _samples(gap, period)
    if length > record.n_samples:
        raise InputError("a block is longer than the record", got=f"{seconds:g} s of {record.duration:g} s")
    return [replace(record.slice(a, a + length), time=None, name=f"{record.name}#{i}")
            for i, a in enumerate(range(0, record.n_samples - length + 1, stride), start=1)]


def folds(records: Record | Sequence[Record], k: int, gap_seconds: float = 0.0, *,
          period: float | None = None) -> list[tuple[list[Record], list[Record]]]:
    """k pairs (training, held out) of contiguous blocks, with a gap at each border between them.

    Fold j holds out the j-th of k equal blocks of every record. When the excitation repeats every `period` seconds
    (`repetition_period`), time blocks share the same pattern; then fold j holds out the j-th of k stretches of the
    *pattern*, wherever it occurs, so that no held-out stretch was trained on.

    Parameters
    ----------
    records : Record or sequence of Record
        Uniform.
    k : int
        Number of folds, at least 2.
    gap_seconds : float
        Left out of the training part on either side of each held-out block [s]: the memory of the system.
    period : float, optional
        Repetition of the excitation [s]; the antiperiod where it repeats with changed sign.

    Returns
    -------
    list of (list of Record, list of Record)

    Raises
    ------
    EmptyFold
        A fold whose training or held-out part is empty; an InputError.
    InputError
        Fewer than two folds, a negative gap, or a record with unsteady time stamps.

    Examples
    --------
    >>> record = Record({"x": np.arange(9.0)}, sample_time=1.0)
    >>> [[p["x"].tolist() for p in training] for training, held_out in folds(record, 3, 1.0)]
    [[[4.0, 5.0, 6.0, 7.0, 8.0]], [[0.0, 1.0], [7.0, 8.0]], [[0.0, 1.0, 2.0, 3.0, 4.0]]]
    """
    listed = as_records(records)
    k = _checks.count(k, "k", at_least=2)
    result: list[tuple[list[Record], list[Record]]] = []
    for fold in range(k):
        training: list[Record] = []
        held_out: list[Record] = []
        for record in listed:
            sample_time = _uniform(record)
            held = _held(record.n_samples, k, fold, None if period is None else period / sample_time)
            gap = _samples(gap_seconds, sample_time)
            near = np.convolve(held, np.ones(2 * gap + 1), mode="same") > 0.5 if gap else held
            held_out += _runs(record, held)
            training += _runs(record, ~near)
        if not training or not held_out:
            raise EmptyFold("a fold has no samples left", got=f"fold {fold + 1} of {k}",
                            mend="fewer folds or a smaller gap")
        result.append((training, held_out))
    return result


def _held(n: int, k: int, fold: int, period: float | None) -> np.ndarray:
    if period is None:
        phase = np.arange(n) * k // n
    else:
        _checks.positive(period, "period", "s")
        phase = np.minimum((np.mod(np.arange(n) + 1e-6, period) / period * k).astype(int), k - 1)
    return phase == fold


def _runs(record: Record, mask: np.ndarray) -> list[Record]:
    runs = true_runs(mask)
    return [replace(record.slice(a, b), time=None, name=f"{record.name}#{i}" if len(runs) > 1 else record.name)
            for i, (a, b) in enumerate(runs, start=1)]


def _uniform(record: Record) -> float:
    if record.sample_time is None:
        raise InputError(f"record '{record.name}' must be uniform to be split by time", got="unsteady time stamps",
                         mend="cut it into segments first")
    return record.sample_time


def _samples(seconds: float, period: float) -> int:
    if _checks.real(seconds, "gap") < 0:
        raise InputError("a gap must not be negative", got=f"{seconds:g} s")
    return int(np.ceil(seconds / period - 1e-9))


def repetition_period(values: np.ndarray, sample_time: float, *, tolerance: float = 0.05) -> Repetition | None:
    """Smallest lag after which a signal repeats itself, or its negative, over the whole record.

    Lags beyond the first loss of correlation count, up to half the record; the residual
    √(mean (x(t+T) ∓ x(t))²/2)/rms(x) must stay below `tolerance` (independent noise of rms s gives s/rms(x)).

    Parameters
    ----------
    values : (n,) array
        Finite.
    sample_time : float
        Sampling period [s].
    tolerance : float
        Largest residual that counts as repetition.

    Returns
    -------
    Repetition or None

    Examples
    --------
    >>> pattern = np.random.default_rng(1).normal(size=100)
    >>> repetition_period(np.tile(np.concatenate((pattern, -pattern)), 3), 0.05)
    Repetition(seconds=5.0, sign=-1, residual=0.0)
    """
    x = _checks.finite(_checks.frozen_array(values, "values", ndim=1), "values")
    x = x - x.mean()
    n, reach = x.size, x.size // 2
    if reach < 4 or not np.ptp(x) > 0:
        return None
    lag_products = _autocorrelation(x)[: reach + 1]
    energy = np.cumsum(np.insert(x**2, 0, 0.0))
    head, tail = energy[n - np.arange(reach + 1)], energy[n] - energy[np.arange(reach + 1)]
    both = np.maximum(head + tail, 1e-300)
    strength = 2 * lag_products / both
    lost = np.flatnonzero(np.abs(strength) < 0.5)
    if not lost.size:
        return None
    residual = np.sqrt(np.maximum(1 - np.abs(strength), 0.0))
    # a lag that falls between two samples leaves its mark on both neighbours: judge the interpolated peak
    best = np.flatnonzero(residual[lost[0]:] < max(3 * tolerance, 0.1)) + lost[0]
    for lag in _peaks(np.abs(strength), best):
        shift, peak = _parabola(np.abs(strength), lag)
        level = float(np.sqrt(max(1 - min(peak, 1.0), 0.0)))
        if level < 1e-6:
            level = 0.0
        if level < tolerance:
            return Repetition(float((lag + shift) * sample_time), int(np.sign(strength[lag])), level)
    return None


def _autocorrelation(x: np.ndarray) -> np.ndarray:
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(2 * x.size, real=True)
    return np.asarray(irfft(np.abs(np.asarray(rfft(x, size))) ** 2, size))[: x.size]


def _peaks(strength: np.ndarray, candidates: np.ndarray) -> list[int]:
    return [int(c) for c in candidates if (c == 0 or strength[c] >= strength[c - 1])
            and (c + 1 == strength.size or strength[c] >= strength[c + 1])]


def _parabola(values: np.ndarray, at: int) -> tuple[float, float]:
    """Offset and height of the parabola through three neighbours."""
    if at == 0 or at + 1 >= values.size:
        return 0.0, float(values[at])
    left, mid, right = values[at - 1], values[at], values[at + 1]
    bend = left - 2 * mid + right
    if bend >= -1e-15 or 1 - mid < 1e-12:
        return 0.0, float(mid)
    shift = 0.5 * (left - right) / bend
    return float(shift), float(mid - 0.25 * (left - right) * shift)


def leaks(training: Record | Sequence[Record], held_out: Record | Sequence[Record], channel: str, *,
          window: float | None = None, tolerance: float = 0.05) -> float | None:
    """Share of the held-out samples whose stretch of `channel` also occurs, with either sign, in the training part.

    Held-out stretches of `window` seconds are sought in every training record by normalised correlation; one counts
    as repeated when what does not repeat is below `tolerance` of its rms.

    Parameters
    ----------
    training, held_out : Record or sequence of Record
        Uniform, of one rate; `channel` finite.
    channel : str
        Name or role of the excitation.
    window : float, optional
        Length of a stretch [s]; by default long enough for eight independent samples of the signal, at least 32.
    tolerance : float

    Returns
    -------
    float or None
        None when nothing repeats. A sine repeats itself always.
    """
    train = [training] if isinstance(training, Record) else list(training)
    held = as_records(held_out)
    sample_time = _uniform(held[0])
    size = round(window / sample_time) if window else max(32, max(8 * _memory(r[channel]) for r in held))
    repeated = total = 0
    for record in held:
        x = record[channel]
        for first in range(0, x.size - size + 1, size):
            stretch = x[first:first + size]
            if not np.ptp(stretch) > 1e-12 * max(float(np.abs(x).max()), 1e-300):
                continue
            total += size
            if any(_occurs(stretch, other[channel], tolerance) for other in train):
                repeated += size
    return repeated / total if repeated else None


def _memory(x: np.ndarray) -> int:
    """Lag [samples] at which the autocorrelation has fallen to one half."""
    c = _autocorrelation(x - x.mean())
    below = np.flatnonzero(c < 0.5 * c[0])
    return int(below[0]) if below.size else x.size


def _occurs(stretch: np.ndarray, x: np.ndarray, tolerance: float) -> bool:
    from scipy.signal import correlate

    n = stretch.size
    if x.size < n:
        return False
    products = correlate(x, stretch, mode="valid", method="fft")
    energy = np.cumsum(np.insert(x**2, 0, 0.0))
    both = energy[n:] - energy[:-n] + float(stretch @ stretch)
    strength = 2 * np.abs(products) / np.maximum(both, 1e-300)
    at = int(np.argmax(strength))
    return bool(np.sqrt(max(1 - min(_parabola(strength, at)[1], 1.0), 0.0)) < tolerance)
