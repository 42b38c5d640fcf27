"""Discrete plants as continuous ones with the same gains and the same Lyapunov matrices.

With z = (1 + s)/(1 − s), A_c = (A + I)⁻¹(A − I) and states ξ = (A + I)x/√2, AᵀPA − P becomes He(P A_c): a constant P
proves the same bound for both, at every scheduling value. Where A has an eigenvalue −1, z = (s + 1)/(s − 1) does.
"""

from __future__ import annotations

import numpy as np

from lpvid.analysis.frozen_norms import to_continuous
from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.scaling import Matrices


def sign_for(a: np.ndarray) -> float:
    """1 for A + I, −1 for A − I: whichever is further from singular over the points (N, n, n).

    Parameters
    ----------
    a : (N, n, n) array
        Discrete dynamics at the points.

    Returns
    -------
    float
        1 also without states, and while A + I is at most a thousand times closer to singular than A − I.
    """
    if not a.shape[1]:
        return 1.0
    worst = [np.linalg.svd(a + s * np.eye(a.shape[1]), compute_uv=False)[:, -1].min() for s in (1.0, -1.0)]
    return 1.0 if worst[0] >= 1e-3 * worst[1] else -1.0


def to_discrete(system: Matrices, sign: float) -> Matrices:
    """Inverse of `to_continuous`.

    Parameters
    ----------
    system : (A, B, C, D), each (N, …)
        Continuous.
    sign : float
        1 or −1, that of the way there.

    Returns
    -------
    (A, B, C, D), each (N, …)
        Discrete.

    Examples
    --------
    >>> lag = tuple(np.array([[[x]]]) for x in (0.5, 1.0, 1.0, 0.0))
    >>> [float(m[0, 0, 0].round(4)) for m in to_discrete(to_continuous(lag, 1.0), 1.0)]
    [0.5, 1.0, 1.0, 0.0]
    """
    a, b, c, d = system
    inverse = np.linalg.inv(np.eye(a.shape[1]) - a)
    return (sign * inverse @ (np.eye(a.shape[1]) + a), np.sqrt(2) * inverse @ b, sign * np.sqrt(2) * c @ inverse,
            d + c @ inverse @ b)


def plant_to_continuous(plant: PlantMatrices, sign: float) -> PlantMatrices:
    """All blocks of a plant.

    Parameters
    ----------
    plant : PlantMatrices
        Discrete, (N, …) each.
    sign : float
        1 or −1, as `sign_for` chooses it.

    Returns
    -------
    PlantMatrices
        Of the continuous plant.
    """
    p, w, z = plant, plant.B1.shape[2], plant.C1.shape[1]
    d = np.block([[p.D11, p.D12], [p.D21, p.D22]])
    a, b, c, d = to_continuous((p.A, np.concatenate([p.B1, p.B2], axis=2), np.concatenate([p.C1, p.C2], axis=1), d),
                               sign)
    return PlantMatrices(a, b[..., :w], b[..., w:], c[:, :z], d[:, :z, :w], d[:, :z, w:], c[:, z:], d[:, z:, :w],
                         d[:, z:, w:])


def around_feedthrough(controller: Matrices, d22: np.ndarray) -> Matrices:
    """The controller that reads y where the design's read y − D22 u: K (I + D22 K)⁻¹.

    Parameters
    ----------
    controller : (A, B, C, D), each (N, …)
        Designed for y − D22 u.
    d22 : (N, n_y, n_u) array
        Direct path from controls to measurements; I + D22 D_K must be regular.

    Returns
    -------
    (A, B, C, D), each (N, …)
        The controller for y.
    """
    a, b, c, d = controller
    inverse = np.linalg.inv(np.eye(d22.shape[-2]) + d22 @ d)
    seen = inverse @ d22 @ c
    return a - b @ seen, b @ inverse, c - d @ seen, d @ inverse
