"""Forward sensitivities of the free run of a transfer function in all of its coefficients, by one recursion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.model.transfer_function import LPVTransferFunction


def free_run_sensitivities(model: LPVTransferFunction, s: Signals, output: np.ndarray,
                           places: Sequence[tuple[str, np.ndarray]]) -> np.ndarray | None:
    """Derivatives of a free run in coefficients of a, b and c; None where the basis is not that of one sample.

    With y(k) = −Σ_i a_i(k) y(k−i) + Σ_j b_j(k) u(k−j) + Σ_j c_j(k), a_i(k) = Σ_m a_im φ_m(k), one recursion holds::

        ∂y/∂θ(k) = f_θ(k) − Σ_i a_i(k) ∂y/∂θ(k−i),   f = −φ_m y(k−i), φ_m u(k−j) or φ_m

    (equation sheet 5.8), at rest where the run starts from the measurement.

    Parameters
    ----------
    model : LPVTransferFunction
        One output.
    s : Signals
        With its inputs and scheduling, by name.
    output : (n,) array
        Its free run along them.
    places : sequence of (str, (m,) array of int)
        ``"a"``, ``"b"`` or ``"c"``, and the entries of it.

    Returns
    -------
    (n, P) array or None
    """
    if model.basis.lags != (0, 0) or model.n_outputs != 1:
        return None
    from lpvid import _sensitivity

    start, n = model.start, s.n_samples
    u, phi = _inputs_and_basis(model, s)
    history, lag = max(_sensitivity.PAST, model.na), int(model.lagged)

    def of(values: np.ndarray, back: int) -> np.ndarray:
        return values[..., start - back: n - back]

    entries = [(name, int(k)) for name, free in places for k in free]
    z = np.zeros((len(entries), history + n - start))
    for row, (name, k) in zip(z[:, history:], entries, strict=True):
        i, *between, m = (int(n) for n in np.unravel_index(k, getattr(model, name).shape))
        if name == "a":
            row[:] = -of(phi[m], lag * (i + 1)) * of(output, i + 1)
        elif name == "b":
            row[:] = of(phi[m], lag * i) * of(u[between[-1]], i)
        else:
            row[:] = of(phi[m], i)
    weights = np.stack([model.a[i, 0, 0] @ of(phi, lag * (i + 1)) for i in range(model.na)]) if model.na else \
        np.zeros((1, n - start))
    _sensitivity.recur(np.ascontiguousarray(weights), z, history, n - start)
    out = np.zeros((n, len(entries)))
    out[start:] = z[:, history:].T
    return out


def _inputs_and_basis(model: LPVTransferFunction, s: Signals) -> tuple[np.ndarray, np.ndarray]:
    """(inputs, n) inputs after the input stage, (functions, n) basis functions after the scheduling stage."""
    p = np.column_stack([s[name] for name in model.box.names]) if model.box.names else np.zeros((s.n_samples, 0))
    if model.scheduling_stage is not None:
        p = model.scheduling_stage.apply(p, model.sample_time or s.sample_time)
    u = np.column_stack([s[signal.name] for signal in model.inputs])
    if model.input_stage is not None:
        u = model.input_stage.apply(u, p)
    return np.ascontiguousarray(u.T), np.ascontiguousarray(model.basis.evaluate(p).T)
