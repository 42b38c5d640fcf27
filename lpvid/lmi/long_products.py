"""Products of matrices with twice the digits of a double, from doubles alone."""

from __future__ import annotations

import numpy as np

EPS = float(np.finfo(float).eps)
SPLIT = 134217729.0
"""2²⁷ + 1: what splits a double into two halves whose products are exact (Veltkamp)"""


def long_product(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A·B as an unevaluated sum of two matrices of doubles.

    Every product is split into its rounded value and its error, and so is every sum (Ogita, Rump & Oishi, SIAM J. Sci.
    Comput. 26 (2005) 1955-1988, algorithm 5.3): the sum of the two is off by at most (nε)²|A||B|, proposition 5.5.

    Parameters
    ----------
    a : (…, m, n) array
        Entries below 1e290.
    b : (…, n, k) array

    Returns
    -------
    ((…, m, k) array, (…, m, k) array)
        The product, and what it is off by.

    Examples
    --------
    >>> a, b = np.array([[1e16, 1.0, -1e16]]), np.ones((3, 1))
    >>> float((a @ b)[0, 0]), float(sum(long_product(a, b))[0, 0])
    (0.0, 1.0)
    """
    a_high, a_low = _halves(a)
    b_high, b_low = _halves(b)
    shape = np.broadcast_shapes(a.shape[:-2], b.shape[:-2])
    total, error = np.zeros((2, *shape, a.shape[-2], b.shape[-1]))
    for k in range(a.shape[-1]):
        x, x1, x2 = (m[..., :, k, None] for m in (a, a_high, a_low))
        y, y1, y2 = (m[..., None, k, :] for m in (b, b_high, b_low))
        term = x * y
        lost = x2 * y2 - (((term - x1 * y1) - x2 * y1) - x1 * y2)
        grown = total + term
        part = grown - total
        error += lost + ((total - (grown - part)) + (term - part))
        total = grown
    return total, error


def _halves(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    wide = SPLIT * m
    high = wide - (wide - m)
    return high, m - high
