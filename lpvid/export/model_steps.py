"""lpvid's own nouns as step programs: transfer functions, state spaces, self-scheduled models, limited controllers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.export.contract import Exportable, Exporter, Options, within
from lpvid.export.flow import flow_of
from lpvid.export.quasi_steps import compliance_program, quasi_program
from lpvid.export.state_space_steps import state_space_program
from lpvid.export.step_program import StepProgram
from lpvid.export.transfer_function_steps import transfer_function_program
from lpvid.model.compliance import ComplianceModel
from lpvid.model.designed import role_of
from lpvid.model.lft import LFTModel
from lpvid.model.quasi import QuasiLPVModel
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import Realization
from lpvid.record import Record
from lpvid.simulation import simulate
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.saturated import SaturatedController

PROGRAMS: Mapping[type, Callable[[Any, str, bool], StepProgram]] = {
    LPVTransferFunction: transfer_function_program, LPVStateSpace: state_space_program, QuasiLPVModel: quasi_program,
    ComplianceModel: compliance_program,
}
NOUNS = (*PROGRAMS, LFTModel, Realization, Synthesis, SaturatedController)


def prepare(noun: Any, options: Options) -> Exportable:
    """A noun of lpvid as a step program; see `lpvid.export.exportable.exportable`.

    Parameters
    ----------
    noun : object
        One of `NOUNS`.
    options : Options
        `clamp` left out holds the scheduling in its box for designed controllers alone; `at` is left to `exportable`.

    Returns
    -------
    Exportable
        Its simulation starts from zero past.

    Raises
    ------
    InputError
        A linear fractional form; a sample time other than that of a sampled model; a continuous model without a sample
        time or with an input stage; a continuous controller, or one with affine terms, behind limits.
    """
    if isinstance(noun, Realization):
        return prepare(noun.model, options)
    if isinstance(noun, Synthesis):
        return prepare(noun.required(), replace(options, name=options.name or "controller"))
    if isinstance(noun, LFTModel):
        raise InputError("a linear fractional form has no exported step", got=repr(noun),
                         mend="export lpvid.to_gridded(model).model, or lpvid.to_affine(model).model")
    if isinstance(noun, SaturatedController):
        return _controller(noun, options)
    if isinstance(noun, LPVStateSpace) and noun.sample_time is None:
        return _sampled(noun, options)
    period = noun.sample_time
    assert period is not None
    if options.sample_time is not None and not np.isclose(options.sample_time, period, rtol=1e-9):
        raise InputError("a sampled model runs at its own rate only",
                         got=f"{1 / options.sample_time:.6g} Hz against {1 / period:.6g} Hz",
                         mend="leave the sample rate out, or identify it at that rate")
    clamp = bool(role_of(noun)) if options.clamp is None else options.clamp
    name = options.name or ("controller" if role_of(noun) == "controller" else "lpv_model")
    program = next(made for cls, made in PROGRAMS.items() if isinstance(noun, cls))(noun, name, clamp)
    channels = [q.label for q in program.inputs]

    def reference(u: np.ndarray) -> np.ndarray:
        columns: dict[str, Any] = dict(zip(channels, u.T, strict=True))
        columns |= {s.name: np.zeros(len(u)) for s in noun.outputs if s.name not in columns}
        return simulate(noun, _clamped(noun, columns, clamp, len(u)), "zero").output

    return Exportable(program, reference, _excitation(noun, channels, clamp), noun)


def _sampled(model: LPVStateSpace, options: Options) -> Exportable:
    """A continuous state space discretised at the period that was requested, with the error that this makes."""
    from lpvid.synthesis.discretising import discretise

    if options.sample_time is None:
        raise InputError("a continuous model has no step", got=f"{model.order} states in continuous time",
                         mend="give a rate (--sample-rate, sample_time=) at which it is discretised, or export it to "
                              "model exchange (--to fmu2)")
    if model.input_stage is not None:
        raise InputError("a continuous model with an input stage is not discretised", got=repr(model.input_stage),
                         mend="export it to model exchange (--to fmu2)")
    sampled = discretise(model, options.sample_time)
    found = prepare(sampled.model, replace(options, sample_time=None))
    note = f"Discretised from continuous time: {'; '.join(str(sampled).splitlines())}."
    return replace(found, program=replace(found.program, notes=(*found.program.notes, note)))


def _clamped(model: Any, columns: dict[str, Any], clamp: bool, n: int) -> Record:
    """The record that our simulation runs along; a channel that is an input too keeps its own values there."""
    columns = columns or {"nothing": np.zeros(n)}
    if clamp:
        for name, low, high in zip(model.box.names, model.box.lower, model.box.upper, strict=True):
            if name not in [s.name for s in model.inputs]:
                columns[name] = np.clip(columns[name], low, high)
    return Record(columns, model.sample_time)


def _controller(law: SaturatedController, options: Options) -> Exportable:
    k = law.controller
    if k.sample_time is None:
        raise InputError("a continuous controller has no step", got=f"{k.order} states in continuous time",
                         mend="put lpvid.discretise(controller, sample_time).model behind its limits")
    if np.any(k.state_offset) or np.any(k.output_offset):
        raise InputError("a controller behind limits has no affine terms", why="its simulation leaves them out",
                         mend="export the controller itself")
    clamp = True if options.clamp is None else options.clamp
    program = state_space_program(k, options.name or "controller", clamp, law)
    channels = [q.label for q in program.inputs]

    def reference(u: np.ndarray) -> np.ndarray:
        run = law.start()
        y = u[:, [channels.index(s.name) for s in k.inputs]]
        p = u[:, [channels.index(n) for n in k.box.names]]
        if clamp:
            p = np.clip(p, k.box.lower, k.box.upper)
        return np.array([run.advance(a, c) for a, c in zip(y, p, strict=True)])

    return Exportable(program, reference, _excitation(k, channels, clamp), law)


def _excitation(model: Any, channels: list[str], clamp: bool) -> Any:
    """Trajectories over the box (a fifth beyond it where it is clamped), and of a few knees of the input stage."""
    box, stage = model.box, model.input_stage
    reach = 1.0
    if stage is not None and stage.first_knee is not None:
        reach = 4 * stage.first_knee
    elif isinstance(model, ComplianceModel):
        reach = float(np.abs(model.knots).max())
    inputs = [s.name for s in model.inputs]
    low, high = np.full(len(channels), -reach), np.full(len(channels), reach)
    for n, lower, upper in zip(box.names, box.lower, box.upper, strict=True):
        at, beyond = channels.index(n), 0.1 * (upper - lower) if clamp and n not in inputs else 0.0
        low[at], high[at] = lower - beyond, upper + beyond
    return lambda samples, rng: within(samples, low, high, rng)


EXPORTER = Exporter(lambda noun: isinstance(noun, NOUNS), prepare, flow_of)
