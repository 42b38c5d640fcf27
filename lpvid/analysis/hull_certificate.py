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
from lpvid.errors import InputError
from lpvid.lmi.affine import block, combined, he
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


def hull_gain(system: LPVStateSpace, hull: Hull, *, moving: bool = False) -> Gain:
    """Bounds of the induced L2 (ℓ2) gain while the scheduling moves in a polytope, however fast.

    Parameters
    ----------
    system : LPVStateSpace
        Affine in the scheduling.
    hull : Hull
        ``lpv.Hull.of(names, samples)`` of measured scheduling, or ``lpv.Hull.disc(names)``.
    moving : bool
        In discrete time: let P follow the scheduling, P(p) affine. It bounds no less tightly, with an inequality for
        each pair of vertices.

    Returns
    -------
    Gain
        Its `lower` is a frozen norm at a vertex.

    Raises
    ------
    InputError
        A system that is not affine, a hull of other variables, `moving` in continuous time.

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
    if moving and not discrete:
        raise InputError("a matrix that moves on a hull needs discrete time", got="a continuous system",
                         why="its inequality is then of degree two in the scheduling, which vertices do not decide")
    signals = plant.inputs, plant.outputs
    level = pole_margins(a, discrete)
    if level.max() >= 0:
        where = ", ".join(f"{r.label} = {v:.6g}" for r, v in zip(plant.readings, points[int(level.argmax())],
                                                                 strict=True))
        return Gain("unstable", math.inf, math.inf, None, None, *signals,
                    f"the model has a pole that does not decay at {where}",
                    "a smaller hull, or stabilise the model first", time.perf_counter() - started)
    lower = max(h_infinity_norm((a[k], b[k], c[k], d[k]), discrete)[0] for k in range(len(a)))
    for p, slopes, gamma, solver in (_moving(plant, hull.names, vertices, lower) if moving
                                     else _proposals(plant, points, lower)):
        for share in RAISED:
            found = recheck_at(plant, hull.names, vertices, p, gamma * (1 + share), slopes)
            if found.holds:
                proof = HullCertificate(gamma * (1 + share), p, hull.names, vertices, plant.sample_time, plant.digest,
                                        *signals, found.margin, solver, slopes)
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
            yield frame.outside(found[p][None])[0], None, gamma, found.solver


def _moving(system: Driven, names: tuple[str, ...], vertices: np.ndarray, floor: float):
    """P(p) affine over the variables in units of the polytope: P_k − AᵀP_lA and its companions for all k, l."""
    points = vertices[:, [names.index(r.label) for r in system.readings]]
    frame, program, n = frame_of(system, points, floor), Program(), system.order
    centre, width = vertices.mean(axis=0), np.ptp(vertices, axis=0)
    weights = np.column_stack([np.ones(len(vertices)), (vertices - centre) / width])
    p = [program.unknowns.symmetric(n) for _ in range(weights.shape[1])]
    level, at = program.unknowns.scalar(), [combined(p, w) for w in weights]
    for here, (a, b, c, d) in zip(at, zip(*frame.inside(system.matrices(points)), strict=True), strict=True):
        program.require(here, margin=MARGIN)
        size = level.times(np.eye(b.shape[1])), level.times(np.eye(len(c)))
        for ahead in at:
            program.require(block([[here - a.T @ ahead @ a, -(a.T @ ahead @ b), c.T],
                                   [-(b.T @ ahead @ a), size[0] - b.T @ ahead @ b, d.T], [c, d, size[1]]]),
                            margin=MARGIN)
    program.minimise(level)
    for found in program.solve(solvers=SOLVERS):
        gamma = float(found[level][0, 0]) * frame.gain
        if gamma > 0:
            first, *slopes = frame.outside(np.array([found[x] for x in p]))
            slopes = np.array(slopes) / width[:, None, None]
            yield first - np.tensordot(centre, slopes, axes=1), slopes, gamma, found.solver
