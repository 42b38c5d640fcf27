"""Likeness: whether an odd function of a signal is closer to the sign of that signal or to the signal."""

from __future__ import annotations

import numpy as np


def closer_to_sign(function: np.ndarray, size: np.ndarray) -> bool:
    """Whether f(|x|) sgn x has a larger correlation with sgn x than with x, at the samples of the data.

    Σf/√N > Σf|x|/√Σx²: a power of the speed is then dry friction, and a deflection under a force is play.

    Parameters
    ----------
    function : (n,) array
        f(|x|) ≥ 0.
    size : (n,) array
        |x|.

    Returns
    -------
    bool
        False where nothing moves.

    Examples
    --------
    >>> size = np.linspace(0.0, 1.0, 10001)
    >>> closer_to_sign(size**0.36, size), closer_to_sign(size**0.38, size)
    (True, False)
    """
    return bool(function.sum() * np.linalg.norm(size) > function @ size * np.sqrt(size.size))
