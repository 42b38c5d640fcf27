"""LPV transfer functions as step programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.export.basis_steps import basis_values, filtered, push, staged
from lpvid.export.expression import Array, Expr, clipped
from lpvid.export.step_builder import StepBuilder
from lpvid.export.step_program import StepProgram
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Basis


@dataclass(frozen=True, eq=False)
class LinearPartInput:
    """What drives a linear part at this sample: filter inputs, and the values of the basis.

    Attributes
    ----------
    u : list of Expr
    p : list of Expr
        Scheduling behind its filter.
    phi : list of Expr
    """

    u: list[Expr]
    p: list[Expr]
    phi: list[Expr]


def drive(b: StepBuilder, model: Any, clamp: bool, own: Basis | None = None) -> LinearPartInput:
    """Inputs, clamped and filtered scheduling, input stage and basis of a model, in the order in which they act.

    Parameters
    ----------
    b : StepBuilder
    model : object
        With inputs, box, stages and a basis, or another one in `own`.
    clamp : bool
        Whether the scheduling is held inside the box.
    own : Basis, optional

    Returns
    -------
    LinearPartInput
        Filter inputs, scheduling behind its filter, and basis values.

    Raises
    ------
    InputError
        A basis that reads future scheduling.
    """
    basis: Basis = model.basis if own is None else own
    if basis.lags[0] < 0:
        raise InputError("this model reads its scheduling ahead of time", got=f"{-basis.lags[0]} sample(s)",
                         why="an exported step is causal", mend="export realize(model, 'augmented')")
    box = model.box
    u: list[Expr] = [b.input(s.name, s.unit, f"input {s.name}") for s in model.inputs]
    p: list[Expr] = []
    for name, low, high, unit in zip(box.names, box.lower, box.upper, box.units, strict=True):
        value: Expr = b.input(name, unit, f"scheduling {name}, {low:g} to {high:g}", low, high)
        p.append(b.let(f"held_{name}", clipped(value, low, high)) if clamp else value)
    if clamp and box.names:
        b.note("The scheduling is held inside its box.")
    first = b.first() if model.scheduling_stage is not None or basis.lags[1] else None
    if first is not None:
        p = filtered(b, model.scheduling_stage, box.names, p, first)
    u = staged(b, model.input_stage, u, p)
    past = {name: _history(b, name, value, basis.lags[1], first) for name, value in zip(box.names, p, strict=True)}
    return LinearPartInput(u, p, basis_values(b, basis, past))


def _history(b: StepBuilder, name: str, value: Expr, depth: int, first: Expr | None) -> Any:
    if not depth:
        return lambda i: value
    assert first is not None
    log = b.states(f"past_{name}", np.zeros(depth + 1), "", f"{name} at this and the last samples")
    with b.when(first), b.loop("place", depth + 1) as i:
        b.set(log[i], value)
    push(b, log, value)
    return lambda i: log[i]


def vector(b: StepBuilder, name: str, values: list[Expr]) -> Array:
    """Values in a local array, for loops.

    Parameters
    ----------
    b : StepBuilder
        Program that the statements are added to.
    name : str
        Of the array.
    values : list of Expr
        Entries in order.

    Returns
    -------
    (k,) Array
        With one entry of 0 where there are no values.
    """
    array = b.array(name, max(len(values), 1))
    for i, v in enumerate(values):
        b.set(array[i], v)
    return array


def rows(b: StepBuilder, name: str, values: list[Expr], depth: int, description: str, fill: bool = False) -> Array:
    """(depth + 1, k) the values of this sample in row 0 and those of the last samples below.

    Parameters
    ----------
    b : StepBuilder
        Program that the statements and states are added to.
    name : str
        Of the array.
    values : list of Expr
        The k values of this sample.
    depth : int
        Earlier samples to keep; with 0 the array is a local one, else it is a state.
    description : str
        Of that state.
    fill : bool
        Whether the rows below start with the first sample's values; left out, with 0.

    Returns
    -------
    (depth + 1, k) Array
        The newest sample in row 0.
    """
    k = len(values)
    if not depth:
        array = b.array(name, 1, k)
    else:
        array = b.states(name, np.zeros((depth + 1, k)), "", description)
        with b.loop("row", depth + 1, 1, down=True) as i, b.loop("column", k) as j:
            b.set(array[i, j], array[i - 1, j])
    for j, v in enumerate(values):
        b.set(array[0, j], v)
    if fill and depth:
        with b.when(b.first()), b.loop("row", depth + 1, 1) as i, b.loop("column", k) as j:
            b.set(array[i, j], array[0, j])
    return array


def transfer_function_program(model: LPVTransferFunction, name: str, clamp: bool = False) -> StepProgram:
    """y(k) = −Σ a_i y(k−i) + Σ b_j u(k−j) + Σ c_j, from zero past outputs and inputs and a scheduling that rested.

    Parameters
    ----------
    model : LPVTransferFunction
    name : str
    clamp : bool
        Whether the scheduling is held inside the model's box.

    Returns
    -------
    StepProgram
        Of one sample.
    """
    b = StepBuilder(name, f"LPV transfer function {', '.join(map(str, model.inputs))} -> "
                    f"{', '.join(map(str, model.outputs))}", model.sample_time)
    total = equation(b, model, drive(b, model, clamp), np.zeros((model.na, model.n_outputs)))
    for o, signal in enumerate(model.outputs):
        b.output(signal.name, total[o], signal.unit, f"output {signal.name}")
    return b.program()


def equation(b: StepBuilder, model: LPVTransferFunction, at: LinearPartInput, past_outputs: np.ndarray) -> Array:
    """(n_outputs,) y(k) of the difference equation; filter inputs before the first sample are zero.

    Parameters
    ----------
    b : StepBuilder
    model : LPVTransferFunction
    at : LinearPartInput
        Filter inputs and basis at this sample.
    past_outputs : (na, n_outputs) array
        Outputs before the first sample, the newest first.

    Returns
    -------
    (n_outputs,) Array
        A local array, in the unit of each output; the log of past outputs has moved on by one sample.
    """
    assert model.c is not None
    ny, nu, na, lags, m = model.n_outputs, model.n_filter_inputs, model.na, model.n_lags, model.basis.size
    used = np.flatnonzero(np.any(model.b != 0, axis=(1, 2, 3)))
    first_lag = int(used[0]) if used.size else lags
    depth = max(max(na, lags - 1) if model.lagged else 0, model.n_affine - 1, 0)
    phi = rows(b, "basis", at.phi, depth, "values of the basis at this and the last samples", fill=True)
    u = rows(b, "driving", at.u, lags - 1, "filter inputs at this and the last samples")
    total = b.array("total", ny)
    if first_lag < lags:
        table = b.table("b", model.b[first_lag:], "", "input coefficients: lag, output, input, basis function")
        with b.loop("lag", lags - first_lag) as j, b.loop("output", ny) as o, b.loop("channel", nu) as q:
            gain = b.sum("gain")
            with b.loop("function", m) as f:
                b.add(gain, table[j, o, q, f] * phi[(j + first_lag) if model.lagged else 0, f])
            b.add(total[o], gain * u[j + first_lag, q])
    if model.n_affine:
        table = b.table("c", model.c, "", "affine terms: lag, output, basis function")
        with b.loop("lag", model.n_affine) as j, b.loop("output", ny) as o, b.loop("function", m) as f:
            b.add(total[o], table[j, o, f] * phi[j, f])
    if na:
        past = b.states("past_outputs", past_outputs, "", "outputs at the last samples, the newest first")
        table = b.table("a", model.a, "", "output coefficients: lag, output, past output, basis function")
        with b.loop("lag", na) as i, b.loop("output", ny) as o, b.loop("channel", ny) as q:
            gain = b.sum("gain")
            with b.loop("function", m) as f:
                b.add(gain, table[i, o, q, f] * phi[(i + 1) if model.lagged else 0, f])
            b.set(total[o], total[o] - gain * past[i, q])
        with b.loop("lag", na, 1, down=True) as i, b.loop("output", ny) as o:
            b.set(past[i, o], past[i - 1, o])
        with b.loop("output", ny) as o:
            b.set(past[0, o], total[o])
    return total
