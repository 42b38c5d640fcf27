"""Continuation of a signal beyond its ends, so that filters in the frequency domain do the same there as inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LENGTH = 2.0
"""time by which a signal is continued as it can be predicted, in the second half of it fading to the mean [s]"""
LOOKED_AT, ORDER = 4.0, 128
"""time next to an end by which it is predicted [s], and the largest order of the predictor"""


@dataclass(frozen=True, eq=False)
class Continued:
    """Spectrum of a signal that is continued at both ends and periodic.

    Attributes
    ----------
    spectrum : (m,) complex array
    omega : (m,) array
        Frequencies [rad/s].
    lead : int
        Samples put before the signal.
    n_samples : int
        Of the signal.
    """

    spectrum: np.ndarray
    omega: np.ndarray
    lead: int
    n_samples: int

    @classmethod
    def predicted(cls, x: np.ndarray, sample_time: float) -> Continued:
        """A signal, (n,), that goes on as `ahead` predicts from either end, and fades to its mean.

        Parameters
        ----------
        x : (n,) array
        sample_time : float
            [s].

        Returns
        -------
        Continued
        """
        n, mean = x.size, float(x.mean())
        count, near = (min(round(time / sample_time), most) for time, most in ((LENGTH, n // 2), (LOOKED_AT, n)))
        fade = np.cos(np.pi / 2 * np.clip(np.linspace(-1.0, 1.0, count), 0.0, 1.0)) ** 2
        before = mean + fade * ahead(x[:near][::-1] - mean, count)
        after = mean + fade * ahead(x[-near:] - mean, count)
        return cls._joined(before[::-1], x, after, sample_time)

    @classmethod
    def reflected(cls, x: np.ndarray, sample_time: float, length: float) -> Continued:
        """A signal, (n,), that goes on for a length [s] as its reflection at either end, which keeps the slope.

        Parameters
        ----------
        x : (n,) array
            Of two samples at least.
        sample_time : float
            [s].
        length : float
            At either end [s]; shorter where the signal is.

        Returns
        -------
        Continued
        """
        count = int(np.clip(round(length / sample_time), 1, x.size - 1))
        return cls._joined(2 * x[0] - x[count:0:-1], x, 2 * x[-1] - x[-2: -2 - count: -1], sample_time)

    @classmethod
    def _joined(cls, before: np.ndarray, x: np.ndarray, after: np.ndarray, sample_time: float) -> Continued:
        """The three, one after the other, and a ramp that closes the period."""
        from scipy.fft import next_fast_len

        longer = np.concatenate([before, x, after])
        size = 2 * int(next_fast_len((longer.size + 1) // 2, real=True) or 0)
        ramp = np.linspace(longer[-1], longer[0], size - longer.size + 2)[1:-1]
        omega = 2 * np.pi * np.fft.rfftfreq(size, sample_time)
        return cls(np.fft.rfft(np.concatenate([longer, ramp])), omega, before.size, x.size)

    def back(self, spectrum: np.ndarray, finer: int = 1) -> np.ndarray:
        """(n finer,) the samples of the signal, from what its spectrum was made to; between them on a finer clock.

        Parameters
        ----------
        spectrum : (m,) complex array
            At the frequencies `omega`.
        finer : int
            Times as fast as the signal's a clock is on which its samples are wanted.

        Returns
        -------
        (n finer,) array
            In the unit of the signal.
        """
        size = finer * (2 * self.spectrum.size - 2)
        return finer * np.fft.irfft(spectrum, size)[finer * self.lead: finer * (self.lead + self.n_samples)]


def ahead(x: np.ndarray, count: int) -> np.ndarray:
    """(count,) what follows a signal, (n,), of mean zero, by linear prediction.

    By Burg's method (Kay 1988, Modern Spectral Estimation, sec. 7.6), whose predictor is stable: sines go on as they
    are, what noise hides or chance drives decays.

    Parameters
    ----------
    x : (n,) array
        On an even clock, the oldest sample first.
    count : int
        Samples wanted.

    Returns
    -------
    (count,) array
        In the unit of x.

    Examples
    --------
    >>> t = 0.01 * np.arange(400)
    >>> wave = np.cos(9 * t) + np.cos(5 * t)
    >>> bool(np.abs(ahead(wave[:300], 100) - wave[300:]).max() < 0.05)
    True
    """
    from lpvid.condition._prediction_kernels import go_on

    out = np.empty(count)
    go_on(np.ascontiguousarray(x, dtype=float), min(ORDER, x.size // 3), out)
    return out
