"""Where a sampled model settles at a constant velocity: the force, and of a state space the state too."""

from __future__ import annotations

from typing import Any

import numpy as np

from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.simulation import simulate
from quartercar.dampers.blackbox.held import Inner
from quartercar.dampers.drive import Drive

HOLD = (64, 4096)
"""samples for which a velocity is held to see where the force settles, at first and at most."""
PART = 1 << 16
"""samples of a run in memory at a time: eight hundred velocities held for 4096 each would be three million, and a
self-scheduled model of twenty regressors lays 600 MB along them."""
SETTLED = 1e-7
"""change over the last half, as a share of the largest force, at which it has."""


def record_of(drive: Drive, force: np.ndarray) -> Record:
    """A drive as a record, beside a force.

    Parameters
    ----------
    drive : Drive
        Velocity [m/s], displacement [m] and current.
    force : (n,) array
        [N].

    Returns
    -------
    Record
        All four channels, without units.
    """
    columns: Any = {"velocity": drive.velocity, "displacement": drive.displacement, "current": drive.current,
                    "force": force}
    return Record(columns, drive.sample_time)


def at_rest(model: Inner, velocity: np.ndarray, current: float, displacement: float) -> np.ndarray:
    """(n,) force to which a model settles at each of these velocities; NaN where it does not.

    Transfer functions and state spaces see the displacement pass through `displacement` at that velocity, and so do
    models that derive the velocity from it; others see both held.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
        In the damper's own sense.
    velocity : (n,) array
        Held, one case each [m/s].
    current : float
        Held, in the unit of the model's scheduling.
    displacement : float
        At the instant of the force [m].

    Returns
    -------
    (n,) array
        [N].
    """
    if isinstance(model, LPVTransferFunction):
        return _closed_form(model, velocity, current, displacement)
    if isinstance(model, LPVStateSpace):
        return state_at_rest(model, velocity, current, displacement)[1]
    out, left, largest, hold = np.empty(velocity.size), np.arange(velocity.size), 0.0, HOLD[0]
    while True:
        y = _held_runs(model, velocity[left], current, displacement, hold)
        out[left] = y[:, -1]
        largest = max(largest, float(np.abs(y).max()))
        moving = np.abs(y[:, -1] - y[:, hold // 2]) > SETTLED * largest
        if hold >= HOLD[1] or not np.isfinite(y).all() or not moving.any():
            return out
        left = left[moving]  # most settle soon, and the few that take long hold up none of them
        hold *= 4


def _held_runs(model: Inner, velocity: np.ndarray, current: float, displacement: float, hold: int) -> np.ndarray:
    """(n, hold) force while each velocity is held, one after the other in a single run; NaN from where it diverged.

    The run is made in parts of whole holds: each goes on from the last inputs and forces of the one before.
    """
    assert model.sample_time is not None
    passing = "velocity" not in [s.name for s in model.inputs]
    steps = np.arange(1 - hold, 1) if passing else np.zeros(hold)
    out, before, past = np.full((velocity.size, hold), np.nan), None, np.zeros((model.start, 1))
    for first in range(0, velocity.size, max(PART // hold, 1)):
        held = velocity[first: first + max(PART // hold, 1)]
        v = np.repeat(held, hold)
        x = displacement + v * np.tile(steps, held.size) * model.sample_time
        motion = np.array([v, x, np.full(v.size, current)])
        if before is None:
            before = np.repeat(motion[:, :1], model.start, axis=1)
        drive = Drive(model.sample_time, *np.concatenate([before, motion], axis=1))
        run = simulate(model, record_of(drive, np.zeros(drive.n_samples)), past)
        out[first: first + held.size] = run.output[model.start:, 0].reshape(-1, hold)
        if run.diverged_at is not None:
            break
        before, past = motion[:, v.size - model.start:], run.output[drive.n_samples - model.start:]
    return out


def _held_inputs(model: Inner, velocity: np.ndarray, current: float, displacement: float) -> np.ndarray:
    """(n, m) inputs behind the static stage as the motion passes through a displacement."""
    motion = {"velocity": velocity, "displacement": np.full(velocity.size, displacement),
              "current": np.full(velocity.size, current)}
    u = np.column_stack([motion[s.name] for s in model.inputs])
    if model.input_stage is None:
        return u
    return model.input_stage.apply(u, np.full((velocity.size, len(model.box.names)), current))


def state_at_rest(model: LPVStateSpace, velocity: np.ndarray, current: float,
                  displacement: float) -> tuple[np.ndarray, np.ndarray]:
    """(n, order) states and (n,) forces to which a state space settles; NaN where a pole stands outside the circle.

    The inputs are u(k) = u_0 + u_1 k with u_1 = v T for the displacement, and so is the state, d(k) = d_0 + d_1 k::

        d_1 = (I − A)⁻¹ B u_1,    d_0 = (I − A)⁻¹ (B u_0 + f − d_1),    y(0) = C d_0 + D u_0 + g

    Parameters
    ----------
    model : LPVStateSpace
        In the damper's own sense.
    velocity : (n,) array
        Held, one case each [m/s].
    current : float
        Held, in the unit of the model's scheduling.
    displacement : float
        At sample 0 [m].

    Returns
    -------
    state : (n, order) array
        At sample 0; a state space has no units for it.
    force : (n,) array
        At sample 0 [N].
    """
    assert model.state_offset is not None and model.output_offset is not None and model.sample_time is not None
    phi = model.basis.evaluate(np.full((1, len(model.box.names)), current))[0]
    a, b, c, d, f, g = (np.tensordot(phi, x, axes=1) for x in (model.A, model.B, model.C, model.D, model.state_offset,
                                                               model.output_offset))
    if np.abs(np.linalg.eigvals(a)).max(initial=0.0) >= 1:
        return np.full((velocity.size, model.order), np.nan), np.full(velocity.size, np.nan)
    u = _held_inputs(model, velocity, current, displacement)
    rise = np.zeros_like(u)
    for column, signal in enumerate(model.inputs):
        if signal.name == "displacement":
            rise[:, column] = velocity * model.sample_time
    left = np.eye(model.order) - a
    slope = np.linalg.solve(left, b @ rise.T)
    state = np.linalg.solve(left, b @ u.T + f[:, None] - slope)
    return state.T, (c @ state + d @ u.T + g[:, None])[0]


def _closed_form(model: LPVTransferFunction, velocity: np.ndarray, current: float,
                 displacement: float) -> np.ndarray:
    """y = (Σ_j b_j u + Σ_j c_j)/(1 + Σ_i a_i); NaN where a pole at this current stands outside the circle.

    The displacement is no constant while the velocity is held, but x(k) = x_0 + v T k, to which the model answers with
    y(k) = y_0 + G v T k, G = Σ_j b_j/(1 + Σ_i a_i), for its own ramp::

        y_0 = G x_0 + v T (G Σ_i i a_i − Σ_j j b_j)/(1 + Σ_i a_i)

    A map of past displacements may contain the velocity as their differences; held still they would contain none.
    """
    point = [current] * len(model.box.names)
    if np.abs(model.frozen_poles(point)).max(initial=0.0) >= 1:
        return np.full(velocity.size, np.nan)
    u = _held_inputs(model, velocity, current, displacement)
    a, b, c = model.coefficients(point)
    below = 1.0 + a.sum()
    settled = (u @ b.sum(axis=0)[0] + c.sum()) / below
    read = [s.name for s in model.inputs]
    if "displacement" not in read:
        return settled
    past = b[:, 0, read.index("displacement")]
    lag = np.arange(1, len(a) + 1) @ a[:, 0, 0] * past.sum() / below - np.arange(len(past)) @ past
    return settled + velocity * model.sample_time * lag / below
