"""What a column of time stamps states: period, jitter, gaps, duplicates, backward steps."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from lpvid.errors import InputError

JITTER_LIMIT = 0.01
"""rms deviation of the sampling intervals, in periods, above which a record is not uniform."""
GAP_FACTOR = 1.5
"""an interval longer than this many periods is a gap, unless the stamps behind it are back on the clock."""
WINDOW = 16
"""stamps on either side of a long interval by which the clock is compared. Of stamps that keep their order the jitter
is about a quarter of a period rms at most; the difference of two medians of 16 then has 0.11 periods rms, a fourth of
the half period that decides."""
FEW_FAULTS = 3
"""up to this many odd intervals among otherwise equal ones are missing or repeated rows, not rounding."""


@dataclass(frozen=True)
class TimeBase:
    """Summary of a column of time stamps.

    Attributes
    ----------
    n_samples : int
    start : float
        First time stamp [s].
    period : float
        Sampling period [s]: the mean over the intervals that are no gaps, whose jitter cancels in the sum (nan for
        fewer than two samples).
    jitter_rms, jitter_max : float
        Deviation of the intervals from the period, in periods; gaps, duplicates and backward steps left out.
    resolution : float
        Step to which the time stamps were rounded when printed [s]; 0 if they were not.
    rounded : bool
        True when the deviations are no more than that rounding: the clock is uniform, the print is not.
    gaps, duplicates, backward : tuple of int
        Rows (0-based) *before* which the gap stands, or at which time repeats or runs backward.
    invalid : tuple of int
        Rows whose time stamp is not a finite number.
    """

    n_samples: int
    start: float
    period: float
    jitter_rms: float
    jitter_max: float
    resolution: float
    rounded: bool
    gaps: tuple[int, ...]
    duplicates: tuple[int, ...]
    backward: tuple[int, ...]
    invalid: tuple[int, ...]

    @property
    def orderly(self) -> bool:
        """True when time increases at every sample."""
        return not (self.duplicates or self.backward or self.invalid)

    @property
    def steady(self) -> bool:
        """True when the intervals agree within `JITTER_LIMIT` or within the print's rounding."""
        return self.jitter_rms <= JITTER_LIMIT or self.rounded

    @property
    def uniform(self) -> bool:
        """True when one period describes every sample: orderly, steady, no gaps."""
        return self.orderly and self.steady and not self.gaps and self.n_samples > 1


def analyse_time(time: np.ndarray) -> TimeBase:
    """Summarise time stamps.

    Parameters
    ----------
    time : (n,) array
        Time stamps [s].

    Returns
    -------
    TimeBase

    Examples
    --------
    >>> base = analyse_time(np.array([0.0, 0.1, 0.2, 0.5, 0.6]))
    >>> base.gaps, round(base.period, 6), base.uniform
    ((3,), 0.1, False)
    """
    time = np.asarray(time, dtype=float)
    n = time.size
    finite = np.isfinite(time)
    invalid = tuple(np.flatnonzero(~finite).tolist())
    if invalid or n < 2:
        return TimeBase(n, float(time[finite][0]) if finite.any() else 0.0, np.nan, np.nan, np.nan, 0.0, False,
                        (), (), (), invalid)
    steps = np.diff(time)
    forward = steps[steps > 0]
    coarse = float(np.median(forward)) if forward.size else np.nan
    long = steps > GAP_FACTOR * coarse
    if forward.size == steps.size:  # repeated and backward stamps are faults by themselves
        long[long] = ~_caught_up(time, np.flatnonzero(long))
    regular = (steps > 0) & ~long
    gaps = np.flatnonzero(long) + 1
    duplicates = np.flatnonzero(steps == 0) + 1
    backward = np.flatnonzero(steps < 0) + 1
    resolution = _print_resolution(time)
    rounded, period = False, float(np.mean(steps[regular])) if regular.any() else np.nan
    if not backward.size and forward.size and not _few_faults(time, coarse, gaps.size + duplicates.size):
        fitted = _rounded_period(time - time[0], resolution)
        if fitted is not None:
            rounded, period = True, fitted
            gaps = duplicates = np.empty(0, dtype=int)
    deviation = (steps[regular] - period) / period if regular.any() else np.array([np.nan])
    return TimeBase(
        n_samples=n, start=float(time[0]), period=period,
        jitter_rms=float(np.sqrt(np.mean(deviation**2))), jitter_max=float(np.max(np.abs(deviation))),
        resolution=float(resolution.max()), rounded=rounded,
        gaps=tuple(gaps.tolist()), duplicates=tuple(duplicates.tolist()), backward=tuple(backward.tolist()),
        invalid=invalid,
    )


def _caught_up(time: np.ndarray, long: np.ndarray) -> np.ndarray:
    """(m,) True for a long interval behind which the stamps are back on the clock: one came late, no row is missing.

    Stamps t_k = (k + s_k) T + e_k with white jitter e and s_k missing rows: an interval of them has the error
    e_{k+1} − e_k, which the intervals beside it take back, while a missing row moves all later stamps by T. Compared
    are the medians of t_j − j T over up to `WINDOW` stamps before and behind; half a period decides.

    Parameters
    ----------
    time : (n,) array
        [s], finite.
    long : (m,) array
        Intervals, by the stamp before each.
    """
    if not long.size:
        return np.zeros(0, dtype=bool)
    period, window = _median_period(time)
    if window < 4 or not period > 0 or not _white(time, window):
        return np.zeros(long.size, dtype=bool)
    none = np.zeros(time.size - 1)
    late = _phase_steps(time, long, period, none, window) > 0.5 * period
    found = none.copy()
    found[long[late]] = np.diff(time)[long[late]]
    # once more without what lies beyond a longer gap, which moves the stamps there too
    late[late] = _phase_steps(time, long[late], period, found, window) > 0.5 * period
    return ~late


def _phase_steps(time: np.ndarray, long: np.ndarray, period: float, gaps: np.ndarray, window: int
                 ) -> np.ndarray:
    """(m,) how much later the clock is behind each long interval than before it [s].

    Parameters
    ----------
    time : (n,) array
        [s]
    long : (m,) array
        Intervals, by the stamp before each.
    period : float
        [s]
    gaps : (n-1,) array
        Length of each interval that passes for a gap [s], 0 for others; stamps beyond a longer gap are left out.
    window : int
        Stamps on either side.
    """
    steps = np.zeros(long.size)
    reach = np.arange(window)
    for first in range(0, long.size, 4096):
        at = long[first:first + 4096, None]
        phases = []
        for way, start in ((-1, at), (1, at + 1)):
            index, beside = start + way * reach, at + way * reach
            longer = (gaps[np.clip(beside, 0, gaps.size - 1)] > gaps[at]) & (beside >= 0) & (beside < gaps.size)
            usable = (index >= 0) & (index < time.size) & ~np.logical_or.accumulate(longer, axis=1)
            phase = time[np.clip(index, 0, time.size - 1)] - period * (index - at)
            phases.append(np.nanmedian(np.where(usable, phase, np.nan), axis=1))
        steps[first:first + 4096] = phases[1] - phases[0]
    return steps


def _median_period(time: np.ndarray) -> tuple[float, int]:
    """Period [s] by the median time of several intervals at once, and of how many.

    The number doubles up to `WINDOW` as long as the time of so many intervals agrees with the last period within half
    of one: beyond that most stretches hold a missing row.
    """
    period, lag = float(np.median(np.diff(time))), 1
    while 2 * lag <= min(WINDOW, time.size // 4):
        wider = float(np.median(time[2 * lag:] - time[:-2 * lag])) / (2 * lag)
        if 2 * lag * abs(wider - period) > 0.5 * period:
            break
        period, lag = wider, 2 * lag
    return period, lag


def _white(time: np.ndarray, lag: int) -> bool:
    """Whether the jitter of stamps does not add up: the time of `lag` intervals spreads as much as that of one.

    Where intervals vary independently of each other it spreads √lag times as much; the geometric mean decides.
    """
    def spread(count: int) -> float:
        taken = time[count:] - time[:-count]
        return float(np.median(np.abs(taken - np.median(taken))))

    return spread(lag) <= lag**0.25 * spread(1) + 4 * float(np.spacing(np.abs(time).max()))


def _few_faults(time: np.ndarray, coarse: float, odd: int) -> bool:
    """True when all intervals are equal but for one to `FEW_FAULTS` gaps or duplicates.

    Stamps printed to one whole period (100 Hz, two decimals) cannot separate one missing row from a clock that runs a
    little slow; the missing row is the likelier, and the one that must not be passed over.
    """
    if not 0 < odd <= FEW_FAULTS:
        return False
    steps = np.diff(time)
    regular = steps[(steps > 0) & (steps <= GAP_FACTOR * coarse)]
    return bool(np.ptp(regular) <= 1e-6 * coarse + 4 * np.spacing(np.abs(time).max()))


def _print_resolution(time: np.ndarray) -> np.ndarray:
    """Step to which each stamp was rounded, found decade by decade (six significant digits coarsen with time).

    Stamps stored in single precision have that precision's spacing.

    A decade with fewer than eight stamps is too short and takes its neighbour's step; 0 where no step was found.
    """
    magnitude = np.where(time != 0, np.floor(np.log10(np.maximum(np.abs(time), 1e-300))), -np.inf)
    resolution = np.full(time.size, np.nan)
    for decade in np.unique(magnitude[np.isfinite(magnitude)]):
        members = magnitude == decade
        values = time[members]
        if values.size < 8:
            continue
        steps = (d for d in range(10)
                 if np.all(np.abs(np.round(values, d) - values) <= 4 * np.spacing(np.abs(values).max())))
        digits = next(steps, None)
        resolution[members] = _single_precision(values) if digits is None else 10.0**-digits
    known = np.flatnonzero(np.isfinite(resolution))
    if not known.size:
        return np.zeros(time.size)
    nearest = known[np.clip(np.searchsorted(known, np.arange(time.size)), 0, known.size - 1)]
    return resolution[nearest]


def _single_precision(values: np.ndarray) -> np.ndarray | float:
    """Spacing of stamps that were stored in single precision, 0 for others."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    return np.spacing(np.abs(single)).astype(float) if np.array_equal(single, values) else 0.0


def _rounded_period(time: np.ndarray, resolution: np.ndarray) -> float | None:
    """Period of the uniform clock whose rounded print these stamps are, or None if there is none."""
    if not resolution.max() > 0 or resolution.min() <= 0:
        return None
    index = np.arange(time.size, dtype=float)
    weight = 1.0 / np.maximum(resolution, 1e-12) ** 2
    mean_index = np.average(index, weights=weight)
    mean_time = np.average(time, weights=weight)
    centred = index - mean_index
    period = float(np.sum(weight * centred * (time - mean_time)) / np.sum(weight * centred**2))
    residual = np.abs(time - mean_time - period * centred)
    fits = bool(period > 0 and resolution.max() <= 2 * period and np.all(residual <= 0.55 * resolution + 1e-12))
    return period if fits else None


def calendar_seconds(source: Any) -> np.ndarray | None:
    """Seconds of dates, from the first valid one, or of durations; None for what holds neither.

    The ticks are subtracted as whole numbers, since a double resolves only 0.2 µs of the seconds since 1970. An array
    of numpy's dates would pass for one of numbers: its ticks, which are nanoseconds or microseconds.

    Parameters
    ----------
    source : array or column of a data frame
        Of numpy's, pandas' or polars' dates or durations, or of Python's.

    Returns
    -------
    (n,) array or None
        [s]; nan where a date is missing.

    Raises
    ------
    InputError
        Months or years, which differ in length, or numbers of no unit.

    Examples
    --------
    >>> calendar_seconds(np.array(["2026-11-26T16:00:00.000", "2026-11-26T16:00:00.005"], dtype="datetime64[ms]"))
    array([0.   , 0.005])
    """
    dtype = getattr(source, "dtype", None)
    if getattr(dtype, "tz", None) is not None:  # pandas with a time zone: numpy has none, hence UTC
        source = np.asarray(source, dtype="datetime64[ns]")
    values = np.asarray(source)
    if values.dtype == object and values.size and isinstance(values.flat[0], datetime):
        values = np.array([v.astimezone(UTC).replace(tzinfo=None) if getattr(v, "tzinfo", None) else v
                           for v in values.ravel()], dtype="datetime64[us]").reshape(values.shape)
    elif values.dtype == object and values.size and isinstance(values.flat[0], timedelta):
        values = values.astype("timedelta64[us]")
    if values.dtype.kind not in "mM":
        return None
    missing = np.isnat(values)
    if values.dtype.kind == "M":
        values = values - (values[~missing][0] if not missing.all() else values.dtype.type(0, "s"))
    step, count = np.datetime_data(values.dtype)
    if step in ("Y", "M", "generic"):
        calendar = {"Y": "years", "M": "months", "generic": "numbers of no unit"}[step]
        raise InputError("time is to be in a unit of fixed length", got=f"{calendar} ({values.dtype})",
                         why={"M": "a month has 28 to 31 days", "Y": "a year has 365 or 366 days"}.get(step),
                         mend="read the stamps with their days and times, or give seconds as numbers")
    tick = float(np.timedelta64(count, step) / np.timedelta64(1, "s"))
    return np.where(missing, np.nan, tick * values.astype(np.int64))
