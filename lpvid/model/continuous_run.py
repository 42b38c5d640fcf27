"""Free runs of continuous state-space models, with inputs and scheduling linear between their samples."""

from __future__ import annotations

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.model.state_space import LPVStateSpace

ACCURATE = 1e-4
"""change of the output, as a share of its largest size, from halved steps at which a run counts as found"""
FINEST = 64
"""parts into which a sampling period is divided at most"""
SPAN = 4096
"""steps whose matrix exponentials are computed at once"""


def continuous_run(model: LPVStateSpace, u: np.ndarray, p: np.ndarray, period: float, x: np.ndarray) -> np.ndarray:
    """(n, n_outputs) output at the samples of inputs (n, m) and scheduling (n, n_scheduling).

    Each step is exact for the scheduling of its middle and an input that is linear in time: with
    F = [A h, B h, 0; 0, 0, I; 0, 0, 0], the first rows of exp F take (x, u, h·u̇) one step ahead (Van Loan 1978). A
    period is divided until halving the steps changes the output by less than `ACCURATE` of its size.

    Parameters
    ----------
    model : LPVStateSpace
        In continuous time.
    u : (n, n_inputs) array
        Filter inputs, in SI.
    p : (n, n_scheduling) array
        In the units of the box.
    period : float
        Between samples [s].
    x : (order,) array
        Initial state.

    Returns
    -------
    (n, n_outputs) array
        With values that are not finite where the run diverges.

    Raises
    ------
    NumericalError
        `FINEST` parts are not enough.
    """
    before = None
    parts = 1
    while parts <= FINEST:
        output = _run(model, u, p, period / parts, parts, x)
        size = float(np.abs(output).max(initial=0.0))
        if not model.box.names and before is None:
            return output
        if before is not None and np.abs(output - before).max(initial=0.0) <= ACCURATE * size:
            return output
        if not np.isfinite(size):
            return output
        before, parts = output, 2 * parts
    raise NumericalError(f"a run with {FINEST} steps per sample is not accurate to {ACCURATE:g}: sample the record "
                         "faster, or its scheduling jumps between samples")


def step_response(model: LPVStateSpace, time: np.ndarray, scheduling: np.ndarray | None = None, *, of: str = ""
                  ) -> np.ndarray:
    """(n, n_outputs) output of a continuous model at rest when one input steps from 0 to 1 at the first time.

    Parameters
    ----------
    model : LPVStateSpace
        In continuous time.
    time : (n,) array
        Equally spaced [s].
    scheduling : (n,) or (n, n_scheduling) array, optional
        Along the same times; left out, the middle of the box.
    of : str, optional
        The input; left out, the first.

    Returns
    -------
    (n, n_outputs) array

    Raises
    ------
    InputError
        Times that are not equally spaced, an input that the model does not have, a discrete model.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> lag = LPVStateSpace([[[-1.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), None)
    >>> step_response(lag, np.linspace(0, 2, 3)).ravel().round(4).tolist()
    [0.0, 0.6321, 0.8647]
    """
    time = np.asarray(time, dtype=float)
    if time.ndim != 1 or len(time) < 2 or not np.allclose(np.diff(time), time[1] - time[0]) or not time[1] > time[0]:
        raise InputError("a step response needs equally spaced rising times", got=f"{time.size} value(s)")
    if model.sample_time is not None:
        raise InputError("this model is discrete in time", mend="run it along a record with lpvid.simulate")
    names = [s.name for s in model.filter_inputs]
    if of and of not in names:
        raise InputError(f"no input '{of}'", got=", ".join(names))
    u = np.zeros((len(time), len(names)))
    u[:, names.index(of) if of else 0] = 1.0
    p = np.tile(model.box.centre, (len(time), 1)) if scheduling is None else np.asarray(scheduling, dtype=float)
    p = p[:, None] if p.ndim == 1 else p
    if p.shape != (len(time), len(model.box.names)):
        raise InputError("the scheduling does not fit the times and the model", got=p.shape,
                         why=f"expected {(len(time), len(model.box.names))}")
    return continuous_run(model, u, p, float(time[1] - time[0]), np.zeros(model.order))


def _run(model: LPVStateSpace, u: np.ndarray, p: np.ndarray, h: float, parts: int, x: np.ndarray) -> np.ndarray:
    from scipy.linalg import expm

    n, m, count = model.order, u.shape[1], len(u)
    share = np.arange(parts) / parts
    at = _between(p, share + 0.5 / parts)
    starts, slopes = _between(u, share), np.repeat(np.diff(u, axis=0), parts, axis=0) / parts
    offset = model.state_offset
    assert offset is not None and model.output_offset is not None
    states = np.empty((count, n))
    states[0] = x
    for first in range(0, len(at), SPAN):
        rows = slice(first, first + SPAN)
        phi = model.basis.evaluate(at[rows])
        f = np.zeros((len(phi), n + 2 * m + 1, n + 2 * m + 1))
        f[:, :n, :n], f[:, :n, n : n + m] = np.tensordot(phi, model.A, 1) * h, np.tensordot(phi, model.B, 1) * h
        f[:, :n, -1] = phi @ offset * h
        f[:, n : n + m, n + m : n + 2 * m] = np.eye(m)
        ahead = expm(f)[:, :n]
        for k, step in enumerate(ahead, start=first):
            x = step @ np.concatenate([x, starts[k], slopes[k], [1.0]])
            if (k + 1) % parts == 0:
                states[(k + 1) // parts] = x
    phi = model.basis.evaluate(p)
    c, d = np.tensordot(phi, model.C, 1), np.tensordot(phi, model.D, 1)
    return np.einsum("kij,kj->ki", c, states) + np.einsum("kij,kj->ki", d, u) + phi @ model.output_offset


def _between(values: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """((n − 1)·len(shares), …) values at shares of the way from each sample to the next."""
    steps = values[:-1, None] + shares[None, :, None] * np.diff(values, axis=0)[:, None]
    return steps.reshape(steps.shape[0] * len(shares), values.shape[1])
