"""The varying model as a python-control `NonlinearIOSystem`."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.errors import InputError
from lpvid.model.scheduling_stage import SchedulingLag, SchedulingStage
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import realize

if TYPE_CHECKING:
    import control


def nonlinear_io_system(model: LPVTransferFunction | LPVStateSpace) -> control.NonlinearIOSystem:
    """The varying model as a python-control `NonlinearIOSystem` with inputs (u…, p…).

    Its inputs are the measured inputs, then the scheduling variables (a channel that is both appears once). The input
    stage, affine terms and a scheduling filter are inside. A transfer function with coefficients at p(k−i) enters in
    its exact observer form, any other in the augmented form. Where p is read at earlier times, states ``past p…`` hold
    it: for the free run that holds p before the first sample, start them at p(0).

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace

    Returns
    -------
    control.NonlinearIOSystem

    Raises
    ------
    InputError
        A model that needs future scheduling, or a continuous one that reads p at other times.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso([[-0.9, 0.1]], [[0, 0], [0.1, 0]], Polynomial("p", degree=1), 0.01)
    >>> nonlinear_io_system(model).input_labels
    ['u1', 'p']
    """
    import control

    ss = model if isinstance(model, LPVStateSpace) else realize(
        model, "observable" if model.lagged else "augmented").model
    memory = _memory(ss)
    names = list(dict.fromkeys([*(s.name for s in ss.inputs), *ss.box.names]))
    u_at, p_at = ([names.index(n) for n in group] for group in ([s.name for s in ss.inputs], ss.box.names))
    nx = ss.order

    def read(x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Basis values, filter inputs, filtered scheduling and what the memory holds next."""
        window, following = memory.step(x[nx:], u[p_at])
        driven = u[u_at][None, :]
        if ss.input_stage is not None:
            driven = ss.input_stage.apply(driven, window[-1:])
        return ss.basis.evaluate(window)[-1], driven[0], window[-1], following

    def update(t: float, x: np.ndarray, u: np.ndarray, params: Mapping) -> np.ndarray:
        phi, v, _, following = read(x, u)
        moved = (np.tensordot(phi, ss.A, 1) @ x[:nx] + np.tensordot(phi, ss.B, 1) @ v
                 + phi @ ss.state_offset)  # type: ignore[operator]
        return np.concatenate([moved, following])

    def output(t: float, x: np.ndarray, u: np.ndarray, params: Mapping) -> np.ndarray:
        phi, v, _, _ = read(x, u)
        return (np.tensordot(phi, ss.C, 1) @ x[:nx] + np.tensordot(phi, ss.D, 1) @ v
                + phi @ ss.output_offset)  # type: ignore[operator]

    states = [f"x{i + 1}" for i in range(nx)] + memory.labels
    return control.NonlinearIOSystem(update if states else None, output, inputs=distinct(names),
                                     outputs=labels(ss.outputs), states=distinct(states), dt=ss.sample_time or 0.0)


@dataclass(frozen=True, eq=False)
class _Memory:
    """Past scheduling that a model still needs: filtered samples, and raw ones inside a delay.

    Held newest first: `depth` rows of filtered p, then `raw` samples of the delayed variable.
    """

    names: tuple[str, ...]
    depth: int
    lag: SchedulingLag | None
    raw: int
    gains: tuple[float, float]
    delay: float

    @property
    def labels(self) -> list[str]:
        past = [f"past {n} {i + 1}" for i in range(self.depth) for n in self.names]
        logged = [f"logged {self.names[self.lag.variable]} {i + 1}" for i in range(self.raw)] if self.lag else []
        return past + logged

    def step(self, held: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Filtered scheduling, oldest first and p(k) last, and what to hold next."""
        split = self.depth * len(self.names)
        past, logged = held[:split].reshape(self.depth, len(self.names)), held[split:]
        now = np.array(p, dtype=float)
        if self.lag is not None:
            i = self.lag.variable
            logged = np.concatenate([now[i : i + 1], logged])
            command = np.interp(self.delay, np.arange(len(logged)), logged)
            error = command - past[0, i]
            now[i] = past[0, i] + self.gains[0 if error > 0 else 1] * error
            logged = logged[: self.raw]
        rows = np.vstack([now[None, :], past])
        return rows[::-1], np.concatenate([rows[: self.depth].ravel(), logged])


def _memory(model: LPVStateSpace) -> _Memory:
    low, high = model.basis.lags
    stage: SchedulingStage | None = model.scheduling_stage
    if low < 0:
        raise InputError("this model reads its scheduling ahead of time", got=f"{-low} sample(s)",
                         why="an input/output system is causal", mend="realise it with form 'augmented'")
    if model.sample_time is None:
        if high or stage is not None:
            raise InputError("a continuous model cannot read its scheduling at other samples", mend="discretise it")
        return _Memory(model.box.names, 0, None, 0, (1.0, 1.0), 0.0)
    if stage is None:
        return _Memory(model.box.names, high, None, 0, (1.0, 1.0), 0.0)
    if not isinstance(stage, SchedulingLag):
        raise InputError("this scheduling filter has no form as an input/output system", got=type(stage).__name__,
                         mend="filter the scheduling first and export the model without it")
    rise, fall = (1.0 if tau == 0 else float(-np.expm1(-model.sample_time / tau))
                  for tau in (stage.tau_rise, stage.tau_fall))
    delay = stage.delay / model.sample_time
    return _Memory(model.box.names, max(high, 1), stage, int(np.ceil(delay)), (rise, fall), delay)


def labels(signals: Sequence[Signal]) -> list[str]:
    """Names as python-control takes them: no dots, no two alike.

    Parameters
    ----------
    signals : sequence of Signal
        Channels of a model.

    Returns
    -------
    list of str
        In the same order, made distinct as by `distinct`.
    """
    return distinct([s.name for s in signals])


def distinct(names: Sequence[str]) -> list[str]:
    """Names with dots replaced by underscores and a number behind those that occurred before.

    Parameters
    ----------
    names : sequence of str
        As in the model; an empty one becomes "_".

    Returns
    -------
    list of str
        In the same order, no two alike.
    """
    out: list[str] = []
    for name in (n.replace(".", "_") or "_" for n in names):
        out.append(next(c for c in (name, *(f"{name}_{i}" for i in itertools.count(2))) if c not in out)
                   if name in out else name)
    return out
