"""Systems on a grid from a MAT file: A, B, C and D with the grid's axes last, as MATLAB stores an array of systems."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.lmi.certificate import tensor


def read_mat_grid(path: Path) -> tuple[tuple[str, ...], dict[tuple[float, ...], Any]]:
    """Names of the scheduling variables, and (A, B, C, D) or a python-control system by grid point.

    The vectors of the file whose lengths are those of the last axes of A, in that order, are the scheduling variables.

    Parameters
    ----------
    path : Path
        MAT file of version 5; "Ts" [s] in it makes the systems discrete, 0 or none leaves them continuous.

    Returns
    -------
    tuple of str
        Scheduling variables, in the order of the grid's axes.
    dict of tuple of float to tuple or system
        By grid point, one value for each variable: (A, B, C, D) in continuous time, a python-control system in
        discrete time.

    Raises
    ------
    InputError
        A file of another version, without the four matrices, or whose vectors do not fit them.
    """
    from scipy.io import loadmat

    try:
        held = {k: np.asarray(v) for k, v in loadmat(str(path), appendmat=False).items() if not k.startswith("__")}
    except OSError:
        raise InputError("no such file", got=str(path)) from None
    except (NotImplementedError, ValueError) as fault:
        raise InputError("the file cannot be read as a MAT file of version 5", got=str(path), why=str(fault),
                         mend="save matrices A, B, C, D and a vector per variable with -v7, no objects") from None
    lacking = [n for n in "ABCD" if n not in held]
    if lacking:
        raise InputError(f"the file holds no {', '.join(lacking)}", got=f"{path.name}: {', '.join(held) or 'nothing'}",
                         mend="save A (n, n, N), B, C, D with the grid's axes last, and a vector for each variable")
    shape = held["A"].shape[2:]
    vectors = {k: v.ravel() for k, v in held.items() if k not in ("A", "B", "C", "D", "Ts") and v.ndim == 2
               and 1 in v.shape and v.size > 1 and np.issubdtype(v.dtype, np.number)}
    names = tuple(k for k in vectors)
    if tuple(len(vectors[n]) for n in names) != shape or not names:
        raise InputError("the vectors of the file are not the axes of its matrices", got=f"A is {held['A'].shape}; " +
                         ", ".join(f"{n} has {len(v)}" for n, v in vectors.items()),
                         mend="save exactly one vector for each axis of the grid, in the order of the axes")
    axes = [vectors[n].astype(float) for n in names]
    if any(np.any(np.diff(a) <= 0) for a in axes):
        raise InputError("the values of a scheduling variable must rise", got=path.name)
    period = float(held["Ts"].ravel()[0]) if "Ts" in held else 0.0
    systems: dict[tuple[float, ...], Any] = {}
    for point, index in zip(tensor(tuple(axes)), np.ndindex(*shape), strict=True):
        four = tuple(np.array(held[n][(slice(None), slice(None), *(index if held[n].ndim > 2 else ()))], dtype=float)
                     for n in "ABCD")
        systems[tuple(map(float, point))] = four if not period else _sampled(four, period)
    return names, systems


def _sampled(four: tuple[np.ndarray, ...], period: float) -> Any:
    import control

    return control.StateSpace(*four, period)
