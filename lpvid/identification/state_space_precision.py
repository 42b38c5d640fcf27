"""How sure the parameters of a state-space search are: covariance through the projected Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid._threads import single_thread
from lpvid.identification.covariance import block_length, residual_memory
from lpvid.identification.state_space_layout import StateSpaceLayout, stacks
from lpvid.identification.state_space_search import LocalProblem, SearchData, StateSpaceSearchEnd, gauge, linearise
from lpvid.model.state_space import LPVStateSpace
from lpvid.validation import residual_tests


@dataclass(frozen=True, eq=False)
class Precision:
    """How sure the parameters of a search are: covariance, noise, condition number, number of free directions."""

    covariance: np.ndarray
    noise: np.ndarray
    condition: float
    free: int
    kind: str = "projected Jacobian, white errors"


def precision(search: StateSpaceSearchEnd, layout: StateSpaceLayout, *, free_coordinates: bool = True) -> Precision:
    """Covariance through the projected Jacobian, zero along a change of coordinates.

    For white errors σ² (JᵀJ)⁺. Where the whiteness test fails and the data are long enough, the sandwich
    (JᵀJ)⁺ S (JᵀJ)⁺ with S from sums of the scores over blocks (`sandwich`), the initial states held.
    """
    model, data = search.model, search.data
    with single_thread():
        factor = linearise(model, layout, data, search.evaluation.starts)
        directions = (gauge(model, layout, data.ones) if free_coordinates else np.zeros((layout.size, 0)))
        local = LocalProblem.of(factor, directions)
        lost = local.singular.size + model.order * len(data.pieces)
        freedom = max(data.rows - lost, 1)
        covariance, free = local.covariance(search.evaluation.cost / freedom)
        kind = Precision.kind
        series = [e[:, o] for e in search.evaluation.errors for o in range(e.shape[1])]
        length = block_length(residual_memory(series), data.rows // model.n_outputs, free)
        white = all(t.passed for t in residual_tests(series, [None] * len(series)))
        if length is not None and not white:
            inverse, _ = local.covariance(1.0)
            middle = _scores(model, layout, data, search.evaluation.starts, length) * (data.rows / freedom)
            covariance, kind = inverse @ middle @ inverse, "projected Jacobian, sandwich over coloured errors"
    errors = np.vstack(search.evaluation.errors)
    noise = errors.T @ errors / max(len(errors) - lost / errors.shape[1], 1.0)
    return Precision(covariance, noise, local.condition, free, kind)


def _scores(model: LPVStateSpace, layout: StateSpaceLayout, data: SearchData, starts: Sequence[np.ndarray],
            length: int) -> np.ndarray:
    """(k, k) long-run sum of products of the scores Jᵀe, from sums over blocks of `length` samples."""
    from lpvid._state_space_kernels import sensitivity_rows

    arrays, table = stacks(model), np.array(layout.table)
    nx, ny, k = model.order, model.n_outputs, layout.size
    total, used, every = np.zeros((k, k)), 0, 0
    block = np.zeros((nx + k + 1, length * ny))
    for (phi, u, y), (d_phi, d_u), x0 in zip(data.at(model).pieces, data.tangents(model), starts, strict=True):
        x, moved = x0.copy(), np.hstack([np.eye(nx), np.zeros((nx, k))])
        every += len(y)
        for first in range(0, len(y) - length + 1, length):
            sensitivity_rows(arrays, phi, u, y, table, data.weight, x, moved, first, first + length, block, 0,
                             d_phi, d_u)
            score = block[nx: nx + k] @ block[nx + k]
            total += np.outer(score, score)
            used += length
    return total * (every / max(used, 1))
