"""Change the sampling rate of a record: anti-aliased, without phase, all channels alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.record import Channel, Record

SAME_RATE = 1e-4
"""relative difference below which two sampling rates, or a rate and a whole multiple of another, are one."""
_LARGEST = 2**28
"""Samples times channels, 2 GB, above which a new rate is taken for a slip."""
_HALF_WIDTH = 25
_KAISER_BETA = 7.857
_TABLE = 1024
WEIGHTS = 131_072
"""weights of the interpolation at a time, 1 MB an array: as many as stay in a processor's cache"""


def resample(record: Record, sample_rate: float) -> Record:
    """The record at another sampling rate, zero phase, every channel through the same kernel.

    Each output sample is x(t) = Σ_k h(t − t_k) x_k / Σ_k h(t − t_k) with h a sinc of cut-off 0.45 times the lower
    rate under a Kaiser window 50 of its periods long: within 1e-3 up to 0.4 times that rate, below −60 dB above
    half of it. At the ends the signal is continued by odd reflection; nothing is computed beyond them. A whole
    ratio of rates keeps every m-th instant. Missing samples stay missing: each run of finite samples is resampled
    on its own. Unsteady time stamps are first brought onto a uniform clock of their mean rate by a cubic spline
    through the stamps as read.

    Parameters
    ----------
    record : Record
        Uniform, or with unsteady stamps that increase and have no gaps (cut it with `segments` first).
    sample_rate : float
        New rate [Hz].

    Returns
    -------
    Record
        Uniform, with a note of what was done.

    Raises
    ------
    InputError
        Time stamps with gaps, duplicates or backward steps.

    Examples
    --------
    >>> t = np.arange(600) / 300
    >>> slow = resample(Record({"x": np.sin(2 * np.pi * 5 * t)}, sample_time=1 / 300), 100.0)
    >>> slow.n_samples, bool(np.abs(slow["x"] - np.sin(2 * np.pi * 5 * slow.times)).max() < 1e-3)
    (200, True)
    """
    sample_rate = _checks.positive(sample_rate, "sample_rate", "Hz")
    if record.sample_time is None and record.time_base.gaps:
        raise InputError(f"record '{record.name}' cannot be resampled", got=f"{len(record.time_base.gaps)} time gap(s)",
                         mend="cut it into segments first")
    uniform, note = on_clock(record)
    assert uniform.sample_time is not None
    old_rate = 1.0 / uniform.sample_time
    if abs(sample_rate - old_rate) <= SAME_RATE * old_rate:
        return replace(uniform, sample_time=1.0 / sample_rate, time=None,
                       notes=(*uniform.notes, note) if note else uniform.notes)
    step = old_rate / sample_rate
    whole = max(round(step), 1)
    if step > 1 and abs(step - whole) <= SAME_RATE * whole:
        step = float(whole)
    wanted = (uniform.n_samples - 1) / step + 1
    if wanted * len(uniform.channels) > _LARGEST:
        raise InputError(f"record '{record.name}' cannot be resampled to {sample_rate:.6g} Hz",
                         got=f"{wanted:.3g} samples of {len(uniform.channels)} channel(s)", mend="a lower rate")
    positions = step * np.arange(int(np.floor(wanted + 1e-9)))
    new = _interpolate_runs(np.column_stack([c.values for c in uniform.channels.values()]), positions, max(step, 1.0))
    channels = {k: replace(c, values=new[:, i]) for i, (k, c) in enumerate(uniform.channels.items())}
    stated = f"resampled from {old_rate:.6g} Hz to {sample_rate:.6g} Hz (anti-aliased, zero phase)"
    if step < 1:
        stated += (f": nothing was recorded above {0.5 * old_rate:.6g} Hz, {1 / step:.3g} samples stand for one that "
                   "was measured, and a count of samples or equations overstates what the data hold")
    return replace(uniform, channels=channels, sample_time=1.0 / sample_rate, time=None,
                   notes=(*uniform.notes, *([note] if note else []), stated))


def on_clock(record: Record, period: float | None = None) -> tuple[Record, str]:
    """The record on a uniform clock (of `period` [s], or its own mean rate), and what was done to it.

    Parameters
    ----------
    record : Record
        A uniform one stays as it is.
    period : float, optional
        [s]; left out, the mean interval of the record.

    Returns
    -------
    Record
        NaN between runs of finite samples.
    str
        Empty where nothing was done.

    Raises
    ------
    InputError
        Time stamps out of order, or a single sample.
    """
    if record.sample_time is not None:
        return replace(record, time=None), ""
    if not record.time_base.orderly or record.n_samples < 2:
        raise InputError(f"record '{record.name}' cannot be resampled", got="time stamps out of order or too few",
                         mend="cut it into segments first")
    assert record.time is not None
    from scipy.interpolate import CubicSpline

    stamps = record.time
    if period is None:  # the mean over the whole record, so that first and last sample keep their instants
        period = float(stamps[-1] - stamps[0]) / (record.n_samples - 1)
    slack = 1e-9 * period
    clock = record.start + period * np.arange(int(np.floor((stamps[-1] - stamps[0] + slack) / period)) + 1)
    channels: dict[str, Channel] = {}
    for name, channel in record.channels.items():
        values = np.full(clock.size, np.nan)
        for first, last in finite_runs(channel.values):
            inside = (clock >= stamps[first] - slack) & (clock <= stamps[last - 1] + slack)
            if last - first > 1:
                values[inside] = CubicSpline(stamps[first:last], channel.values[first:last])(clock[inside])
        channels[name] = replace(channel, values=values)
    note = f"unsteady time stamps brought onto a uniform clock of {1 / period:.6g} Hz by cubic spline"
    return replace(record, channels=channels, sample_time=period, time=None, start=record.start), note


def finite_runs(values: np.ndarray) -> list[tuple[int, int]]:
    """(first, last+1) of every unbroken run of finite samples of an (n,) or (n, channels) array.

    Parameters
    ----------
    values : (n,) or (n, channels) array
        Of several channels all must be finite.

    Returns
    -------
    list of (int, int)
    """
    good = np.isfinite(values) if values.ndim == 1 else np.isfinite(values).all(axis=1)
    return true_runs(np.asarray(good))


def true_runs(good: np.ndarray) -> list[tuple[int, int]]:
    """(first, last+1) of every unbroken run of True.

    Parameters
    ----------
    good : (n,) bool array

    Returns
    -------
    list of (int, int)
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], good, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _interpolate_runs(values: np.ndarray, positions: np.ndarray, width: float) -> np.ndarray:
    """Interpolate (n, channels) at sample positions, every channel over each of its finite runs alone."""
    result = np.full((positions.size, values.shape[1]), np.nan)
    whole = np.isfinite(values).all(axis=0)
    if whole.any():
        result[:, whole] = interpolate(values[:, whole], positions, width, cutoff=0.45)
    for column in np.flatnonzero(~whole):
        for first, last in finite_runs(values[:, column]):
            inside = (positions >= first) & (positions <= last - 1)
            result[inside, column] = interpolate(values[first:last, column:column + 1], positions[inside] - first,
                                                 width, cutoff=0.45)[:, 0]
    return result


def interpolate(values: np.ndarray, positions: np.ndarray, width: float = 1.0, cutoff: float = 0.5) -> np.ndarray:
    """Band-limited interpolation of (n, channels) at sample positions; `width` stretches the kernel.

    The kernel sinc(2·cutoff·x/width) under a Kaiser window of ±25·width samples, weights normalised to sum one.
    Positions within [0, n−1]; the signal is continued by odd reflection.

    Parameters
    ----------
    values : (n, channels) array
        Finite.
    positions : (m,) array
        In samples.
    width : float
        1 keeps the band; m takes out what positions m samples apart would fold back.
    cutoff : float
        Edge of the band as a share of the sampling rate, for `width` 1.

    Returns
    -------
    (m, channels) array
    """
    n = values.shape[0]
    if positions.size == 0:
        return np.empty((0, values.shape[1]))
    if n == 1:
        return np.repeat(values, positions.size, axis=0)
    half = int(np.ceil(_HALF_WIDTH * width))
    padded = np.pad(values, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    if positions.size == 1:
        offset = np.arange(padded.shape[0]) - half - positions[0]
        near = np.abs(offset) <= half
        weights = _kernel(offset[near], width, cutoff)
        return (weights @ padded[near] / weights.sum())[None, :]
    step = positions[1] - positions[0]
    if positions[0] == 0 and step == round(step) and np.array_equal(positions, step * np.arange(positions.size)):
        return _on_grid(padded, int(step), half, width, cutoff)[: positions.size]
    return _off_grid(padded, positions, half, width, cutoff)


def _kernel(offset: np.ndarray, width: float, cutoff: float) -> np.ndarray:
    scaled = offset / width
    inside = np.clip(1.0 - (scaled / _HALF_WIDTH) ** 2, 0.0, None)
    window = np.where(np.abs(scaled) <= _HALF_WIDTH, np.i0(_KAISER_BETA * np.sqrt(inside)), 0.0)
    return np.sinc(2 * cutoff * scaled) * window


def _on_grid(padded: np.ndarray, step: int, half: int, width: float, cutoff: float) -> np.ndarray:
    """Every `step`-th instant: one symmetric filter."""
    from scipy.signal import upfirdn

    taps = _kernel(np.arange(-half, half + 1.0), width, cutoff)
    taps /= taps.sum()
    lead = (-2 * half) % step  # so that the first wanted output falls on the decimated grid
    shifted = np.concatenate((np.zeros((lead, padded.shape[1])), padded))
    return np.asarray(upfirdn(taps, shifted, up=1, down=step, axis=0)[(2 * half + lead) // step:])


def _off_grid(padded: np.ndarray, positions: np.ndarray, half: int, width: float, cutoff: float) -> np.ndarray:
    """Any instants: a sparse matrix of kernel weights, so many rows at a time as have `WEIGHTS` of them."""
    from scipy.sparse import csr_array

    grid = np.arange(-half - 1, half + 1 + 0.5 / _TABLE, 1.0 / _TABLE)
    table = _kernel(grid, width, cutoff)
    taps = 2 * half
    result = np.empty((positions.size, padded.shape[1]))
    chunk, padded = max(1, WEIGHTS // taps), np.vstack((padded, padded[-1:]))
    for begin in range(0, positions.size, chunk):
        at = positions[begin:begin + chunk]
        base = np.floor(at).astype(np.int64)
        columns = base[:, None] + np.arange(1, taps + 1)[None, :]
        offsets = columns - half - at[:, None]
        weights = np.interp(offsets, grid, table)
        weights /= weights.sum(axis=1, keepdims=True)
        matrix = csr_array((weights.ravel(), columns.ravel(), np.arange(0, at.size * taps + 1, taps)),
                           shape=(at.size, padded.shape[0]))
        result[begin:begin + chunk] = matrix @ padded
    return result
