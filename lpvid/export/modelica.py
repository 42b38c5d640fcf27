"""Modelica: a package with the step function, a model around it, and a check against this package's simulation."""

# rumoca is an extra
# pyright: reportMissingImports=false
from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.export.contract import Exportable, Options
from lpvid.export.exporting import Content, Export, content, written
from lpvid.export.flow import Flow
from lpvid.export.fmu_description import BASE
from lpvid.export.modelica_printer import description, literal, spelled, step_function
from lpvid.export.step_builder import checked_name
from lpvid.export.step_program import Quantity, StepProgram
from lpvid.units import base_exponents

TOLERANCE = 1e-12
"""Largest error of the check model, relative to the largest output, with which a package passes."""


def export_modelica(model: Any, folder: str | os.PathLike, *, name: str = "", clamp: bool | None = None,
                    sample_time: float | None = None, at: Mapping[str, float] | None = None) -> Export:
    """Write a model, damper or controller as a Modelica package in text, ``NAME.mo``.

    ::

        NAME.step     the function of one sample (of derivatives and outputs, where the model is continuous)
        NAME.Block    the model: inputs, outputs, parameters with units; sampled by ``when sample(0, period)``,
                      continuous by ``der``, and a law without states as an algebraic equation at every time
        NAME.Check    Block along a random trajectory beside this package's simulation: its `error` stays below 1e-12

    Where rumoca (the extra ``modelica``) is installed, it compiles the package and runs the check; OpenModelica and
    Dymola take the same text.

    Parameters
    ----------
    model, folder, name, clamp, sample_time, at
        As for `lpvid.export_c`; a continuous model is left continuous.

    Returns
    -------
    Export

    Examples
    --------
    >>> import tempfile
    >>> from lpvid import LPVTransferFunction, Polynomial
    >>> model = LPVTransferFunction.siso([[-0.9, 0.1]], [[0, 0], [0.1, 0]], Polynomial("p", degree=1), 0.01)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in export_modelica(model, folder, name="lag").files]
    ['lag.mo']
    """
    return written(content(model, "modelica", Options(checked_name(name), clamp, sample_time, at or {})), folder)


def modelica_content(found: Exportable, precision: str = "double") -> Content:
    """The package of a step program; a law without states becomes an algebraic model.

    Parameters
    ----------
    found : Exportable
        A step program with its simulation.
    precision : str
        "double" is the only one.

    Returns
    -------
    Content
        One file, ``NAME.mo``; without rumoca it counts as passed.

    Raises
    ------
    InputError
        Another precision.
    """
    _double(precision)
    u, y = found.trial()
    return _content(found.program, u, np.zeros((len(u), 0)), y, found.program.sample_time)


def modelica_flow_content(flow: Flow, precision: str = "double") -> Content:
    """The package of a continuous model; the check compares derivatives and outputs along a trajectory.

    Parameters
    ----------
    flow : Flow
        A continuous model with its derivatives.
    precision : str
        "double" is the only one.

    Returns
    -------
    Content
        One file, ``NAME.mo``; without rumoca it counts as passed.

    Raises
    ------
    InputError
        Another precision.
    """
    _double(precision)
    u, x = flow.trial()
    y = np.array([np.concatenate([flow.rates(a, b), flow.outputs(a, b)]) for a, b in zip(x, u, strict=True)])
    return _content(flow.program, u, x, y, flow.step)


def _double(precision: str) -> None:
    if precision != "double":
        raise InputError("Modelica computes in double precision", got=precision, mend="leave --precision out")


def _content(program: StepProgram, u: np.ndarray, x: np.ndarray, y: np.ndarray, period: float) -> Content:
    text = package(program, u, x, y, period)
    check, passed = _run_check(program, text, len(u), period)
    return Content(
        "modelica", {f"{program.name}.mo": text.encode()}, program.description, (check,), program.notes, passed
    )


# -- the text --------------------------------------------------------------------------------------------------------
def package(program: StepProgram, u: np.ndarray, x: np.ndarray, y: np.ndarray, period: float) -> str:
    """The whole file.

    Parameters
    ----------
    program : StepProgram
    u : (n, inputs) array
        A trajectory of the inputs.
    x : (n, states) array
        Of the states, for a continuous model; else without columns.
    y : (n, derivatives and outputs) array
        What this package's simulation makes of it.
    period : float
        Between the samples [s].

    Returns
    -------
    str
        Text of ``NAME.mo``.
    """
    name = spelled(program.name)
    parts = [step_function(program), _block(program, name), _check(program, name, u, x, y, period)]
    notes = "".join(f"  // {note}\n" for note in program.notes)
    body = "\n\n".join("\n".join(f"  {line}" for line in part) for part in parts)
    head = f"package {name} {description(program.description)}\n  // Generated by lpvid; do not edit.\n"
    return f"{head}{notes}\n{body}\nend {name};\n"


def _block(program: StepProgram, name: str) -> list[str]:
    sampled, count = bool(program.sample_time), sum(q.start.size for q in program.states)
    total, held = count + len(program.outputs), [v for q in program.states for v in q.start.ravel()]
    given = [*_names(program.parameters), *(["{}"] if count else []), *_names(program.inputs)]
    call = f"{name}.step({', '.join(given)})"
    out = [f"model Block {description(program.description)}"]
    out += [
        f"    parameter Real {spelled(q.name)}{_size(q)}{_unit(q)} = {literal(q.start)} {description(q.description)};"
        for q in program.parameters
    ]
    out += [f"    input Real {spelled(q.name)}{_unit(q)} {description(q.description)};" for q in program.inputs]
    out += [f"    output Real {spelled(q.name)}{_unit(q)} {description(q.description)};" for q in program.outputs]
    if count and sampled:
        start = literal(np.array([*held, *[0.0] * len(program.outputs)]))
        out += ["protected", f"    discrete Real held[{total}](start = {start}, each fixed = true) "
                f"{description('states, then outputs')};", "equation",
                f"    when sample(0.0, {program.sample_time!r}) then",
                f"        held = {call.replace('{}', 'pre(held)')};", "    end when;"]
    elif count:
        out += [
            f"    Real states[{count}](start = {literal(np.array(held))}, each fixed = true) {description('states')};",
            "protected",
            f"    Real held[{total}] {description('derivatives of the states, then outputs')};",
            "equation",
            f"    held = {call.replace('{}', 'states')};",
            f"    for k in 1:{count} loop",
            "        der(states[k]) = held[k];",
            "    end for;",
        ]
    else:
        out += ["protected", f"    Real held[{total}];", "equation", f"    held = {call};"]
    out += [f"    {spelled(q.name)} = held[{count + k}];" for k, q in enumerate(program.outputs, 1)]
    return [*out, "end Block;"]


def _check(program: StepProgram, name: str, u: np.ndarray, x: np.ndarray, y: np.ndarray, period: float) -> list[str]:
    scale = np.abs(y).max(axis=0, initial=0.0)
    scale = np.where(scale > 0, scale, 1.0)
    first = y.shape[1] - len(program.outputs)
    out = [
        f"model Check {description('Block along a random trajectory; error must stay below 1e-12')}",
        "    constant Integer samples = " + f"{len(u)};",
        f"    parameter Real U[samples, {u.shape[1]}] = {literal(u)};" if u.shape[1] else "",
        f"    parameter Real Y[samples, {y.shape[1]}] = {literal(y / scale)} {description('by the largest of each')};",
        "    discrete Integer k(start = 1, fixed = true) " + description("sample") + ";",
        "    discrete Real error(start = 0.0, fixed = true) " + description("largest relative difference") + ";",
    ]
    if x.shape[1]:
        names = [*(f"{spelled(q.name)}" for q in program.parameters)]
        out += [f"    parameter Real {n}{_size(q)} = {literal(q.start)};"
                for n, q in zip(names, program.parameters, strict=True)]
        given = ["{" + ", ".join(f"X[k, {i}]" for i in range(1, x.shape[1] + 1)) + "}",
                 *(f"U[k, {i}]" for i in range(1, u.shape[1] + 1))]
        out += [f"    parameter Real X[samples, {x.shape[1]}] = {literal(x)};",
                f"    Real found[{y.shape[1]}];", "equation",
                f"    found = {name}.step({', '.join([*names, *given])});"]
        compared = [f"found[{i}]" for i in range(1, y.shape[1] + 1)]
    else:
        out += ["    Block tested;", "equation"]
        out += [f"    tested.{spelled(q.name)} = U[k, {i}];" for i, q in enumerate(program.inputs, 1)]
        compared = [f"tested.{spelled(q.name)}" for q in program.outputs]
        assert first == 0
    gaps = [f"abs({n} / {float(s)!r} - Y[k, {i}])" for i, (n, s) in enumerate(zip(compared, scale, strict=True), 1)]
    worst = "pre(error)"
    for gap in gaps:
        worst = f"max({worst}, {gap})"
    out += [f"    when sample({0.5 * period!r}, {period!r}) then", "        k = min(pre(k) + 1, samples);",
            "    end when;", f"    when sample({0.25 * period!r}, {period!r}) then",
            f"        error = {worst};", "    end when;"]
    return [line for line in out if line] + ["end Check;"]


def _names(quantities: tuple[Quantity, ...]) -> list[str]:
    return [spelled(q.name) for q in quantities]


def _size(q: Quantity) -> str:
    return f"[{', '.join(map(str, q.shape))}]" if q.shape else ""


def _unit(q: Quantity) -> str:
    found = modelica_unit(q.unit)
    return f'({"each " if q.shape else ""}unit = "{found}")' if found else ""


def modelica_unit(unit: str) -> str:
    """A unit in Modelica's spelling (3.6, chapter 19): its SI base units; "" for a pure number and for no SI unit.

    Parameters
    ----------
    unit : str
        As in the model, "N*s/m" for instance.

    Returns
    -------
    str
        Units that Modelica names itself, such as N, Pa and Hz, as they are; any other by base units with whole
        exponents.

    Examples
    --------
    >>> modelica_unit("N*s/m"), modelica_unit("A"), modelica_unit("%"), modelica_unit("m/s")
    ('kg.s-1', 'A', '', 'm.s-1')
    """
    if re.fullmatch(r"[AKNVWJmsg]|kg|Pa|rad|Hz", unit):
        return unit
    base = base_exponents(unit) if unit else {}
    if not base or not all(n in BASE and float(e).is_integer() for n, e in base.items()):
        return ""
    return ".".join(f"{n}{'' if int(e) == 1 else int(e)}" for n, e in base.items())


# -- checking --------------------------------------------------------------------------------------------------------
def _run_check(program: StepProgram, text: str, samples: int, period: float) -> tuple[str, bool]:
    """Compile the package with rumoca and run its check; what was found, and whether it passed."""
    try:
        import rumoca
    except ImportError:
        return "not compiled: no rumoca (pip install 'lpvid[modelica]'); simulate the model Check", True
    try:
        model = rumoca.Session().loads(text, model=f"{spelled(program.name)}.Check")
        run = model.simulate(t=samples * period, dt=period)
    except Exception as error:  # its own classes, and panics of its compiler
        return f"rumoca {rumoca.version()} did not run it: {' '.join(str(error).split())[:200]}", False
    error = float(run["error"][-1])
    what = "derivatives and outputs" if not program.sample_time else "outputs"
    text = f"compiled and run by rumoca {rumoca.version()}: {what} against our free run, relative error {error:.2g}"
    return text, int(run["k"][-1]) == samples and error <= TOLERANCE
