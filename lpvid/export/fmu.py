"""FMUs of FMI 2.0 and 3.0: co-simulation of step programs, model exchange of flows; C sources and a library inside."""

# FMPy is an extra
# pyright: reportMissingImports=false
from __future__ import annotations

import io
import os
import platform
import re
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lpvid.errors import InputError
from lpvid.export.c_build import compile_c, find_compiler
from lpvid.export.c_printer import c_number
from lpvid.export.c_source import header, source
from lpvid.export.contract import Exportable, relative_error
from lpvid.export.exporting import Content, Export, exported
from lpvid.export.flow import Flow
from lpvid.export.fmu_description import Variable, build_description, model_description, variables
from lpvid.export.step_program import StepProgram

T = TypeVar("T")
HEADERS = {2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
           3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h")}
"""The standard's headers (2-clause BSD, Modelica Association), taken from FMPy, which ships them unchanged."""
PLATFORMS = {2: "linux64", 3: "x86_64-linux"}
"""Folder of a Linux x86-64 library in either version of the standard."""
MARKS = {2: {"FMI": "fmi2", "VERSION": "2", "REAL": "fmi2Real", "ENVIRONMENT": "ComponentEnvironment",
             "LOGGER": "CallbackLogger", "TITLE": "m->title, ", "CLOCKS": "0"},
         3: {"FMI": "fmi3", "VERSION": "3", "REAL": "fmi3Float64", "ENVIRONMENT": "InstanceEnvironment",
             "LOGGER": "LogMessageCallback", "TITLE": "", "CLOCKS": "1"}}
"""Names of either version of the standard in the templates that both share; FMI 3 has the time as a variable."""
TOLERANCE = 1e-12
"""Largest error against the simulation, relative to the largest output, with which an FMU passes."""
SLOPE_TOLERANCE = 1e-6
"""The same of directional derivatives, whose central differences are good to ε^(2/3) = 4e-11 times their curvature."""
OFF = 1e-3
"""Share of a random direction by which points are moved before they are differentiated: inputs that rest at a limit,
and ends of splines, are kinks, where there is no derivative; a random point beside them is none."""
NAMESPACE = uuid.UUID("6ba7b811-9dad-11d1-80b4-00c04fd430c8")
"""Of the tokens: RFC 4122's name space of URLs."""


def export_fmu(model: Any, folder: str | os.PathLike, *, version: int = 2, name: str = "", clamp: bool | None = None,
               sample_time: float | None = None, at: Mapping[str, float] | None = None) -> Export:
    """Write a model, damper or controller as an FMU: co-simulation, or model exchange where it is continuous.

    One step of the model per period of communication (or several, for a multiple of it): inputs are read at the start
    of a communication step and held, and the outputs after it are those of the last sample in it, from its inputs. The
    library is compiled here for Linux x86-64, the C sources with the standard's headers are inside, and no Python is
    needed to run it. It is validated and run by FMPy against this package's simulation.

    Parameters
    ----------
    model : object
        As for `lpvid.export_c`.
    folder : str or path-like
    version : {2, 3}
    name, clamp, sample_time, at
        As for `lpvid.export_c`.

    Returns
    -------
    Export
        With FMPy's verdict and the error against the simulation.

    Raises
    ------
    InputError
        FMPy is not installed; a model without a step.
    """
    if version not in HEADERS:
        raise InputError("an FMU is of FMI 2 or 3", got=version)
    return exported(model, folder, f"fmu{version}", name, clamp, sample_time, at)


def step_content(found: Exportable, version: int) -> Content:
    """The FMU of a step program, in memory.

    Parameters
    ----------
    found : Exportable
        A step program with its simulation.
    version : {2, 3}
        Of the standard.

    Returns
    -------
    Content
        One file, ``NAME.fmu`` for co-simulation; without a C compiler for Linux x86-64 it has sources alone and counts
        as passed.
    """
    return _content(found.program, version, lambda fmu: checked(found, fmu))


def flow_content(flow: Flow, version: int) -> Content:
    """The FMU of a continuous model, for model exchange, in memory.

    Parameters
    ----------
    flow : Flow
        A continuous model with its derivatives.
    version : {2, 3}
        Of the standard.

    Returns
    -------
    Content
        One file, ``NAME.fmu``; without a C compiler for Linux x86-64 it has sources alone and counts as passed.

    Raises
    ------
    InputError
        A model without states.
    """
    if not flow.program.states:
        raise InputError("a model without states has nothing to integrate", got=flow.program.description,
                         mend="discretise it (lpvid.discretise); any period will do")
    return _content(flow.program, version, lambda fmu: _checked_flow(flow, fmu), flow.step)


def _content(program: StepProgram, version: int, check: Callable[[bytes], tuple[tuple[str, ...], bool]],
             step: float = 0.0) -> Content:
    """Description, sources and, where a compiler is, the library of a program; `check` runs it."""
    listed = variables(program)
    texts, token = _fmu_sources(program, listed, version)
    archive = {"modelDescription.xml": model_description(program, listed, version, token, step).encode()}
    archive |= {f"sources/{n}": t.encode() for n, t in texts.items()}
    if version == 3:
        archive["sources/buildDescription.xml"] = build_description(program).encode()
    library = _library(program, texts, version)
    notes, checks, passed = program.notes, ("not run: no library inside",), True
    if library is None:
        notes = (*notes, "Sources only: there is no C compiler here for Linux x86-64.")
    else:
        archive[f"binaries/{PLATFORMS[version]}/{program.name}.so"] = library
        checks, passed = check(_packed(archive))
    return Content(f"fmu{version}", {f"{program.name}.fmu": _packed(archive)}, program.description, checks, notes,
                   passed)


def _fmu_sources(program: StepProgram, listed: tuple[Variable, ...], version: int) -> tuple[dict[str, str], str]:
    """Every C file of an FMU by its name, and the token that names exactly these."""
    name = program.name
    files = {f"{name}.h": header(program, "double"), f"{name}.c": source(program, "double")}
    places = ",\n".join(f"    offsetof(Instance, {v.member})" for v in listed)
    home = resources.files("lpvid.export.fmi")
    headers = _headers(version)
    way = "step" if program.sample_time else "flow"
    text = "".join(home.joinpath(file).read_text(encoding="utf-8")
                   for file in ("fmi.c", f"{way}.c", f"fmi{version}.c", f"fmi{version}_{way}.c"))
    marks = {**MARKS[version], "NAME": name, "PERIOD": c_number(program.sample_time), "PLACES": places,
             "VARIABLES": str(len(listed)),
             "KIND": "co-simulation", "TYPE": "fmi2CoSimulation", "MORE": "", "ALWAYS": "0"}
    if not program.sample_time:
        first = [next(i for i, v in enumerate(listed) if v.kind == kind) for kind in ("state", "rate")]
        marks |= {"KIND": "model exchange", "TYPE": "fmi2ModelExchange", "MORE": f"    {name}_states dx;\n",
                  "ALWAYS": "1", "STATES": str(sum(v.kind == "state" for v in listed)), "FIRST_STATE": str(first[0]),
                  "FIRST_DERIVATIVE": str(first[1]), "INPUTS": str(sum(v.kind == "input" for v in listed)),
                  "OUTPUTS": str(sum(v.kind == "output" for v in listed))}
    for mark, value in marks.items():
        text = text.replace(f"@{mark}@", value)
    text += _not_supported(text, headers["fmi3FunctionTypes.h"]) if version == 3 else ""
    token = str(uuid.uuid5(NAMESPACE, files[f"{name}.c"] + text))
    token = f"{{{token}}}"
    files[f"{name}_fmi{version}.c"] = text.replace("@TOKEN@", token)
    return files | headers, token


def _not_supported(text: str, types: str) -> str:
    """Functions of FMI 3 that a wrapper does not name, each failing: importers look for all of them.

    Parameters
    ----------
    text : str
        The wrapper in C.
    types : str
        The standard's header with the type of every function.
    """
    named, out = set(re.findall(r"fmi3\w+", text)), "\n/* Functions of the standard that this model does not have. */\n"
    for kind, name, listed in re.findall(r"typedef\s+(\w+)\s+(fmi3\w+)TYPE\s*\(([^;]*)\);", types):
        if name in named:
            continue
        arguments = [" ".join(a.split()) for a in listed.split(",")]
        unused = re.findall(r"(\w+)(?:\[\])?(?:,|$)", ", ".join(arguments))
        result = "NULL"
        if kind == "fmi3Status":
            unused, result = unused[1:], f'complain((Instance *)instance, "{name} is not supported")'
        out += "\n".join(("", f"{kind} {name}(" + f",\n{' ' * len(f'{kind} {name}(')}".join(arguments) + ")", "{",
                          *(f"    (void){a};" for a in unused), f"    return {result};", "}", ""))
    return out


def _headers(version: int) -> dict[str, str]:
    home = _fmpy_folder()
    return {name: (home / "c-code" / name).read_text(encoding="utf-8") for name in HEADERS[version]}


def _fmpy_folder() -> Path:
    from importlib.util import find_spec

    found = find_spec("fmpy")
    if found is None or found.origin is None:
        raise InputError("an FMU needs the standard's headers and a check, which FMPy brings", got="no fmpy",
                         mend="pip install 'lpvid[fmu]'")
    return Path(found.origin).parent


def _library(program: StepProgram, files: dict[str, str], version: int) -> bytes | None:
    """The shared library, or None where this system cannot make one for Linux x86-64."""
    if find_compiler() is None or sys.platform != "linux" or platform.machine() != "x86_64":
        return None
    with tempfile.TemporaryDirectory(prefix="lpvid-fmu-") as folder:
        home = Path(folder)
        for name, text in files.items():
            (home / name).write_text(text, encoding="utf-8")
        target = home / f"{program.name}.so"
        compile_c([home / f"{program.name}.c", home / f"{program.name}_fmi{version}.c"], target,
                  ("-shared", "-fPIC", "-fvisibility=hidden", f"-I{home}"))
        return target.read_bytes()


def _packed(archive: dict[str, bytes]) -> bytes:
    """A zip file whose bytes depend on its contents alone."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in archive.items():
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            file.writestr(entry, data)
    return out.getvalue()


# -- continuous models -----------------------------------------------------------------------------------------------
def _checked_flow(flow: Flow, fmu: bytes) -> tuple[tuple[str, ...], bool]:
    """FMPy's validation; derivatives and outputs of the FMU along a trajectory against our own at the same points.

    An importer integrates; what is compared is what it integrates, so that no solver's error stands in between.
    """
    valid, problems, (error, slope) = _validated(flow.program, fmu, lambda path: _flow_error(flow, path))
    text = (f"{valid}; derivatives and outputs for model exchange against our own along a trajectory: relative error "
            f"{error:.2g}")
    more = f"directional derivatives against central differences of our own: relative error {slope:.2g}"
    return (text, more), not problems and error <= TOLERANCE and slope <= SLOPE_TOLERANCE


def _flow_error(flow: Flow, path: str) -> tuple[float, float]:
    """Largest errors of an FMU's derivatives and outputs, and of their directional derivatives, along a trajectory.

    The first are relative to the largest of each; the second, along one random direction at every point and against
    central differences of this package's own functions, to the largest directional derivative of each.
    """
    from ctypes import c_double

    import fmpy
    from fmpy.fmi2 import FMU2Model
    from fmpy.fmi3 import FMU3Model

    u, states = flow.trial()
    wanted = np.array([np.concatenate([flow.rates(x, row), flow.outputs(x, row)])
                       for x, row in zip(states, u, strict=True)])
    described: Any = fmpy.read_model_description(path)
    named = {v.name: v.valueReference for v in described.modelVariables}
    listed = variables(flow.program)
    ins, outs = ([named[v.name] for v in listed if v.kind == kind] for kind in ("input", "output"))
    n = states.shape[1]
    with tempfile.TemporaryDirectory(prefix="lpvid-fmu-") as folder:
        fmpy.extract(path, folder)
        second = described.fmiVersion == "2.0"
        fmu: Any = (FMU2Model if second else FMU3Model)(
            guid=described.guid, unzipDirectory=folder, instanceName="check",
            modelIdentifier=described.modelExchange.modelIdentifier)
        fmu.instantiate()
        if second:
            fmu.setupExperiment()
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        (fmu.newDiscreteStates if second else fmu.updateDiscreteStates)()
        fmu.enterContinuousTimeMode()
        write, look = (fmu.setReal, fmu.getReal) if second else (fmu.setFloat64, fmu.getFloat64)
        rates = fmu.getDerivatives if second else fmu.getContinuousStateDerivatives
        got, place = np.empty_like(wanted), (c_double * n)()
        known = [*ins, *(named[v.name] for v in listed if v.kind == "state")]
        unknown = [*(named[v.name] for v in listed if v.kind == "rate"), *outs]
        ways, slopes = _directions(u, states), np.empty_like(wanted)
        off_u, off_x = u + OFF * ways[:, : u.shape[1]], states - OFF * ways[:, u.shape[1] :]
        for k in range(len(u)):
            fmu.setTime(k * flow.step)
            write(ins, u[k].tolist())
            fmu.setContinuousStates((c_double * n)(*states[k]), n)
            rates(place, n)
            got[k] = [*place, *look(outs)]
            write(ins, off_u[k].tolist())
            fmu.setContinuousStates((c_double * n)(*off_x[k]), n)
            slopes[k] = fmu.getDirectionalDerivative(unknown, known, ways[k].tolist())
        fmu.terminate()
        fmu.freeInstance()
    return relative_error(got, wanted), relative_error(slopes, _differences(flow, off_u, off_x, ways))


def _directions(u: np.ndarray, states: np.ndarray) -> np.ndarray:
    """(n, inputs + states) random directions, each variable by the size that it has along the trajectory."""
    at = np.hstack([u, states])
    size = np.abs(at).max(axis=0)
    return np.random.default_rng(1).standard_normal(at.shape) * np.where(size > 0, size, 1.0)


def _differences(flow: Flow, u: np.ndarray, states: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """(n, rates + outputs) central differences of this package's own functions along the directions."""
    step, found = np.finfo(float).eps ** (1 / 3), []  # the width that balances rounding and curvature
    for row, x, way in zip(u, states, ways, strict=True):
        ends = [(row + h * way[: row.size], x + h * way[row.size :]) for h in (step, -step)]
        ahead, behind = (np.concatenate([flow.rates(b, a), flow.outputs(b, a)]) for a, b in ends)
        found.append((ahead - behind) / (2 * step))
    return np.array(found)


# -- checking --------------------------------------------------------------------------------------------------------
def checked(found: Exportable, fmu: bytes) -> tuple[tuple[str, ...], bool]:
    """FMPy's validation, and the largest error of a co-simulation against this package's simulation.

    Parameters
    ----------
    found : Exportable
        A step program with its simulation.
    fmu : bytes
        The file for co-simulation, with a library for this system.

    Returns
    -------
    tuple of str
        One line: FMPy's verdict and the relative error.
    bool
        Whether FMPy finds no problem and the error is at most `TOLERANCE`.
    """
    valid, problems, error = _validated(found.program, fmu, lambda path: _fmu_error(found, path))
    return (f"{valid}; co-simulation against our free run: relative error {error:.2g}",), \
        not problems and error <= TOLERANCE


def _validated(program: StepProgram, fmu: bytes, measure: Callable[[str], T]) -> tuple[str, list, T]:
    """FMPy's summary of an FMU, the problems that it lists, and what `measure` returns for the file."""
    import fmpy
    from fmpy.validation import validate_fmu

    with tempfile.TemporaryDirectory(prefix="lpvid-fmu-") as folder:
        path = str(Path(folder) / f"{program.name}.fmu")
        Path(path).write_bytes(fmu)
        problems = validate_fmu(path)
        measured = measure(path)
    stated = "valid" if not problems else f"{len(problems)} problem(s): {' '.join(str(problems[0]).split())[:200]}"
    return f"FMPy {fmpy.__version__}: {stated}", problems, measured


def _fmu_error(found: Exportable, path: str, samples: int = 200) -> float:
    """Largest difference of an FMU's outputs from the simulation, relative to the largest output."""
    import fmpy

    u, y = found.trial(samples)
    program = found.program
    listed = variables(program)
    labels, names = ([v.name for v in listed if v.kind == kind] for kind in ("input", "output"))
    table = np.zeros(samples, dtype=[("time", float), *((n, float) for n in labels)])
    table["time"] = program.sample_time * np.arange(samples)
    for column, label in zip(u.T, labels, strict=True):
        table[label] = column
    run: Any = fmpy.simulate_fmu(path, start_time=0.0, stop_time=float(table["time"][-1]), fmi_type="CoSimulation",
                                 step_size=program.sample_time, output_interval=program.sample_time, input=table,
                                 output=names)
    out = np.column_stack([np.asarray(run[n], dtype=float) for n in names])
    return relative_error(out[1 : len(y)], y[: len(out) - 1], y)  # outputs after a step are those of its start
