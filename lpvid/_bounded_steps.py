"""Steps of a bounded Levenberg-Marquardt descent by normal equations, for Jacobians too tall to factor at each step.

`lpvid.least_squares.bounded_step` has the triangular factor instead.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from lpvid._tall import column_norms
from lpvid.least_squares import bounded_least_squares
from lpvid.rounding import EPS, TINY, VANISHING

MOST_CORRECTION = 0.75
"""length of the geodesic correction over that of the step, in units of the derivatives' norms, beyond which it is
rejected"""


def geodesic_correction(jacobian: np.ndarray, deviation: np.ndarray, step: np.ndarray, weights: np.ndarray,
                        vector: np.ndarray, damping: float, low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
    """Second-order correction of a step in a curved valley; None where it is not finite, or too long.

    Of the path x + h s + h² b the simulation changes by h J s + h² (f_ss/2 + J b); b makes the second part as small as
    it can: the geodesic acceleration of Transtrum and Sethna (2012), section 3, below `MOST_CORRECTION` of the step.

    Parameters
    ----------
    jacobian : (N, P) array
    deviation : (N,) array
        f_ss/2: the change by a step beyond that of the derivatives, over the square of its share.
    step : (P,) array
    weights : (N,) array
    vector : (P,) array
    damping : float
    low, high : (P,) arrays

    Returns
    -------
    (P,) array or None
    """
    if not np.isfinite(deviation).all():
        return None
    correction, _ = damped_step(jacobian, -deviation, weights, np.clip(vector + step, low, high), damping, low, high)
    norms = column_norms(jacobian)
    length = np.linalg.norm(correction * norms)
    return correction if 0.0 < length <= MOST_CORRECTION * np.linalg.norm(step * norms) else None


def broyden_update(jacobian: np.ndarray, step: np.ndarray, change: np.ndarray) -> None:
    """Broyden's update in place, in parameters scaled by the columns' norms: J step = change afterwards.

    Parameters
    ----------
    jacobian : (N, P) array
        Changed.
    step : (P,) array
    change : (N,) array
        Of the simulation by the step.
    """
    norms = np.maximum(column_norms(jacobian), TINY)
    scaled = step * norms
    length = float(scaled @ scaled)
    if length > 0 and np.isfinite(change).all():
        deviation = change - jacobian @ step
        for k, share in enumerate(scaled * norms / length):
            jacobian[:, k] += deviation * share


def damped_step(jacobian: np.ndarray, errors: np.ndarray, weights: np.ndarray, vector: np.ndarray, damping: float,
                low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
    """Damped step in the free parameters, and its predicted decrease of the cost (0 where there is none to take).

    Where that would carry some beyond their bounds, the best step inside them (bounded least squares).

    Parameters
    ----------
    jacobian : (N, P) array
        Of the simulation.
    errors : (N,) array
        Measured less simulated.
    weights : (N,) array
        Of the squared errors.
    vector : (P,) array
    damping : float
        On the diagonal of normal equations that are scaled to one there.
    low, high : (P,) arrays

    Returns
    -------
    (P,) array
        Zero in the parameters that are held at a bound or change nothing.
    float
    """
    weighted = jacobian if (weights == 1.0).all() else jacobian * weights[:, None]
    gradient, hessian = weighted.T @ errors, weighted.T @ jacobian
    norms = np.sqrt(np.maximum(np.diag(hessian), TINY))
    held = ((vector <= low) & (gradient < 0)) | ((vector >= high) & (gradient > 0)) | (norms <= VANISHING)
    free = np.flatnonzero(~held)
    step = np.zeros(vector.size)
    if not free.size or not np.isfinite(hessian).all():
        return step, 0.0
    scale = norms[free]
    matrix = hessian[np.ix_(free, free)] / np.outer(scale, scale) + damping * np.eye(free.size)
    room = (low - vector)[free] * scale, (high - vector)[free] * scale
    step[free] = bounded_minimiser(matrix, gradient[free] / scale, *room) / scale
    step = np.clip(vector + step, low, high) - vector
    return step, float(2 * step @ gradient - step @ hessian @ step)


def bounded_minimiser(matrix: np.ndarray, right: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minimiser of xᵀ M x/2 − bᵀ x, between bounds, for a positive semidefinite M.

    Parameters
    ----------
    matrix : (k, k) array
        M.
    right, low, high : (k,) arrays
        b and the bounds.

    Returns
    -------
    (k,) array
    """
    with suppress(np.linalg.LinAlgError):
        x = np.linalg.solve(matrix, right)
        if ((x >= low) & (x <= high)).all():
            return x
    values, vectors = np.linalg.eigh(matrix)
    root = np.sqrt(np.maximum(values, EPS * values[-1]))
    return bounded_least_squares(root[:, None] * vectors.T, vectors.T @ right / root, low, high)
