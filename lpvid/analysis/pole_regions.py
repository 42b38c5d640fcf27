"""Certificates that all frozen poles of an LPV system lie in a convex region of the plane."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Protocol

import numpy as np

from lpvid.analysis.bound import Bound, BoundSearch, judged
from lpvid.analysis.certificates import Range
from lpvid.analysis.gain import requested
from lpvid.analysis.gain_bounds import storage_bases
from lpvid.analysis.hull_stability import region_on
from lpvid.errors import InputError
from lpvid.lmi.certificate import grid
from lpvid.model.hull import design_hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial


class Region(Protocol):
    """{s : L + sM + s̄Mᵀ ≺ 0}: a half plane, a disc, a cone (`lpvid.synthesis.criteria`)."""

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """L (symmetric) and M.

        Returns
        -------
        ((m, m) array, (m, m) array)
            In units of the plane [1/s, or of z].
        """
        ...


def certify_region(system: LPVStateSpace, region: Region, *, range: Range = None) -> Bound:
    """Prove that the poles lie in a region for every held value of the scheduling, not only at points of a grid.

    P(p) may follow p, for nothing moves; a constant P, tried first, states more. The inequality stands in
    `lpvid.lmi.bounds.RegionBound`. Of a closed loop that was designed for a hull that polytope is meant: one P at its
    vertices, else P(p) on the box around it.

    Parameters
    ----------
    system : LPVStateSpace
    region : Region
        With ``matrices() -> (L, M)``.
    range
        As for `l2_gain`.

    Returns
    -------
    Bound
        With quantity "pole-region"; `why` names a pole outside where there is one.

    Raises
    ------
    InputError
        L is not symmetric, or the matrices do not match.
    """
    fixed, varying = (np.asarray(x, dtype=float) for x in region.matrices())
    if fixed.shape != varying.shape or fixed.ndim != 2 or not np.array_equal(fixed, fixed.T):
        raise InputError("a pole region needs a symmetric L and an M of the same size",
                         got=f"shapes {fixed.shape} and {varying.shape}")
    hull = design_hull(system) if range is None else None
    plant, box = requested(system, None, None, range if hull is None else hull.enclosing(system.box).limits)
    if not plant.order:
        return Bound("pole-region", "not certified", math.nan, math.nan, None, "the model has no poles")
    still = replace(box, rate=(0.0,) * len(box.names))
    points = grid(still, {0: 1, 1: 201, 2: 31, 3: 11}.get(len(box.names), 3))
    if hull is not None and box.names:
        own = hull.over(box.names)
        points = np.vstack([own.vertices(), points[own.contains(points)]])
    poles = np.linalg.eigvals(plant.matrices(points)[0])
    level = np.linalg.eigvalsh(fixed + poles[..., None, None] * varying + poles.conj()[..., None, None] * varying.T)
    outside = level[..., -1].max(axis=1, initial=-math.inf)
    worst = int(outside.argmax())
    if outside[worst] >= 0:
        pole = poles[worst][int(level[worst, :, -1].argmax())]
        at = ", ".join(f"{n} = {v:.6g}" for n, v in zip(box.names, points[worst], strict=True))
        return Bound("pole-region", "not certified", math.nan, math.nan, None,
                     f"the pole {pole:.4g} lies outside the region" + (f" at {at}" if at else ""))
    certificate = None if hull is None else region_on(system, hull, (fixed, varying))
    if certificate is None:
        certificate = BoundSearch(plant, still, "pole-region", (fixed, varying)).at(0.0, _bases(still, plant))
    return judged("pole-region", certificate, math.nan, math.nan, "no P(p) was found, though no pole was seen outside")


def _bases(still, plant) -> Iterator[Basis]:
    """A constant, then P(p) up to degree 5 in one variable."""
    yield from storage_bases(plant, still)
    if len(still.names) == 1:
        yield Polynomial(still.names, 5).bound(still)
