"""Parameters that laws of a variable damping share, and the force between two of them."""

from __future__ import annotations

import numpy as np

from quartercar.dampers.parameter import Parameter

LOW = Parameter("low_damping", "N*s/m", "c_min", 300.0, 0.0, 3000.0)
HIGH = Parameter("high_damping", "N*s/m", "c_max", 3000.0, 300.0, 15000.0, log=True)


def between(force: np.ndarray, velocity: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(n,) force clipped to what dampings from c_min to c_max do at a velocity; c_min v where they are out of order.

    Parameters
    ----------
    force : (n,) array
        Wanted [N], positive in extension.
    velocity : (n,) array
        v_d, positive in extension [m/s].
    low, high : (n,) or (1,) arrays
        c_min, c_max [N·s/m]; a c_max below c_min counts as c_min.

    Returns
    -------
    (n,) array
        Force [N] between c_min v_d and c_max v_d; zero where the velocity is.

    Examples
    --------
    >>> between(np.array([900.0, 900.0]), np.array([0.5, -0.5]), np.array([300.0]), np.array([3000.0]))
    array([ 900., -150.])
    """
    soft, hard = low * velocity, np.maximum(low, high) * velocity
    return np.clip(force, np.minimum(soft, hard), np.maximum(soft, hard))
