"""H2 norms over scheduling sets that are no boxes, by one storage function at the vertices of a polytope.

For A, B, C, D affine in p and one P, −He(PA) − CᵀC (in discrete time P − AᵀPA − CᵀC) and ν² − tr BᵀPB (− tr DᵀD) are
concave in p: positive at the vertices, they are positive on the polytope.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lpvid.analysis.frozen import pole_margins
from lpvid.lmi.affine import he, trace
from lpvid.lmi.bound_certificate import BoundCertificate
from lpvid.lmi.driven import driven
from lpvid.lmi.frame import frame_of, gramian
from lpvid.lmi.program import Program
from lpvid.lmi.readings import box_of
from lpvid.lmi.storage_search import SOLVERS
from lpvid.model.hull import Hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial

MARGIN = 1e-7
"""of the inequalities, in balanced coordinates"""
RAISED = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""shares above the solver's level at which its matrix is checked"""


def variance_on(system: LPVStateSpace, hull: Hull) -> tuple[float, BoundCertificate | None]:
    """The largest H2 norm with the scheduling held in a hull, and the certificate of a bound for every motion in it.

    Parameters
    ----------
    system : LPVStateSpace
        In continuous time without feedthrough.
    hull : Hull
        Over the system's variables.

    Returns
    -------
    float
        Infinite where a system with held scheduling is unstable.
    BoundCertificate or None
        None where no constant P was found, and for a system that is not affine.
    """
    plant, points = driven(system), hull.points
    names, discrete = tuple(r.label for r in plant.readings), system.is_discrete
    a, b, c, d = system.at(points[:, [hull.names.index(n) for n in system.basis.names]])
    if pole_margins(a, discrete).max(initial=-math.inf) >= 0:
        return math.inf, None
    square = [float(np.trace(c[k] @ gramian(a[k], b[k] @ b[k].T, discrete) @ c[k].T)) + float(np.sum(d[k] ** 2))
              for k in range(len(a))]
    lower = math.sqrt(max(max(square), 0.0))
    if not names or not plant.affine or not plant.order:
        return lower, None
    vertices, box = hull.over(names).vertices(), box_of(plant.readings, hull.enclosing(system.box))
    frame, program = frame_of(plant, vertices, lower), Program()
    p, level = program.unknowns.symmetric(plant.order), program.unknowns.scalar()
    program.require(p, margin=MARGIN)
    for ak, bk, ck, dk in zip(*frame.inside(plant.matrices(vertices)), strict=True):
        state = p - ak.T @ p @ ak if discrete else -he(p @ ak)
        program.require(state - ck.T @ ck, margin=MARGIN)
        program.require(level - trace(p, bk @ bk.T) - float(np.sum(dk**2)))
    program.minimise(level)
    for found in program.solve(solvers=SOLVERS):
        bound = frame.gain * math.sqrt(max(float(found[level][0, 0]), 0.0) / frame.time)
        matrix = frame.gain * frame.outside(found[p][None])
        for share in RAISED:
            made = BoundCertificate("h2-norm", bound * (1 + share), None, "quadratic", matrix, Polynomial((), 0), box,
                                    plant.sample_time, plant.digest, plant.inputs, plant.outputs, -math.inf, True,
                                    found.solver, vertices)
            outcome = made.recheck(system, plant)
            if bound > 0 and outcome.holds:
                return lower, replace(made, margin=outcome.margin)
    return lower, None
