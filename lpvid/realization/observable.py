"""Observer canonical form: with coefficients at p(k) alone, or shifted so that it is exact."""

from __future__ import annotations

import numpy as np

from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization.layout import RealizationLayout, padded, still
from lpvid.realization.varying import Term, Varying, at, constant, product


def observable(model: LPVTransferFunction) -> RealizationLayout:
    """Observer form with every matrix at p(k).

    ::

        x_i(k+1) = −a_i(p_k) x_1(k) + x_{i+1}(k) + b̃_i(p_k) u(k) + c̃_i(p_k),   i = 1 … n,  x_{n+1} = 0
        y(k)     = x_1(k) + b_0(p_k) u(k) + c_0(p_k)
        b̃_i = b_i − a_i b_0,   c̃_i = c_i − a_i c_0

    Its input-output equation takes a_i, b_i at p(k−i) (Tóth, Abbas & Werner 2012): exact for a model with
    ``lagged=True``, b_0 and affine terms included, and for a and b that do not move. For a_i, b_i at p(k) it agrees
    for frozen scheduling only.

    Parameters
    ----------
    model : LPVTransferFunction

    Returns
    -------
    RealizationLayout
    """
    return _observer(model, ahead=False)


def shifted_observable(model: LPVTransferFunction) -> RealizationLayout:
    """Observer form whose coefficients are taken when they act on the output: exact for every model.

    ::

        x_i(k+1) = −a_i(p_{k+i}) x_1(k) + x_{i+1}(k) + b̃_i u(k) + c̃_i,   y(k) = x_1(k) + b_0(p_k) u(k) + c_0(p_k)
        b̃_i = b_i(p_{k+i}) − a_i(p_{k+i}) b_0(p_k),   c̃_i = c_i(p_k) − a_i(p_{k+i}) c_0(p_k)

    b_0 stands at the time of its input. For coefficients at p(k) this needs future scheduling; for a model with
    ``lagged=True`` it is the observer form itself.

    Parameters
    ----------
    model : LPVTransferFunction

    Returns
    -------
    RealizationLayout
    """
    return _observer(model, ahead=True)


def _observer(model: LPVTransferFunction, *, ahead: bool) -> RealizationLayout:
    ny, nu = model.n_outputs, model.n_filter_inputs
    n = max(model.order, model.n_affine - 1)
    a, b, c = padded(model, n)
    base = model.basis
    arrays = {"A": Varying(n * ny, n * ny), "B": Varying(n * ny, nu), "C": Varying(ny, n * ny), "D": Varying(ny, nu),
              "state_offset": Varying(n * ny), "output_offset": Varying(ny), "observer_gain": Varying(n * ny, ny)}
    direct, level = (base, b[0]), (base, c[0])
    for i in range(1, n + 1):
        lag = -i if ahead and not model.lagged else 0
        here, first = slice((i - 1) * ny, i * ny), slice(0, ny)
        back: Term = at(base, a[i - 1], lag)
        arrays["A"].add((here, first), back, -1.0)
        arrays["observer_gain"].add(here, back, -1.0)
        arrays["B"].add(here, at(base, b[i], lag))
        arrays["B"].add(here, product(back, direct), -1.0)
        arrays["state_offset"].add(here, (base, c[i]))
        arrays["state_offset"].add(here, product(back, level), -1.0)
        if i < n:
            arrays["A"].add((here, slice(i * ny, (i + 1) * ny)), constant(base, np.eye(ny)))
    if n:
        arrays["C"].add((slice(None), slice(0, ny)), constant(base, np.eye(ny)))
    arrays["D"].add(slice(None), direct)
    arrays["output_offset"].add(slice(None), level)
    return RealizationLayout(arrays, exact=ahead or model.lagged or n == 0 or still(model, "ab"), settling=n)
