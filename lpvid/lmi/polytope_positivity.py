"""Is a matrix inequality with a storage function that moves true on a whole polytope, and not only at its vertices?

With P(p) of degree d and a system of degree a the inequality is a polynomial of degree d + a in p (d + 2a in discrete
time), and affine in the rates, or in the step, where P is: corners of these suffice, vertices of the polytope do not.
It is cut into simplices around its middle. On each

    p(s) = v₀ + s₁(v₁ − v₀ + s₂(v₂ − v₁ + …)),    0 ≤ s ≤ 1,

is affine in every s (Duffy, SIAM J. Numerical Analysis 19, 1982), so that the inequality is a polynomial of the same
degree in each, which Bernstein coefficients on the unit cube decide. Where they do not at once, the cube is halved:
they come quadratically close to the values, so no share of the bound is lost as with one condition for each pair of
vertices (the coefficients of degree two on the polytope as it is).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lpvid.lmi.bernstein import Positivity
from lpvid.lmi.box_positivity import Axis, everywhere
from lpvid.lmi.certificate import EPS, Recheck
from lpvid.lmi.driven import Driven
from lpvid.lmi.inequality import LyapunovInequality, budget_for, recheck_inequality, recheck_vertices, root_of
from lpvid.lmi.storage import Storage
from lpvid.scheduling import Basis, Polynomial, Scheduling

CUBES = 8
"""times the budget of a box for all simplices together: some eight seconds"""

EDGE = 12
"""parts of every edge of the simplices by the points at which frozen models are looked at"""
FROZEN = 20_000
"""of these points at most: some two seconds of eigenvalues at ten states"""


def simplices(vertices: np.ndarray) -> np.ndarray:
    """The simplices around the middle of a polytope that fill it.

    Parameters
    ----------
    vertices : (V, n) array
        Whose convex hull the polytope is.

    Returns
    -------
    (S, n + 1, n) array
        The middle first; a simplex is left whole.

    Examples
    --------
    >>> square = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    >>> len(simplices(square)), len(simplices(square[:3])), simplices(np.array([[1.0], [3.0]])).tolist()
    (4, 1, [[[1.0], [3.0]]])
    """
    from scipy.spatial import ConvexHull  # here, so that a certificate on a box needs numpy alone

    n = vertices.shape[1]
    if n == 1:
        return np.array([[[vertices.min()], [vertices.max()]]])
    if len(vertices) == n + 1:
        return vertices[None]
    middle, width = vertices.mean(axis=0), np.ptp(vertices, axis=0)
    facets = ConvexHull((vertices - middle) / np.where(width > 0, width, 1.0)).simplices
    return np.stack([np.vstack([middle, vertices[facet]]) for facet in facets])


def total_degree(system: Driven) -> int | None:
    """Highest total degree of a system's matrices in what they read; None for one that is no polynomial of p now.

    Parameters
    ----------
    system : Driven

    Returns
    -------
    int or None
    """
    if not isinstance(system.basis, Polynomial) or any(r.lag for r in system.readings):
        return None
    used = system.coefficients[:-1].any(axis=(1, 2))
    return int(system.basis.exponents.sum(axis=1)[used].max(initial=0))


def decidable(system: Driven, basis: Basis) -> str:
    """Why an inequality of a system and a storage function is not decided on a polytope; empty where it is.

    Parameters
    ----------
    system : Driven
    basis : Basis
        Of the storage function.

    Returns
    -------
    str
    """
    if total_degree(system) is None:
        return "the model is no polynomial of its scheduling"
    if not isinstance(basis, Polynomial):
        return "the storage function is no polynomial of the scheduling"
    if system.sample_time is not None and basis.degree > 1:
        return "in discrete time corners of a step decide for a storage function of degree one only"
    return ""


def recheck_on(problem: LyapunovInequality, vertices: np.ndarray | None, *, budget: int | None = None) -> Recheck:
    """Check an inequality on the box, or on a polytope: by its vertices where these decide, else by `recheck_polytope`.

    Parameters
    ----------
    problem : LyapunovInequality
    vertices : (V, readings) array or None
        None for the box of the storage function.
    budget : int, optional
        Matrices that subdivision may examine.

    Returns
    -------
    Recheck
    """
    if vertices is None:
        return recheck_inequality(problem, budget=budget)
    still = not problem.storage.basis.names
    return recheck_vertices(problem, vertices) if still else recheck_polytope(problem, vertices, budget=budget)


def recheck_polytope(problem: LyapunovInequality, vertices: np.ndarray, *, budget: int | None = None) -> Recheck:
    """Check P ≻ 0 and F ≻ 0 on a polytope, for every corner of the rates of the storage function's box.

    In discrete time for a step of at most the rate bounds, from anywhere in the polytope, to outside of it too; where
    one of these is missing, for every step within the polytope.

    Parameters
    ----------
    problem : LyapunovInequality
        A storage function whose box is around the polytope; in continuous time with rate bounds wherever it moves.
    vertices : (V, readings) array
        Over the variables of that box.
    budget : int, optional
        Matrices that subdivision may examine.

    Returns
    -------
    Recheck
        Holds between vertices, or not at all: there is no proof on a grid.
    """
    storage, system = problem.storage, problem.system
    why = decidable(system, storage.basis)
    if why:
        return Recheck(False, False, math.nan, why)
    if storage.unbounded:
        return Recheck(False, False, -math.inf, "P depends on a variable whose rate has no bound")
    jumps = any(storage.box.rate[i] is None for i in storage.moving)
    if system.sample_time is not None and not jumps:
        storage = replace(storage, box=stepped_box(storage))
        problem = replace(problem, storage=storage)  # type: ignore[type-var]
    root = root_of(storage)
    if root is None:
        return Recheck(False, False, -math.inf, "P is not positive definite at the centre of the box")
    own, degree = storage.basis.degree or 0, total_degree(system) or 0
    try:
        parts, scale = simplices(vertices), problem.congruence(root)
    except (RuntimeError, ValueError):  # the convex hull's QhullError is of the first kind
        return Recheck(False, False, math.nan, "the polytope has no inside, or is not finite")
    share = (budget or CUBES * budget_for(len(scale))) // len(parts)

    def definite(p: np.ndarray) -> tuple[np.ndarray, float]:
        values, size = root @ storage.values(p) @ root.T, np.abs(root) @ storage.magnitudes(p) @ np.abs(root.T)
        rounding = (4 * len(root) + 30) * EPS * float(size.sum(axis=2).max(initial=0.0))
        return 0.5 * (values + values.swapaxes(1, 2))[:, None], rounding

    margin = math.inf
    if len(root):
        found = _on_simplices(definite, parts, own, share)
        if not found.holds:
            return Recheck(False, False, found.bound, "P(p) is not shown to be positive definite on the polytope")
        margin = math.inf if not storage.readings else found.bound
    still = np.full((1, vertices.shape[1]), 0.5)
    if jumps:
        ahead = [(still, v[None]) for v in vertices]
    else:
        sides = [[0.0, 1.0] if i in storage.moving else [0.5] for i in range(vertices.shape[1])]
        ahead = [(np.array([move]), None) for move in itertools.product(*sides)]
    for move, landing in ahead:
        found = _on_simplices(lambda p, m=move, v=landing: problem.evaluate(p, m, scale, v), parts,
                              own + problem.power * degree, share)
        if not found.holds:
            what = "fails somewhere in" if found.holds is False else "is not decided on"
            return Recheck(False, False, found.bound, f"the inequality {what} the polytope")
        margin = min(margin, found.bound)
    return Recheck(True, True, margin, "proven on the polytope by Bernstein coefficients on its simplices")


def lattice(vertices: np.ndarray, order: int) -> np.ndarray:
    """Points of a polytope that divide every edge of its simplices into parts of one length, and what is between.

    Parameters
    ----------
    vertices : (V, n) array
    order : int
        Parts of an edge, at least 1: then the vertices and the middle.

    Returns
    -------
    (N, n) array
        Each once.

    Examples
    --------
    >>> lattice(np.array([[0.0], [2.0]]), 2).tolist()
    [[0.0], [1.0], [2.0]]
    """
    n = vertices.shape[1]
    bars = np.array(list(itertools.combinations(range(order + n), n)), dtype=int).reshape(-1, n)  # between order stars
    ends = np.full((len(bars), 1), order + n)
    shares = (np.diff(np.hstack([np.full((len(bars), 1), -1), bars, ends]), axis=1) - 1) / order
    points = (shares @ simplices(vertices)).reshape(-1, n)
    low, width = vertices.min(axis=0), np.ptp(vertices, axis=0)
    size = np.where(width > 0, width, 1.0)
    return np.asarray(low + size * np.unique(np.round((points - low) / size, 10), axis=0))


def dense(vertices: np.ndarray) -> np.ndarray:
    """Points of a polytope at which frozen models are looked at: twelve parts of an edge, fewer in many variables.

    Parameters
    ----------
    vertices : (V, n) array

    Returns
    -------
    (N, n) array
        As `lattice`, each once.

    Examples
    --------
    >>> square, cross = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]]), np.vstack([np.eye(6), -np.eye(6)])
    >>> len(dense(square)), len(dense(cross)) <= FROZEN
    (313, True)
    """
    n, parts = vertices.shape[1], len(simplices(vertices))
    affordable = (k for k in range(EDGE, 1, -1) if parts * math.comb(k + n, n) <= FROZEN)
    return lattice(vertices, next(affordable, 1))


def stepped_box(storage: Storage) -> Scheduling:
    """The box with what one sample adds to it on either side: no step from inside of the first ends at its edge.

    Parameters
    ----------
    storage : Storage
        With rate bounds of what moves, in discrete time.

    Returns
    -------
    Scheduling
        With the same rates.
    """
    box = storage.box
    more = [storage.reach(i) if i in storage.moving else 0.0 for i in range(len(box.names))]
    return replace(box, lower=tuple(a - r for a, r in zip(box.lower, more, strict=True)),
                   upper=tuple(b + r for b, r in zip(box.upper, more, strict=True)))


def _on_simplices(evaluate: Callable[[np.ndarray], tuple[np.ndarray, float]], parts: np.ndarray, degree: int,
                  budget: int) -> Positivity:
    """Whether a polynomial of a total degree is positive definite on all simplices."""
    axes = [Axis(0.0, 1.0, degree)] * parts.shape[2]
    bound, work = math.inf, 0
    for part in parts:
        found = everywhere(lambda s, _, part=part: evaluate(_placed(part, s)), axes, [], budget=budget)
        work += found.work
        if not found.holds:
            return Positivity(found.holds, found.bound, work)
        bound = min(bound, found.bound)
    return Positivity(True, bound, work)


def _placed(part: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(N, n) points of a simplex (n + 1, n) at (N, n) values of s."""
    shares = np.cumprod(s, axis=1)
    return part[0] + shares @ np.diff(part, axis=0)
