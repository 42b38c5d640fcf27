"""Splines: a channel between its samples, by cubic splines through them on a uniform clock."""

from __future__ import annotations

from math import factorial

import numpy as np

from lpvid.rounding import EPS


def _vanishing_samples() -> int:
    """Samples over which the effect of an end on the spline, 2 − √3 of it per sample, is lost in the last digit."""
    return int(np.ceil(np.log(EPS) / np.log(2 - np.sqrt(3))))


END = _vanishing_samples()
"""samples added to both ends of a channel"""


def spline_shifted(values: np.ndarray, samples: float) -> np.ndarray:
    """Values, (n,), of a smooth signal read `samples` later, interpolated by cubic splines, the ends held.

    Linear interpolation would reduce the amplitude at a frequency f by cos(π f T) half-way between samples.

    Parameters
    ----------
    values : (n,) array
    samples : float
        Need not be whole; earlier where negative.

    Returns
    -------
    (n,) array
        In the unit of the values.

    Examples
    --------
    >>> spline_shifted(np.array([0.0, 1.0, 4.0, 9.0, 16.0]), 2.0).round(6)
    array([ 4.,  9., 16., 16., 16.])
    """
    whole = int(np.clip(np.floor(samples), -values.size, values.size))
    margin = abs(whole) + 2
    weights = np.pad(_weights(np.pad(values, END, mode="edge")), margin, constant_values=(values[0], values[-1]))
    begun = margin + END + whole
    return _between(weights[begun - 1: begun + values.size + 2], samples - np.floor(samples))


def spline_resampled(values: np.ndarray, finer: int) -> np.ndarray:
    """(n finer,) values, (n,), on a clock `finer` times as fast, the last one held.

    Parameters
    ----------
    values : (n,) array
    finer : int

    Returns
    -------
    (n finer,) array
        In the unit of the values; every `finer`-th one is a given value.

    Examples
    --------
    >>> spline_resampled(np.array([0.0, 1.0, 2.0]), 2).round(6)
    array([0. , 0.5, 1. , 1.5, 2. , 2. ])
    """
    n = values.size
    weights = _weights(np.pad(values, END, mode="reflect", reflect_type="odd"))[END - 1: END + n + 2]
    out = np.empty((n, finer))
    out[:, 0], out[-1] = values, values[-1]
    for k in range(1, finer):
        out[:-1, k] = _between(weights, k / finer)[:-1]
    return out.ravel()


def _weights(values: np.ndarray) -> np.ndarray:
    """Weights of the cubic B-splines whose sum interpolates values."""
    from scipy.ndimage import spline_filter1d

    return np.asarray(spline_filter1d(values, 3, mode="mirror"))


def _between(weights: np.ndarray, share: float) -> np.ndarray:
    """(n,) sum of B-splines at a share of the way from each to the next; weights (n + 3,), from one before the first.

    The four cubic pieces of a B-spline (de Boor 1978, A Practical Guide to Splines, chapter X).
    """
    n, rest = weights.size - 3, 1 - share
    pieces = (rest**3 / factorial(3), 2 / 3 - share**2 * (2 - share) / 2, 2 / 3 - rest**2 * (2 - rest) / 2,
              share**3 / factorial(3))
    return sum((p * weights[k: k + n] for k, p in enumerate(pieces)), np.zeros(n))
