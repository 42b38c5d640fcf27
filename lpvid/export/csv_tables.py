"""Tables: every coefficient with its unit, the frozen matrices on a grid, and a trajectory to check a copy against."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from lpvid.export.exportable import Exportable
from lpvid.export.exporting import Content, Export, exported
from lpvid.export.python_control import frozen_grid, linear_model


def export_csv(model: Any, folder: str | os.PathLike, *, name: str = "", clamp: bool | None = None,
               sample_time: float | None = None, at: Mapping[str, float] | None = None) -> Export:
    """Write the coefficients of a model, damper or controller as tables.

    ``NAME_parameters.csv``: name, index (from 1), value, unit, description. ``NAME_frozen.csv``, for LPV models: the
    matrices A, B, C, D on an even grid of the box. ``NAME_trajectory.csv``: a random trajectory with the simulated
    outputs from rest. Numbers come back bit for bit.

    Parameters
    ----------
    model, folder, name, clamp, sample_time, at
        As for `lpvid.export_c`.

    Returns
    -------
    Export
    """
    return exported(model, folder, "csv", name, clamp, sample_time, at)


def csv_content(found: Exportable) -> Content:
    """The tables of a step program.

    Parameters
    ----------
    found : Exportable
        A step program with its simulation.

    Returns
    -------
    Content
        Parameters, trajectory and, of an LPV model, frozen matrices; always passed, since nothing is run.
    """
    program = found.program
    rows = [(q.name, " ".join(str(i + 1) for i in place), float(q.start[place]), q.unit, q.description)
            for q in program.parameters for place in np.ndindex(q.shape)]
    files = {f"{program.name}_parameters.csv": _table(("name", "index", "value", "unit", "description"), rows)}
    model = linear_model(found.model)
    if model is not None:
        grid = frozen_grid(model)
        matrices = {"A": grid.a, "B": grid.b, "C": grid.c, "D": grid.d}
        entries = [(*map(float, p), m, i + 1, j + 1, float(values[i, j, k])) for k, p in enumerate(grid.points)
                   for m, values in matrices.items() for i, j in np.ndindex(*values.shape[:2])]
        units = [f"{n} [{u or '1'}]" for n, u in zip(model.box.names, model.box.units, strict=True)]
        files[f"{program.name}_frozen.csv"] = _table((*units, "matrix", "row", "column", "value"), entries)
    u, y = found.trial()
    time = program.sample_time * np.arange(len(u))
    head = ["time [s]", *(f"{q.label or q.name} [{q.unit or '1'}]" for q in (*program.inputs, *program.outputs))]
    files[f"{program.name}_trajectory.csv"] = _table(head, np.column_stack([time, u, y]).tolist())
    return Content("csv", {n: t.encode() for n, t in files.items()}, program.description,
                   (f"{len(rows)} coefficients; the trajectory is this package's simulation from rest",), program.notes)


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([[repr(v) if isinstance(v, float) else v for v in row] for row in rows])
    return out.getvalue()
