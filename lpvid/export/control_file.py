"""python-control: any step program as a discrete `NonlinearIOSystem`, as an object and as a file that stands alone."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.errors import InputError
from lpvid.export.contract import relative_error
from lpvid.export.control_io_system import distinct
from lpvid.export.exportable import Exportable, Options, exportable
from lpvid.export.exporting import Content, Export, exported
from lpvid.export.python_printer import python_source
from lpvid.export.step_program import Quantity, StepProgram
from lpvid.model.lft import LFTModel
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction

if TYPE_CHECKING:
    import control

TOLERANCE = 1e-12
"""Largest relative error against this package's simulation with which an export passes."""
TAIL = '''

def _unpack(x):
    """States by name from the vector that python-control carries."""
    s, place = {}, 0
    for name, shape, _ in STATES:
        size = int(np.prod(shape, dtype=int))
        s[name] = np.array(x[place:place + size], dtype=float).reshape(shape) if shape else float(x[place])
        place += size
    return s


def _run(x, u):
    s, y = _unpack(x), {}
    step(PARAMETERS, s, dict(zip(INPUTS, map(float, u))), y)
    after = [np.ravel(s[name]) for name, _, _ in STATES]
    return (np.concatenate(after) if after else np.zeros(0)), np.array([y[name] for name in OUTPUTS])


def start():
    """Initial states: at rest."""
    values = [np.ravel(value) for _, _, value in STATES]
    return np.concatenate(values) if values else np.zeros(0)


def system():
    """The system; simulate it from `start()`."""
    update = (lambda t, x, u, params: _run(x, u)[0]) if STATE_LABELS else None
    return control.NonlinearIOSystem(update, lambda t, x, u, params: _run(x, u)[1], inputs=INPUT_LABELS,
                                     outputs=OUTPUT_LABELS, states=STATE_LABELS or None, dt=SAMPLE_TIME, name=NAME)
'''


def control_system(model: Any, *, clamp: bool | None = None, sample_time: float | None = None
                   ) -> tuple[control.NonlinearIOSystem, np.ndarray]:
    """A model, damper or controller as a discrete python-control `NonlinearIOSystem`, and its states at rest.

    Every input and state of `lpvid.export_c` is one here: input stage, scheduling filter, limits and switches are
    inside. For an LPV model whose states should mean something use ``model.to_nonlinear_io_system()``.

    Parameters
    ----------
    model, clamp, sample_time
        As for `lpvid.export_c`.

    Returns
    -------
    control.NonlinearIOSystem
    (n_states,) array
        The state to start from.

    Examples
    --------
    >>> from lpvid import LPVTransferFunction, Polynomial
    >>> model = LPVTransferFunction.siso([[-0.9, 0.1]], [[0, 0], [0.1, 0]], Polynomial("p", degree=1), 0.01)
    >>> system, rest = control_system(model)
    >>> system.input_labels, system.nstates == rest.size
    (['u1', 'p'], True)
    """
    scope = _scope(exportable(model, Options("", clamp, sample_time)).program)
    return scope["system"](), scope["start"]()


def to_control(model: Any, at: Sequence[float] | np.ndarray | None = None, *, clamp: bool | None = None,
               sample_time: float | None = None) -> control.StateSpace | control.NonlinearIOSystem:
    """A model, damper, controller or synthesis as a system of python-control.

    Parameters
    ----------
    model : object
        As for `lpvid.export_c`.
    at : (n_scheduling,) array, optional
        Scheduling, SI: the frozen linear system there, of an LPV model. Left out, the varying system with everything
        inside; the state that it rests in is the second of `control_system`.
    clamp, sample_time
        As for `lpvid.export_c`.

    Returns
    -------
    control.StateSpace or control.NonlinearIOSystem

    Raises
    ------
    InputError
        A thing that has no such form, named with the nearest that has; `at` for one that cannot be frozen.

    Examples
    --------
    >>> from lpvid import LPVTransferFunction, Polynomial
    >>> model = LPVTransferFunction.siso([[-0.9, 0.1]], [[0, 0], [0.1, 0]], Polynomial("p", degree=1), 0.01)
    >>> to_control(model).input_labels, to_control(model, at=[1.0]).poles().real.round(6)
    (['u1', 'p'], array([0.8]))
    """
    if at is None:
        return control_system(model, clamp=clamp, sample_time=sample_time)[0]
    frozen = _frozen_at(model)
    if frozen is None:
        raise InputError(f"a {type(model).__name__} has no frozen linear system", got=f"at={np.ravel(at).tolist()}",
                         mend="leave at= out for the whole of it, or linearise that with control.linearize")
    return frozen(at)


def _frozen_at(model: Any) -> Callable[[Any], control.StateSpace] | None:
    """What freezes a model, or the controller of a synthesis; None for a damper and the like."""
    linear = getattr(model, "controller", model)
    return linear.to_control if isinstance(linear, LPVTransferFunction | LPVStateSpace | LFTModel) else None


def export_control(model: Any, folder: str | os.PathLike, *, name: str = "", clamp: bool | None = None,
                   sample_time: float | None = None, at: Mapping[str, float] | None = None) -> Export:
    """Write a Python file that makes a python-control `NonlinearIOSystem` of a model, damper or controller.

    It needs numpy and control, not this package.

    Parameters
    ----------
    model, folder, name, clamp, sample_time, at
        As for `lpvid.export_c`.

    Returns
    -------
    Export
    """
    return exported(model, folder, "control", name, clamp, sample_time, at)


def control_content(found: Exportable) -> Content:
    """The Python file of a step program, run by python-control against the simulation.

    Parameters
    ----------
    found : Exportable
        A step program with its simulation.

    Returns
    -------
    Content
        One file, ``NAME_control.py``; passed where the relative error is at most `TOLERANCE`.
    """
    import control

    program = found.program
    u, y = found.trial()
    scope = _scope(program)
    time = program.sample_time * np.arange(len(u))
    drive: Any = u.T
    run = control.input_output_response(scope["system"](), time, drive, scope["start"]())
    error = relative_error(np.asarray(run.outputs).reshape(len(program.outputs), -1).T, y)
    check = (f"python-control {control.__version__}: input_output_response against our free run, relative error "
             f"{error:.2g}")
    return Content(
        "control",
        {f"{program.name}_control.py": _control_source(program).encode()},
        program.description,
        (check,),
        program.notes,
        error <= TOLERANCE,
    )


def _control_source(program: StepProgram) -> str:
    """The text of the file."""
    def labels(quantities: tuple[Quantity, ...]) -> list[str]:
        return distinct([q.label or q.name for q in quantities])

    states = distinct([q.name + "".join(f"_{i + 1}" for i in place) for q in program.states
                        for place in np.ndindex(q.shape)])
    rows = [f"    {q.name!r}: " + (f"np.array({q.start.tolist()!r})" if q.shape else repr(float(q.start)))
            for q in program.parameters]
    description = program.description.replace('"""', "'''")
    return "\n".join([
        f'"""{description}, for python-control. Generated by lpvid."""', "",
        "from math import cos, exp, floor, pow, sin, sqrt, tanh", "", "import control", "import numpy as np",
        "from numpy import zeros", "", "fabs, fmin, fmax = abs, min, max", f"NAME = {program.name!r}",
        f"SAMPLE_TIME = {program.sample_time!r}", f"INPUTS = {[q.name for q in program.inputs]!r}",
        f"OUTPUTS = {[q.name for q in program.outputs]!r}", f"INPUT_LABELS = {labels(program.inputs)!r}",
        f"OUTPUT_LABELS = {labels(program.outputs)!r}", f"STATE_LABELS = {states!r}",
        "PARAMETERS = {", ",\n".join(rows), "}",
        f"STATES = {[(q.name, q.shape, q.start.tolist()) for q in program.states]!r}", "", "",
        python_source(program).rstrip(), TAIL])


def _scope(program: StepProgram) -> dict[str, Any]:
    scope: dict[str, Any] = {}
    exec(compile(_control_source(program), f"<{program.name}_control.py>", "exec"), scope)  # text made above
    return scope
