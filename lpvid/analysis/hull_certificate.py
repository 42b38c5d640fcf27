"""Gains over scheduling sets that are no boxes: the convex hull of what was measured, a disc.

For a system whose matrices are affine in p and one P, the bounded-real inequality is affine in p in continuous time; in
discrete time P − AᵀPA and its companions are concave in p. It holds on a polytope where it holds at the vertices.
"""

from __future__ import annotations

import math
import time

import numpy as np

from lpvid.analysis.frozen import pole_margins
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.analysis.induced_gain import Gain
from lpvid.lmi.affine import block, he
from lpvid.lmi.driven import Driven
from lpvid.lmi.frame import frame_of
from lpvid.lmi.hull_certificate import HullCertificate, affine_driven, recheck_at, scheduling_points
from lpvid.lmi.program import Program
from lpvid.lmi.storage_search import SOLVERS
from lpvid.model.hull import Hull
from lpvid.model.state_space import LPVStateSpace

__all__ = ["HullCertificate", "hull_gain"]

MARGIN = 1e-7
"""of the inequalities, in balanced coordinates"""
RAISED = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""shares above the solver's bound at which its matrix is checked"""


def hull_gain(system: LPVStateSpace, hull: Hull) -> Gain:
    """Bounds of the induced L2 (ℓ2) gain while the scheduling moves in a polytope, however fast.

    Parameters
    ----------
    system : LPVStateSpace
        Affine in the scheduling.
    hull : Hull
        ``lpv.Hull.of(names, samples)`` of measured scheduling, or ``lpv.Hull.disc(names)``.

    Returns
    -------
    Gain
        Its `lower` is a frozen norm at a vertex.

    Raises
    ------
    InputError
        A system that is not affine, a hull of other variables.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> corner = Hull.of(("p", "q"), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    >>> model = LPVStateSpace([[[-2.5]], [[1.0]], [[1.0]]], [[[1.0]], [[0.0]], [[0.0]]], [[[1.0]], [[0.0]], [[0.0]]],
    ...                       np.zeros((3, 1, 1)), Polynomial(("p", "q"), 1), None)
    >>> found = hull_gain(model, corner)                    # ẋ = −(2.5 − p − q) x + w with p + q ≤ 1: 1/1.5
    >>> round(found.upper, 3), found.verdict
    (0.667, 'certified')
    """
    started = time.perf_counter()
    plant, vertices = affine_driven(system, hull.names), hull.vertices()
    points = scheduling_points(plant, hull.names, vertices)
    a, b, c, d = plant.matrices(points)
    discrete = plant.sample_time is not None
    signals = plant.inputs, plant.outputs
    level = pole_margins(a, discrete)
    if level.max() >= 0:
        where = ", ".join(f"{n} = {v:.6g}" for n, v in zip(hull.names, vertices[int(level.argmax())], strict=True))
        return Gain("unstable", math.inf, math.inf, None, None, *signals,
                    f"the model has a pole that does not decay at {where}",
                    "a smaller hull, or stabilise the model first", time.perf_counter() - started)
    lower = max(h_infinity_norm((a[k], b[k], c[k], d[k]), discrete)[0] for k in range(len(a)))
    for p, gamma, solver in _proposals(plant, points, lower):
        for share in RAISED:
            found = recheck_at(plant, hull.names, vertices, p, gamma * (1 + share))
            if found.holds:
                proof = HullCertificate(gamma * (1 + share), p, hull.names, vertices, plant.sample_time, plant.digest,
                                        *signals, found.margin, solver)
                return Gain("certified", proof.gamma, min(lower, proof.gamma), None, proof,
                            *signals, seconds=time.perf_counter() - started)
    return Gain("not certified", math.inf, lower, None, None, *signals,
                "no constant storage function was found that bounds the gain", "a smaller hull, or l2_gain with rate "
                "bounds on its box", time.perf_counter() - started)


def _proposals(system: Driven, points: np.ndarray, floor: float):
    frame = frame_of(system, points, floor)
    program, n = Program(), system.order
    p, level = program.unknowns.symmetric(n), program.unknowns.scalar()
    program.require(p, margin=MARGIN)
    for a, b, c, d in zip(*frame.inside(system.matrices(points)), strict=True):
        m, z = b.shape[1], len(c)
        size = level.times(np.eye(m)), level.times(np.eye(z))
        if system.sample_time is None:
            whole = block([[-he(p @ a), -(p @ b), c.T], [-(p @ b).T, size[0], d.T], [c, d, size[1]]])
        else:
            whole = block([[p - a.T @ p @ a, -(a.T @ p @ b), c.T], [-(b.T @ p @ a), size[0] - b.T @ p @ b, d.T],
                           [c, d, size[1]]])
        program.require(whole, margin=MARGIN)
    program.minimise(level)
    for found in program.solve(solvers=SOLVERS):
        gamma = float(found[level][0, 0]) * frame.gain
        if gamma > 0:
            yield frame.outside(found[p][None])[0], gamma, found.solver
