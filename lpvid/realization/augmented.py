"""Augmented form: the state is the past itself, exact and causal for every model."""

from __future__ import annotations

import numpy as np

from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization.layout import RealizationLayout
from lpvid.realization.varying import Varying, at, constant


def augmented(model: LPVTransferFunction) -> RealizationLayout:
    """Past outputs and inputs as the state, x = [y(k−1) … y(k−na), u(k−1) … u(k−nb)].

    ::

        y(k)   = −Σ a_i y(k−i) + Σ b_j u(k−j) + Σ c_j(p_{k−j}) + e(k)      static in p(k), or in p(k), p(k−1) … where
        x(k+1) = [y(k); y(k−1) …; u(k); u(k−1) …]                          the model takes coefficients there

    Exact and causal, not minimal: na·ny + nb·nu states.

    Parameters
    ----------
    model : LPVTransferFunction

    Returns
    -------
    RealizationLayout
    """
    ny, nu, na, past = model.n_outputs, model.n_filter_inputs, model.na, max(model.n_lags - 1, 0)
    base, split, n = model.basis, na * ny, na * ny + past * nu
    arrays = {"A": Varying(n, n), "B": Varying(n, nu), "C": Varying(ny, n), "D": Varying(ny, nu),
              "state_offset": Varying(n), "output_offset": Varying(ny), "observer_gain": Varying(n, ny)}
    assert model.c is not None
    # the output equation, written into y and into the slot that holds y
    targets = [("C", "D", "output_offset", slice(0, ny))]
    if na:
        targets.append(("A", "B", "state_offset", slice(0, ny)))
    for on_state, on_input, alone, rows in targets:
        for i in range(na):
            term = at(base, model.a[i], i + 1 if model.lagged else 0)
            arrays[on_state].add((rows, slice(i * ny, (i + 1) * ny)), term, -1.0)
        for j in range(past):
            term = at(base, model.b[j + 1], j + 1 if model.lagged else 0)
            arrays[on_state].add((rows, slice(split + j * nu, split + (j + 1) * nu)), term)
        if model.n_lags:
            arrays[on_input].add(rows, (base, model.b[0]))
        for j in range(model.n_affine):
            arrays[alone].add(rows, at(base, model.c[j], j))
    # the memory
    arrays["A"].add((slice(ny, split), slice(0, max(split - ny, 0))), constant(base, np.eye(max(split - ny, 0))))
    if past:
        older = (past - 1) * nu
        arrays["A"].add((slice(split + nu, n), slice(split, split + older)), constant(base, np.eye(older)))
        arrays["B"].add(slice(split, split + nu), constant(base, np.eye(nu)))
    if na:
        arrays["observer_gain"].add(slice(0, ny), constant(base, np.eye(ny)))
    return RealizationLayout(arrays, exact=True, settling=na)
