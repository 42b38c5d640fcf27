"""Which entries of a canonical form are free: the parameters of the form itself."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lpvid.errors import InputError
from lpvid.identification.state_space_layout import ARRAYS, StateSpaceLayout
from lpvid.identification.state_space_search import BEYOND, SearchData, StateSpaceSearchEnd, evaluate
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import Realization

SHRUNK = (1.0, 0.98, 0.95, 0.9, 0.8, 0.5, 0.0)
"""factors on the poles of a start that diverges, until its run is bounded."""

Entry = tuple[str, int, int, int]
"""Field of `LPVStateSpace`, row, column, sign."""


def form_layout(realization: Realization) -> StateSpaceLayout:
    """The free parameters of a realised form; the ones and zeros that make it canonical stay.

    ::

        controllable   A: a_i(p), the same in every chain   C: c_i(p) per input   D: d(p)   offsets of the output
        observable     A: a_i(p)   B: b_i(p) per input   D: d(p)   offsets of states and output

    Díaz Salas 2011 (3.8)-(3.13), and the observer form of Tóth, Abbas & Werner 2012. Every coefficient runs over the
    basis of the transfer function; the products b_i − a_i b_0 of a direct term run over the products of its functions,
    so that the form as realised is one of the models that the layout reaches.

    Parameters
    ----------
    realization : Realization
        Controllable or observable, one output.

    Returns
    -------
    StateSpaceLayout

    Raises
    ------
    InputError
        Another form, or several outputs.
    """
    if realization.form not in FREE:
        raise InputError(f"the {realization.form} form has no parameters of its own to re-estimate",
                         why="it equals the transfer function for any scheduling, so that "
                             "simulation error on either is the same",
                         mend="re-estimate the transfer function with OutputError (--structure oe), or take the "
                              f"{' or the '.join(FREE)} form")
    if realization.model.n_outputs > 1:
        raise InputError("a form is re-estimated for a single output", got=f"{realization.model.n_outputs} outputs",
                         mend="use StateSpaceError (--structure pem-ss) for several")
    table = _LayoutRows(realization)
    FREE[realization.form](table, realization.source)
    return StateSpaceLayout(np.array(table.rows, dtype=int).reshape(-1, 6), tuple(table.labels))


class _LayoutRows:
    """Rows of a layout under construction."""

    def __init__(self, realization: Realization) -> None:
        source, model = realization.source, realization.model
        self.narrow, self.wide = source.basis.size, model.basis.size
        self.rows: list[tuple[int, ...]] = []
        self.labels: list[str] = []

    def add(self, label: str, entries: list[Entry], width: int) -> None:
        """One parameter per basis function, standing in all these entries."""
        for f in range(width):
            self.rows += [(len(self.labels), ARRAYS.index(name), f, row, column, sign)
                          for name, row, column, sign in entries]
            self.labels.append(label)


def _controllable(table: _LayoutRows, source: LPVTransferFunction) -> None:
    assert source.c is not None
    affine = [max(source.na, source.n_affine - 1)] if np.any(source.c) else []
    ends = (np.cumsum([source.order] * source.n_filter_inputs + affine) - 1).tolist()
    for i in range(1, source.na + 1):
        table.add(f"a{i}", [("A", end, end + 1 - i, -1) for end in ends], table.narrow)
    _inputs(table, source, "c", lambda i, q: ("C", 0, ends[q] + 1 - i, 1))
    _affine(table, source, "g", lambda i: ("C", 0, ends[-1] + 1 - i, 1))


def _observable(table: _LayoutRows, source: LPVTransferFunction) -> None:
    for i in range(1, source.na + 1):
        table.add(f"a{i}", [("A", i - 1, 0, -1)], table.narrow)
    _inputs(table, source, "b", lambda i, q: ("B", i - 1, q, 1))
    _affine(table, source, "f", lambda i: ("state_offset", i - 1, 0, 1))


def _inputs(table: _LayoutRows, source: LPVTransferFunction, stem: str, entry: Callable[[int, int], Entry]) -> None:
    """The direct term of every input, and what its lags i become."""
    for q in range(source.n_filter_inputs):
        where = f"{{{source.filter_inputs[q].name}}}" if source.n_filter_inputs > 1 else ""
        direct = bool(np.any(source.b[:1, :, q]))
        if direct:
            table.add(f"d{where}", [("D", 0, q, 1)], table.narrow)
        for i in range(1, max(source.n_lags - 1, source.na if direct else 0) + 1):
            table.add(f"{stem}{i}{where}", [entry(i, q)], table.wide if direct else table.narrow)


def _affine(table: _LayoutRows, source: LPVTransferFunction, stem: str, entry: Callable[[int], Entry]) -> None:
    """The affine terms, where there are any: the level now, and what the lags i become."""
    assert source.c is not None
    if not np.any(source.c):
        return
    level = bool(np.any(source.c[0]))
    if level:
        table.add("g", [("output_offset", 0, 0, 1)], table.narrow)
    for i in range(1, max(source.n_affine - 1, source.na if level else 0) + 1):
        table.add(f"{stem}{i}", [entry(i)], table.wide if level else table.narrow)


FREE: dict[str, Callable[[_LayoutRows, LPVTransferFunction], None]] = {
    "controllable": _controllable, "observable": _observable}
"""Forms that can be re-estimated, with what lists their free entries."""


def bounded_start(model: LPVStateSpace, layout: StateSpaceLayout, data: SearchData, na: int) -> StateSpaceSearchEnd:
    """The model with its frozen poles drawn toward zero, z → factor·z, by the least factor that bounds its run.

    The layout lists the coefficients a_1 … a_na first, all over the same basis.

    Parameters
    ----------
    model : LPVStateSpace
        Canonical form whose run may diverge.
    layout : StateSpaceLayout
        Of its free entries.
    data : SearchData
        Records on which the run must stay bounded.
    na : int
        Number of coefficients a_i.

    Returns
    -------
    StateSpaceSearchEnd
        A search that has not begun, at that model; at the strongest factor tried where none bounds the run.
    """
    theta = layout.read(model)
    width = layout.labels.count("a1")
    power = np.repeat(np.arange(1, na + 1), width)
    for factor in SHRUNK:
        drawn = theta.copy()
        drawn[: power.size] *= factor**power
        trial = layout.fill(model, drawn)
        run = evaluate(trial, data)
        if run.cost < BEYOND * data.rows:
            break
    return StateSpaceSearchEnd(trial, run, data, 0, "not begun")
