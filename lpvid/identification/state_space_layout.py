"""Where each parameter of a vector stands among the matrices of a state-space model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.model.state_space import LPVStateSpace

ARRAYS = ("A", "B", "state_offset", "observer_gain", "C", "D", "output_offset")
"""Fields of `LPVStateSpace` by their code in a layout."""
SYMBOLS = ("A", "B", "f", "K", "C", "D", "g")


@dataclass(frozen=True, eq=False)
class StateSpaceLayout:
    """Parameters of a state-space model by place; one parameter may stand in several places.

    Attributes
    ----------
    table : (entries, 6) int array
        One row per entry: parameter, array (place in `ARRAYS`), basis function, row, column (0 for offsets), sign.
    labels : tuple of str
        Stem of every parameter's name where the matrices' entries are not the names wanted, e.g. ``a1``; may be empty.
    """

    table: np.ndarray
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "table", _checks.frozen_array(self.table, "a parameter layout", ndim=2, dtype=int))

    @classmethod
    def full(cls, model: LPVStateSpace, arrays: tuple[str, ...]) -> StateSpaceLayout:
        """Every entry of the named fields.

        Parameters
        ----------
        model : LPVStateSpace
            For the sizes of its fields.
        arrays : tuple of str
            Names among `ARRAYS`.

        Returns
        -------
        StateSpaceLayout
            One parameter per entry, field by field in the order of `ARRAYS`.
        """
        rows: list[tuple[int, ...]] = []
        for code, name in enumerate(ARRAYS):
            if name in arrays:
                stack = _stack(model, name)
                for m, i, j in np.ndindex(*stack.shape):
                    rows.append((len(rows), code, m, i, j, 1))
        return cls(np.array(rows, dtype=int).reshape(-1, 6))

    @property
    def size(self) -> int:
        """Number of parameters."""
        return int(self.table[:, 0].max(initial=-1)) + 1

    @property
    def outputs(self) -> StateSpaceLayout:
        """The parameters of the output equation alone: the free run is linear in them."""
        rows = self.table[self.table[:, 1] >= ARRAYS.index("C")]
        kept, place = np.unique(rows[:, 0], return_inverse=True)
        table = np.column_stack([place, rows[:, 1:]])
        return StateSpaceLayout(table, tuple(self.labels[i] for i in kept) if self.labels else ())

    def fill(self, model: LPVStateSpace, theta: np.ndarray) -> LPVStateSpace:
        """The model with these parameters in place of its own; all other entries stay.

        Parameters
        ----------
        model : LPVStateSpace
            Gives everything but the parameters.
        theta : (k,) array
            In the order of the layout.

        Returns
        -------
        LPVStateSpace
        """
        return model.replace(**self.arrays(model, theta))

    def arrays(self, model: LPVStateSpace, theta: np.ndarray) -> dict[str, np.ndarray]:
        """The fields that hold parameters, with these in place.

        Parameters
        ----------
        model : LPVStateSpace
            For the entries that hold no parameter.
        theta : (k,) array
            In the order of the layout.

        Returns
        -------
        dict of str to array
            By field, as `LPVStateSpace` takes them.
        """
        parameter, array, function, row, column, sign = self.table.T
        out: dict[str, np.ndarray] = {}
        for code in np.unique(array):
            stack, here = _stack(model, ARRAYS[code]).copy(), array == code
            stack[function[here], row[here], column[here]] = sign[here] * theta[parameter[here]]
            out[ARRAYS[code]] = stack[:, :, 0] if ARRAYS[code].endswith("offset") else stack
        return out

    def read(self, model: LPVStateSpace) -> np.ndarray:
        """(k,) parameters of a model of this layout.

        Parameters
        ----------
        model : LPVStateSpace
            Of this layout.

        Returns
        -------
        (k,) array
            Of a parameter in several places the first in the table.
        """
        theta = np.zeros(self.size)
        stacks = [_stack(model, name) for name in ARRAYS]
        for parameter, array, function, row, column, sign in self.table[::-1]:
            theta[parameter] = sign * stacks[array][function, row, column]
        return theta

    def direction(self, arrays: dict[str, np.ndarray]) -> np.ndarray:
        """(k,) parameters that stand for given (M, rows, columns) changes of the fields, by name.

        Parameters
        ----------
        arrays : dict of str to (M, rows, columns) array
            Changes by field; a field that is left out does not change.

        Returns
        -------
        (k,) array
        """
        theta = np.zeros(self.size)
        for parameter, array, function, row, column, sign in self.table:
            if ARRAYS[array] in arrays:
                theta[parameter] = sign * arrays[ARRAYS[array]][function, row, column]
        return theta

    def names(self, model: LPVStateSpace) -> tuple[str, ...]:
        """A readable name of every parameter, e.g. ``A12[current]``.

        Parameters
        ----------
        model : LPVStateSpace
            For the labels of its basis.

        Returns
        -------
        tuple of str
        """
        out = [""] * self.size
        for parameter, array, function, row, column, _ in self.table[::-1]:
            place = f"{row + 1}" if ARRAYS[array].endswith("offset") else (
                f"{row + 1}{column + 1}" if max(row, column) < 9 else f"{row + 1},{column + 1}")
            stem = self.labels[parameter] if self.labels else f"{SYMBOLS[array]}{place}"
            out[parameter] = f"{stem}[{model.basis.labels[function]}]"
        return tuple(out)

    def to_list(self) -> list[list[int]]:
        """Plain data for JSON.

        Returns
        -------
        list of list of int
            Rows of the table.
        """
        return self.table.tolist()


def _stack(model: LPVStateSpace, name: str) -> np.ndarray:
    """(M, rows, columns) coefficients of a field; a missing observer gain is zero."""
    fields = {"A": model.A, "B": model.B, "C": model.C, "D": model.D, "state_offset": model.state_offset,
              "output_offset": model.output_offset, "observer_gain": model.observer_gain}
    array = fields[name]
    if array is None:
        return np.zeros((model.basis.size, model.order, model.n_outputs))
    return array[:, :, None] if array.ndim == 2 else array


def stacks(model: LPVStateSpace) -> tuple[np.ndarray, ...]:
    """A, B, C, D, f, g, K as (M, rows, columns) arrays of one's own, in the order of the compiled runs.

    Parameters
    ----------
    model : LPVStateSpace
        A field that it lacks counts as zero.

    Returns
    -------
    tuple of seven arrays
    """
    order = ("A", "B", "C", "D", "state_offset", "output_offset", "observer_gain")
    return tuple(np.array(_stack(model, name), order="C") for name in order)
