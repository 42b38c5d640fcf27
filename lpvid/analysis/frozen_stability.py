"""Is every frozen model of the box stable, and where is it closest to losing stability?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.analysis.critical import CriticalScheduling, critical_scheduling
from lpvid.analysis.frozen import CAVEAT, FrozenFamily, Model, family, stability_margin
from lpvid.codec import Encoded
from lpvid.lmi.certificate import tensor
from lpvid.model.adaptable import checked_matrices
from lpvid.model.hull import Hull, design_hull
from lpvid.scheduling import Scheduling


@dataclass(frozen=True, eq=False)
class FrozenStability(Encoded):
    """Whether the frozen model is stable over its box, and where it is closest to losing stability.

    It gives no information on a scheduling variable that moves; see `certify_stability`.

    Attributes
    ----------
    stable : bool
        At every point of the grid, and between them along the lines of `critical`.
    max_modulus : float or None
        Largest |z|; None in continuous time.
    max_real_part : float or None
        Largest Re s [1/s]; None in discrete time.
    at : dict of str to float
        Scheduling where that is.
    points : int
        Points of the grid.
    critical : CriticalScheduling
        Along the axis of every variable, through the middle of the box.
    hull : Hull or None
        Examined in place of the box: that for which a controller or closed loop was designed.
    """

    caveat = CAVEAT
    JSON = ("stable", "max_modulus", "max_real_part", "at", "points", "caveat")

    stable: bool
    max_modulus: float | None
    max_real_part: float | None
    at: dict[str, float]
    points: int
    critical: CriticalScheduling
    hull: Hull | None = None

    def __str__(self) -> str:
        where = ", ".join(f"{n} = {v:.6g}" for n, v in self.at.items()) or "every time"
        size = (f"largest pole modulus {self.max_modulus:.6g}" if self.max_modulus is not None
                else f"largest real part {self.max_real_part:.6g} 1/s")
        span = "the box" if self.hull is None else self.hull.text
        rows = [f"{'frozen-stable' if self.stable else 'NOT frozen-stable'} over {span}: {size} at {where}",
                *(f"  {v}" for v in self.critical.values)]
        if len(self.critical.lines) > 1:
            middle = "box" if self.hull is None else "polytope"
            rows.append(f"  judged at {self.points} points and exactly along each axis through the middle of the "
                        f"{middle}")
        return "\n".join([*rows, CAVEAT])

    __repr__ = __str__


def frozen_stability(model: Model, points: int | None = None) -> FrozenStability:
    """Whether every frozen model of the box is stable: exactly for one scheduling variable, on a grid for several.

    Of a controller or closed loop that was designed for a hull: every frozen model of that polytope, its vertices too.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    points : int, optional
        Grid points along each variable; by default about 20 000 in all, at most 401 each. The largest modulus is then
        sharpened by zooming in around the best one.

    Returns
    -------
    FrozenStability

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso(a=[[-0.5, 0.25]], b=[[0, 0], [1, 0]], sample_time=0.1,
    ...                                  basis=Polynomial("current", degree=1))
    >>> result = frozen_stability(model)
    >>> result.stable, result.max_modulus, result.at
    (True, 0.75, {'current': -1.0})
    """
    checked_matrices(model, "frozen stability is that of a model")
    models, hull, box = family(model), design_hull(model), model.box
    box = box if hull is None else hull.enclosing(box)
    count = len(box.names)
    if points is None:
        points = int(np.clip(20_000 ** (1 / max(count, 1)), 2, 401))
    _checks.count(points, "points", at_least=2)
    grid = _of_set(box, hull, box.grid(points))
    if models.order == 0:
        worst, at = (-1.0 if models.discrete else -np.inf), box.centre if hull is None else hull.middle
    else:
        worst, at = _worst(models, grid)
        cube = tensor([np.linspace(-1.0, 1.0, 9 if count < 3 else 3)] * count)
        for shrink in range(1, 13 if count <= 8 else 1):
            share = 2.0 / (points - 1) * 0.5 ** (shrink - 1)
            local = _of_set(box, hull, at + cube * box.half_width * share, at, share)
            better, place = _worst(models, local)
            if better > worst:
                worst, at = better, place
    critical = critical_scheduling(model)
    stable = bool(worst < 0) and critical.stable
    return FrozenStability(stable, 1.0 + worst if models.discrete else None, None if models.discrete else worst,
                           dict(zip(box.names, at.tolist(), strict=True)), len(grid), critical, hull)


def _of_set(box: Scheduling, hull: Hull | None, points: np.ndarray, at: np.ndarray | None = None, share: float = 1.0
            ) -> np.ndarray:
    """Points (N, n) moved into the box; of a hull those inside and its vertices, drawn to a share of their way from
    `at`."""
    if hull is None:
        return np.clip(points, box.lower, box.upper)
    vertices = hull.vertices()
    return np.vstack([points[hull.contains(points)], vertices if at is None else at + share * (vertices - at)])


def _worst(models: FrozenFamily, p: np.ndarray) -> tuple[float, np.ndarray]:
    margin = stability_margin(models.poles(p), models.discrete).max(axis=1)
    i = int(np.argmax(margin))
    return float(margin[i]), p[i]
