"""Controllable canonical form, as the thesis writes it."""

from __future__ import annotations

import numpy as np

from lpvid.errors import InputError
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization.layout import RealizationLayout, padded, still
from lpvid.realization.varying import Varying, constant, product


def controllable(model: LPVTransferFunction) -> RealizationLayout:
    """Companion form with A(p_k), C(p_k) and constant B, Díaz Salas 2011 (3.8)-(3.13).

    ::

        x(k+1) = [0 1 0 …; 0 0 1 …; …; −a_n … −a_1] x(k) + [0 … 0 1]ᵀ u(k)
        y(k)   = [b_n − a_n b_0 … b_1 − a_1 b_0] x(k) + b_0 u(k)

    One such block for every filter input, and one driven by the constant 1 for affine terms: with more than one block
    the form is not minimal. It realises the filters in the other order, y = N D⁻¹ u in place of D⁻¹ N u, so it agrees
    with the input-output model for frozen scheduling and differs by O(‖p(k+1) − p(k)‖) when p moves.

    Parameters
    ----------
    model : LPVTransferFunction
        Single output.

    Returns
    -------
    RealizationLayout

    Raises
    ------
    InputError
        Several outputs.
    """
    if model.n_outputs > 1:
        raise InputError("the controllable form is for a single output", got=f"{model.n_outputs} outputs",
                         mend="use form 'observable', or 'augmented' for an exact one")
    assert model.c is not None
    nu = model.n_filter_inputs
    affine = bool(np.any(model.c))
    orders = [model.order] * nu + ([max(model.na, model.n_affine - 1)] if affine else [])
    n = sum(orders)
    a, b, c = padded(model, max([0, *orders]))
    arrays = {"A": Varying(n, n), "B": Varying(n, nu), "C": Varying(1, n), "D": Varying(1, nu),
              "state_offset": Varying(n), "output_offset": Varying(1)}
    first = 0
    for block, order in enumerate(orders):
        drive = arrays["B"] if block < nu else arrays["state_offset"]
        entry = (slice(first + order - 1, first + order), slice(block, block + 1)) if block < nu else first + order - 1
        numerator = b[:, :, block : block + 1] if block < nu else c[:, :, None]
        _companion(arrays, model, a, numerator, first, order)
        if order:
            drive.add(entry, constant(model.basis, np.ones((1, 1) if block < nu else ())))
        first += order
    arrays["D"].add(slice(None), (model.basis, b[0]))
    arrays["output_offset"].add(slice(None), (model.basis, c[0]))
    memoryless = not np.any(model.a)
    if memoryless:
        arrays["observer_gain"] = Varying(n, 1)
    exact = n == 0 or still(model, "abc") or (
        memoryless and not model.lagged and (model.n_affine <= 1 or still(model, "c")))
    return RealizationLayout(arrays, exact=exact, settling=n)


def _companion(arrays: dict[str, Varying], model: LPVTransferFunction, a: np.ndarray, numerator: np.ndarray,
               first: int, order: int) -> None:
    """Write the companion block of one input with `numerator` (order + 1 or more, 1, 1, M) from lag 0 on."""
    base = model.basis
    last = slice(first + order - 1, first + order)
    for i in range(1, order + 1):
        column = slice(first + order - i, first + order - i + 1)
        back = (base, a[i - 1])
        arrays["A"].add((last, column), back, -1.0)
        arrays["C"].add((slice(None), column), (base, numerator[i]))
        arrays["C"].add((slice(None), column), product(back, (base, numerator[0])), -1.0)
        if i < order:
            row = slice(first + i - 1, first + i)
            arrays["A"].add((row, slice(first + i, first + i + 1)), constant(base, np.ones((1, 1))))
