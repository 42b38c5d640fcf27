"""The largest decay rate that can be certified while the scheduling moves."""

from __future__ import annotations

import math

from lpvid.analysis.bound import Bound, BoundSearch, judged, largest
from lpvid.analysis.certificates import Range, Rate
from lpvid.analysis.frozen import pole_margins
from lpvid.analysis.gain import requested
from lpvid.analysis.gain_bounds import storage_bases, worst_pole
from lpvid.analysis.hull_stability import decay_on
from lpvid.lmi.bound_certificate import BoundCertificate
from lpvid.model.hull import Hull, design_hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis

STEPS = 7


def decay_rate(system: LPVStateSpace, rate: Rate = None, basis: Basis | None = None, *, range: Range = None) -> Bound:
    """The largest α [1/s] for which √(xᵀP(p)x) is certified to decrease at least as exp(−αt), with zero input.

    Of a closed loop that was designed for a hull that polytope is meant: one P at its vertices, or P(p) on the box
    around it, whichever decreases faster.

    Parameters
    ----------
    system : LPVStateSpace
        Continuous or discrete; its basis may be trigonometric too.
    rate, basis, range
        As for `l2_gain`.

    Returns
    -------
    Bound
        Its `lower` is certified; its `upper` is the rate of the slowest frozen mode, which nothing can exceed.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> lag = LPVStateSpace([[[-2.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), None)
    >>> found = decay_rate(lag)
    >>> found.upper, round(found.lower, 1)
    (2.0, 2.0)
    """
    plant, box = requested(system, rate, basis, range)
    if not plant.order:
        return Bound("decay-rate", "not certified", 0.0, math.inf, None, "the model has no state that could decay")
    hull = design_hull(system) if range is None else None
    if hull is not None:
        return _on_hull(system, hull, rate, basis)
    worst = worst_pole(plant, box)[0]
    frozen = -worst if plant.sample_time is None else -math.log(max(1 + worst, 1e-6)) / plant.sample_time
    if worst >= 0:
        return Bound("decay-rate", "unstable", -math.inf, frozen, None, "a frozen pole does not decay")
    search = BoundSearch(plant, box, "decay-rate")
    best: BoundCertificate | None = None
    for own in storage_bases(plant, box, basis):
        found: dict[float, BoundCertificate] = {}

        def holds(level: float, own: Basis = own, found: dict[float, BoundCertificate] = found) -> bool:
            certificate = search.at(level, [own])
            if certificate is not None:
                found[level] = certificate
            return certificate is not None

        low = 0.0 if best is None else best.level
        if not any(holds(share * frozen) for share in (0.999, 0.98) if share * frozen > low):
            largest(holds, low, 0.98 * frozen, STEPS)
        if found and (best is None or found[max(found)].between_grid >= best.between_grid):
            best = found[max(found)]
        if best is not None and best.level >= 0.98 * frozen:
            break
    if best is None:
        best = search.at(0.0, storage_bases(plant, box))
    return judged("decay-rate", best, -math.inf if best is None else best.level, frozen,
                  "no storage function was found that decreases")


def _on_hull(system: LPVStateSpace, hull: Hull, rate: Rate, basis: Basis | None) -> Bound:
    """One P at the vertices, or P(p) on the box around the hull; a faster decay on a grid only is left for a proven
    one."""
    points = hull.points[:, [hull.names.index(n) for n in system.basis.names]]
    worst = float(pole_margins(system.at(points)[0], system.is_discrete).max(initial=-math.inf))
    frozen = -worst if system.sample_time is None else -math.log(max(1 + worst, 1e-6)) / system.sample_time
    if worst >= 0:
        return Bound("decay-rate", "unstable", -math.inf, frozen, None, "a frozen pole does not decay")
    found = None if basis is not None else decay_on(system, hull)
    around = decay_rate(system, rate, basis, range=hull.enclosing(system.box).limits)
    if around.certificate is not None and (found is None or (around.between_grid and around.lower > found.level)):
        found = around.certificate
    return judged("decay-rate", found, -math.inf if found is None else found.level, frozen,
                  "no storage function was found that decreases")
