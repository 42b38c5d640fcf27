"""Flow: a continuous model as derivatives and outputs, for FMUs that leave the integration to their importer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.export.basis_steps import basis_values, staged
from lpvid.export.contract import Options, within
from lpvid.export.expression import Expr, clipped
from lpvid.export.state_space_steps import mixed
from lpvid.export.step_builder import StepBuilder
from lpvid.export.step_program import StepProgram
from lpvid.export.transfer_function_steps import vector
from lpvid.model.designed import role_of
from lpvid.model.state_space import LPVStateSpace

PERIODS = 3.0
"""Time constants of the slowest frozen pole over which a flow is compared with its reference."""


@dataclass(frozen=True, eq=False)
class Flow:
    """ẋ and y of a continuous model as a program, with the functions of this package that it must reproduce.

    Attributes
    ----------
    program : StepProgram
        Its period is 0; it writes outputs and rates.
    rates : callable
        (states, inputs) to (states,): this package's own derivative.
    outputs : callable
        (states, inputs) to (outputs,).
    excite : callable
        (n, rng) to (n, inputs): a random trajectory, linear between its samples.
    step : float
        Time between those [s].
    """

    program: StepProgram
    rates: Callable[[np.ndarray, np.ndarray], np.ndarray]
    outputs: Callable[[np.ndarray, np.ndarray], np.ndarray]
    excite: Callable[[int, np.random.Generator], np.ndarray]
    step: float

    def trial(self, samples: int = 60, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Inputs at the samples, and the states there by an implicit integration of this package's derivatives.

        Parameters
        ----------
        samples : int
            Length of the trajectory, `step` apart.
        seed : int
            Of the random inputs.

        Returns
        -------
        (n, inputs) array
        (n, states) array
        """
        from scipy.integrate import solve_ivp

        u = self.excite(samples, np.random.default_rng(seed))
        time = self.step * np.arange(samples)

        def rate(t: float, x: np.ndarray) -> np.ndarray:
            return self.rates(x, np.array([np.interp(t, time, column) for column in u.T]))

        states = [np.concatenate([np.ravel(q.start) for q in self.program.states])]
        for k in range(samples - 1):
            states.append(solve_ivp(rate, (time[k], time[k + 1]), states[-1], method="Radau", rtol=1e-4).y[:, -1])
        return u, np.array(states)


def _state_space_flow(model: LPVStateSpace, options: Options) -> Flow:
    """ẋ = A(p)x + B(p)u + f(p), y = C(p)x + D(p)u + g(p) of a continuous state space.

    Raises
    ------
    InputError
        A scheduling filter, or a basis of past scheduling, which a continuous model cannot have.
    """
    if model.scheduling_stage is not None or model.basis.lags != (0, 0):
        raise InputError("a continuous model cannot read its scheduling at other samples", mend="discretise it")
    assert model.state_offset is not None and model.output_offset is not None
    clamp = bool(role_of(model)) if options.clamp is None else options.clamp
    b = StepBuilder(options.name or "lpv_model", f"continuous LPV state space {', '.join(map(str, model.inputs))} -> "
                    f"{', '.join(map(str, model.outputs))}", 0.0)
    u: list[Expr] = [b.input(s.name, s.unit, f"input {s.name}") for s in model.inputs]
    p: dict[str, Expr] = {}
    for name, low, high, unit in zip(model.box.names, model.box.lower, model.box.upper, model.box.units, strict=True):
        value: Expr = b.input(name, unit, f"scheduling {name}", low, high)
        p[name] = b.let(f"held_{name}", clipped(value, low, high)) if clamp else value
    driven = vector(b, "driving", staged(b, model.input_stage, u, list(p.values())))
    phi = vector(b, "basis", basis_values(b, model.basis, {n: (lambda i, at=at: at) for n, at in p.items()}))
    x = b.states("x", np.zeros(model.order), "", "states") if model.order else None
    if x is not None:
        ahead = mixed(b, phi, x, driven, ("A", model.A), ("B", model.B), ("f", model.state_offset), model.order)
        for i in range(model.order):
            b.rate(x[i], ahead[i])
    y = mixed(b, phi, x, driven, ("C", model.C), ("D", model.D), ("g", model.output_offset), model.n_outputs)
    for o, signal in enumerate(model.outputs):
        b.output(signal.name, y[o], signal.unit, f"output {signal.name}")
    program = b.program()
    return _with_reference(model, program, clamp)


def _with_reference(model: LPVStateSpace, program: StepProgram, clamp: bool) -> Flow:
    channels = [q.label for q in program.inputs]
    own = [channels.index(s.name) for s in model.inputs]
    moving = [channels.index(n) for n in model.box.names]
    low, high = np.full(len(channels), -1.0), np.full(len(channels), 1.0)
    low[moving], high[moving] = model.box.lower, model.box.upper

    def parts(row: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        p = row[moving][None]
        p = np.clip(p, model.box.lower, model.box.upper) if clamp else p
        u = row[own][None] if model.input_stage is None else model.input_stage.apply(row[own][None], p)
        return model.basis.evaluate(p)[0], u[0], p

    def rates(x: np.ndarray, row: np.ndarray) -> np.ndarray:
        phi, u, _ = parts(row)
        assert model.state_offset is not None
        return np.tensordot(phi, model.A, 1) @ x + np.tensordot(phi, model.B, 1) @ u + phi @ model.state_offset

    def outputs(x: np.ndarray, row: np.ndarray) -> np.ndarray:
        phi, u, _ = parts(row)
        assert model.output_offset is not None
        return np.tensordot(phi, model.C, 1) @ x + np.tensordot(phi, model.D, 1) @ u + phi @ model.output_offset

    poles = np.abs(model.frozen_poles(model.box.centre))
    slowest = float(poles[poles > 0].min(initial=np.inf))
    step = 1.0 / 20 if not np.isfinite(slowest) else PERIODS / slowest / 20
    return Flow(program, rates, outputs, lambda n, rng: within(n, low, high, rng), step)


def flow_of(noun: Any, options: Options) -> Flow | None:
    """The flow of a noun of lpvid; None for what is sampled, or is to be.

    Parameters
    ----------
    noun : object
        A model, a realisation (its model) or a synthesis (its controller).
    options : Options
        A sample time in it requests a sampled model.

    Returns
    -------
    Flow or None
        None for all that is no continuous `LPVStateSpace`.
    """
    from lpvid.realization import Realization
    from lpvid.synthesis.result import Synthesis

    model = noun.required() if isinstance(noun, Synthesis) else noun.model if isinstance(noun, Realization) else noun
    if isinstance(model, LPVStateSpace) and model.sample_time is None and options.sample_time is None:
        return _state_space_flow(model, options)
    return None
