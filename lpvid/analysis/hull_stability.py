"""Stability and pole regions on a polytope of scheduling values: one Lyapunov matrix that serves at the vertices.

For A(p) affine in p and one P the decrease He(PA) + 2αP ≺ 0 is affine in p, and AᵀPA ≺ exp(−2αT) P, convex in A, too
holds on a polytope where it holds at the vertices (Boyd, El Ghaoui, Feron & Balakrishnan 1994, section 5.1).
A P(p) that moves no faster than rate bounds is decided between the vertices (`lpvid.lmi.polytope_positivity`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lpvid.analysis.stability_certificate import StabilityCertificate
from lpvid.lmi.bound_certificate import BoundCertificate
from lpvid.lmi.bounds import DecayBound
from lpvid.lmi.certificate_common import certificate_kind
from lpvid.lmi.driven import Driven, Model, autonomous, driven
from lpvid.lmi.frame import Frame
from lpvid.lmi.polytope_positivity import dense, total_degree
from lpvid.lmi.readings import box_of
from lpvid.lmi.search import LyapunovSearch, frozen_rates
from lpvid.lmi.storage import Storage
from lpvid.model.hull import Hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling

if TYPE_CHECKING:
    from lpvid.lmi.affine import Affine

MARGIN = 1e-7
"""of P, in coordinates in which the frozen systems are nearly contractions"""
HIGHEST = 3
"""degree of a P that moves"""
STEPS = 5
"""halvings of the interval between the decay of the first P and that of the slowest frozen mode"""


def region_on(system: LPVStateSpace, hull: Hull, region: tuple[np.ndarray, np.ndarray]) -> BoundCertificate | None:
    """The certificate of one P for the poles of every system whose scheduling is held in a polytope, or None.

    −(L ⊗ P + M ⊗ PA + Mᵀ ⊗ AᵀP) ≻ 0 (Chilali & Gahinet 1996, theorem 2.2) is affine in A.

    Parameters
    ----------
    system : LPVStateSpace
        Affine in its scheduling; None for another.
    hull : Hull
        Over the system's variables.
    region : (L, M)
        {s : L + sM + s̄Mᵀ ≺ 0}.

    Returns
    -------
    BoundCertificate or None
    """
    plant = driven(system)
    names = tuple(r.label for r in plant.readings)
    if not names or not plant.affine:
        return None
    vertices, box = hull.over(names).vertices(), box_of(plant.readings, hull.enclosing(system.box))
    if frozen_rates(plant, vertices).max() >= 0:
        return None
    empty = BoundCertificate("pole-region", 0.0, region, "quadratic", np.zeros((0, 0, 0)), Polynomial((), 0), box,
                             plant.sample_time, plant.digest, plant.inputs, plant.outputs, math.nan, True, "", vertices)
    fixed, varying = region

    def stated(p: Affine, a: np.ndarray, time: float) -> Affine:
        from lpvid.lmi.affine import block

        product = p @ a
        return block([[-(float(time * fixed[i, j]) * p + float(varying[i, j]) * product
                         + float(varying[j, i]) * product.T) for j in range(len(fixed))] for i in range(len(fixed))])

    for matrix, solver in _proposals(plant, box, vertices, stated):
        made = replace(empty, matrices=matrix[None], solver=solver)
        found = made.recheck(system, plant)
        if found.holds:
            return replace(made, margin=found.margin)
    return None


def decay_on(system: LPVStateSpace, hull: Hull) -> BoundCertificate | None:
    """The certificate of the fastest decay that one P was found to prove on a polytope, or None.

    Parameters
    ----------
    system : LPVStateSpace
        Affine in its scheduling; None for another.
    hull : Hull
        Over the system's variables.

    Returns
    -------
    BoundCertificate or None
    """
    found, plant = certificate_on(system, hull, system.box), driven(system)
    if found is None:
        return None
    made = BoundCertificate("decay-rate", found.decay_rate, None, "quadratic", found.matrices, found.basis, found.box,
                            plant.sample_time, plant.digest, plant.inputs, plant.outputs, math.nan, True, found.solver,
                            found.vertices)
    outcome = made.recheck(system, plant)
    return replace(made, margin=outcome.margin) if outcome.holds else None


def certificate_on(model: Model, hull: Hull, scheduling: Scheduling) -> StabilityCertificate | None:
    """The certificate of one P for every motion in a polytope, or None.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Affine in its scheduling, none of it delayed; None for another.
    hull : Hull
        Over the model's variables.
    scheduling : Scheduling
        The model's variables, with the rates to state.

    Returns
    -------
    StabilityCertificate or None
        None also where a frozen model at a vertex is unstable.

    Examples
    --------
    >>> from lpvid.model.state_space import LPVStateSpace
    >>> corner = Hull.of(("p", "q"), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    >>> basis, box = Polynomial(("p", "q"), 1), Scheduling(("p", "q"), (0.0, 0.0), (1.0, 1.0))
    >>> zero = np.zeros((3, 1, 1))
    >>> model = LPVStateSpace([[[-1.5]], [[1.0]], [[1.0]]], zero, zero, zero, basis, None, box)
    >>> found = certificate_on(model, corner, box)              # ẋ = −(1.5 − p − q) x with p + q ≤ 1
    >>> found.claim.partition("trajectory of ")[2]
    'p in [0, 1], q in [0, 1] in a polytope of 3 vertices, however fast it moves'
    >>> round(found.decay_rate, 2)
    0.5
    """
    system = autonomous(model)
    names = tuple(r.label for r in system.readings)
    if not names or not system.affine:
        return None
    vertices, box = hull.over(names).vertices(), box_of(system.readings, hull.enclosing(scheduling))
    slowest = float(frozen_rates(system, vertices).max())
    if slowest >= 0:
        return None
    empty = StabilityCertificate("quadratic", np.zeros((0, 0, 0)), Polynomial((), 0), box, system.sample_time,
                                 system.digest, True, math.nan, True, 0.0, None, "", vertices)
    best = next(_holding(empty, system, vertices, 0.0, slowest), None)
    low, high = 0.0 if best is None else best.decay_rate, -slowest
    for _ in range(STEPS if best is not None and system.order else 0):
        middle = 0.5 * (low + high)
        found = next(_holding(empty, system, vertices, middle, slowest), None)
        if found is None:
            high = middle
        else:
            best, low = found, max(middle, found.decay_rate)
    return best


def moving_certificate_on(model: Model, hull: Hull, scheduling: Scheduling) -> StabilityCertificate | None:
    """The certificate of a P(p) that moves, for motion in a polytope no faster than the rates; None for none.

    P is a polynomial of degree up to 3 in the variables of bounded rate, in discrete time of degree 1.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Polynomial in its scheduling, none of it delayed; None for another.
    hull : Hull
        Over the model's variables.
    scheduling : Scheduling
        The model's variables, with the rates to cover.

    Returns
    -------
    StabilityCertificate or None
        None also where a frozen model in the polytope is unstable, and without rate bounds.
    """
    from lpvid.lmi.storage_search import StorageSearch  # here, so that checking a certificate needs numpy alone

    system = autonomous(model)
    names, degree = tuple(r.label for r in system.readings), total_degree(system)
    limits = dict(zip(scheduling.names, scheduling.rate, strict=True))
    bounded = tuple(n for n in names if limits.get(n) is not None)
    if not bounded or degree is None or not system.order:
        return None
    vertices, box = hull.over(names).vertices(), box_of(system.readings, hull.enclosing(scheduling))
    slowest = float(frozen_rates(system, dense(vertices)).max())
    if slowest >= 0:
        return None
    solutions = LyapunovSearch(system, box).frozen_solutions(vertices)
    try:
        states = np.linalg.inv(np.linalg.cholesky((solutions / np.trace(solutions, axis1=1, axis2=2)[:, None, None]
                                                   ).mean(axis=0))).T
    except np.linalg.LinAlgError:
        return None
    discrete = system.sample_time is not None
    poles = np.abs(np.linalg.eigvals(system.state_matrices(vertices)))
    frame = Frame(states, 1.0 if discrete else 1 / max(float(poles.max()), 1e-300), 1.0)
    for of in range(1, 2 if discrete else HIGHEST + 1):
        basis = Polynomial(bounded, of).bound(box)
        search = StorageSearch(system, box, basis, frame, lambda _: partial(DecayBound, level=0.0), vertices=vertices)
        for found in search.roomiest(capped=True) if search.affordable else ():
            storage = Storage(found.matrices, basis, box, system.sample_time)
            made = StabilityCertificate(certificate_kind(storage), found.matrices, basis, box, system.sample_time,
                                        system.digest, True, math.nan, True, 0.0, None, found.solver, vertices)
            shown = made.decrease(system)
            if shown.holds:
                return replace(made, margin=shown.margin, decay_rate=_decay(made, system, 0.0, slowest))
            if found.margin < MARGIN:
                break
    return None


def _holding(empty: StabilityCertificate, system: Driven, vertices: np.ndarray, exponent: float, slowest: float
             ) -> Iterator[StabilityCertificate]:
    """Certificates that pass the re-check at a decay α [1/s], each with the largest that its own P allows."""
    def stated(p: Affine, a: np.ndarray, time: float) -> Affine:
        from lpvid.lmi.affine import he

        if system.sample_time is not None:
            return math.exp(-2 * exponent * system.sample_time) * p - a.T @ p @ a
        return -he(p @ a) - (2 * exponent * time) * p

    for matrix, solver in _proposals(system, empty.box, vertices, stated):
        made = replace(empty, matrices=matrix[None], solver=solver)
        found = made.decrease(system, exponent)
        if found.holds:
            yield replace(made, margin=made.decrease(system).margin, decay_rate=_decay(made, system, exponent, slowest))


def _decay(made: StabilityCertificate, system: Driven, low: float, slowest: float) -> float:
    """The largest α [1/s], to 1 %, at which the re-check still holds."""
    high = -slowest if system.order else low
    while high - low > 0.01 * -slowest:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if made.decrease(system, middle).holds else (low, middle)
    return low


def _proposals(system: Driven, box: Scheduling, vertices: np.ndarray,
               stated: Callable[[Affine, np.ndarray, float], Affine]) -> Iterator[tuple[np.ndarray, str]]:
    """P over the states: the mean of the frozen Lyapunov matrices, then that of the largest margin.

    `stated` gives what must be positive of P, A and the unit of time, all in the program's coordinates.
    """
    n, discrete = system.order, system.sample_time is not None
    if not n:
        yield np.zeros((0, 0)), "closed form"
        return
    solutions = LyapunovSearch(system, box).frozen_solutions(vertices)
    mean = (solutions / np.trace(solutions, axis1=1, axis2=2)[:, None, None]).mean(axis=0)
    yield mean, "closed form"
    try:
        states = np.linalg.inv(np.linalg.cholesky(mean)).T
    except np.linalg.LinAlgError:
        return
    from lpvid.lmi.program import Program  # here, so that checking a certificate needs numpy alone
    from lpvid.lmi.storage_search import SOLVERS

    a = system.state_matrices(vertices)
    time = 1.0 if discrete else 1 / max(float(np.abs(np.linalg.eigvals(a)).max()), 1e-300)
    frame, program = Frame(states, time, 1.0), Program()
    inside = time * np.linalg.inv(states) @ a @ states
    p, t = program.unknowns.symmetric(n), program.unknowns.scalar()
    program.require(p, margin=MARGIN)
    program.require(np.eye(n) - p)
    for m in inside:
        inequality = stated(p, m, time)
        program.require(inequality - t.times(np.eye(inequality.shape[0])))
    program.minimise(-t)
    for found in program.solve(solvers=SOLVERS):
        yield frame.outside(found[p][None])[0], found.solver
