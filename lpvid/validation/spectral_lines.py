"""Spectral lines: sinusoids in the error of a free run that nothing of the motion has, as the hum of the mains."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lpvid._checks import read_only
from lpvid.validation.trust import LEVEL

BANDWIDTH = 4.0
"""time-bandwidth product of the tapers (Thomson 1982): a line is distinguished from what is broader than ±4/T"""
TAPERS = int(2 * BANDWIDTH) - 1
"""of which the energy lies within that band"""
FINER = 4
"""frequencies computed per 1/T, at least"""


@dataclass(frozen=True)
class SpectralLine:
    """A sinusoid in a signal.

    Attributes
    ----------
    frequency : float
        [Hz]
    amplitude : float
        In the signal's unit.
    """

    frequency: float
    amplitude: float

    @property
    def power(self) -> float:
        """Mean square."""
        return self.amplitude**2 / 2


def spectral_lines(error: np.ndarray, driving: Sequence[np.ndarray], sample_time: float) -> list[SpectralLine]:
    """Lines in an error that neither the driving signals nor their sizes or signs have.

    Thomson's test of the harmonic mean (1982, sec. XIII): with the spectra Y_k of the signal under orthogonal tapers of
    the sums U_k, a line is μ = Σ U_k Y_k / Σ U_k², and

        F = (K - 1) |μ|² Σ U_k² / Σ |Y_k - μ U_k|²

    has 2 and 2K - 2 degrees of freedom where there is none, whatever the colour of the noise, if that is even within
    the bandwidth of the tapers. Its tail is P(F > f) = (1 + f/(K - 1))^(1 - K). A line in the error, or in a driving
    signal, is significant at `LEVEL` over all frequencies that are computed. The sign and the size of a sinusoid have
    its odd and its even harmonics.

    Parameters
    ----------
    error : (n,) array
    driving : sequence of (n,) arrays
        Whatever moves the model: its inputs and scheduling variables, and its output.
    sample_time : float
        Period [s].

    Returns
    -------
    list of SpectralLine
        Those with a significant share of the variance (`LEVEL`), the largest first.

    Examples
    --------
    >>> t, rng = np.arange(2000) / 500, np.random.default_rng(0)
    >>> noise, motion = 0.1 * rng.standard_normal(2000), np.sin(2 * np.pi * 3 * t)
    >>> found = spectral_lines(np.sin(2 * np.pi * 50.1 * t) + motion**3 + noise, [motion], 1 / 500)
    >>> [(round(x.frequency, 1), round(x.amplitude, 1)) for x in found], spectral_lines(noise, [motion], 1 / 500)
    ([(50.1, 1.0)], [])
    """
    from scipy.fft import next_fast_len, rfft

    n = error.size
    if n < 2 * TAPERS:
        return []
    varying = error - error.mean()
    least_power = (1 - LEVEL) * float(np.mean(varying**2))
    if not _concentrated(varying, least_power / 2):
        return []
    tapers, size = _tapers(n), next_fast_len(FINER * n, real=True) or FINER * n
    sums, near = tapers.sum(axis=1), int(BANDWIDTH * size / n)
    mean, ratio = _harmonic(np.asarray(rfft(tapers * varying, size, axis=1)), sums)
    least = (TAPERS - 1) * (((1 - LEVEL) / ratio.size) ** (-1 / (TAPERS - 1)) - 1)
    amplitude = np.where(ratio > least, 2 * np.abs(mean), 0.0)
    amplitude[:near], amplitude[-near:] = 0.0, 0.0  # so near to zero frequency a line is drift
    moved, found = list(_driven(driving)), []
    while amplitude.any():
        k = int(amplitude.argmax())
        amplitude[max(k - near, 0): k + near + 1] = 0.0
        place, amount = _refined(tapers, sums, varying, k * n / size)
        wave = np.exp(-2j * np.pi * place / n * np.arange(n))
        line = SpectralLine(place / (n * sample_time), amount)
        if line.power < least_power:
            break
        if not any(_harmonic((tapers * x) @ wave, sums)[1] > least for x in moved):
            found.append(line)
    return found


def _concentrated(x: np.ndarray, power: float) -> bool:
    """Whether some band as wide as that of the tapers holds that much of the power of a signal, by a cosine transform
    (Parseval): few errors do, and the others need no tapers."""
    from scipy.fft import dct

    energy = np.cumsum(np.asarray(dct(x, norm="ortho")) ** 2)
    width = int(4 * BANDWIDTH)  # a coefficient for every 1/2T
    return bool(np.any(energy[width:] - energy[:-width] > power * x.size))


def _refined(tapers: np.ndarray, sums: np.ndarray, x: np.ndarray, place: float) -> tuple[float, float]:
    """Frequency near a place [1/T] at which the amplitude is largest, and that amplitude."""
    from scipy.optimize import minimize_scalar

    weighted, time = sums @ tapers * x, np.arange(x.size) / x.size  # Σ U_k Y_k as one transform
    found = minimize_scalar(lambda at: -abs(weighted @ np.exp(-2j * np.pi * at * time)),
                            bounds=(place - 1 / FINER, place + 1 / FINER), method="bounded")
    return float(found.x), 2 * float(-found.fun) / float(sums @ sums)


def _driven(driving: Sequence[np.ndarray]) -> Iterator[np.ndarray]:
    """Signals, their signs and their sizes about their means; those that do not change are left out."""
    for x in driving:
        about = x - x.mean()
        if np.any(about):
            size = np.abs(about)
            yield from (about, np.sign(about), size - size.mean())


@lru_cache(maxsize=2)
def _tapers(n: int) -> np.ndarray:
    """(K, n) discrete prolate spheroidal sequences of unit energy."""
    from scipy.signal.windows import dpss

    return read_only(np.asarray(dpss(n, BANDWIDTH, TAPERS)))


def _harmonic(spectra: np.ndarray, sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """μ and F of spectra, tapers along the first axis."""
    power = float(sums @ sums)
    mean = np.tensordot(sums, spectra, 1) / power
    left = np.sum(np.abs(spectra - np.multiply.outer(sums, mean)) ** 2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return mean, (TAPERS - 1) * np.abs(mean) ** 2 * power / left
