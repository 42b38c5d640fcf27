r"""The state in which a record begins, from its first outputs, weighed against what the model's state can be.

The free run is affine in its initial state: y(k) = y₀(k) + O(k) x(0) + e(k). Few samples, or samples close to one
another, determine x(0) badly: least squares alone then puts the model's error, amplified, into a state whose response
goes on for as long as the slowest mode. Hence

::

    min_x  Σ_{k<n} |y − y₀ − O x|²/σ² + xᵀ P⁻¹ x

    P = (1/N) Σ x₀(k) x₀(k)ᵀ + (s²/n_x) (OᵀO/N)⁻¹

x₀ are the states along the record's own input from rest, s² = mean |y − y₀|² what that input leaves unexplained: a
state is as likely as those that the input reaches, or as one whose free response has the power left over. σ² is the
error of the model, the mean square left after the best initial state for the first N samples, N of `HORIZON` or more.
An exact model has σ = 0 and the plain least squares; so has a fit to N samples or more. Outputs count in units of their
spread.
"""

from __future__ import annotations

import numpy as np

from lpvid import _checks
from lpvid.model.state_space import LPVStateSpace

HORIZON = 200
"""samples, or 20 per state if that is more, over which the error of the model is looked at."""
SEEN = 1e-12
"""eigenvalue of OᵀO/N, over the largest, below which a state has a negligible response."""
OVERFLOW = 1e9
"""growth of a free response after which it gives no information on its start."""


def estimate_state(model: LPVStateSpace, phi: np.ndarray, u: np.ndarray, y: np.ndarray, length: int, limit: float,
                   *, weighed: bool = True) -> np.ndarray:
    """State at the first sample.

    Parameters
    ----------
    model : LPVStateSpace
    phi : (n, M) array
        Basis functions along the record.
    u : (n, n_inputs) array
    y : (n, n_outputs) array
        Measured outputs.
    length : int
        Samples that the state is fitted to.
    limit : float
        What no sane run exceeds.
    weighed : bool
        False for the plain least squares: an observer corrects its state from sample to sample, and the error of its
        model is not that of a free run.

    Returns
    -------
    (order,) array
    """
    if not model.order:
        return np.zeros(0)
    far = min(len(y), max(HORIZON, 20 * model.order, length))
    spread = np.std(y[:far], axis=0)
    unit = np.where(spread > 0, spread, np.maximum(np.abs(y[:far]).max(axis=0), 1e-300))
    forced, sane = _forced(model, phi[:far], u[:far], limit)
    influence = _influence(model, phi[:sane]) / unit[:, None]
    far = len(influence)
    left = (y[:far] - forced[:far]) / unit
    near = min(length, far)
    rows, target = influence[:near].reshape(-1, model.order), left[:near].ravel()
    enough = length >= max(HORIZON, 20 * model.order)
    root = _prior(model, phi[:far], u[:far], influence, left) if weighed and not enough else None
    whole = influence.reshape(-1, model.order)
    if root is None:
        return np.linalg.lstsq(rows, target, rcond=1e-10)[0]
    best = np.linalg.lstsq(whole, left.ravel(), rcond=1e-10)[0]
    degrees = max(left.size - model.order, 1)
    error = np.sqrt(np.sum((left.ravel() - whole @ best) ** 2) / degrees)
    stacked = np.vstack([rows @ root, error * np.eye(root.shape[1])])
    z = np.linalg.lstsq(stacked, np.append(target, np.zeros(root.shape[1])), rcond=1e-12)[0]
    return root @ z


def _forced(model: LPVStateSpace, phi: np.ndarray, u: np.ndarray, limit: float) -> tuple[np.ndarray, int]:
    """The run from rest, and the samples over which it is bounded."""
    from lpvid import _kernels

    out = np.zeros((len(u), model.n_outputs))
    code = _kernels.free_run_ss(model.A, model.B, model.C, model.D, model.state_offset, model.output_offset, phi,
                                _checks.read_only(u), _checks.read_only(np.zeros(model.order)), out, limit)
    return out, len(u) if code < 0 else max(int(code), 1)


def _influence(model: LPVStateSpace, phi: np.ndarray) -> np.ndarray:
    """(n, n_outputs, order) responses O(k), up to where they overflow."""
    found, state = [], np.eye(model.order)
    for row in phi:
        found.append(np.tensordot(row, model.C, axes=1) @ state)
        state = np.tensordot(row, model.A, axes=1) @ state
        if not np.abs(state).max() < OVERFLOW:
            break
    return np.array(found)


def _states(model: LPVStateSpace, phi: np.ndarray, u: np.ndarray) -> np.ndarray | None:
    """(n, order) states from rest; None where they are not finite.

    The free run with the identity as its output matrix, on one more basis function that is 1 throughout: the kernel is
    that of every other run, which is compiled already.
    """
    from lpvid import _kernels

    n = model.order
    assert model.state_offset is not None

    def extended(matrices: np.ndarray, last: np.ndarray) -> np.ndarray:
        out = np.concatenate([matrices, last[None]])
        out.setflags(write=False)
        return out

    none = np.zeros((len(model.A), n, n))
    states = np.zeros((len(u), n))
    code = _kernels.free_run_ss(
        extended(model.A, np.zeros((n, n))), extended(model.B, np.zeros(model.B.shape[1:])),
        extended(none, np.eye(n)), extended(np.zeros(model.B.shape), np.zeros(model.B.shape[1:])),
        extended(model.state_offset, np.zeros(n)), extended(np.zeros((len(model.A), n)), np.zeros(n)),
        np.column_stack([phi, np.ones(len(phi))]), _checks.read_only(u),
        _checks.read_only(np.zeros(n)), states, np.inf)
    return None if code >= 0 else states


def _prior(model: LPVStateSpace, phi: np.ndarray, u: np.ndarray, influence: np.ndarray,
           left: np.ndarray) -> np.ndarray | None:
    """(order, r) root of P; None where the states from rest are not finite."""
    n = model.order
    states = _states(model, phi, u)
    if states is None:
        return None
    if np.abs(states).max() > np.sqrt(np.finfo(float).max) / len(u):
        return None
    reached = states.T @ states / len(u)
    values, vectors = np.linalg.eigh(np.einsum("koi,koj->ij", influence, influence) / len(influence))
    seen = values > SEEN * max(float(values[-1]), 1e-300)
    free = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T * float(np.mean(left**2)) / n
    values, vectors = np.linalg.eigh(reached + free)
    return vectors * np.sqrt(np.maximum(values, 0.0))
