"""Where the inequalities of a design are imposed, and controllers that are known at the points of a grid."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.lmi.certificate import tensor
from lpvid.scheduling import Basis, Fourier, Polynomial, Product, Scheduling, Spline
from lpvid.synthesis.generalized_plant import GeneralizedPlant

MOST_POINTS = 400
"""Points of a tensor grid above which a design is refused rather than begun."""
CELLS = 3
"""Parts into which cells of the design grid are divided where a matrix is tabulated or fitted."""
HIGHEST = {1: 5, 2: 3}
"""Highest degree of a fitted polynomial by the number of variables; 2 for more. Of a Fourier series, harmonics."""
MISFIT = 1e-3
ROUNDING = 4096 * np.finfo(float).eps
"""share of a block's largest entry: what a regression of a few thousand operations leaves of a gain that is constant"""


def design_axes(box: Scheduling, points: int, affine: bool, given: Mapping[str, np.ndarray] | None = None
                ) -> tuple[np.ndarray, ...]:
    """Values of each scheduling variable: the ends where inequalities are affine in it, `points` of them elsewhere.

    Parameters
    ----------
    box : Scheduling
        Ranges of the variables.
    points : int
        Values of each variable, at least 2, where inequalities are not affine.
    affine : bool
        The ends are enough.
    given : mapping of name to array, optional
        Values of some variables, in place of those.

    Returns
    -------
    tuple of arrays
        Rising values of each variable, in its unit; one value where it has no width.

    Raises
    ------
    InputError
        More than `MOST_POINTS` combinations.
    """
    count = 2 if affine else _checks.count(points, "points of a design grid", at_least=2)
    axes = tuple(given[name] if given and name in given else np.unique([low, high]) if low == high or affine
                 else np.linspace(low, high, count)
                 for name, low, high in zip(box.names, box.lower, box.upper, strict=True))
    total = int(np.prod([len(a) for a in axes], initial=1))
    if total > MOST_POINTS:
        raise InputError(f"the grid of {', '.join(box.names)} has {total} points", why=f"the limit is {MOST_POINTS}",
                         mend=_smaller(len(box.names), count))
    return axes


def with_breaks(axes: tuple[np.ndarray, ...], box: Scheduling, *bases: Basis) -> tuple[np.ndarray, ...]:
    """Axes with the breakpoints of some tables among their values: a gain between them would be looked at nowhere.

    Parameters
    ----------
    axes : tuple of arrays
        Rising values of each variable of the box.
    box : Scheduling
    *bases : Basis
        Over variables of the box.

    Returns
    -------
    tuple of arrays

    Examples
    --------
    >>> box = Scheduling(("p",), (0.0,), (1.0,))
    >>> with_breaks((np.array([0.0, 1.0]),), box, Spline("p", 2, 1).bound(box))[0].tolist()
    [0.0, 0.5, 1.0]
    """
    found = list(axes)
    for basis in bases:
        for reading in basis.readings():
            i = box.names.index(reading.name)
            inside = [b for b in reading.breaks if box.lower[i] < b < box.upper[i]]
            found[i] = np.union1d(found[i], inside)
    return tuple(found)


def _smaller(variables: int, points: int) -> str:
    """What brings a tensor grid below the limit."""
    most = int(MOST_POINTS ** (1 / variables) + 1e-9)
    fewer = f"at most {most} points along each variable, " if 2 <= most < points else ""
    return (f"{fewer}a form of the plant with fewer scheduling variables (another realisation, or a reduced one), or "
            "one that is affine in each, of which the corners alone are looked at")


def finer(axes: tuple[np.ndarray, ...], cells: int) -> tuple[np.ndarray, ...]:
    """Axes with every interval divided into `cells`.

    Parameters
    ----------
    axes : tuple of arrays
        Rising values of each variable.
    cells : int
        Parts of every interval.

    Returns
    -------
    tuple of arrays
        With the given values among them; an axis of one value stays.

    Examples
    --------
    >>> finer((np.array([0.0, 1.0, 3.0]),), 2)[0].tolist()
    [0.0, 0.5, 1.0, 2.0, 3.0]
    """
    def divided(axis: np.ndarray) -> np.ndarray:
        parts = [np.linspace(a, b, cells + 1) for a, b in itertools.pairwise(axis)]
        return np.unique(np.concatenate(parts)) if parts else axis

    return tuple(divided(axis) for axis in axes)


def distinct(stacks: Sequence[np.ndarray]) -> list[int]:
    """The first of all points at which every block is the same, but for rounding of its largest entry.

    Parameters
    ----------
    stacks : sequence of (N, …) arrays
        Blocks at N points.

    Returns
    -------
    list of int
        Rising.

    Examples
    --------
    >>> p = np.array([-np.pi, 0.0, np.pi])
    >>> distinct([np.stack([np.cos(p), np.sin(p)], axis=1)])
    [0, 1]
    """
    rows = np.hstack([s.reshape(len(s), -1) / max(float(np.abs(s).max(initial=0.0)), 1e-300) for s in stacks])
    kept: list[int] = []
    for k, row in enumerate(rows):
        if not (np.abs(rows[kept] - row).max(axis=1, initial=0.0) <= ROUNDING).any():
            kept.append(k)
    return kept


def varies(stack: np.ndarray) -> bool:
    """Entries of (N, …) values differ from point to point by more than rounding leaves of a fitted plant.

    Parameters
    ----------
    stack : (N, …) array
        Values at N points.

    Returns
    -------
    bool
        False for an empty array.

    Examples
    --------
    >>> varies(np.array([1.0, 1.0 + 4e-16])), varies(np.array([1.0, 1.001]))
    (False, True)
    """
    return bool(stack.size and np.ptp(stack, axis=0).max() > ROUNDING * np.abs(stack).max())


def is_affine(basis: Basis) -> bool:
    """Along every coordinate: then a matrix inequality that is linear in these functions holds where corners do.

    Parameters
    ----------
    basis : Basis
        Functions of the scheduling.

    Returns
    -------
    bool
        False for a table and for whatever is neither a polynomial nor a product of such.
    """
    if isinstance(basis, Product):
        separate = not set(basis.first.names) & set(basis.second.names)
        return separate and is_affine(basis.first) and is_affine(basis.second)
    return isinstance(basis, Polynomial) and basis.degree <= 1


def interpolating(box: Scheduling, axes: tuple[np.ndarray, ...]) -> Basis:
    """Functions that are linear between neighbouring points of every axis: one for each point, in `tensor`'s order.

    Parameters
    ----------
    box : Scheduling
        Names the axes.
    axes : tuple of arrays
        Rising values of each variable.

    Returns
    -------
    Basis
        Splines of degree one and their products; the constant where no axis has two values.

    Examples
    --------
    >>> box = Scheduling(("p", "q"), (0, 0), (1, 2))
    >>> interpolating(box, (np.array([0.0, 1.0]), np.array([0.0, 1.0, 2.0]))).evaluate(np.array([[0.0, 1.0]])).round(2)
    array([[0., 1., 0., 0., 0., 0.]])
    """
    factors: list[Basis] = [Spline(n, len(a) - 1, 1, tuple(a.tolist())) for n, a in zip(box.names, axes, strict=True)
                            if len(a) > 1]
    return reduce(Product, factors) if factors else Polynomial((), 0)


def fitted(values: Callable[[np.ndarray], np.ndarray], box: Scheduling, axes: tuple[np.ndarray, ...],
           basis: Basis) -> tuple[Basis, np.ndarray]:
    """A matrix known at every point of a box as a combination of functions: coefficients (M, …) over a basis.

    For a polynomial `basis` a polynomial of the least degree that misses every entry by less than `MISFIT` of its size
    (or of the highest degree tried), for a Fourier series over the only variable that moves such a series (if one
    misses by less); else a table, linear between the points of a grid finer than `axes`.

    box : Scheduling
        Ranges of the variables.
    axes : tuple of arrays
        Grid of the design.
    basis : Basis
        Of the plant: its kind decides what is tried.

    Parameters
    ----------
    values : callable
        (N, …) values at (N, n_scheduling) points.

    Returns
    -------
    Basis
        Polynomial, Fourier series or table.
    (M, …) array
        Coefficients over it.
    """
    finest = finer(axes, CELLS)
    points = tensor(finest)
    table = values(points)
    flat = table.reshape(len(points), -1)
    sizes, best, close = np.abs(flat).max(axis=0, initial=0.0), None, False
    sizes = sizes + 1e-6 * sizes.max(initial=1e-300)
    for tried in _rising(basis, box):
        phi = columns(box, tried, points)
        found = np.linalg.lstsq(phi, flat, rcond=None)[0]
        best = tried, found.reshape(tried.size, *table.shape[1:])
        close = bool(np.all(np.abs(phi @ found - flat) <= MISFIT * sizes))
        if close:
            break
    if best is None or not (close or isinstance(basis, Polynomial)):
        return interpolating(box, finest), table
    return best


def _rising(basis: Basis, box: Scheduling) -> Iterator[Basis]:
    """Smooth functions of rising degree, of the kind of a basis; none where that is neither of two."""
    highest = HIGHEST.get(len(box.names), 2)
    if isinstance(basis, Polynomial):
        for degree in range(highest + 1):
            yield Polynomial(box.names, degree).bound(box)
    elif isinstance(basis, Fourier) and box.names == basis.names:
        for harmonics in range(1, highest + 1):
            yield replace(basis, harmonics=harmonics)


def richer(plant: GeneralizedPlant, lyapunov: Basis, axes: tuple[np.ndarray, ...]) -> Basis:
    """Functions for an unknown gain beside a Lyapunov matrix that moves: a degree more, or free at every point.

    Parameters
    ----------
    plant : GeneralizedPlant
        Its basis and box.
    lyapunov : Basis
        Functions of the Lyapunov matrix.
    axes : tuple of arrays
        Grid of the design.

    Returns
    -------
    Basis
        Polynomial or Fourier series where both bases are, else one function for each point of the grid.
    """
    own = plant.system.basis
    if isinstance(lyapunov, Polynomial) and isinstance(own, Polynomial):
        return Polynomial(plant.box.names, max(own.degree, lyapunov.degree) + 1).bound(plant.box)
    if isinstance(lyapunov, Fourier) and isinstance(own, Fourier) and plant.box.names == lyapunov.names == own.names:
        return replace(lyapunov, harmonics=max(own.harmonics, lyapunov.harmonics) + 1)
    return interpolating(plant.box, axes)


def storage_for(lyapunov: Basis) -> Basis:
    """Functions in which the inverse of a Lyapunov matrix over others is looked for: two degrees more.

    Parameters
    ----------
    lyapunov : Basis
        Functions of the Lyapunov matrix.

    Returns
    -------
    Basis
        One degree more for several variables; `lyapunov` itself where it is no polynomial, or constant.
    """
    if isinstance(lyapunov, Polynomial) and lyapunov.names:
        return Polynomial(lyapunov.names, lyapunov.degree + (2 if len(lyapunov.names) == 1 else 1))
    return lyapunov


def columns(box: Scheduling, basis: Basis, points: np.ndarray) -> np.ndarray:
    """(N, M) values of a basis over some of a box's variables, at points over all of them.

    Parameters
    ----------
    box : Scheduling
        Names the columns of the points.
    basis : Basis
        Reads some of them.
    points : (N, n_scheduling) array
        Scheduling values.

    Returns
    -------
    (N, M) array
        One column for each function.
    """
    return basis.evaluate(np.atleast_2d(points)[:, [box.names.index(n) for n in basis.names]])


def moving_basis(lyapunov: Basis | None) -> Basis | None:
    """Functions in which a Lyapunov matrix moves.

    Parameters
    ----------
    lyapunov : Basis or None
        As given to a design.

    Returns
    -------
    Basis or None
        None for a constant one.

    Raises
    ------
    InputError
        What is no basis.
    """
    constant = isinstance(lyapunov, Polynomial) and lyapunov.degree == 0
    if lyapunov is None or constant or (isinstance(lyapunov, Basis) and not lyapunov.names):
        return None
    if not isinstance(lyapunov, Basis):
        raise InputError("`lyapunov` is a basis over scheduling variables", got=type(lyapunov).__name__,
                         mend='Polynomial("name of a variable", degree)')
    return lyapunov


def check_rates(basis: Basis, box: Scheduling, sample_time: float | None) -> None:
    """Refuse a Lyapunov matrix that no certificate covers, or over a variable of unbounded rate in continuous time.

    Parameters
    ----------
    basis : Basis
        Of the Lyapunov matrix.
    box : Scheduling
        With its rate bounds [units/s]; None for none.
    sample_time : float or None
        [s]; None in continuous time. In discrete time no rate bound is needed.

    Raises
    ------
    InputError
        A variable that is not in the box, or one with width and no rate bound in continuous time.
    """
    basis.readings()
    for name in basis.names:
        i = box.names.index(_checks.known_name(name, box.names, "scheduling variable"))
        if sample_time is None and box.rate[i] is None and box.upper[i] > box.lower[i]:
            raise InputError(f"the Lyapunov matrix depends on '{name}', whose rate has no bound",
                             why="a function that may jump cannot decrease along every trajectory",
                             mend=f"give '{name}' a rate bound in its Scheduling, or leave it out of `lyapunov`")


def check_back_off(factor: float) -> None:
    """Refuse a factor above the least gain that is below one.

    Parameters
    ----------
    factor : float
        The back-off of a design.

    Raises
    ------
    InputError
        A factor below 1.
    """
    if not _checks.real(factor, "back_off") >= 1:
        raise InputError("back_off must be at least 1", got=factor, why="it multiplies the least gain",
                         mend="1.02 stops 2 % above it")
