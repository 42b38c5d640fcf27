"""The secant of the hyperbolic tangent, by which tanh laws become quasi-LPV models."""

from __future__ import annotations

import numpy as np


def secant(s: np.ndarray) -> np.ndarray:
    """tanh(s)/s, 1 at 0.

    Parameters
    ----------
    s : (n,) array
        Argument of the tanh.

    Returns
    -------
    (n,) array
        In (0, 1].

    Examples
    --------
    >>> secant(np.array([0.0, 1.0])).round(3)
    array([1.   , 0.762])
    """
    near = np.abs(s) < 1e-6
    return np.where(near, 1 - s**2 / 3, np.tanh(s) / np.where(near, 1.0, s))
