"""MATLAB: a .mat file, a step function, a grid of ``ss`` and an ``lpvss`` data function, and a check that runs them."""

from __future__ import annotations

import io
import os
import re
import shutil
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lpvid.errors import ExtrapolationWarning
from lpvid.export.basis_steps import basis_values
from lpvid.export.c_build import run_tool
from lpvid.export.exportable import SAMPLES, Exportable, within
from lpvid.export.exporting import Content, Export, exported
from lpvid.export.matlab_printer import CHOOSE, MatlabPrinter, matlab_step
from lpvid.export.python_control import FrozenGrid, frozen_grid, linear_model, varying_state_space
from lpvid.export.step_builder import StepBuilder
from lpvid.export.step_program import Quantity, StepProgram
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.record import Record
from lpvid.simulation import simulate

TOLERANCE = 1e-12
"""Largest relative error of the step function against this package's simulation with which an export passes."""
IMPULSE = 1e-9
"""Largest relative error of impulse responses over three times the order: matrix powers lose what rounding leaves."""


def export_matlab(model: Any, folder: str | os.PathLike, *, name: str = "", clamp: bool | None = None,
                  sample_time: float | None = None, at: Mapping[str, float] | None = None) -> Export:
    """Write a model, damper or controller for MATLAB (and GNU Octave).

    ``NAME.mat`` (version 7) holds parameters, states, names, units and a test trajectory; ``NAME_step.m`` is the exact
    step; ``NAME_check.m`` runs it along the trajectory. For LPV models ``NAME_load.m`` rebuilds the frozen models as an
    array of ``ss`` with its sampling grid, and ``NAME_data.m`` is the data function that ``lpvss`` takes. Where Octave
    is installed, it runs the check and evaluates the data function.

    Parameters
    ----------
    model, folder, name, clamp, sample_time, at
        As for `lpvid.export_c`.

    Returns
    -------
    Export
    """
    return exported(model, folder, "matlab", name, clamp, sample_time, at)


def matlab_content(found: Exportable) -> Content:
    """The MATLAB files of a step program, checked by Octave where it is installed.

    Parameters
    ----------
    found : Exportable
        A step program with its simulation.

    Returns
    -------
    Content
        ``NAME.mat`` and the M files; without Octave it counts as passed.
    """
    from scipy.io import savemat

    program, notes = found.program, list(found.program.notes)
    name = program.name
    held = _variables(found)
    files = {f"{name}_step.m": matlab_step(program), f"{name}_check.m": _check(program)}
    model = linear_model(found.model)
    if model is not None:
        grid = frozen_grid(model)
        held["grid"] = _grid_variables(grid)
        files[f"{name}_load.m"] = _load(name, grid, model.sample_time or 0.0)
        varying = varying_state_space(model)
        if varying is None:
            notes.append(f"No lpvss form: the matrices need the scheduling of other samples; {name}_step.m has them.")
        else:
            held["lpv"] = _varying_variables(varying) | {"test": _varying_test(varying)}
            files[f"{name}_data.m"] = _data_function(name, varying)
        if model.input_stage is not None or model.scheduling_stage is not None:
            notes.append(f"ss and lpvss are the linear part; {name}_step.m has input stage and scheduling filter too.")
    target = io.BytesIO()
    savemat(target, {name: held}, do_compression=True, long_field_names=True)
    data = {f"{name}.mat": target.getvalue(), **{n: t.encode() for n, t in files.items()}}
    checks, passed = _octave_checks(found, data)
    return Content("matlab", data, program.description, checks, tuple(notes), passed)


# -- what the .mat file holds ----------------------------------------------------------------------------------------
def _variables(found: Exportable) -> dict[str, Any]:
    program = found.program
    u, y = found.trial()
    groups = {"inputs": program.inputs, "outputs": program.outputs, "states": program.states,
              "parameters": program.parameters}
    return {"p": _values(program.parameters), "s": _values(program.states), "sample_time": program.sample_time,
            "description": program.description,
            "names": {n: _cells([q.name for q in g]) for n, g in groups.items()},
            "units": {n: _cells([q.unit for q in g]) for n, g in groups.items()},
            "says": {n: _cells([q.description for q in g]) for n, g in groups.items()},
            "test": {"inputs": u, "outputs": y}}


def _values(quantities: tuple[Quantity, ...]) -> dict[str, Any]:
    return {q.name: q.start if q.shape else float(q.start) for q in quantities} or {"unused": 0.0}


def _cells(texts: list[str]) -> np.ndarray:
    out = np.empty((1, len(texts)), dtype=object)
    out[0, :] = texts
    return out


def _signals(signals: tuple[Signal, ...]) -> dict[str, Any]:
    return {"names": _cells([s.name for s in signals]), "units": _cells([s.unit for s in signals])}


def _grid_variables(grid: FrozenGrid) -> dict[str, Any]:
    return {"points": grid.points, "names": _cells(list(grid.names)), "A": grid.a, "B": grid.b, "C": grid.c,
            "D": grid.d, "inputs": _signals(grid.inputs), "outputs": _signals(grid.outputs)}


def _varying_variables(model: LPVStateSpace) -> dict[str, Any]:
    assert model.state_offset is not None and model.output_offset is not None
    last = {"A": model.A, "B": model.B, "C": model.C, "D": model.D}
    return {**{n: np.moveaxis(m, 0, -1) for n, m in last.items()}, "dx0": model.state_offset.T,
            "y0": model.output_offset.T, "knots": _values(_basis_program(model).parameters)}


def _varying_test(model: LPVStateSpace) -> dict[str, np.ndarray]:
    """A random trajectory of the linear part, its scheduling moving, and this package's simulation from zero states."""
    changes: dict[str, Any] = {"input_stage": None, "scheduling_stage": None, "inputs": model.filter_inputs}
    bare, rng = model.replace(**changes), np.random.default_rng(0)
    reach = np.ones(len(bare.inputs))
    u = within(SAMPLES, -reach, reach, rng)
    p = within(SAMPLES, np.array(bare.box.lower), np.array(bare.box.upper), rng)
    columns = dict(zip([s.name for s in bare.inputs], u.T, strict=True))
    for k, name in enumerate(bare.box.names):
        p[:, k] = columns.setdefault(name, p[:, k])  # a channel that is both an input and the scheduling
    columns |= {s.name: np.zeros(SAMPLES) for s in bare.outputs if s.name not in columns}
    columns = columns or {"nothing": np.zeros(SAMPLES)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExtrapolationWarning)
        y = simulate(bare, Record(columns, bare.sample_time), "zero").output
    return {"inputs": u, "scheduling": p, "outputs": y}


# -- the .m files ----------------------------------------------------------------------------------------------------
def _check(program: StepProgram) -> str:
    name = program.name
    inputs = [f"    u.{q.name} = m.test.inputs(k, {i + 1});" for i, q in enumerate(program.inputs)]
    inputs = inputs or ["    u = struct();"]
    outputs = [f"    out(k, {i + 1}) = y.{q.name};" for i, q in enumerate(program.outputs)]
    return "\n".join([
        f"function worst = {name}_check()",
        f"%{name.upper()}_CHECK Largest error of {name}_step on the test trajectory, by the largest output.",
        f"m = load('{name}.mat');", f"m = m.{name};", "s = m.s;", "out = zeros(size(m.test.outputs));",
        "for k = 1:size(m.test.inputs, 1)", *inputs, f"    [s, y] = {name}_step(m.p, s, u);", *outputs, "end",
        "scale = max(abs(m.test.outputs), [], 1);", "scale(scale == 0) = 1;",
        "worst = max(max(abs(out - m.test.outputs), [], 1) ./ scale);",
        f"fprintf('{name}: relative error %.3g\\n', worst);", "end", ""])


def _load(name: str, grid: FrozenGrid, sample_time: float) -> str:
    fields = [re.sub(r"[^A-Za-z0-9]", "_", v.strip()) for v in grid.names]  # a name as MATLAB takes it
    variables = [f"    '{v}', g.points(:, {i + 1})" for i, v in enumerate(fields)]
    out = [f"function sys = {name}_load()",
           f"%{name.upper()}_LOAD Frozen models on the grid of {name}.mat as an array of ss (Control System Toolbox).",
           f"m = load('{name}.mat');", f"g = m.{name}.grid;", "count = size(g.points, 1);",
           "sys = ss(zeros(size(g.D, 1), size(g.D, 2), count));", "for k = 1:count",
           f"    sys(:, :, k) = ss(g.A(:, :, k), g.B(:, :, k), g.C(:, :, k), g.D(:, :, k), {sample_time!r});", "end",
           "sys.InputName = g.inputs.names;", "sys.InputUnit = g.inputs.units;", "sys.OutputName = g.outputs.names;",
           "sys.OutputUnit = g.outputs.units;"]
    if variables:
        out += ["sys.SamplingGrid = struct( ...", ", ...\n".join(variables) + ");"]
    return "\n".join([*out, "end", ""])


def _basis_program(model: LPVStateSpace) -> StepProgram:
    """The basis alone: scheduling in, values out."""
    b = StepBuilder("basis", "basis", 1.0)
    given = {n: b.input(n) for n in model.box.names}
    values = basis_values(b, model.basis, {n: (lambda i, at=at: at) for n, at in given.items()})
    for i, v in enumerate(values):
        b.output(f"phi{i + 1}", v)
    return b.program()


def _data_function(name: str, model: LPVStateSpace) -> str:
    """[A, B, C, D, E, dx0, x0, u0, y0, Delays] = NAME_data(t, p), as lpvss takes it."""
    program = _basis_program(model)
    given = [f"u.{q.name} = q({i + 1});" for i, q in enumerate(program.inputs)]
    size = model.basis.size
    phi = ", ".join(f"y.{q.name}" for q in program.outputs)
    box = "; ".join(f"{n} in [{lo:g}, {hi:g}] {u}".strip() for n, lo, hi, u in
                    zip(model.box.names, model.box.lower, model.box.upper, model.box.units, strict=True))
    sums = [f"{m} = sum_of(l.{m}, phi, {rows}, {columns});" for m, rows, columns in
            (("A", model.order, model.order), ("B", model.order, model.n_filter_inputs),
             ("C", model.n_outputs, model.order), ("D", model.n_outputs, model.n_filter_inputs))]
    return "\n".join([
        f"function [A, B, C, D, E, dx0, x0, u0, y0, Delays] = {name}_data(~, q)",
        f"%{name.upper()}_DATA Data function for lpvss: matrices and offsets at the scheduling q.",
        f"%   sys = lpvss({{{', '.join(repr(n) for n in model.box.names)}}}, @{name}_data, {model.sample_time!r});",
        f"%   {box or 'There is no scheduling.'}", "persistent l", "if isempty(l)", f"    m = load('{name}.mat');",
        f"    l = m.{name}.lpv;", "end", "p = l.knots;", *given, *MatlabPrinter().block(program.body, 0),
        f"phi = reshape([{phi}], {size}, 1);", *sums, "E = [];", "dx0 = l.dx0 * phi;",
        "x0 = [];", "u0 = [];", "y0 = l.y0 * phi;", "Delays = [];", "end", "",
        "function value = sum_of(parts, phi, rows, columns)",
        "value = reshape(reshape(parts, rows * columns, numel(phi)) * phi, rows, columns);", "end", CHOOSE])


CHECK_STEP = "worst = NAME_check();"
CHECK_DATA = """
m = load('NAME.mat');
g = m.NAME.grid;
off = 0;
top = 0;
for k = 1:size(g.points, 1)
    [A, B, C, D] = NAME_data(0, g.points(k, :));
    H = D;
    F = g.D(:, :, k);
    for j = 0:3 * size(A, 1)
        H(:, :, j + 2) = C * A ^ j * B;
        F(:, :, j + 2) = g.C(:, :, k) * g.A(:, :, k) ^ j * g.B(:, :, k);
    end
    off = max(off, max(abs(H(:) - F(:))));
    top = max(top, max(abs(F(:))));
end
fprintf('data function: relative error %.3g\\n', off / max(top, realmin));
t = m.NAME.lpv.test;
x = [];
out = zeros(size(t.outputs));
for k = 1:size(out, 1)
    [A, B, C, D, E, dx0, x0, u0, y0] = NAME_data(k - 1, t.scheduling(k, :));
    if isempty(x)
        x = zeros(size(A, 1), 1);
    end
    out(k, :) = (C * x + D * t.inputs(k, :)' + y0)';
    x = A * x + B * t.inputs(k, :)' + dx0;
end
top = max(abs(t.outputs(:)));
fprintf('varying: relative error %.3g\\n', max(abs(out(:) - t.outputs(:))) / max(top, realmin));
"""


# -- Octave ----------------------------------------------------------------------------------------------------------
def find_octave() -> str | None:
    """The path of GNU Octave; None where it is not installed.

    Returns
    -------
    str or None
        Path of ``octave-cli``, or else of ``octave``.
    """
    return shutil.which("octave-cli") or shutil.which("octave")


def _octave_checks(found: Exportable, files: dict[str, bytes]) -> tuple[tuple[str, ...], bool]:
    """What Octave finds: the error of the step along the trajectory, and of the data function on the grid."""
    octave = find_octave()
    if octave is None:
        return ("not run: GNU Octave is not installed",), True
    name = found.program.name
    with_data = f"{name}_data.m" in files
    script = (CHECK_STEP + (CHECK_DATA if with_data else "")).replace("NAME", name)
    with tempfile.TemporaryDirectory(prefix="lpvid-matlab-") as folder:
        for file, data in files.items():
            (Path(folder) / file).write_bytes(data)
        done = run_tool([octave, "--no-gui", "--no-init-file", "--quiet", "--eval", script], folder)
    numbers = [float(x) for x in re.findall(r"relative error (\S+)", done.stdout)]
    if done.returncode or len(numbers) != 1 + 2 * with_data:
        return (f"Octave ended with {done.returncode}: {' '.join((done.stderr or done.stdout).split())[:300]}",), False
    checks = [f"GNU Octave: step against our free run, relative error {numbers[0]:.2g}"]
    if with_data:
        checks.append("GNU Octave: data function with moving scheduling against our free run, relative error "
                      f"{numbers[2]:.2g}")
        checks.append("GNU Octave: impulse responses of the data function against the frozen models on the grid, "
                      f"relative error {numbers[1]:.2g}")
    return tuple(checks), max(numbers[:1] + numbers[2:]) <= TOLERANCE and max([0.0, *numbers[1:2]]) <= IMPULSE
