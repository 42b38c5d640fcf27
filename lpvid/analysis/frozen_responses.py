"""Frozen responses over time: what a unit step in one input does while the scheduling is constant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction

SETTLED = 5.0
"""Time constants of the slowest pole after which a response is drawn to its end (exp(−5) < 1 %)."""
SHORTEST, LONGEST = 20, 1500
"""Samples of a step response, at least and at most."""


def step_response(model: LPVTransferFunction | LPVStateSpace, at: Sequence[float] | np.ndarray,
                  samples: int) -> np.ndarray:
    """Response from rest to a unit step in each filter input, the scheduling held at `at`.

    A transfer function y(k) = −Σ_i a_i(p) y(k−i) + Σ_j b_j(p) u(k−j) is run as it stands, without its constant; a
    state space x(k+1) = A(p) x + B(p) u, y = C(p) x + D(p) u too. Behind an input stage: the step is in its output.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Discrete in time.
    at : (n_scheduling,) array
        Physical units.
    samples : int

    Returns
    -------
    (samples, n_outputs, n_filter_inputs) array

    Examples
    --------
    >>> import lpvid as lpv
    >>> model = lpv.LPVTransferFunction.siso([[-0.5]], [[2.0]], lpv.Polynomial(), 0.1)
    >>> [float(v) for v in step_response(model, [], 3)[:, 0, 0]]
    [2.0, 3.0, 3.5]
    """
    if isinstance(model, LPVTransferFunction):
        return _transfer_function(model, at, samples)
    A, B, C, D = model.frozen(at)
    rows, x = [], np.zeros((A.shape[0], B.shape[1]))
    for _ in range(samples):
        rows.append(C @ x + D)
        x = A @ x + B
    return np.array(rows)


def _transfer_function(model: LPVTransferFunction, at: Sequence[float] | np.ndarray, samples: int) -> np.ndarray:
    a, b, _ = model.coefficients(at)
    if model.n_outputs == 1:
        from scipy.signal import lfilter

        left = np.concatenate([[1.0], a[:, 0, 0]])
        return np.stack([lfilter(b[:, 0, j], left, np.ones(samples)) for j in range(b.shape[2])], axis=1)[:, None, :]
    total, y = np.cumsum(b, axis=0), np.zeros((samples, model.n_outputs, b.shape[2]))
    for k in range(samples):
        y[k] = total[min(k, len(b) - 1)] - sum((a[i] @ y[k - 1 - i] for i in range(min(model.na, k))),
                                               np.zeros_like(y[k]))
    return y


def settling_samples(model: LPVTransferFunction | LPVStateSpace, places: Sequence[np.ndarray]) -> int:
    """Samples in which every frozen model has settled, within `SHORTEST` and `LONGEST`.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Discrete in time.
    places : sequence of (n_scheduling,) arrays
        Held scheduling, in physical units.

    Returns
    -------
    int
        `LONGEST` where a pole does not decay.
    """
    moduli = [float(np.abs(model.frozen_poles(p)).max(initial=0.0)) for p in places]
    slowest = min(max(moduli, default=0.0), 1 - 1e-9)
    wanted = SETTLED / -np.log(slowest) if slowest > 0 else 0.0
    return int(np.clip(wanted + model.order if isinstance(model, LPVStateSpace) else wanted + len(model.b), SHORTEST,
                       LONGEST))
