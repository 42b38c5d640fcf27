"""The storage function of a synthesised loop as a certificate for others to check, between grid points too."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from lpvid.analysis.bound import first_proven
from lpvid.analysis.rated_certificate import RatedGainCertificate
from lpvid.lmi.driven import driven
from lpvid.lmi.gain_certificate import BoundedReal, GainCertificate, certify_gain, recheck_gain
from lpvid.lmi.inequality import is_decidable
from lpvid.lmi.readings import box_of
from lpvid.lmi.storage import Storage
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Fourier, Polynomial, Scheduling
from lpvid.synthesis.controller_formula import FeedbackLaw
from lpvid.synthesis.controller_table import dense
from lpvid.synthesis.design_grid import columns
from lpvid.synthesis.loop_check import LoopStorage
from lpvid.synthesis.progress import stage

SHARES = (1e-6, 1e-4, 5e-4, 2e-3)
"""by which the certified bound may lie above the one found at points."""
NEAR = 2
"""How many of them are tried over the loop's own states before the storage function is written over its two blocks."""
CELLS = {1: 96, 2: 14, 3: 6}
"""of the grid on which P(p) is sampled, by the number of its variables."""
SCREEN = {1: 13, 2: 5, 3: 3}
"""Points per variable at which a design's own storage function is looked at first."""


def certificate_of(formula: FeedbackLaw, loop: LPVStateSpace, bound: float
                   ) -> GainCertificate | RatedGainCertificate | None:
    """The loop's storage function, re-checked; None where its rounding errors, or its approximation, cost the proof.

    With X(p), Y(p) the storage function holds X⁻¹, which is no finite sum: it is fitted in a richer basis. That of a
    controller which reads the rates ties them to p.

    Parameters
    ----------
    formula : FeedbackLaw
        The controller for every p, with its storage function.
    loop : LPVStateSpace
        Closed loop with the controller as it was written down.
    bound : float
        Gain that the storage function kept at points.

    Returns
    -------
    GainCertificate, RatedGainCertificate or None
        The latter for a controller that reads the rates.
    """
    return first_proven(c for c in _chain(formula, loop, bound) if c is not None)


def _chain(formula: FeedbackLaw, loop: LPVStateSpace, bound: float
           ) -> Iterator[GainCertificate | RatedGainCertificate | None]:
    """What one way of writing the storage function down after the other shows."""
    states = formula.storage(formula.plant.plant.box.centre[None, :]).mix
    if formula.variations.rated:
        gammas = [bound * (1 + share) for share in (*SHARES[:NEAR], SHARES[-1])]
        for basis, matrices in _proposals(formula, loop.box, LoopStorage.blocks):
            stage(f"certifying {bound:.4g} between grid points with {basis.size} functions")
            yield RatedGainCertificate.within(loop, matrices, basis, gammas, states)
        return
    box = box_of(driven(loop).readings, loop.box)
    yield _exact(formula, loop, box, bound, states)
    yield proven(loop, bound, _proposals(formula, box), SHARES[:NEAR])
    yield proven(loop, bound, _proposals(formula, box, LoopStorage.blocks), SHARES, states)
    yield proven(loop, bound, _proposals(formula, box), SHARES[NEAR:])


def _exact(formula: FeedbackLaw, loop: LPVStateSpace, box: Scheduling, bound: float, states: np.ndarray
           ) -> GainCertificate | None:
    """That of a continuous design in which one of X and Y moves, over its own functions: exact, where fits are not.

    Over the states of its two blocks P is diag(X⁻¹, Y(p) − X⁻¹), or P⁻¹ is diag(Y⁻¹, X(p) − Y⁻¹).
    """
    own, plant = formula.variations.basis, formula.plant.plant
    if own is None or not formula.variations.moving or loop.is_discrete or not set(own.names) <= set(box.names):
        return None
    points, inverse = dense(plant.box, CELLS.get(len(plant.box.names), 4)), formula.variations.varying == "controls"
    values = formula.storage(points).blocks()
    matrices = np.tensordot(np.linalg.pinv(columns(plant.box, own, points)),
                            np.linalg.inv(values) if inverse else values, axes=1)
    return proven(loop, bound, [(own, 0.5 * (matrices + matrices.swapaxes(1, 2)))], SHARES, states, inverse)


def proven(loop: LPVStateSpace, bound: float, proposals: Iterable[tuple[Basis, np.ndarray]],
           shares: Sequence[float], states: np.ndarray | None = None, inverse: bool = False
           ) -> GainCertificate | None:
    """The first of some storage functions that proves a gain at most `shares` above a bound; else the best on a grid.

    One that holds on a grid is given more room, up to the last share, before the next one is tried.

    loop : LPVStateSpace
        Closed loop w → z.
    bound : float
        Gain that was found at points.

    Parameters
    ----------
    proposals : iterable of (Basis, (K, n, n) array)
    shares : sequence of float
        Rising.
    states : (n, n) array, optional
        T of x = Tξ, where the storage functions are over ξ.
    inverse : bool
        The matrices are those of P⁻¹.

    Returns
    -------
    GainCertificate or None
        None where no storage function proves any of the shares.
    """
    system = driven(loop)
    box = box_of(system.readings, loop.box)
    best: GainCertificate | None = None
    for basis, matrices in proposals:
        if system.order and box.names:
            stage(f"certifying {bound:.4g} between grid points with {basis.size} functions")
        storage = Storage(matrices, basis, box, system.sample_time)
        decidable, judged = is_decidable(BoundedReal(system, storage, bound)), False
        for share in shares:
            gamma = bound * (1 + share)
            found = recheck_gain(system, storage, gamma, states=states, inverse=inverse)
            if found.holds and (best is None or found.between_grid > best.between_grid):
                best = GainCertificate.of(system, storage, gamma, found, states=states, inverse=inverse)
            if best is not None and best.between_grid:
                return best
            if found.holds and not judged:  # the most room: where that is not enough, no less is
                most = bound * (1 + shares[-1])
                judged = decidable and recheck_gain(system, storage, most, states=states, inverse=inverse).between_grid
                if not judged:
                    break
    return best


def own_certificate(values: Callable[[np.ndarray], np.ndarray], basis: Basis, loop: LPVStateSpace, promised: float,
                    most: float) -> GainCertificate | None:
    """Whether the storage function that a design gives proves its promise for the loop, or `most` times that.

    loop : LPVStateSpace
        Closed loop w → z.
    promised : float
        Gain that the design gave.
    most : float
        Above 1.

    Parameters
    ----------
    values : callable
        (N, n, n) P at (N, variables) points of the loop's box; fitted in `basis` and in richer ones.
    basis : Basis
        Over variables of the box.

    Returns
    -------
    GainCertificate or None
        None where nothing up to `most` times the promise is proven.
    """
    box = loop.box
    if not loop.is_discrete and not _plausible(values, loop, promised * most):
        return None
    points = dense(box, CELLS.get(len(box.names), 4))
    at = values(points)

    shares = *(s for s in (1e-6, 5e-4, 2e-3, 5e-3, 1e-2, 2e-2, 3.5e-2) if s < most - 1), most - 1
    return proven(loop, promised, fits(at, box, points, own_and_richer(basis, box)), shares)


def _plausible(values: Callable[[np.ndarray], np.ndarray], loop: LPVStateSpace, bound: float) -> bool:
    """A glance at a few points, with slopes by differences, before anything is fitted."""
    box = loop.box
    if not box.names:
        return True
    points, width = box.grid(SCREEN.get(len(box.names), 2)), np.array(box.upper) - np.array(box.lower)
    steps = np.diag(1e-5 * width)
    slopes = np.stack([(values(points + e) - values(points - e)) / max(2 * e.sum(), 1e-300) for e in steps], axis=1)
    rates = np.array([r or 0.0 for r in box.rate])
    return certify_gain(loop.at(points), values(points), bound, slopes=slopes, rate=rates).holds


def _proposals(formula: FeedbackLaw, box: Scheduling,
               written: Callable[[LoopStorage], np.ndarray] = LoopStorage.matrices
               ) -> Iterator[tuple[Basis, np.ndarray]]:
    own, plant = formula.variations.basis, formula.plant.plant
    if own is None or not set(own.names) <= set(box.names):
        still = written(formula.storage(plant.box.centre[None, :]))
        yield Polynomial((), 0), 0.5 * (still + still.swapaxes(1, 2))
        return
    points = dense(plant.box, CELLS.get(len(plant.box.names), 4))
    yield from fits(written(formula.storage(points)), plant.box, points, richer_bases(own, plant.box))


def fits(values: np.ndarray, box: Scheduling, points: np.ndarray, bases: Iterable[Basis]
         ) -> Iterator[tuple[Basis, np.ndarray]]:
    """Symmetric matrices known at points, by least squares over one basis after the other.

    Parameters
    ----------
    values : (N, n, n) array
        The matrices.
    box : Scheduling
        Variables of the points.
    points : (N, n_scheduling) array
        Where they are known.
    bases : iterable of Basis
        Functions over some of the variables.

    Yields
    ------
    (Basis, (M, n, n) array)
        A basis and the coefficients over it.
    """
    for basis in bases:
        matrices = np.tensordot(np.linalg.pinv(columns(box, basis, points)), values, axes=1)
        yield basis, 0.5 * (matrices + matrices.swapaxes(1, 2))


def own_and_richer(basis: Basis, box: Scheduling) -> Iterator[Basis]:
    """A basis bound to a box, then those of `richer_bases` with more functions.

    Parameters
    ----------
    basis : Basis
        Of a storage function.
    box : Scheduling
        What it is bound to.

    Yields
    ------
    Basis
        The poorest first.
    """
    own = basis.bound(box)
    yield own
    yield from (richer for richer in richer_bases(own, box) if richer.size > own.size)


def richer_bases(basis: Basis, box: Scheduling) -> Iterator[Basis]:
    """Functions of rising degree, or of more harmonics, in which a storage function may be written down.

    Parameters
    ----------
    basis : Basis
        Of the design's Lyapunov matrix.
    box : Scheduling

    Yields
    ------
    Basis
    """
    if isinstance(basis, Fourier):
        for factor in (2, 4):
            yield Fourier(basis.name, factor * basis.harmonics, basis.period, basis.origin)
        return
    for degree in (2, 4, 6):
        yield Polynomial(basis.names, degree).bound(box)
