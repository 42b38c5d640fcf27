"""What a design's own storage function, in two blocks, proves of its closed loop: gains and variances, by numpy alone.

Both inequalities are affine in the loop's matrices, or convex, for one storage function: corners of the box suffice
for a loop that is affine in each variable. For others the box is looked at on a grid, and the figure states so.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_continuous_are

from lpvid.analysis.frozen_norms import largest_frozen_norm
from lpvid.lmi.certificate import diagonal
from lpvid.lmi.driven import driven
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial
from lpvid.synthesis.criteria import CovarianceCriterion
from lpvid.synthesis.design_grid import is_affine
from lpvid.synthesis.figures import Figure
from lpvid.synthesis.loop_certificate import own_certificate
from lpvid.synthesis.loop_check import SAFETY, LoopStorage, frozen_gain, gain_bounds
from lpvid.synthesis.polytope import MOVING, Polytope
from lpvid.synthesis.scaling import Matrices

Values = Callable[[np.ndarray], np.ndarray]
"""From points to matrices."""
GRID = {0: 1, 1: 33, 2: 9}
"""Points per variable at which a loop that is not affine is looked at; 4 for more variables."""
RAISED = (1e-4, 1e-3, 1e-2)
"""shares above the H-infinity norm at which its storage function is computed"""
REST = 1e-4
"""ε over the share and the pace of the loop: 1e-7 of it leaves rounding room at 1 % above the norm, 1e-9 does not"""
DIGITS = 1.002
"""share up to which a storage function written as one matrix may prove less than its two blocks do: rounding"""


def gain_figure(channel: str, loop: LPVStateSpace, promised: float, storage: LoopStorage,
                polytope: Polytope | None = None) -> Figure | None:
    """The bound of the induced gain; None where the storage function proves none.

    Parameters
    ----------
    channel : str
        From what to what, for the figure.
    loop : LPVStateSpace
        Closed loop w → z, continuous or discrete.
    promised : float
        Bound that the design gave.
    storage : LoopStorage
        One constant storage function, (1, …) blocks.
    polytope : Polytope, optional
        The scheduling set where that is no box; the loop is affine in it.

    Returns
    -------
    Figure or None
        With the larger of the frozen H-infinity norms as lower bound.
    """
    at, many = _corners(loop, polytope)
    bound = float(gain_bounds(at, _repeated(storage, many), 0, discrete=loop.is_discrete).max())
    if not np.isfinite(bound):
        return None
    if polytope is not None:
        held = frozen_gain(polytope.over(loop, polytope.looked), discrete=loop.is_discrete)
        proof = polytope.proof(loop, storage.matrices()[0], bound)
        if not held <= bound * (1 + 1e-6):
            return None
        return Figure("H-infinity", channel, promised, bound if proof is None else proof.gamma, held, True, proof,
                      "polytope")
    lower, whole = largest_frozen_norm(driven(loop), loop.box)[0], storage.matrices()[0]
    if not lower <= bound * (1 + 1e-6):
        return None
    own = own_certificate(lambda points: np.broadcast_to(whole, (len(points), *whole.shape)), Polynomial((), 0), loop,
                          bound, DIGITS)
    proven = own is not None and own.between_grid
    return Figure("H-infinity", channel, promised, bound if own is None else own.gamma, lower,
                  is_affine(loop.basis) or proven, own)


def searched_figure(channel: str, loop: LPVStateSpace, promised: float, polytope: Polytope, *, moving: bool = False
                    ) -> Figure | None:
    """The least gain that an analysis certifies on a polytope; None where it certifies none.

    Parameters
    ----------
    channel : str
        From what to what, for the figure.
    loop : LPVStateSpace
        Closed loop w → z, affine in the scheduling.
    promised : float
        Bound that the design gave.
    polytope : Polytope
    moving : bool
        In discrete time: by a P that follows the scheduling.

    Returns
    -------
    Figure or None
    """
    found = polytope.searched(loop, moving)
    if found is None:
        return None
    held = frozen_gain(polytope.over(loop, polytope.looked), discrete=loop.is_discrete)
    return Figure("H-infinity", channel, promised, found.gamma, held, True, found, "polytope")


def moving_figure(channel: str, loop: LPVStateSpace, promised: float, polytope: Polytope, values: Values,
                  lyapunov: Basis, most: float) -> Figure | None:
    """The gain that a storage function which moves proves on a polytope, at the rates of its box; None for none.

    Parameters
    ----------
    channel : str
        From what to what, for the figure.
    loop : LPVStateSpace
        Closed loop w → z, polynomial in the scheduling.
    promised : float
        Bound that the design gave.
    polytope : Polytope
    values : callable
        (N, n, n) P at (N, n_scheduling) points.
    lyapunov : Basis
        Its functions, or those of its inverse.
    most : float
        Gain up to which it is tried.

    Returns
    -------
    Figure or None
    """
    shares = [s for s in MOVING if promised * (1 + s) <= most] or [0.0]
    found = polytope.moving_proof(loop, values, lyapunov, promised, shares)
    if found is None:
        return None
    held = frozen_gain(polytope.over(loop, polytope.looked), discrete=loop.is_discrete)
    return Figure("H-infinity", channel, promised, found.gamma, held, True, found, "polytope")


def variance_figure(channel: str, loop: LPVStateSpace, promised: float, storage: LoopStorage,
                    criterion: CovarianceCriterion, polytope: Polytope | None = None) -> Figure | None:
    """The bound of the H2 norm, rms of z while w is white noise of unit intensity, at every instant of any trajectory.

    Of the generalised one: the peak of z for a w of unit energy.

    With Q = P⁻¹ and the least s for which AQ + QAᵀ + BBᵀ/s ≼ 0 (or AQAᵀ − Q + BBᵀ/s ≼ 0) at every point, sQ bounds the
    covariance of the states: ν² = s·max trace(CQCᵀ), in discrete time with trace(DDᵀ); of a peak the largest
    eigenvalue of s·CQCᵀ + DDᵀ.

    Parameters
    ----------
    channel : str
        From what to what, for the figure.
    loop : LPVStateSpace
        Closed loop w → z; D = 0 in continuous time.
    promised : float
        Bound that the design gave.
    storage : LoopStorage
        One constant storage function, (1, …) blocks.
    criterion : CovarianceCriterion
        Trace of the output's covariance, or its peak.
    polytope : Polytope, optional
        The scheduling set where that is no box; the loop is affine in it.

    Returns
    -------
    Figure or None
        None where P shows no decay at some point of the box.
    """
    (a, b, c, d), _ = _corners(loop, polytope)
    into = storage.mix @ diagonal(*(np.linalg.inv(np.linalg.cholesky(p[0]).T) for p in (storage.first, storage.second)))
    out = np.linalg.inv(into)
    a, b, c = out @ a @ into, out @ b, c @ into
    m = np.eye(a.shape[1]) - a @ a.swapaxes(1, 2) if loop.is_discrete else -(a + a.swapaxes(1, 2))
    if not np.all(np.isfinite(m)) or np.linalg.eigvalsh(m)[:, 0].min() <= 1e-12 * np.linalg.norm(m, axis=(1, 2)).max():
        return None
    share = float(np.linalg.eigvalsh(b.swapaxes(1, 2) @ np.linalg.solve(m, b))[:, -1].max(initial=0.0))
    output = share * (c @ c.swapaxes(1, 2)) + d @ d.swapaxes(1, 2)
    square = np.linalg.eigvalsh(output)[:, -1] if criterion.peak else np.trace(output, axis1=1, axis2=2)
    bound = float(np.sqrt(square.max())) * (1 + SAFETY)
    return Figure(criterion.kind, channel, promised, bound, None, is_affine(loop.basis),
                  region="box" if polytope is None else "polytope")


def still_bound(loop: LPVStateSpace, states: np.ndarray, reached: float) -> float:
    """A bound of the gain of a loop that does not move, by the Riccati equation of the bounded-real lemma.

    AᵀP + PA + γ⁻¹CᵀC + (PB + γ⁻¹CᵀD)(γ − γ⁻¹DᵀD)⁻¹(PB + γ⁻¹CᵀD)ᵀ + εI = 0 over states in which P has digits: written
    down over the loop's own, P loses them where a plant's integrator and a controller's hold the same number.

    Parameters
    ----------
    loop : LPVStateSpace
        Continuous, without scheduling.
    states : (n, n) array
        T of x = T x̃ with balanced x̃.
    reached : float
        The H-infinity norm.

    Returns
    -------
    float
        Infinite where numpy does not agree with any.
    """
    if loop.is_discrete or not loop.order:
        return np.inf
    a, b, c, d = (np.asarray(m) for m in loop.frozen(loop.box.centre))
    a, b, c = np.linalg.solve(states, a @ states), np.linalg.solve(states, b), c @ states
    n, none = len(a), np.zeros((1, 0, 0))
    for share in RAISED:
        gamma = reached * (1 + share)
        try:
            p = solve_continuous_are(a, b, c.T @ c / gamma + share * REST * np.linalg.norm(a) * np.eye(n),
                                     d.T @ d / gamma - gamma * np.eye(b.shape[1]), s=c.T @ d / gamma)
        except (np.linalg.LinAlgError, ValueError):
            continue
        storage = LoopStorage(0.5 * (p + p.T)[None], none, np.zeros((1, 1, n, n)), none[:, None], np.eye(n))
        found = float(gain_bounds((a[None], b[None], c[None], d[None]), storage, 0)[0])
        if found <= (1 + 2 * share) * reached:
            return found
    return np.inf


def _corners(loop: LPVStateSpace, polytope: Polytope | None) -> tuple[Matrices, int]:
    """The loop where it must be looked at, and at how many points."""
    if polytope is not None:
        return polytope.over(loop, polytope.vertices), len(polytope.vertices)
    points = loop.box.grid(2 if is_affine(loop.basis) else GRID.get(len(loop.box.names), 4))
    a, b, c, d = (np.array(m) for m in zip(*(loop.frozen(p) for p in points), strict=True))
    return (a, b, c, d), len(points)


def _repeated(v: LoopStorage, many: int) -> LoopStorage:
    first, second = (np.tile(m[:1], (many, 1, 1)) for m in (v.first, v.second))
    return LoopStorage(first, second, 0 * first[:, None], 0 * second[:, None], v.mix)
