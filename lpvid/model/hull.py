"""The region of scheduling space that the training data covered: outside it a model extrapolates."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from lpvid import _checks
from lpvid.codec import Coded
from lpvid.errors import InputError
from lpvid.model.designed import role_of
from lpvid.model.quasi import SelfScheduled
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Scheduling

Model = LPVTransferFunction | LPVStateSpace | SelfScheduled
KEY = "hull"
"""of a model's metadata that holds a `Hull`"""
FACETS = 200
"""half spaces that a hull may have at most."""
EXACT_VARIABLES = 4
"""variables up to which the exact convex hull is sought."""
CORNERS = 2000
"""vertices beyond which a hull cannot have few facets."""
GRID = {1: 41, 2: 9}
"""points per variable of the box around a hull, of which those inside are looked at; 4 for more variables"""
CHUNK = 16_384
"""samples looked at together."""
SLACK = 1e-9
"""tolerance, in half widths of the box, within which a point counts as inside."""


@dataclass(frozen=True, eq=False)
class Hull(Coded):
    """Convex region ``normals @ z ≤ offsets`` with z = (p − centre)/half_width, around the training scheduling.

    The convex hull itself where it has at most 200 facets in at most four variables; otherwise the tightest region with
    that many fixed directions (the box's sides among them), which holds the hull.

    Attributes
    ----------
    names : tuple of str
    centre, half_width : (n,) arrays
        The training box [units of the variables].
    normals : (facets, n) array
        Unit length, outward.
    offsets : (facets,) array
    exact : bool
        True for the convex hull itself.

    Examples
    --------
    >>> corner = Hull.of(("p", "q"), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    >>> corner.contains(np.array([[0.2, 0.2], [0.9, 0.9]]))
    array([ True, False])
    """

    names: tuple[str, ...]
    centre: np.ndarray
    half_width: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray
    exact: bool

    def __post_init__(self) -> None:
        n = len(self.names)
        set_ = object.__setattr__
        set_(self, "names", tuple(self.names))
        set_(self, "normals", _checks.shaped(_checks.frozen_array(self.normals, "normals"), (None, n), "normals"))
        count = self.normals.shape[0]
        for name, length in (("centre", n), ("half_width", n), ("offsets", count)):
            array = _checks.frozen_array(getattr(self, name), f"{name} of a hull", ndim=1)
            set_(self, name, _checks.finite(_checks.shaped(array, (length,), name), name))
        if not np.all(self.half_width > 0):
            raise InputError("the half widths of a hull must be positive", got=self.half_width.tolist(),
                             why="its facets are in units of them")

    @classmethod
    def of(cls, names: Sequence[str], p: np.ndarray) -> Hull:
        """The hull of samples `p` of shape (n, len(names)).

        Parameters
        ----------
        names : sequence of str
            Variables.
        p : (n, len(names)) array
            Samples, in the units of the variables.

        Returns
        -------
        Hull
            Exact, or an outer polytope where there are many variables.

        Raises
        ------
        InputError
            Samples of another shape, none, or ones that are not finite.
        """
        points = _checks.finite(np.asarray(p, dtype=float), "scheduling samples")
        if points.ndim != 2 or points.shape[1] != len(names) or not points.size:
            raise InputError("a hull needs samples of every variable", got=f"shape {points.shape}")
        low, high = points.min(axis=0), points.max(axis=0)
        centre, half = 0.5 * (low + high), 0.5 * (high - low)
        half = np.where(half > 0, half, 1.0)
        z = (points - centre) / half
        normals = _facets(z) if 2 <= len(names) <= EXACT_VARIABLES else None
        exact = normals is not None or len(names) == 1
        normals = directions(len(names), FACETS) if normals is None else normals
        return cls(tuple(names), centre, half, normals, _reach(z, normals), exact)

    @classmethod
    def disc(cls, names: Sequence[str], radius: float = 1.0, sides: int = 16) -> Hull:
        """The polygon around a circle: of (cos θ, sin θ) and its like.

        Parameters
        ----------
        names : sequence of str
            Two variables.
        radius : float
            Of the circle that the polygon encloses, in their unit.
        sides : int
            Sides of the polygon, at least three.

        Returns
        -------
        Hull
            The circle inside, its centre zero.

        Raises
        ------
        InputError
            Not two variables, a radius that is not positive, fewer than three sides.

        Examples
        --------
        >>> Hull.disc(("c", "s"), sides=4).vertices().round(6).tolist()
        [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]
        """
        if len(names) != 2:
            raise InputError("a disc has two variables", got=", ".join(names))
        angles = 2 * np.pi * np.arange(_checks.count(sides, "sides of a polygon", at_least=3)) / sides
        normals = np.column_stack([np.cos(angles), np.sin(angles)])
        reach = _checks.positive(radius, "the radius of a disc")
        return cls(tuple(names), np.zeros(2), np.full(2, reach), normals, np.ones(sides), False)

    def vertices(self) -> np.ndarray:
        """(V, n) corners, sorted [units of the variables].

        Returns
        -------
        (V, n) array
            One corner a row.

        Raises
        ------
        InputError
            A hull without inside: variables that follow from each other, or one variable with one value. Facets that
            leave a direction open.
        """
        from scipy.optimize import linprog
        from scipy.spatial import HalfspaceIntersection, QhullError

        n = len(self.names)
        endless = InputError(f"the hull of {', '.join(self.names)} has no end", got=f"{len(self.normals)} facets",
                             why="they leave a direction open", mend="lpv.Hull.of(names, samples)")
        if n == 1:
            if not (self.normals > 0).any() or not (self.normals < 0).any():
                raise endless
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = self.offsets / self.normals[:, 0]
            z = np.array([[ends[self.normals[:, 0] < 0].max()], [ends[self.normals[:, 0] > 0].min()]])
            if z[1, 0] - z[0, 0] <= SLACK:
                raise InputError(f"the hull of {self.names[0]} has no inside",
                                 got=f"{self.centre[0] + self.half_width[0] * z[0, 0]:.6g}",
                                 why="its samples are one value", mend="two values that differ")
        else:
            found = linprog(np.r_[np.zeros(n), -1.0], np.hstack([self.normals, np.ones((len(self.normals), 1))]),
                            self.offsets, bounds=[(None, None)] * n + [(0, None)])
            middle = np.zeros(n + 1) if found.x is None else found.x
            corners = None
            if middle[-1] > SLACK:
                with contextlib.suppress(QhullError), np.errstate(divide="ignore", invalid="ignore"):
                    corners = HalfspaceIntersection(np.column_stack([self.normals, -self.offsets]),
                                                    middle[:n]).intersections
            if corners is None:
                raise InputError(f"the hull of {', '.join(self.names)} has no inside",
                                 mend="leave out a variable that follows from the others")
            if not np.all(np.isfinite(corners)):
                raise endless
            z = np.unique(np.round(corners, 10), axis=0)
        return self.centre + self.half_width * z

    def contains(self, p: np.ndarray) -> np.ndarray:
        """(n,) bool: which samples of `p` (n, len(names)) lie inside.

        Parameters
        ----------
        p : (n, len(names)) array
            Samples, in the units of the variables.

        Returns
        -------
        (n,) bool array
            Which lie inside.
        """
        z = (np.asarray(p, dtype=float) - self.centre) / self.half_width
        inside = np.ones(len(z), dtype=bool)
        for first in range(0, len(z), CHUNK):
            part = slice(first, first + CHUNK)
            inside[part] = np.all(z[part] @ self.normals.T <= self.offsets + SLACK, axis=1)
        return inside

    @property
    def middle(self) -> np.ndarray:
        """(n,) mean of the vertices, a point inside [units of the variables]; to ten digits of the widths."""
        return self.centre + self.half_width * np.round((self.vertices() - self.centre) / self.half_width, 10).mean(
            axis=0).round(10)

    @property
    def points(self) -> np.ndarray:
        """(N, n) the vertices and a grid inside, each once [units of the variables]."""
        vertices, count = self.vertices(), GRID.get(len(self.names), 4)
        axes = np.linspace(vertices.min(axis=0), vertices.max(axis=0), count).T
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(self.names))
        return np.unique(np.vstack([vertices, grid[self.contains(grid)]]), axis=0)

    @property
    def text(self) -> str:
        """The set in a few words."""
        return f"a polytope of {len(self.vertices())} vertices over {', '.join(self.names)}"

    def scaled(self, factor: float) -> Hull:
        """The set about its middle, all widths times a factor.

        Parameters
        ----------
        factor : float
            Above zero.

        Returns
        -------
        Hull

        Examples
        --------
        >>> Hull.disc(("c", "s"), sides=4).scaled(0.5).vertices().round(6).tolist()
        [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]]
        """
        middle = self.normals @ ((self.middle - self.centre) / self.half_width)
        return replace(self, offsets=factor * self.offsets + (1 - factor) * middle)

    def over(self, names: Sequence[str]) -> Hull:
        """The same set over some of its variables, in another order.

        Parameters
        ----------
        names : sequence of str
            Some of `names`, each once.

        Returns
        -------
        Hull
            Its projection, the hull of the projected vertices: every value that these variables take in the set.
        """
        if tuple(names) == self.names:
            return self
        columns = [self.names.index(_checks.known_name(n, self.names, "variable of the hull")) for n in names]
        return Hull.of(tuple(names), self.vertices()[:, columns])

    def span(self, origin: np.ndarray, direction: np.ndarray) -> tuple[float, float] | None:
        """The part of the line origin + s·direction that lies inside.

        Parameters
        ----------
        origin, direction : (n,) arrays
            In the units of the variables.

        Returns
        -------
        (low, high) of s, or None
            None where the line misses the set.
        """
        slope = self.normals @ (np.asarray(direction) / self.half_width)
        room = self.offsets - self.normals @ ((np.asarray(origin) - self.centre) / self.half_width)
        level = np.finfo(float).eps * len(self.names) * np.linalg.norm(np.asarray(direction) / self.half_width)
        down, up = slope < -level, slope > level
        low = np.max(room[down] / slope[down], initial=-np.inf)
        high = np.min(room[up] / slope[up], initial=np.inf)
        return (float(low) + 0.0, float(high) + 0.0) if low <= high and np.all(room[~(down | up)] >= -SLACK) else None

    def enclosing(self, box: Scheduling) -> Scheduling:
        """The least box around the set.

        Parameters
        ----------
        box : Scheduling
            Of the same variables in any order: gives names, units and rates.

        Returns
        -------
        Scheduling
            With the lowest and highest value of each variable in the set.
        """
        vertices = self.over(box.names).vertices()
        return replace(box, lower=tuple(vertices.min(axis=0).tolist()), upper=tuple(vertices.max(axis=0).tolist()))

    @classmethod
    def array_shapes(cls, values: Mapping) -> dict[str, tuple[int, ...]]:
        return {"normals": (-1, len(values["names"]))}


def _facets(z: np.ndarray) -> np.ndarray | None:
    """(facets, n) outward normals of the convex hull, or None where there are too many or the data are flat."""
    from scipy.spatial import ConvexHull, QhullError

    corners = np.empty((0, z.shape[1]))
    try:
        for first in range(0, len(z), CHUNK):
            hull = ConvexHull(np.vstack([corners, z[first: first + CHUNK]]))
            corners = hull.points[hull.vertices]
            if len(corners) > CORNERS:
                return None
    except QhullError:
        return None
    normals = np.unique(np.round(hull.equations[:, :-1], 12), axis=0)
    return normals if len(normals) <= FACETS else None


def _reach(z: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(facets,) largest n·z over the samples: no sample is left outside by rounding."""
    return np.max([(z[i: i + CHUNK] @ normals.T).max(axis=0) for i in range(0, len(z), CHUNK)], axis=0)


def directions(n: int, count: int) -> np.ndarray:
    """(≤ count, n) unit vectors: the axes, the diagonals of every pair, then an even spread that never changes.

    Parameters
    ----------
    n : int
        Dimension.
    count : int
        Directions at most.

    Returns
    -------
    (≤ count, n) array
        One direction a row.
    """
    rows = [sign * row for row in np.eye(n) for sign in (1.0, -1.0)]
    for i, j in combinations(range(n), 2):
        for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            row = np.zeros(n)
            row[i], row[j] = a, b
            rows.append(row / np.sqrt(2))
    rows = rows[:count] if len(rows) > count else rows
    if n == 1:
        return np.array(rows)
    if n == 2:
        angles = 2 * np.pi * np.arange(count - len(rows)) / max(count - len(rows), 1)
        return np.vstack([*rows, np.column_stack([np.cos(angles), np.sin(angles)])])
    spread = np.random.default_rng(0).standard_normal((count - len(rows), n))
    return np.vstack([*rows, spread / np.linalg.norm(spread, axis=1, keepdims=True)])


def hull_of(model: Model) -> Hull | None:
    """The training hull that a model's metadata describes, or None.

    Parameters
    ----------
    model : model
        Any kind with metadata.

    Returns
    -------
    Hull or None
        The hull.
    """
    data = model.metadata.get(KEY)
    return Hull.from_dict(data) if isinstance(data, Mapping) else None


def design_hull(model: Model) -> Hull | None:
    """The hull that a controller or closed loop was designed for: analyses look at it in place of the box.

    That of an identified model is the region of its training data, and no limit of where it is used.

    Parameters
    ----------
    model : model
        Any kind with metadata.

    Returns
    -------
    Hull or None
        Over the variables of the model's own box, in their order; None for a design over a box, for a model that was
        not designed, and without scheduling.
    """
    hull, names = hull_of(model), model.box.names
    if hull is None or not role_of(model) or not names or not set(names) <= set(hull.names):
        return None
    return hull.over(names)


def corners_of(model: Model, most: int) -> np.ndarray:
    """Corners of a model's box, or of the hull that its metadata describe.

    Parameters
    ----------
    model : model
        Any kind with a box.
    most : int
        So many of them at most: the first of a box, evenly spread ones of a hull.

    Returns
    -------
    (N, n_scheduling) array
        In the order of the box's variables, and their units; (1, 0) without scheduling.
    """
    hull, names = hull_of(model), model.box.names
    if hull is None or not names or not set(names) <= set(hull.names):
        return model.box.grid(2)[:most] if names else np.zeros((1, 0))
    corners = np.unique(hull.vertices()[:, [hull.names.index(n) for n in names]], axis=0)
    return corners[np.unique(np.linspace(0, len(corners) - 1, most).astype(int))]


def inside(model: Model, p: np.ndarray) -> np.ndarray:
    """(n,) bool: samples of `p` (n, n_scheduling) in the training box and, where the model has one, the hull.

    Parameters
    ----------
    model : model
        Any kind with a box; a hull of variables that it lacks is not looked at.
    p : (n, n_scheduling) array
        Samples in the order of the box's variables, and their units.

    Returns
    -------
    (n,) bool array
        Which lie inside.
    """
    within, names = model.box.contains(p), model.box.names
    hull = hull_of(model)
    if hull is None or not set(hull.names) <= set(names):
        return within
    return within & hull.contains(p[:, [names.index(n) for n in hull.names]])


def outside_share(model: Model, p: np.ndarray) -> float:
    """Share of scheduling samples at which the model extrapolates.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
    p : (n, n_scheduling) array

    Returns
    -------
    float
    """
    return float(np.mean(~inside(model, p))) if p.shape[1] and len(p) else 0.0
