"""H2 norm of an LPV system: certified from above, reached from below by frozen systems."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lpvid.analysis.bound import Bound, BoundSearch, first_proven, judged, scaled_outputs
from lpvid.analysis.certificates import Range, Rate
from lpvid.analysis.gain import rated, requested
from lpvid.analysis.gain_bounds import STALLS, blended, storage_bases, worst_pole
from lpvid.analysis.hull_variance import variance_on
from lpvid.lmi.bound_certificate import BoundCertificate, has_h2_norm, inequality_of
from lpvid.lmi.certificate import grid
from lpvid.lmi.driven import Driven
from lpvid.lmi.frame import Frame, gramian
from lpvid.lmi.storage_search import ROUGHLY, Claim, StorageProposal, StorageSearch
from lpvid.model.hull import Hull, design_hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Scheduling

BACK_OFF = (1e-6, 1e-5, 1e-4, 1e-3, 5e-3)
RELAXED = (0.01, 0.05)
ENOUGH = 0.005
MOST_EFFORT = 2_000_000
"""`StorageSearch.effort`, some ten seconds, from which on a richer storage function is left out where a poorer one has
a bound."""


def h2_norm(system: LPVStateSpace, rate: Rate = None, basis: Basis | None = None, *, range: Range = None) -> Bound:
    """Bounds of the rms of a model's outputs while its inputs are white noise and its scheduling moves.

    The noise has unit intensity (unit variance per sample in discrete time) in every input. The inequalities stand in
    `lpvid.lmi.bounds.H2Bound`; for a time-invariant system both bounds are the H2 norm. Of a closed loop that was
    designed for a hull that polytope is meant: one P at its vertices, or P(p) on the box around it.

    Parameters
    ----------
    system : LPVStateSpace
        In continuous time without feedthrough.
    rate, basis, range
        As for `l2_gain`.

    Returns
    -------
    Bound
        Its `upper` is certified, its `lower` the largest H2 norm of a frozen system on a grid.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> lag = LPVStateSpace([[[-2.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), None)
    >>> found = h2_norm(lag)                                     # 1/(s + 2): ½
    >>> round(found.lower, 6), round(found.upper, 4), found.verdict
    (0.5, 0.5, 'certified')
    """
    plant, box = requested(system, rate, basis, range)
    if not has_h2_norm(plant):
        return Bound("h2-norm", "not certified", math.inf, math.inf, None, "with feedthrough in continuous time white "
                     "noise passes with infinite variance")
    hull = design_hull(system) if range is None else None
    if hull is not None:
        return _on_hull(system, hull, rate, basis)
    if worst_pole(plant, box)[0] >= 0:
        return Bound("h2-norm", "unstable", math.inf, math.inf, None, "a frozen pole does not decay")
    lower = _largest_frozen_h2(plant, box)
    best: BoundCertificate | None = None
    stalls = 0
    for own in storage_bases(plant, box, basis):
        if best is not None and _effort(plant, box, own) > MOST_EFFORT:
            break
        found = first_proven(_certified(plant, box, own, lower or 1.0))
        if found is None:
            continue
        stalled = (best is not None and own.degree != 1 and
                   (1 - ENOUGH) * best.level < found.level < best.level)
        stalls = stalls + 1 if stalled else 0
        if best is None or (found.between_grid, -found.level) > (best.between_grid, -best.level):
            best = found
        near = stalls >= STALLS or best.level <= (1 + ENOUGH) * lower
        if basis is None and near and best.between_grid:
            break
    return judged("h2-norm", best, lower, math.inf if best is None else best.level,
                  "no storage function was found that bounds the variance")


def _on_hull(system: LPVStateSpace, hull: Hull, rate: Rate, basis: Basis | None) -> Bound:
    """The lower of two bounds; the second where there is no first, or where P may move."""
    lower, best = variance_on(system, hull)
    if math.isinf(lower):
        return Bound("h2-norm", "unstable", math.inf, math.inf, None, "a frozen pole does not decay")
    box = hull.enclosing(rated(system.box, rate, None))
    if best is None or basis is not None or system.is_discrete or any(r is not None for r in box.rate):
        around = h2_norm(system, rate, basis, range=box.limits).certificate
        if around is not None and (best is None or (around.between_grid and around.level < best.level)):
            best = around
    return judged("h2-norm", best, lower, math.inf if best is None else best.level,
                  "no storage function was found that bounds the variance")


def _certified(plant: Driven, box: Scheduling, basis: Basis, typical: float) -> Iterator[BoundCertificate]:
    search = BoundSearch(plant, box, "h2-norm")
    frame = search.frame()
    size = typical * math.sqrt(frame.time)  # of the outputs, that the level is about one in the frame's unit of time
    unit = scaled_outputs(plant, 1 / size)
    for density in (2.0, 5.0) if plant.order <= 6 else (2.0,):
        inner = StorageSearch(unit, box, basis, frame, _variance, density)
        for proposal in _proposals(inner) if inner.affordable else ():
            found = search.checked(proposal.matrices * size**2, basis, typical * math.sqrt(proposal.level),
                                   proposal.solver)
            if found is not None:
                yield found


def _effort(plant: Driven, box: Scheduling, basis: Basis) -> int:
    return StorageSearch(plant, box, basis, Frame(np.eye(plant.order), 1.0, 1.0), _variance).effort


def _variance(square: float) -> Claim:
    """ν² enters the inequality linearly."""
    return inequality_of("h2-norm", math.sqrt(square), None)


def _proposals(search: StorageSearch) -> Iterator[StorageProposal]:
    """The least variance, backed off a little; then variances with room to spare."""
    least = next(search.least(), None)
    if least is None or not least.level > 0:
        return
    for share in BACK_OFF:
        yield replace(least, level=least.level * (1 + share) ** 2)
    for share in RELAXED:
        roomy = next(search.roomiest(least.level * (1 + share) ** 2, settings=ROUGHLY), None)
        if roomy is not None:
            yield from blended(least, roomy)  # the inequality is linear in P and the variance


def _largest_frozen_h2(plant: Driven, box: Scheduling) -> float:
    """Largest H2 norm over a grid of frozen systems, by Lyapunov equations."""
    points = grid(box, {0: 1, 1: 81, 2: 13, 3: 6}.get(len(box.names), 3))
    best, discrete = 0.0, plant.sample_time is not None
    for a, b, c, d in zip(*plant.matrices(points), strict=True):
        variance = c @ gramian(a, b @ b.T, discrete) @ c.T if len(a) else np.zeros((len(c), len(c)))
        best = max(best, float(np.trace(variance)) + (float(np.sum(d**2)) if discrete else 0.0))
    return math.sqrt(best)
