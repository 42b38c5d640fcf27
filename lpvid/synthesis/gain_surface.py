"""GainSurface: the gains of a controller of fixed structure over the scheduling, as a table for an ECU."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Scheduling, basis_from_dict
from lpvid.synthesis.controller_structures import GAINS
from lpvid.synthesis.design_grid import tensor
from lpvid.synthesis.matrix_function import MatrixFunction


@dataclass(frozen=True, eq=False)
class GainSurface:
    """G(p): what each reading contributes to each demand.

    Parameters
    ----------
    rows : tuple of str
        Controls, and states of a low-order or observer-based controller (their derivatives).
    columns : tuple of str
        Readings: measurements, their integrals and derivatives, states, innovations.
    free : (rows, columns) bool array
        Entries that the structure leaves free; the others are zero.
    gain : MatrixFunction
    box : Scheduling
        Of the variables that the gains read.
    """

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    free: np.ndarray
    gain: MatrixFunction
    box: Scheduling

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the free entries, row by row."""
        return tuple(f"{r} <- {c}" for r, row in zip(self.rows, self.free, strict=True)
                     for c, free in zip(self.columns, row, strict=True) if free)

    def at(self, points: np.ndarray) -> np.ndarray:
        """(N, labels) values of the free entries at points of shape (N, len(box.names)).

        Parameters
        ----------
        points : (N, n) array
            Values of the scheduling variables, in their units.

        Returns
        -------
        (N, labels) array
            Values of the free entries.
        """
        return self.gain.at(np.atleast_2d(np.asarray(points, dtype=float)))[:, self.free]

    def table(self, points: int | Sequence[Sequence[float]] = 9) -> tuple[np.ndarray, np.ndarray]:
        """Breakpoints and values.

        Parameters
        ----------
        points : int or sequence of sequences
            Breakpoints of every variable, or how many.

        Returns
        -------
        points : (N, variables) array
        values : (N, labels) array

        Raises
        ------
        InputError
            Breakpoints outside of the box the gains were designed for.
        """
        if isinstance(points, int):
            at = self.box.grid(points)
        else:
            at = tensor(tuple(np.asarray(axis, dtype=float) for axis in points))
            if at.shape[1] != len(self.box.names) or not self.box.contains(at).all():
                raise InputError("a table needs breakpoints of every variable, within the box of the design",
                                 got=f"{len(points)} axes for {', '.join(self.box.names) or 'constant gains'}",
                                 mend=", ".join(f"{n} from {a:.6g} to {b:.6g}" for n, a, b in
                                                zip(self.box.names, self.box.lower, self.box.upper, strict=True)))
        return at, self.at(at)

    def to_csv(self, path: str | Path, points: int | Sequence[Sequence[float]] = 9) -> Path:
        """Write the table: one line for each breakpoint, a column for each variable and each gain.

        Parameters
        ----------
        path : str or Path
            File to write.
        points : int or sequence of sequences of float
            Breakpoints of every variable, or how many of them.

        Returns
        -------
        Path
            The file.
        """
        at, values = self.table(points)
        heads = [f"{n} [{u}]" if u else n for n, u in zip(self.box.names, self.box.units, strict=True)]
        path = Path(path)
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*heads, *self.labels])
            writer.writerows([repr(float(x)) for x in (*p, *v)] for p, v in zip(at, values, strict=True))
        return path

    def __repr__(self) -> str:
        _, values = self.table(5)
        spans = [f"  {label}: {low:.4g} … {high:.4g}" for label, low, high in
                 zip(self.labels, values.min(axis=0), values.max(axis=0), strict=True)]
        return "\n".join([f"GainSurface over {', '.join(self.box.names) or 'nothing'}", *spans[:9]])


def gain_surface(controller: LPVStateSpace) -> GainSurface:
    """The gains of a controller that `FixedStructure` designed.

    Parameters
    ----------
    controller : LPVStateSpace
        What `FixedStructure` returned.

    Returns
    -------
    GainSurface
        Its gains over the scheduling.

    Raises
    ------
    InputError
        Another controller.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> other = LPVStateSpace([[[-1.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), None)
    >>> gain_surface(other)                                                      # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    lpvid.errors.InputError: this controller has no gain surfaces...
    """
    kept = controller.metadata.get(GAINS)
    if not isinstance(kept, Mapping):
        raise InputError("this controller has no gain surfaces", got="a controller without fixed structure",
                         mend="design one with FixedStructure")
    gain = MatrixFunction(basis_from_dict(kept["basis"]), np.asarray(kept["gains"], dtype=float))
    return GainSurface(tuple(kept["rows"]), tuple(kept["columns"]), np.array(kept["free"], dtype=bool), gain,
                       Scheduling.from_dict(kept["box"]))
