"""The controller behind R, S and the scalings of scaled small gain, as an H-infinity problem without scheduling.

With the scalings known, the plant together with the controller's own copy of Δ is a time-invariant plant from
(p, p_K, w) to (q, q_K, z), its controls (u, q_K) and its measurements (y, p_K); in the scalings' coordinates its gain
must be below one. All that `OutputFeedback` does for such plants then serves (Riccati equations, conditioning, the
closed form).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lpvid.lmi.certificate import diagonal
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial
from lpvid.synthesis.balanced_plant import BalancedPlant
from lpvid.synthesis.controller_formula import Variations
from lpvid.synthesis.fractional_plant import FractionalController, FractionalPlant
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.output_feedback_search import FeedbackProblem, moderate


def by_feedback(plant: FractionalPlant, gamma: float, scaling: np.ndarray) -> FractionalController | None:
    """A controller that brings the scaled gain below one, the most moderate that was found; None for none.

    plant : FractionalPlant
        In the coordinates of the scaling.

    Parameters
    ----------
    gamma : float
        Of the performance.
    scaling : (2r, 2r) array
        Λ ≻ 0 of (q, q_K), which commutes with diag(Δ, Δ).

    Returns
    -------
    FractionalController or None
        With the storage function of its closed loop.
    """
    still = _still(plant, gamma, scaling)
    nowhere = np.empty((1, 0))
    problem = FeedbackProblem(BalancedPlant.of(still, nowhere), Variations(None, "both", still.box), (), True, False,
                              nowhere[:0])
    found = moderate(problem, 1.0)
    if found is None:
        return None
    controller, formula = found
    a, b, c, d = controller.frozen([])
    v = formula.storage(nowhere)
    moved = diagonal(np.eye(plant.order) if plant.turn is None else plant.turn, np.eye(len(a)))
    return FractionalController(np.block([[a, b], [c, d]]), len(a), plant.repetitions, replace(v, mix=moved @ v.mix))


def _still(plant: FractionalPlant, gamma: float, scaling: np.ndarray) -> GeneralizedPlant:
    """The time-invariant plant, w and z in units in which the gain requested is one."""
    n, r, (nw, nu, nz, ny) = plant.order, sum(plant.repetitions), plant.outer
    tall, wide = np.cumsum([0, n, r, r, nz, ny, r]), np.cumsum([0, n, r, r, nw, nu, r])
    whole = np.zeros((tall[-1], wide[-1]))
    for i, row in ((0, "x"), (1, "q"), (3, "z"), (4, "y")):
        for k, column in ((0, "x"), (1, "p"), (3, "w"), (4, "u")):
            whole[tall[i] : tall[i + 1], wide[k] : wide[k + 1]] = plant.part(row, column)
    whole[tall[2] : tall[3], wide[5] : wide[6]] = np.eye(r)  # the controller's q_K
    whole[tall[5] : tall[6], wide[2] : wide[3]] = np.eye(r)  # its p_K
    turn = np.linalg.cholesky(scaling).T if r else np.zeros((0, 0))
    back = np.linalg.inv(turn) if r else turn
    whole = (diagonal(np.eye(n), turn, np.eye(nz) / np.sqrt(gamma), np.eye(ny + r)) @ whole
             @ diagonal(np.eye(n), back, np.eye(nw) / np.sqrt(gamma), np.eye(nu + r)))
    names = [f"{letter}{i}" for letter, count in (("w", 2 * r + nw), ("u", nu + r)) for i in range(count)]
    shown = [f"{letter}{i}" for letter, count in (("z", 2 * r + nz), ("y", ny + r)) for i in range(count)]
    system = LPVStateSpace.of(whole[None], n, Polynomial((), 0), 1.0 if plant.discrete else None,
                              inputs=tuple(map(Signal, names)), outputs=tuple(map(Signal, shown)))
    return GeneralizedPlant(system, tuple(names[2 * r + nw :]), tuple(shown[2 * r + nz :]))
