"""Regions of scheduling space that an embedding can visit: boxes, and convex hulls that are smaller than their box."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from lpvid.errors import InputError
from lpvid.scheduling import Scheduling
from lpvid.toolkit import checks

SLACK = 1e-9
"""tolerance, in half widths of the box, within which a point counts as inside."""


@dataclass(frozen=True, eq=False)
class Region:
    """A convex region by its corners, and points that the plant itself can stand at.

    A polytopic design has its inequalities at the `corners`; a gridded one at the `visited` points, which may lie on a
    curve inside.

    Attributes
    ----------
    names : tuple of str
        Scheduling variables.
    corners : (V, n) array
    visited : (N, n) array
        Spread over what the plant can reach; all in the hull of the corners.
    source : str
        Where the limits come from.

    Examples
    --------
    >>> Region.box(("p", "q"), (0.0, -1.0), (1.0, 1.0), "by definition").contains(np.array([[0.5, 0.0], [2.0, 0.0]]))
    array([ True, False])
    """

    names: tuple[str, ...]
    corners: np.ndarray
    visited: np.ndarray
    source: str = ""

    def __post_init__(self) -> None:
        n = len(self.names)
        for name in ("corners", "visited"):
            array = checks.shaped(checks.frozen_array(getattr(self, name), name), (None, n), name)
            object.__setattr__(self, name, checks.finite(array, name))
        if not len(self.corners):
            raise InputError("a region of scheduling has corners", got="none")

    @classmethod
    def box(cls, names: tuple[str, ...], lower: tuple[float, ...], upper: tuple[float, ...], source: str,
            points: int = 5) -> Region:
        """Everything between two limits for each variable, with a tensor grid of `points` values each.

        Parameters
        ----------
        names : tuple of str
            Scheduling variables.
        lower, upper : tuple of float
            Limits of each, in its unit.
        source : str
            Where the limits come from.
        points : int
            Values of each variable in the grid, both limits included.

        Returns
        -------
        Region
            With 2ⁿ corners, the grid as its visited points.
        """
        box = Scheduling(names, lower, upper)
        corners = np.array(list(product(*zip(box.lower, box.upper, strict=True))))
        return cls(names, corners.reshape(-1, len(names)), box.grid(points), source)

    @classmethod
    def of_runs(cls, names: tuple[str, ...], limits: Mapping[str, tuple[float, float]]) -> Region:
        """The box of the limits that recorded runs set, as `limits_around` gives them.

        Parameters
        ----------
        names : tuple of str
        limits : mapping of str to (float, float)

        Returns
        -------
        Region

        Raises
        ------
        InputError
            A variable without limits.
        """
        missing = [n for n in names if n not in limits]
        if missing:
            raise InputError("the scheduling of E9 is limited by recorded runs", got=f"no limits of {missing[0]}",
                             mend=".around(runs)")
        lower, upper = zip(*(limits[n] for n in names), strict=True)
        return cls.box(names, lower, upper, "recorded runs", points=3)

    def scheduling(self, units: tuple[str, ...] = (), rate: tuple[float | None, ...] = ()) -> Scheduling:
        """The smallest box around it.

        Parameters
        ----------
        units : tuple of str
            Of the variables; none where left out.
        rate : tuple of float or None
            Bounds on the rate of each variable, per second; None for a variable that may jump.

        Returns
        -------
        Scheduling
            A box; what the region leaves out of it is inside again.
        """
        return Scheduling(self.names, tuple(self.corners.min(axis=0)), tuple(self.corners.max(axis=0)), rate, units)

    def contains(self, p: np.ndarray) -> np.ndarray:
        """(n,) bool: which samples of `p` (n, len(names)) lie inside.

        Parameters
        ----------
        p : (n, len(names)) array
            In the variables' units.

        Returns
        -------
        (n,) bool array
            True on the boundary too, within `SLACK` of the half width.
        """
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        half = np.where(high > low, 0.5 * (high - low), 1.0)
        z, corners = (np.asarray(p, dtype=float) - low) / half, (self.corners - low) / half
        within = np.all((z >= -SLACK) & (z <= (high - low) / half + SLACK), axis=1)
        if len(self.names) < 2 or np.linalg.matrix_rank(corners - corners[0]) < len(self.names):
            return within
        from scipy.spatial import ConvexHull

        sides = ConvexHull(corners).equations
        return within & np.all(z @ sides[:, :-1].T + sides[:, -1] <= SLACK, axis=1)

    @property
    def volume(self) -> float:
        """Area of the hull of the corners, or volume, in the variables' units; length for one variable."""
        if len(self.names) == 1:
            return float(np.ptp(self.corners))
        from scipy.spatial import ConvexHull

        return float(ConvexHull(self.corners).volume)


def limits_around(names: tuple[str, ...], p: np.ndarray, margin: float) -> dict[str, tuple[float, float]]:
    """Least and largest value of each scheduling variable along runs, widened by a margin about the middle.

    Parameters
    ----------
    names : tuple of str
    p : (n, len(names)) array
        Samples.
    margin : float
        Factor on the width of every range, 1 for the samples alone.

    Returns
    -------
    dict of str to (float, float)
    """
    low, high = p.min(axis=0), p.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * margin * (high - low)
    return {n: (float(m - h), float(m + h)) for n, m, h in zip(names, middle, half, strict=True)}
