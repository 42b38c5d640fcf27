"""Delay between two signals, and shifting a channel by a fraction of a sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lpvid import _checks
from lpvid.condition.resampling import finite_runs, interpolate
from lpvid.errors import InputError
from lpvid.record import Record


def delay(reference: np.ndarray, delayed: np.ndarray, sample_time: float, max_delay: float) -> float:
    """Delay τ [s] for which delayed(t) ≈ g·reference(t − τ) + c fits best, to a fraction of a sample.

    The correlation of a fixed middle stretch of `reference` with `delayed`, whole sample by whole sample, of either
    sign, finds τ within one sample; Gauss-Newton on the band-limited interpolation of `reference` does the rest.
    Negative when `delayed` leads.

    Parameters
    ----------
    reference, delayed : (n,) array
        Finite; related linearly.
    sample_time : float
        Sampling period [s].
    max_delay : float
        Largest |τ| considered [s].

    Returns
    -------
    float

    Raises
    ------
    InputError
        Signals too short for `max_delay`, unequal, not finite or constant.

    Examples
    --------
    >>> t = 0.01 * np.arange(1000)
    >>> x = np.sin(2 * np.pi * t) + 0.5 * np.sin(2 * np.pi * 2.7 * t)
    >>> y = 3 - 2 * (np.sin(2 * np.pi * (t - 0.0234)) + 0.5 * np.sin(2 * np.pi * 2.7 * (t - 0.0234)))
    >>> round(delay(x, y, 0.01, 0.1), 5)
    0.0234
    """
    sample_time = _checks.positive(sample_time, "sample_time", "s")
    x = _checks.finite(_checks.frozen_array(reference, "reference", ndim=1), "reference")
    y = _checks.finite(_checks.frozen_array(delayed, "delayed", ndim=1), "delayed")
    reach = int(np.ceil(_checks.positive(max_delay, "max_delay", "s") / sample_time)) + 1
    margin = reach + 2
    if x.size != y.size or x.size < 4 * margin:
        raise InputError("delay needs two signals of one length, four times longer than max_delay",
                         got=f"{x.size} and {y.size} samples for {reach} samples of delay")
    if np.ptp(x) == 0 or np.ptp(y) == 0:
        raise InputError("delay needs two signals that move", got="a constant")
    whole = _whole_delay(x, y, reach, margin)
    return _refine(x, y, float(whole), reach, margin) * sample_time


def _whole_delay(x: np.ndarray, y: np.ndarray, reach: int, margin: int) -> int:
    """Whole-sample lag of the largest |correlation coefficient|."""
    from scipy.signal import correlate

    inner = x[margin:-margin] - x[margin:-margin].mean()
    outer = y[margin - reach:y.size - margin + reach]
    outer = outer - outer.mean()
    products = correlate(outer, inner, mode="valid", method="fft")
    n = inner.size
    sums, squares = np.cumsum(np.insert(outer, 0, 0.0)), np.cumsum(np.insert(outer**2, 0, 0.0))
    energy = squares[n:] - squares[:-n] - (sums[n:] - sums[:-n]) ** 2 / n
    strength = np.abs(products) / np.sqrt(np.maximum(energy, 1e-12 * squares[-1]))
    return int(np.argmax(strength)) - reach


def _refine(x: np.ndarray, y: np.ndarray, lag: float, reach: int, margin: int) -> float:
    """Least squares over gain, offset and lag."""
    rows = np.arange(margin, y.size - margin)
    target = y[rows]
    bounds = (max(lag - 1, -reach), min(lag + 1, reach))
    slope_of_x = np.gradient(x)
    both = np.column_stack((x, slope_of_x))
    for _ in range(8):
        moved = interpolate(both, np.clip(rows - lag, 0, x.size - 1))
        design = np.column_stack((moved, np.ones(rows.size)))
        gain, moving, _ = np.linalg.lstsq(design, target, rcond=None)[0]
        if gain == 0:
            break
        step = float(np.clip(-moving / gain, -0.5, 0.5))
        lag = float(np.clip(lag + step, *bounds))
        if abs(step) < 1e-7:
            break
    return lag


def align(record: Record, channel: str, seconds: float) -> Record:
    """The record with one channel brought forward by `seconds`: its new value at t is the old one at t + seconds.

    Band-limited interpolation; the ends where the moved channel has no samples are cut off all channels.

    Parameters
    ----------
    record : Record
        Uniform.
    channel : str
        Name or role; finite.
    seconds : float
        Delay to take out [s]; negative pushes the channel back.

    Returns
    -------
    Record
        Shorter by the shift rounded up to whole samples, with a note.

    Raises
    ------
    InputError
        Unsteady time stamps, a channel that is not finite throughout, or a shift as long as the record.

    Examples
    --------
    >>> record = Record({"a": [1.0, 2, 3, 4], "late": [9.0, 1, 2, 3]}, sample_time=0.5)
    >>> align(record, "late", 0.5).matrix(["a", "late"]).round(9).tolist()
    [[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]
    """
    name = record.resolve(channel)
    if record.sample_time is None:
        raise InputError(f"record '{record.name}' must be uniform to be aligned", got="unsteady time stamps",
                         mend="cut it into segments first")
    values = record[name]
    if finite_runs(values) != [(0, values.size)]:
        raise InputError(f"record '{record.name}', channel '{name}' must be finite to be moved",
                         mend="cut it into segments first")
    shift = _checks.real(seconds, "seconds") / record.sample_time
    if abs(shift - round(shift)) < 1e-9:
        shift = float(round(shift))
    lost = int(np.ceil(abs(shift)))
    if lost >= record.n_samples:
        raise InputError("the shift is longer than the record", got=f"{seconds:g} s of {record.duration:g} s")
    first, last = (0, record.n_samples - lost) if shift >= 0 else (lost, record.n_samples)
    moved = interpolate(values[:, None], np.arange(first, last) + shift)[:, 0]
    cut = record.slice(first, last)
    channels = {**cut.channels, name: replace(cut.channels[name], values=moved)}
    note = f"'{name}' brought forward by {1e3 * seconds:.6g} ms"
    return replace(cut, channels=channels, time=None, notes=(*cut.notes, note))
