"""Sampled dampers inside a simulation: an input-output model of lpvid stepped one sample at a time."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace

import numpy as np

from lpvid.errors import InputError
from lpvid.model.quasi import SelfScheduled
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from quartercar.dampers.blackbox.held import Inner
from quartercar.dampers.blackbox.rest import at_rest, state_at_rest
from quartercar.dampers.stepper import DamperStepper

LIMIT = 1e12
"""force at which a run counts as diverged [N]"""


def sampled_stepper(model: Inner) -> DamperStepper:
    """The stepper of a sampled damper's model, at the model's own period.

    Parameters
    ----------
    model : Inner
        With velocity, displacement and current as inputs and scheduling.

    Returns
    -------
    DamperStepper
        Of the kind that suits the model.

    Raises
    ------
    InputError
        A current filter that is not a lag, a model that reads the current ahead of time.
    """
    if isinstance(model, LPVTransferFunction):
        return _TransferFunctionStepper(model)
    if isinstance(model, LPVStateSpace):
        return _StateSpaceStepper(model)
    return _WindowStepper(model)


class _CurrentFilter:
    """The model's filter on its current, one sample at a time."""

    def __init__(self, model: Inner) -> None:
        lag = model.scheduling_stage
        if lag is not None and not isinstance(lag, SchedulingLag):
            raise InputError("a car can only step a current filter that is a lag", got=type(lag).__name__)
        assert model.sample_time is not None
        self._period = model.sample_time
        self._delay = 0.0 if lag is None else lag.delay / self._period
        self._lag = None if lag is None else replace(lag, delay=0.0)
        self._past: list[float] = []
        self._value = 0.0

    def begin(self, current: float) -> float:
        """Settled at a current."""
        self._past = [current] * (int(np.ceil(self._delay)) + 2)
        self._value = current
        return current

    def __call__(self, current: float) -> float:
        """The filtered current at the next sample."""
        self._past = [*self._past[1:], current]
        if self._lag is None:
            return current
        whole = int(np.floor(self._delay))
        late = self._delay - whole
        wanted = (1 - late) * self._past[-1 - whole] + (late * self._past[-2 - whole] if late else 0.0)
        self._value = float(self._lag.apply(np.array([[self._value], [wanted]]), self._period)[1, 0])
        return self._value


class _ModelStepper(DamperStepper):
    """The current behind the model's filter at the last samples, the newest last, and the inputs at this one."""

    def __init__(self, model: Inner, rows: int) -> None:
        if model.box.names not in ((), ("current",)):
            raise InputError("a car can only step a damper that is scheduled by its current",
                             got=", ".join(model.box.names))
        self._model, self._rows = model, rows
        self._names = [s.name for s in model.inputs]
        self._filter = _CurrentFilter(model)

    def _settle(self, current: float) -> None:
        self._current = current
        self._p = np.full((self._rows, len(self._model.box.names)), self._filter.begin(current))

    def approach(self, current: float) -> None:
        self._current, filtered = current, self._filter(current)
        self._p = np.roll(self._p, -1, axis=0)
        self._p[-1] = filtered
        self._look()

    @abstractmethod
    def _look(self) -> None:
        """Prepare what does not depend on the motion at the coming sample."""

    def _inputs(self, displacement: float, velocity: float) -> np.ndarray:
        motion = {"displacement": displacement, "velocity": velocity, "current": self._current}
        return np.array([motion[n] for n in self._names])

    def _shaped(self, displacement: float, velocity: float) -> np.ndarray:
        """Inputs behind the static stage."""
        u, stage = self._inputs(displacement, velocity), self._model.input_stage
        return u if stage is None else stage.apply(u[None], self._p[-1:])[0]


class _SampledStepper(_ModelStepper):
    """Rows of the past: inputs, scheduling and force of the last samples, the newest last."""

    _model: LPVTransferFunction | SelfScheduled

    def __init__(self, model: LPVTransferFunction | SelfScheduled) -> None:
        super().__init__(model, model.start + 1)

    def begin(self, displacement: float, velocity: float, current: float) -> float:
        self._settle(current)
        before = displacement + velocity * self._model.sample_time * np.arange(1 - self._rows, 1)
        self._u = np.array([self._inputs(x, velocity) for x in before])
        self._y = np.array([float(at_rest(self._model, np.array([velocity]), current, x)[0]) for x in before])
        return float(self._y[-1])

    def approach(self, current: float) -> None:
        self._u, self._y = np.roll(self._u, -1, axis=0), np.roll(self._y, -1)
        super().approach(current)

    def commit(self, displacement: float, velocity: float) -> None:
        self._y[-1] = self.trial(displacement, velocity)
        self._u[-1] = self._inputs(displacement, velocity)


class _TransferFunctionStepper(_SampledStepper):
    """y(k) = past + b_0(p) u(k); the past is summed once per sample."""

    _model: LPVTransferFunction

    def _look(self) -> None:
        model = self._model
        phi = model.basis.evaluate(self._p)
        u = self._u if model.input_stage is None else model.input_stage.apply(self._u, self._p)
        last = len(phi) - 1
        total = 0.0
        for i in range(1, model.na + 1):
            total -= float(model.a[i - 1, 0, 0] @ phi[last - i if model.lagged else last]) * self._y[last - i]
        for j in range(1, model.n_lags):
            total += float(u[last - j] @ (model.b[j, 0] @ phi[last - j if model.lagged else last]))
        assert model.c is not None
        for j in range(model.n_affine):
            total += float(model.c[j, 0] @ phi[last - j])
        self._past, self._direct = total, model.b[0, 0] @ phi[last]

    def trial(self, displacement: float, velocity: float) -> float:
        return self._past + float(self._shaped(displacement, velocity) @ self._direct)


class _WindowStepper(_SampledStepper):
    """A model that schedules itself, run from its past for one sample."""

    def _look(self) -> None:
        pass

    def trial(self, displacement: float, velocity: float) -> float:
        u = self._u.copy()
        u[-1] = self._inputs(displacement, velocity)
        out, _ = self._model.free_run(u, self._p, self._y[:-1].copy(), LIMIT)  # type: ignore[union-attr]
        return float(out[-1])


class _StateSpaceStepper(_ModelStepper):
    """F = C d + D u + g with the state carried along; a basis that reads past currents is given them."""

    _model: LPVStateSpace

    def __init__(self, model: LPVStateSpace) -> None:
        low, memory = model.basis.lags
        if low < 0:
            raise InputError(f"this state space reads the current {-low} samples ahead", why="a car has none",
                             mend="--form augmented or --form observable instead of shifted")
        super().__init__(model, memory + 1)
        assert model.state_offset is not None and model.output_offset is not None
        self._stacks = (model.A, model.B, model.C[:, 0], model.D[:, 0], model.state_offset, model.output_offset[:, 0])

    def begin(self, displacement: float, velocity: float, current: float) -> float:
        self._settle(current)
        state, force = state_at_rest(self._model, np.array([velocity]), current, displacement)
        self._state = state[0]
        return float(force[0])

    def _look(self) -> None:
        phi = self._model.basis.evaluate(self._p)[-1]
        self._now = tuple(np.tensordot(phi, x, axes=1) for x in self._stacks)
        self._past = float(self._now[2] @ self._state + self._now[5])

    def trial(self, displacement: float, velocity: float) -> float:
        return self._past + float(self._now[3] @ self._shaped(displacement, velocity))

    def commit(self, displacement: float, velocity: float) -> None:
        a, b, _, _, f, _ = self._now
        self._state = a @ self._state + b @ self._shaped(displacement, velocity) + f
