"""How far a fit can be trusted: the error of many parameters on other data, the interval of few held-out samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.validation.figures import Figures

LEVEL = 0.95
"""of the interval of a held-out fit, the level of every interval that is printed."""
QUANTILE = 1.96
"""standard errors on either side of a normal estimate that make an interval of `LEVEL`: the 97.5 % quantile."""
QUIET = 10
"""lags in a row within their band that end the correlation, as for the standard errors (`residual_memory`)."""


def independent_samples(residuals: Sequence[np.ndarray]) -> float:
    """How many independent samples determine the residual's variance as well as these: n / Σ_j ρ_j², j over both signs.

    Bartlett 1946; Priestley 1981, 5.3. A lag counts where its autocorrelation ρ_j leaves its own 95 % band, which
    Bartlett's formula widens by the lags before it, until ten in a row stay inside or half of the longest record.

    Parameters
    ----------
    residuals : sequence of (n,) arrays
        One per record; their common mean is not taken off, since an offset is an error that every sample repeats.

    Returns
    -------
    float
        0 without samples; their number where all are zero.

    Examples
    --------
    >>> independent_samples([np.resize([1.0, -1, -1, 1, -1], 8)])
    8.0
    """
    n = sum(len(e) for e in residuals)
    power = sum(float(e @ e) for e in residuals)
    if not power > 0:
        return float(n)
    lags = max(len(e) for e in residuals) // 2 + 1
    correlation = np.sum([autocovariance(e, lags) for e in residuals], axis=0) / power
    squares, inside = 0.0, 0
    for rho in correlation[1:].tolist():
        inside = inside + 1 if rho**2 < 4 * (1 + 2 * squares) / n else 0
        if inside == QUIET:
            break
        if not inside:
            squares += rho**2
    return n / (1 + 2 * squares)


def autocovariance(e: np.ndarray, lags: int) -> np.ndarray:
    """Sums Σ e(t) e(t−τ) at lags from none on, by fast Fourier transform.

    Parameters
    ----------
    e : (n,) array
    lags : int

    Returns
    -------
    (lags,) array
        Zero from n on.

    Examples
    --------
    >>> autocovariance(np.array([1.0, 2.0, 3.0]), 3).round(9).tolist()
    [14.0, 8.0, 3.0]
    """
    size = 1 << (len(e) + lags - 1).bit_length()
    return np.fft.irfft(np.abs(np.fft.rfft(e, size)) ** 2, size)[:lags]


def esr_interval(esr: float, count: float) -> tuple[float, float]:
    """Interval of an ESR whose error has as much information as `count` independent normal samples.

    Σe²/σ² is then χ² with `count` degrees of freedom: the true ESR lies within count · ESR / χ² at its two tails.

    Parameters
    ----------
    esr : float
        Measured.
    count : float
        Independent samples, above 0.

    Returns
    -------
    low, high : float

    Examples
    --------
    >>> low, high = esr_interval(0.04, 10.0)
    >>> round(low, 4), round(high, 4)
    (0.0195, 0.1232)
    """
    from scipy.special import gammaincinv

    tail = (1 - LEVEL) / 2
    low, high = (count * esr / (2 * max(float(gammaincinv(count / 2, q)), np.finfo(float).tiny))
                 for q in (1 - tail, tail))
    return low, high


NO_BETTER = "free run no better than the mean of the measured output"
"""of an ESR of 1 or more, a fit of 0 % or less."""


def held_out_doubt(figures: Figures, count: float | None) -> str | None:
    """Why the free run on held-out data is not reliable, or None.

    It is where the model is no better than the mean of the data (ESR 1, fit 0 %), and where the interval of one that
    seems better includes that mean.

    Parameters
    ----------
    figures : Figures
        Of the free run.
    count : float or None
        `independent_samples` of its residual; None where they are not known.

    Returns
    -------
    str or None
    """
    if figures.esr is not None and figures.esr >= 1:
        return NO_BETTER
    if count is None or not count > 0 or figures.esr is None or not figures.esr > 0:
        return None
    high = esr_interval(figures.esr, count)[1]
    if high < 1:
        return None
    return (f"fit cannot be trusted: {figures.n_samples} samples are worth {count:.2g} independent ones, which "
            "leave it open whether the model is better than the mean")


def training_doubt(samples: int, parameters: float) -> str | None:
    """Why a fit on training data is not reliable, or None.

    With n samples and k parameters least squares leaves the error σ²(1 − k/n) on the data it is fitted to and
    σ²(1 + k/n) on others of their kind: (n + k)/(n − k) times as much (Akaike's final prediction error, 1969; Ljung
    1999, 16.4). The figure cannot be trusted where that is over 2, with more of the error missing than shown:
    below n = 3k.

    Parameters
    ----------
    samples : int
        Equations for each output.
    parameters : float
        For each output.

    Returns
    -------
    str or None

    Examples
    --------
    >>> training_doubt(27, 9) is None
    True
    >>> training_doubt(16, 9)
    'training fit cannot be trusted: 16 equations for 9 parameters, 3.6 times that error to expect on other data'
    """
    if parameters <= 0 or samples >= 3 * parameters:
        return None
    expected = ("as many parameters as equations" if samples <= parameters else
                f"{(samples + parameters) / (samples - parameters):.2g} times that error to expect on other data")
    return f"training fit cannot be trusted: {samples} equations for {parameters:.0f} parameters, {expected}"
