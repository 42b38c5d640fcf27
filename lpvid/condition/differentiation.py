"""Differentiate sampled signals: Savitzky-Golay, central, backward."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise

import numpy as np

from lpvid import _checks
from lpvid.condition.repeated_stamps import one_row_per_stamp, refuse_contradictions, stamp_of_rows
from lpvid.condition.resampling import finite_runs, true_runs
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.remark import Derivation

METHODS = ("savitzky-golay", "central", "backward")
DERIVED = "velocity derived from displacement"
"""how the note begins that a record carries of a velocity that was not measured"""


def differentiate(values: np.ndarray, sample_time: float, *, method: str = "savitzky-golay", window: int = 11,
                  order: int = 4) -> np.ndarray:
    """Derivative of a uniformly sampled signal, in units per second.

    Savitzky-Golay: slope of the polynomial of `order` fitted to `window` samples about each one (one-sided only at
    the ends). Central: (x_{k+1} − x_{k−1})/2T, exact for parabolas, second-order one-sided at the ends. Backward:
    (x_k − x_{k−1})/T, which lags by T/2; its first sample repeats the second. Each run of finite samples is
    differentiated alone; one too short gives NaN.

    Parameters
    ----------
    values : (n,) array
    sample_time : float
        Sampling period [s].
    method : {"savitzky-golay", "central", "backward"}
    window : int
        Odd number of samples under the polynomial; shorter runs take the longest window that fits.
    order : int
        Degree of the polynomial, below `window`.

    Returns
    -------
    (n,) array

    Raises
    ------
    InputError
        Another method, an even window, or an order that is not below it.

    Examples
    --------
    >>> t = 0.01 * np.arange(40)
    >>> bool(np.allclose(differentiate(t**3, 0.01), 3 * t**2))
    True
    """
    _checks.one_of(method, METHODS, "method")
    sample_time = _checks.positive(sample_time, "sample_time", "s")
    window, order = _checks.count(window, "window", at_least=3), _checks.count(order, "order", at_least=1)
    if window % 2 == 0 or order >= window:
        raise InputError("window must be odd and exceed order", got=f"window {window}, order {order}")
    values = np.asarray(values, dtype=float)
    slope = np.full(values.size, np.nan)
    for first, last in finite_runs(values):
        if last - first > 1 and not np.ptp(values[first:last]):
            slope[first:last] = 0.0  # exactly: the rounding of a filter would count as motion
        elif last - first > 1:
            slope[first:last] = _run(values[first:last], sample_time, method, window, order)
    return slope


def _run(values: np.ndarray, sample_time: float, method: str, window: int, order: int) -> np.ndarray:
    if method == "backward":
        steps = np.diff(values) / sample_time
        return np.concatenate((steps[:1], steps))
    window = min(window, values.size - 1 + values.size % 2)
    if method == "central" or window < 3:
        return np.gradient(values, sample_time, edge_order=2 if values.size > 2 else 1)
    from scipy.signal import savgol_filter

    return np.asarray(savgol_filter(values, window, min(order, window - 1), deriv=1, delta=sample_time, mode="interp"))


def with_velocity(record: Record, method: str = "savitzky-golay") -> Record:
    """The record with a `velocity` channel, derived from `displacement` where it was not measured.

    Parameters
    ----------
    record : Record
        Time stamps with gaps are differentiated piece by piece; unsteady stamps by central differences over the
        stamps as read.
    method : {"savitzky-golay", "central", "backward"}

    Returns
    -------
    Record
        Unchanged if it has `velocity` or lacks `displacement`; otherwise with the channel and a note.

    Raises
    ------
    InputError
        Two values of the displacement at one time.

    Examples
    --------
    >>> record = with_velocity(Record({"displacement": [0.0, 0.1, 0.2, 0.3]}, sample_time=0.1))
    >>> record["velocity"].round(6).tolist(), record.notes
    ([1.0, 1.0, 1.0, 1.0], ('velocity derived from displacement (savitzky-golay)',))
    """
    if record.has("velocity") or not record.has("displacement"):
        return record
    _checks.one_of(method, METHODS, "method")
    channel = record.channel("displacement")
    unit = f"{channel.unit}/s" if channel.unit else ""  # taken as SI, as the displacement is
    single = one_row_per_stamp(record, ["displacement"])
    if single is not record:  # rows of one stamp stay apart here: other channels may contradict each other in them
        derived = with_velocity(single, method=method)
        how = next(n for n in derived.notes if isinstance(n, Derivation))
        return record.with_channel("velocity", derived["velocity"][stamp_of_rows(record)], unit, how)
    refuse_contradictions(record, ["displacement"])
    base = record.time_base
    if record.sample_time is not None or (base.orderly and base.steady):
        edges = [0, *base.gaps, record.n_samples]
        parts = [differentiate(channel.values[a:b], base.period, method=method)
                 for a, b in pairwise(edges)]
        how = method
        slope = np.concatenate(parts)
    else:
        how = "central differences over unsteady time stamps"
        slope = _over_stamps(channel.values, record.times, base.gaps)
    return record.with_channel("velocity", slope, unit, Derivation(f"{DERIVED} ({how})"))


DERIVATIONS: Mapping[str, Callable[[Record], Record]] = {"velocity": with_velocity}
"""Channels that others give where they were not measured, each with what derives it of a record."""


def with_derived(records: Iterable[Record], channels: Iterable[str]) -> list[Record]:
    """The records with those of the channels that were not measured and follow from others, as `DERIVATIONS` has them.

    Parameters
    ----------
    records : iterable of Record
    channels : iterable of str
        What a model reads.

    Returns
    -------
    list of Record
    """
    found = list(records)
    for derive in (DERIVATIONS[c] for c in channels if c in DERIVATIONS):
        found = [derive(r) for r in found]
    return found


def _over_stamps(values: np.ndarray, times: np.ndarray, gaps: tuple[int, ...]) -> np.ndarray:
    slope = np.full(values.size, np.nan)
    forward = np.concatenate(([True], np.diff(times) > 0))
    forward[list(gaps)] = False
    good = np.isfinite(values) & np.isfinite(times)
    for first, last in true_runs(good):
        cuts = [first, *(np.flatnonzero(~forward[first + 1:last]) + first + 1).tolist(), last]
        for a, b in pairwise(cuts):
            if b - a > 2:
                slope[a:b] = np.gradient(values[a:b], times[a:b], edge_order=2)
    return slope
