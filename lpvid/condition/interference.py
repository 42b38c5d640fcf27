"""Interference: bands of a displacement in which what the motion drives does not follow, as hum of the mains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.condition.bandwidth import PASSED
from lpvid.condition.resampling import true_runs
from lpvid.rounding import TINY

STRETCH, FEWEST = 1.0, 4
"""length of the stretches whose spectra are averaged at most [s], and how many there are at least"""
SHORT = 100
"""samples of a stretch at least, from so many on a derivative in the band of the motion has less error than one by
polynomials of eleven samples"""
QUIET = 0.3
"""share of the Nyquist frequency, at the top of a channel's spectrum, whose level counts as its sensor's noise"""
ABOVE = 2.0
"""times the level of the sensor's noise that is taken off, to be safe"""
FOLLOWS = 0.25
"""force over velocity in a band of its own, as a share of that in the first one, up to which the band is interference:
half of its power moves (with less, what is taken for motion in error is more than what is lost), and dry friction that
a slow motion turns over follows a faster one beside it with half of its slope"""


def of_motion(power: np.ndarray, noise: float) -> np.ndarray:
    """Wiener's share (S − 2N)₊/S of a power S that is no noise of the sensor.

    Parameters
    ----------
    power : (m,) array
        S, of a channel by frequency.
    noise : float
        N, the level at the top of its band.

    Returns
    -------
    (m,) array
    """
    return np.maximum(1 - ABOVE * noise / np.maximum(power, 1e-300), 0.0)


def interference(values: np.ndarray, output: np.ndarray, period: float, finer: int = 1
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Whether frequencies of a displacement that stand out of its noise are none of the motion.

    A band that lies apart from the first one moves the output as the first one does: the slope of the force over the
    velocity by regression over the band, G = Σ V* F/Σ |V|² with V = jω X, is not biased by what else is in the force.
    Where a share h of the power does not move, G is smaller by 1 − h; where both |G| and the part in phase, |Re G|, are
    below `FOLLOWS` times those of the first band it is interference. In phase, because a spring makes |G| of a slow
    band as large as K/ω, beside which a damper's slope in a fast one is small.

    Parameters
    ----------
    values : (n,) array
        The displacement.
    output : (n,) array
        What the motion drives, a damper's force.
    period : float
        Sampling period [s].
    finer : int
        As for `power_of`.

    Returns
    -------
    frequency : (m,) array
        Those of `power_of` [Hz].
    interfering : (m,) bool array
        Nowhere where the output never changes, and in records too short to find a band.

    Examples
    --------
    >>> t = np.arange(6000) / 300
    >>> noise = np.random.default_rng(0).standard_normal((2, t.size))
    >>> read = np.sin(2 * np.pi * t) + 0.01 * np.sin(2 * np.pi * 50 * t) + 1e-3 * noise[0]
    >>> _, hum = interference(read, np.cos(2 * np.pi * t) + 0.1 * noise[1], 1 / 300)
    >>> bool(hum[50]), bool(hum[1])
    (True, False)
    """
    from scipy.signal import detrend, get_window

    frequency, power, noise = power_of(values, period, finer)
    none = np.zeros(frequency.size, dtype=bool)
    bands = true_runs(of_motion(power, noise) > 0.5)
    if values.size < FEWEST * SHORT or len(bands) < 2 or not np.ptp(output):
        return frequency, none
    taper = get_window("hann", values.size)
    fine = np.fft.rfftfreq(values.size, period)
    velocity, force = 2j * np.pi * fine * np.fft.rfft(detrend(values) * taper), np.fft.rfft(detrend(output) * taper)
    slopes = []
    for a, b in bands:
        inside = slice(*np.searchsorted(fine, ((a - 0.5) * frequency[1], (b - 0.5) * frequency[1])))
        moved = float(np.sum(np.abs(velocity[inside]) ** 2))
        slope = np.vdot(velocity[inside], force[inside]) / max(moved, 1e-300)
        slopes.append((abs(slope), abs(slope.real)))
    for (a, b), sizes in zip(bands[1:], slopes[1:], strict=True):
        if all(size < FOLLOWS * first for size, first in zip(sizes, slopes[0], strict=True)):
            none[a - 1:b + 1] = True  # with the frequencies beside it, which have a part of it
    return frequency, none


def stretch_samples(samples: int, period: float) -> int:
    """Samples of the stretches whose spectra are averaged: fewer where there were too few stretches.

    Parameters
    ----------
    samples : int
        Of the record.
    period : float
        Sampling period [s].

    Returns
    -------
    int
    """
    return min(samples, max(int(min(STRETCH / period, samples / FEWEST)), 2))


def power_of(values: np.ndarray, period: float, finer: int = 1) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies, power by Welch's method, and the level of the sensor's noise.

    A line is taken off every stretch: the jump between the ends of a slow stroke would stand above the noise far beyond
    where it moves.

    Parameters
    ----------
    values : (n,) array
    period : float
        Sampling period [s].
    finer : int
        How many times as fast the clock is as that by which the channel was recorded.

    Returns
    -------
    frequency : (m,) array
        [Hz]
    power : (m,) array
        Spectral density.
    noise : float
    """
    from scipy.signal import welch

    size = stretch_samples(values.size, period)
    frequency, power = welch(values, 1 / period, nperseg=size, detrend="linear")
    return frequency, power, float(np.median(top_of(frequency, power, finer)))


def power_of_all(several: Sequence[np.ndarray], period: float, finer: int = 1) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies, mean power and noise level of a channel in several records.

    The mean is over all of their time, at the frequencies of the longest (`power_of`).

    Parameters
    ----------
    several : sequence of (n,) arrays
        One per record.
    period : float
        Sampling period [s].
    finer : int
        As for `power_of`.

    Returns
    -------
    frequency : (m,) array
        [Hz]
    power : (m,) array
        Spectral density.
    noise : float

    Examples
    --------
    >>> x, y = np.random.default_rng(0).standard_normal((2, 4000))
    >>> _, _, noise = power_of_all([x, 3 * y[:2000]], 0.01)
    >>> bool(abs(noise / (2 * 0.01 * (2 * 1 + 1 * 9) / 3) - 1) < 0.2)  # 2 times the period times the mean variance
    True
    """
    several = sorted(several, key=len, reverse=True)
    weights = np.array([v.size for v in several]) / sum(v.size for v in several)
    found = [power_of(v, period, finer) for v in several]
    frequency = found[0][0]
    power = np.sum([w * np.interp(frequency, at, p) for w, (at, p, _) in zip(weights, found, strict=True)], axis=0)
    return frequency, power, float(np.sum([w * n for w, (_, _, n) in zip(weights, found, strict=True)]))


def top_of(frequency: np.ndarray, power: np.ndarray, finer: int = 1) -> np.ndarray:
    """Power at the top of the band that was recorded, where there is noise alone.

    The upper `QUIET` of the band. Where that is not flat and the same share of the band that an anti-alias filter
    passes (`PASSED`) is, without a trend, the filter has removed the noise above: what it passes counts, as of a record
    that was decimated.

    Parameters
    ----------
    frequency, power : (m,) array
    finer : int
        As for `power_of`.

    Returns
    -------
    (k,) array

    Examples
    --------
    >>> frequency = np.arange(100.0)
    >>> white = np.ones(100)
    >>> top_of(frequency, white).size, float(np.median(top_of(frequency, np.where(frequency < 83, white, 0.0))))
    (30, 1.0)
    >>> falling = (10 + frequency) ** -2.0  # a motion, not noise: its end counts
    >>> bool(np.median(top_of(frequency, np.where(frequency < 83, falling, 0.0))) < np.median(falling[-30:]))
    True
    """
    recorded = power[frequency <= frequency[-1] / finer]
    whole, passed = (part[-round(QUIET * part.size):] for part in (recorded, recorded[:round(PASSED * recorded.size)]))
    return passed if is_flat(passed) and not has_trend(passed) and not is_flat(whole) else whole


def has_trend(power: np.ndarray) -> bool:
    """Whether the logarithm of a band's power changes with frequency beyond its scatter, as that of a motion does.

    Its correlation r with the frequency is then beyond two standard errors, |r|√(n/2) > 2: behind Hann's window two
    neighbours count as one.

    Parameters
    ----------
    power : (m,) array
        Positive.

    Returns
    -------
    bool
    """
    level, place = np.log(np.maximum(power, TINY)), np.arange(power.size)
    level, place = level - level.mean(), place - place.mean()
    r = float(level @ place) / max(float(np.linalg.norm(level) * np.linalg.norm(place)), TINY)
    return abs(r) * float(np.sqrt(power.size / 2)) > 2


def is_flat(power: np.ndarray) -> bool:
    """Whether the median levels of the two halves of a band are within `ABOVE` of each other, as of white noise.

    Parameters
    ----------
    power : (m,) array

    Returns
    -------
    bool
        False of fewer than two, and without any power.
    """
    if power.size < 2:
        return False
    lower, upper = (float(np.median(half)) for half in np.array_split(power, 2))
    return 0 < max(lower, upper) < ABOVE * min(lower, upper)
