"""Covariance of all parameters of a sampled damper that was fitted to its free run, shape and lag included."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.identification.covariance import bartlett, inverse_gram, residual_memory
from lpvid.record import Record
from lpvid.simulation import simulate

if TYPE_CHECKING:
    from quartercar.dampers.blackbox.held import Held

STEP = 1e-6
"""share of a parameter by which it is moved for its difference quotient."""


def free_run_covariance(held: Held, records: Sequence[Record]) -> np.ndarray | None:
    """H⁻¹ S H⁻¹ with H = JᵀJ and S the sum of lagged products of the scores J(t) e(t); None where a run diverges.

    J holds central differences of the free run, whose start is fitted to the data at every trial. S has Bartlett
    weights over the residual's memory (Newey & West 1987), for the error of a free run is not white.

    Parameters
    ----------
    held : Held
        At the estimate.
    records : sequence of Record
        Training data, in the damper's own sense.
    """
    theta = held.vector
    steps = STEP * np.maximum(np.abs(theta), 1e-3 * np.abs(theta[theta != 0]).min(initial=1.0))

    def runs(vector: np.ndarray) -> list[np.ndarray]:
        model = held.at(vector)
        return [np.asarray(simulate(model, r, "estimate").output[:, 0]) for r in records]

    columns = []
    for j, step in enumerate(steps):
        up, down = theta.copy(), theta.copy()
        up[j] += step
        down[j] -= step
        columns.append([(a - b) / (2 * step) for a, b in zip(runs(up), runs(down), strict=True)])
    jacobians = [np.column_stack([column[k] for column in columns]) for k in range(len(records))]
    errors = [r["force"] - run for r, run in zip(records, runs(theta), strict=True)]
    if not all(np.isfinite(a).all() for a in (*jacobians, *errors)):
        return None
    scores = [j * e[:, None] for j, e in zip(jacobians, errors, strict=True)]
    inverse = inverse_gram(np.vstack(jacobians))
    return inverse @ bartlett(scores, residual_memory(errors)) @ inverse
