"""Interference: bands of a channel of motion in which what the motion drives does not follow, as hum of the mains."""

from __future__ import annotations

import numpy as np

from lpvid.condition.resampling import true_runs

STRETCH, FEWEST = 1.0, 4
"""length of the stretches whose spectra are averaged at most [s], and how many there are at least: of so many noise
stands `ABOVE` its level by twice as much at one frequency in 60,000"""
SHORT = 100
"""samples of a stretch at least, from so many on a derivative in the band of the motion has less error than one by
polynomials of eleven samples"""
QUIET = 0.3
"""share of the Nyquist frequency, at the top of a channel's spectrum, whose level counts as its sensor's noise"""
ABOVE = 2.0
"""times the level of the sensor's noise that is taken off, to be safe"""


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


def interference(frequency: np.ndarray, power: np.ndarray, noise: float, values: np.ndarray, output: np.ndarray,
                 period: float) -> np.ndarray:
    """Whether frequencies that stand out of the noise, apart from the band that begins at rest, are none of the motion.

    With what part of a band's power does the output move? By the coherence γ², Σ γ² P/Σ P, γ² less what chance makes of
    n stretches: (γ² − 1/n)/(1 − 1/n), 1/n the mean for two signals that have nothing in common (Carter 1987). Below one
    half the band is better left out: what is taken for motion in error is then more than the motion that is lost.

    Parameters
    ----------
    frequency : (m,) array
        Of stretches of a second [Hz].
    power : (m,) array
        Of the channel.
    noise : float
        Level of its sensor's noise.
    values : (n,) array
        The channel.
    output : (n,) array
        What the motion drives, a damper's force.
    period : float
        Sampling period [s].

    Returns
    -------
    (m,) bool array
        Nowhere, where there are too few stretches.

    Examples
    --------
    >>> t = np.arange(6000) / 300
    >>> noise = np.random.default_rng(0).standard_normal((2, t.size))
    >>> read = np.sin(2 * np.pi * t) + 0.01 * np.sin(2 * np.pi * 50 * t) + 1e-3 * noise[0]
    >>> hum = interference(*power_of(read, 1 / 300), read, np.cos(2 * np.pi * t) + 0.1 * noise[1], 1 / 300)
    >>> bool(hum[50]), bool(hum[1])
    (True, False)
    """
    from scipy.signal import coherence

    none = np.zeros(frequency.size, dtype=bool)
    bands = true_runs(of_motion(power, noise) > 0.5)
    size = max(int(stretch_of(values.size, period) / period), 2)
    if len(bands) < 2 or values.size < FEWEST * size or not np.ptp(output):
        return none
    found = coherence(values, output, 1 / period, nperseg=size)[1]
    chance = size / values.size
    common = (found - chance) / (1 - chance)
    for a, b in bands[1:]:  # a lone frequency stands out by chance as well, and is no motion either
        none[a:b] = common[a:b] @ power[a:b] < 0.5 * power[a:b].sum()
    return none


def stretch_of(samples: int, period: float) -> float:
    """Length of the stretches whose spectra are averaged [s]: shorter ones where there were too few.

    Parameters
    ----------
    samples : int
        Of the record.
    period : float
        Sampling period [s].

    Returns
    -------
    float
    """
    return min(STRETCH, samples * period / FEWEST)


def power_of(values: np.ndarray, period: float, finer: int = 1) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies, power by Welch's method, and the level of the sensor's noise.

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

    size = max(int(stretch_of(values.size, period) / period), 2)
    frequency, power = welch(values, 1 / period, nperseg=min(values.size, size))
    return frequency, power, float(np.median(top_of(frequency, power, finer)))


def top_of(frequency: np.ndarray, power: np.ndarray, finer: int = 1) -> np.ndarray:
    """Power at the top of the band that was recorded, where there is noise alone.

    Parameters
    ----------
    frequency, power : (m,) array
    finer : int
        As for `power_of`.

    Returns
    -------
    (k,) array
        Of the upper `QUIET` of the band.
    """
    recorded = power[frequency <= frequency[-1] / finer]
    return recorded[-round(QUIET * recorded.size):]
