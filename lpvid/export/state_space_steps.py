"""LPV state spaces, and controllers behind limits, as step programs."""

from __future__ import annotations

import numpy as np

from lpvid.export.expression import Array, Expr, Index, Symbol, call, clipped
from lpvid.export.step_builder import StepBuilder
from lpvid.export.step_program import StepProgram
from lpvid.export.transfer_function_steps import drive, vector
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.saturated import SaturatedController


def state_space_program(model: LPVStateSpace, name: str, clamp: bool = False,
                        law: SaturatedController | None = None) -> StepProgram:
    """x⁺ = A(p)x + B(p)u + f(p), y = C(p)x + D(p)u + g(p); behind limits with E(p)(u − v) added to the state.

    Parameters
    ----------
    model : LPVStateSpace
        Discrete.
    name : str
    clamp : bool
        Whether the scheduling is held inside the model's box.
    law : SaturatedController, optional
        Limits and anti-windup gain of this controller.

    Returns
    -------
    StepProgram
        From a state of zero.
    """
    assert model.sample_time is not None and model.state_offset is not None and model.output_offset is not None
    kind = "LPV state space" if law is None else "LPV controller with limits and anti-windup"
    b = StepBuilder(name, f"{kind} {', '.join(map(str, model.inputs))} -> {', '.join(map(str, model.outputs))}",
                    model.sample_time)
    at = drive(b, model, clamp)
    phi, u = vector(b, "basis", at.phi), vector(b, "driving", at.u)
    x = b.states("x", np.zeros(model.order), "", "states") if model.order else None
    y = mixed(b, phi, x, u, ("C", model.C), ("D", model.D), ("g", model.output_offset), model.n_outputs)
    given: list[Expr] = [y[o] for o in range(model.n_outputs)]
    short: list[Expr] = []
    if law is not None:
        given, short = _limited(b, law, given)
    if x is not None:
        ahead = mixed(b, phi, x, u, ("A", model.A), ("B", model.B), ("f", model.state_offset), model.order)
        if law is not None and np.any(law.gain):
            table = b.table("E", law.gain, "", "anti-windup gain: basis function, state, control")
            with b.loop("function", phi.shape[0]) as f, b.loop("row", model.order) as i:
                for j, missing in enumerate(short):
                    b.add(ahead[i], phi[f] * table[f, i, j] * missing)
        with b.loop("row", model.order) as i:
            b.set(x[i], ahead[i])
    for value, signal in zip(given, model.outputs, strict=True):
        b.output(signal.name, value, signal.unit, f"output {signal.name}")
    return b.program()


def mixed(b: StepBuilder, phi: Array, x: Array | None, u: Array, by_state: tuple[str, np.ndarray],
          by_input: tuple[str, np.ndarray], offset: tuple[str, np.ndarray], size: int) -> Array:
    """Σ_m φ_m (M_m x + N_m u + f_m); what is zero throughout is left out.

    Parameters
    ----------
    b : StepBuilder
        Program that the statements and tables are added to.
    phi : (M,) Array
        Values of the basis at this sample.
    x : (n,) Array or None
        States; None for a model without.
    u : (k,) Array
        Filter inputs.
    by_state, by_input, offset : (str, array) pairs
        Name and value of the (M, size, n) matrices M, the (M, size, k) matrices N and the (M, size) vectors f.
    size : int
        Rows of the result.

    Returns
    -------
    (size,) Array
        A local array.
    """
    out = b.array("sum", size)
    tables = {name: b.table(name, value, "", f"{name}: basis function, row" + (", column" if value.ndim == 3 else ""))
              for name, value in (by_state, by_input, offset) if value.size and np.any(value)}
    if not tables:
        return out
    with b.loop("function", phi.shape[0]) as f, b.loop("row", size) as i:
        part = b.sum("part", tables[offset[0]][f, i] if offset[0] in tables else 0.0)
        for (name, value), source in ((by_state, x), (by_input, u)):
            if name in tables and source is not None:
                _product(b, part, tables[name], source, (f, i), value.shape[2])
        b.add(out[i], phi[f] * part)
    return out


def _product(b: StepBuilder, part: Symbol, table: Array, source: Array, at: tuple[Index, Index], width: int) -> None:
    with b.loop("column", width) as j:
        b.add(part, table[at[0], at[1], j] * source[j])


def _limited(b: StepBuilder, law: SaturatedController, wanted: list[Expr]) -> tuple[list[Expr], list[Expr]]:
    """Controls cut to their limits, and how much was cut off (u − v)."""
    given: list[Expr] = []
    short: list[Expr] = []
    for value, low, high, signal in zip(wanted, law.lower, law.upper, law.controller.outputs, strict=True):
        name, v = signal.name, b.let("wanted", value)
        bound: Expr = v
        if np.isfinite(low) and np.isfinite(high):
            ends = (b.parameter(f"{name}_lowest", low, signal.unit, f"lower limit of {name}"),
                    b.parameter(f"{name}_highest", high, signal.unit, f"upper limit of {name}"))
            bound = clipped(v, *ends)
        elif np.isfinite(high):
            bound = call("fmin", v, b.parameter(f"{name}_highest", high, signal.unit, f"upper limit of {name}"))
        elif np.isfinite(low):
            bound = call("fmax", v, b.parameter(f"{name}_lowest", low, signal.unit, f"lower limit of {name}"))
        given.append(b.let("given", bound))
        short.append(b.let("short", given[-1] - v))
    return given, short
