"""Exports of models, dampers and controllers: the functions behind ``lpv.export_c`` and the others."""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.export.exportable import Exportable, Options, exportable, flow_of
from lpvid.export.json_files import write_bytes
from lpvid.export.step_builder import checked_name


@dataclass(frozen=True, eq=False)
class Export:
    """Files that were written, and what was checked of them.

    Attributes
    ----------
    form : str
        "c", "fmu2", "fmu3", "modelica", "matlab", "control" or "csv".
    files : tuple of Path
    description : str
        What was exported.
    checks : tuple of str
        What was compared with what, with its figures.
    notes : tuple of str
    passed : bool
        Whether what was checked agreed; True where nothing could be checked, as `checks` then states.
    """

    form: str
    files: tuple[Path, ...]
    description: str
    checks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    passed: bool = True

    def __repr__(self) -> str:
        lines = [
            f"{self.form}: {self.description}",
            *(f"  {c}" for c in self.checks),
            *(f"  note: {n}" for n in self.notes),
            f"  {', '.join(p.name for p in self.files)}",
        ]
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class Content:
    """What an export would write: files by name, in memory.

    Attributes
    ----------
    form, description, checks, notes
        As in `Export`.
    files : mapping of str to bytes
    passed : bool
        Whether what was checked agreed.
    """

    form: str
    files: Mapping[str, bytes]
    description: str
    checks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    passed: bool = True


def export_c(model: Any, folder: str | os.PathLike, *, name: str = "", precision: str = "double",
             clamp: bool | None = None, sample_time: float | None = None,
             at: Mapping[str, float] | None = None) -> Export:
    """Write a model, damper or controller as C99: one header, one source, a self-test.

    ::

        NAME_init(&s);                                   s: states
        NAME_step(&NAME_defaults, &s, &u, &y);           u: inputs now, y: outputs now

    Nothing is allocated, nothing is global, every loop has constant bounds. Where the system has a C compiler the
    self-test is compiled and run: it compares a random trajectory with this package's simulation from rest.

    Parameters
    ----------
    model : object
        A model of lpvid, a synthesis (its controller), `lpvid.saturate`'s controller behind limits, or a noun that an
        installed package can export (a damper, a controller).
    folder : str or path-like
        Made where it does not exist.
    name : str
        Prefix of files and functions.
    precision : {"double", "float"}
    clamp : bool, optional
        Hold the scheduling inside the model's box; left out, for designed controllers only.
    sample_time : float, optional
        Period of what runs at any [s].
    at : mapping of str to float, optional
        Inputs to hold, ``{"current": 1.2}`` for a model frozen at 1.2 A; each becomes a parameter.

    Returns
    -------
    Export

    Raises
    ------
    InputError
        What has no step in C, with the nearest that has.

    Examples
    --------
    >>> import tempfile
    >>> from lpvid import LPVTransferFunction, Polynomial
    >>> model = LPVTransferFunction.siso([[-0.9, 0.1]], [[0, 0], [0.1, 0]], Polynomial("p", degree=1), 0.01)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in export_c(model, folder, name="filter").files]
    ['filter.h', 'filter.c', 'filter_test.c']
    """
    return exported(model, folder, "c", name, clamp, sample_time, at, precision)


def exported(model: Any, folder: str | os.PathLike, form: str, name: str, clamp: bool | None,
             sample_time: float | None, at: Mapping[str, float] | None, precision: str = "double") -> Export:
    """Write a model in one of `FORMS`: what `export_c` and the others do.

    Parameters
    ----------
    model : object
        As for `export_c`.
    folder : str or path-like
        Made where it does not exist.
    form : str
        A key of `FORMS`.
    name, clamp, sample_time, at, precision
        As for `export_c`.

    Returns
    -------
    Export
    """
    options = Options(checked_name(name), clamp, sample_time, at or {})
    return written(content(model, form, options, precision), folder)


def c_content(found: Exportable, precision: str = "double") -> Content:
    """The C files of a step program, compiled and tested where there is a compiler.

    Parameters
    ----------
    found : Exportable
        A step program with its simulation.
    precision : {"double", "float"}
        Arithmetic of the step.

    Returns
    -------
    Content
        Header, source and self-test; passed where the self-test passes, or where there is no compiler.
    """
    from lpvid.export.c_build import find_compiler, run_self_test
    from lpvid.export.c_source import c_files

    files, passed = c_files(found, precision), True
    if find_compiler() is None:
        check = "not compiled: no C compiler found"
    else:
        test = run_self_test(files)
        passed = test.passed
        check = (f"self-test {'passed' if test.passed else 'FAILED'}: {precision} against our free run, relative "
                 f"error {test.error:.2g} ({test.compiler}); states {test.state_bytes} bytes, parameters "
                 f"{test.parameter_bytes} bytes, at most {found.program.operations()} assignments per step")
    return Content(
        "c", {n: t.encode() for n, t in files.items()}, found.program.description, (check,), found.program.notes, passed
    )


FORMS: Mapping[str, tuple[str, str, tuple]] = {
    "c": ("lpvid.export.exporting", "c_content", ()),
    "fmu2": ("lpvid.export.fmu", "step_content", (2,)),
    "fmu3": ("lpvid.export.fmu", "step_content", (3,)),
    "modelica": ("lpvid.export.modelica", "modelica_content", ()),
    "matlab": ("lpvid.export.matlab", "matlab_content", ()),
    "control": ("lpvid.export.control_file", "control_content", ()),
    "csv": ("lpvid.export.csv_tables", "csv_content", ()),
}
"""Where each form is written: module, function from an Exportable to `Content`, its further arguments. C takes the
precision behind them."""
FLOW_FORMS: Mapping[str, tuple[str, str, tuple]] = {
    "fmu2": ("lpvid.export.fmu", "flow_content", (2,)),
    "fmu3": ("lpvid.export.fmu", "flow_content", (3,)),
    "modelica": ("lpvid.export.modelica", "modelica_flow_content", ()),
}
"""Forms that hold a continuous model as it is: the same, from a Flow."""
DOUBLE_ALONE = {
    "fmu2": "an FMU computes in double precision, as FMI's variables are",
    "fmu3": "an FMU computes in double precision, as FMI's variables are",
    "modelica": "Modelica computes in double precision",
    "matlab": "MATLAB computes in double precision",
    "control": "python-control computes in double precision",
    "csv": "tables hold every number in double precision",
}
"""Forms that refuse single precision, and why."""


def content(model: Any, form: str, options: Options | None = None, precision: str = "double") -> Content:
    """What an export in one of `FORMS` would write, with its checks, in memory.

    Parameters
    ----------
    model : object
        As for `export_c`.
    form : str
        A key of `FORMS`.
    options : Options, optional
        Left out, those of `Options()`.
    precision : {"double", "float"}
        Arithmetic; C has both, other forms refuse "float".

    Returns
    -------
    Content
        Of "fmu2", "fmu3" and "modelica" a continuous one, where the model is continuous and no sample time is
        requested.

    Raises
    ------
    InputError
        An unknown form; a model that the form cannot hold, with the nearest that can.
    """
    _checks.one_of(form, tuple(FORMS), "the form of an export")
    if precision != "double" and form in DOUBLE_ALONE:
        raise InputError(DOUBLE_ALONE[form], got=precision, mend="leave --precision out")
    if form in FLOW_FORMS and (flow := flow_of(model, options)) is not None:
        if options is not None and options.at:
            raise InputError("inputs of a continuous model are not held", got=", ".join(options.at),
                             mend="discretise it (lpvid.discretise), or let the importer set them")
        return _noted(_made(FLOW_FORMS[form], flow), flow.program, options, None)
    found = exportable(model, options)
    made = _made(FORMS[form], found, *((precision,) if form == "c" else ()))
    return _noted(made, found.program, options, found.model)


def _noted(made: Content, program: Any, options: Options | None, model: Any) -> Content:
    """The content with a note on every option that changed nothing or something else, and on an unstable model."""
    notes = []
    if options is not None and options.name and options.name != program.name:
        notes.append(f"'{options.name}' is a word of C, Python or MATLAB: files and functions are named "
                     f"'{program.name}'")
    if options is not None and options.sample_time is not None and not (program.sample_time and program.states):
        why = "a static law has no states" if program.sample_time else "the importer of a model exchange integrates it"
        notes.append(f"the sample rate of {1 / options.sample_time:.6g} Hz changes nothing: {why}")
    return replace(made, notes=(*made.notes, *notes, *_unstable(model)))


def _unstable(model: Any) -> tuple[str, ...]:
    """A note where an identified model has a frozen pole that does not decay; a controller may have one."""
    from lpvid.analysis.frozen_stability import frozen_stability
    from lpvid.model.state_space import LPVStateSpace
    from lpvid.model.transfer_function import LPVTransferFunction

    if not isinstance(model, (LPVTransferFunction, LPVStateSpace)) or "structure" not in model.metadata:
        return ()
    found = frozen_stability(model)
    if found.stable or found.max_modulus is None:
        return ()
    where = ", ".join(f"{n} = {v:.4g}" for n, v in found.at.items())
    return (f"this model is NOT stable: largest frozen pole modulus {found.max_modulus:.6g}"
            + (f" at {where}" if where else "") + "; a long free run diverges (lpvid stability)",)


def _made(writer: tuple[str, str, tuple], source: Any, *chosen: str) -> Content:
    module, function, more = writer
    return getattr(importlib.import_module(module), function)(source, *more, *chosen)


def written(made: Content, folder: str | os.PathLike) -> Export:
    """Write every file of an export; each appears complete or not at all.

    Parameters
    ----------
    made : Content
        Files by name, in memory.
    folder : str or path-like
        Made where it does not exist, with its parents; files of the same names are replaced.

    Returns
    -------
    Export
        With the paths, and checks and notes as in `made`.

    Raises
    ------
    InputError
        A folder that is a file, or that cannot be made.
    """
    home = Path(folder)
    if home.exists() and not home.is_dir():
        raise InputError(f"'{home}' is a file", mend="name a folder")
    try:
        home.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"'{home}' cannot be made", why=error.strerror, mend="check the folder") from None
    paths = tuple(write_bytes(data, home / name) for name, data in made.files.items())
    return Export(made.form, paths, made.description, made.checks, made.notes, made.passed)
