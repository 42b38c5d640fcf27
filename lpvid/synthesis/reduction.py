"""Model reduction by balancing: one change of states for all scheduling, weak states cut off, the error reported."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.analysis.frozen import pole_margins
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.errors import InputError, NumericalError
from lpvid.lmi.driven import Matrices
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis._gramians import averaged_gramian, bounding_gramian, frozen_matrices
from lpvid.synthesis.forms import multi_affine

WEAK = 1e-10
"""Directions of the states weaker than this share of the strongest are not excited, or not seen, but rounding."""


@dataclass(frozen=True, eq=False)
class Reduction:
    """A system with fewer states, and how far its frozen responses are from those of the full one.

    Parameters
    ----------
    model : LPVStateSpace
    singular_values : (n,) array
        √eig(P Q) of the gramians used, falling.
    bound : float or None
        2 Σ of the singular values that were cut: no induced L2 gain of the difference is larger, for any trajectory
        through the grid's points (Wood, Goddard & Glover 1996). None for averaged gramians, which promise nothing.
    between_grid : bool
        True where the bound holds on the whole box: the system is affine in every variable, and so are the inequalities
        (written with a Schur complement), whose corners are points of the grid.
    error : float
        Largest H-infinity norm of the frozen differences over the grid.
    at : tuple of float
        Scheduling where that is.
    size : float
        Largest H-infinity norm of the full system over the grid.
    points : int
        Points of the grid.
    """

    model: LPVStateSpace
    singular_values: np.ndarray
    bound: float | None
    between_grid: bool
    error: float
    at: tuple[float, ...]
    size: float
    points: int

    def __str__(self) -> str:
        names = self.model.box.names
        where = ", ".join(f"{n} = {v:.4g}" for n, v in zip(names, self.at, strict=True)) or "all of the box"
        bound = ("no bound (averaged gramians)" if self.bound is None else
                 f"bound 2Σσ = {self.bound:.4g} " + ("on the whole box" if self.between_grid else
                                                     f"for the grid's {self.points} points only"))
        return (f"{len(self.singular_values)} -> {self.model.order} states: frozen error {self.error:.4g} of "
                f"{self.size:.4g} ({where}), {bound}\n"
                f"singular values {', '.join(f'{s:.3g}' for s in self.singular_values[:12])}")

    __repr__ = __str__


def reduce_order(system: LPVStateSpace, order: int | None = None, *, tolerance: float = 1e-3, points: int = 5,
                 certified: bool = True) -> Reduction:
    """Balance over a grid of the scheduling and keep the states with the largest singular values.

    Gramians for all points p of the grid at once: A P + P Aᵀ + B Bᵀ ⪯ 0 and Aᵀ Q + Q A + Cᵀ C ⪯ 0 (discrete:
    A P Aᵀ − P + B Bᵀ ⪯ 0 …), by matrix inequalities and re-checked with numpy, or the means of the frozen gramians. The
    states that balance them are constant combinations of the old ones, so the basis stays.

    Parameters
    ----------
    system : LPVStateSpace
        Stable at every point of the grid.
    order : int, optional
        States to keep; left out, as few as keep 2 Σσ of the rest below `tolerance` times the largest.
    tolerance : float
    points : int
        Points of the grid for each scheduling variable.
    certified : bool
        Whether to solve the inequalities. They need a common Lyapunov function, a mean does not.

    Returns
    -------
    Reduction
        The smaller system, with its error.

    Raises
    ------
    InputError
        A system that is unstable at a point of the grid.
    NumericalError
        No common gramians exist (or none was found).

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> system = LPVStateSpace([np.diag([-1.0, -30.0]), np.diag([-0.5, 0.0])], [[[1.0], [1.0]], [[0.0], [0.0]]],
    ...                        [[[1.0, 1.0]], [[0.0, 0.0]]], np.zeros((2, 1, 1)), Polynomial("p", 1), None)
    >>> smaller = reduce_order(system, 1)
    >>> smaller.model.order, smaller.error < smaller.bound < 0.1
    (1, True)
    """
    _checks.instance(system, LPVStateSpace, "a reduction is of a state space",
                     'lpv.realize(model, form="augmented").model')
    grid = system.box.grid(_checks.count(points, "points of the grid", at_least=2))
    a, b, c, d = frozen_matrices(system, grid)
    _refuse_unstable(system, a, grid)
    p, q = _gramians(system, a, b, c, certified)
    left, right, values = _balancing(p, q)
    n = len(values) if order is None else _checks.count(order, "order")
    if order is None:
        tail = 2 * np.concatenate([np.cumsum(values[::-1])[::-1], [0.0]])
        n = int(np.argmax(tail <= tolerance * values.max(initial=0.0)))
    if n > system.order:
        raise InputError("a reduced model cannot have more states than the full one", got=f"{n} of {system.order}")
    n = min(n, int(np.sum(values > 1e-9 * values.max(initial=0.0))))  # the rest cannot be balanced, and does nothing
    model = _transformed(system, left[:n], right[:, :n])
    discrete = system.sample_time is not None
    gaps = [h_infinity_norm(_difference(full, part), discrete)[0]
            for full, part in zip(zip(a, b, c, d, strict=True), zip(*frozen_matrices(model, grid), strict=True),
                                  strict=True)]
    sizes = [h_infinity_norm(full, discrete)[0] for full in zip(a, b, c, d, strict=True)]
    worst = int(np.argmax(gaps))
    bound = float(2 * values[n:].sum()) if certified else None
    return Reduction(model, values, bound, certified and multi_affine(system), float(gaps[worst]),
                     tuple(grid[worst].tolist()), float(max(sizes)), len(grid))


def balanced_realization(system: LPVStateSpace, points: int = 5) -> LPVStateSpace:
    """The same system in states whose (averaged) gramians are equal and diagonal; states without influence are dropped.

    For an unstable system, where there are no gramians, the states are scaled only. Inequalities in balanced states
    lose far fewer digits than in companion forms.

    Parameters
    ----------
    system : LPVStateSpace
        Continuous or discrete.
    points : int
        Points of the grid for each scheduling variable, over which the gramians are averaged.

    Returns
    -------
    LPVStateSpace
        Same signals and basis; the system itself where it has no states.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> companion = LPVStateSpace([[[0.0, 1.0], [-1e6, -1e3]]], [[[0.0], [1.0]]], [[[1e6, 0.0]]], [[[0.0]]],
    ...                           Polynomial(), None)
    >>> bool(abs(balanced_realization(companion).B).max() < 50)
    True
    """
    if not system.order:
        return system
    system = _seen(_excited(_scaled(system)))
    if not system.order:
        return system
    grid = system.box.grid(points)
    a, b, c, _ = frozen_matrices(system, grid)
    if np.max(pole_margins(a, system.sample_time is not None)) >= 0:
        return system
    discrete = system.sample_time is not None
    left, right, _ = _balancing(averaged_gramian(a, b, discrete),
                                averaged_gramian(a.swapaxes(1, 2), c.swapaxes(1, 2), discrete))
    return _transformed(system, left, right)


def _gramians(system: LPVStateSpace, a: np.ndarray, b: np.ndarray, c: np.ndarray, certified: bool
              ) -> tuple[np.ndarray, np.ndarray]:
    discrete = system.sample_time is not None
    at, ct = a.swapaxes(1, 2), c.swapaxes(1, 2)
    p, q = averaged_gramian(a, b, discrete), averaged_gramian(at, ct, discrete)
    if not certified or not system.order:
        return p, q
    bounding_p = bounding_gramian(a, b, q, discrete)
    bounding_q = None if bounding_p is None else bounding_gramian(at, ct, bounding_p, discrete)
    if bounding_p is None or bounding_q is None:
        raise NumericalError("no gramians hold at all points of the grid together: the system needs a Lyapunov "
                             "function that moves with the scheduling, or has none; certified=False balances without "
                             "a bound")
    return bounding_p, bounding_q


def _balancing(p: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """T⁻¹, T and σ with T⁻¹ P T⁻ᵀ = Tᵀ Q T = diag σ, by square roots (Laub, Heath, Paige & Ward 1987)."""
    root_p, root_q = _root(p), _root(q)
    u, s, v = np.linalg.svd(root_q.T @ root_p)
    safe = np.sqrt(np.maximum(s, WEAK * max(s.max(initial=0.0), 1e-300)))
    return (u / safe).T @ root_q.T, root_p @ v.T / safe, s


def _root(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _excited(system: LPVStateSpace) -> LPVStateSpace:
    """Without the states that no input reaches at any time: the smallest V ⊇ B_m with A_m V ⊂ V for every m."""
    assert system.state_offset is not None
    v = _invariant(system.A, np.concatenate([*system.B, system.state_offset.T], axis=1))
    return _transformed(system, v.T, v)


def _seen(system: LPVStateSpace) -> LPVStateSpace:
    """Without the states that reach no output."""
    v = _invariant(system.A.swapaxes(1, 2), np.concatenate(list(system.C)).T)
    return _transformed(system, v.T, v)


def _invariant(a: np.ndarray, start: np.ndarray) -> np.ndarray:
    v = _orthonormal(start)
    for _ in range(len(a[0])):
        wider = _orthonormal(np.concatenate([v, *(x @ v for x in a)], axis=1))
        if wider.shape[1] == v.shape[1]:
            break
        v = wider
    return v


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    sizes = np.linalg.norm(columns, axis=0)
    kept = columns[:, sizes > WEAK * sizes.max(initial=0.0)] / sizes[sizes > WEAK * sizes.max(initial=0.0)]
    u, s, _ = np.linalg.svd(kept, full_matrices=False)
    return u[:, s > WEAK]


def _scaled(system: LPVStateSpace) -> LPVStateSpace:
    """Diagonal scaling of the states to rows and columns of like size (Osborne), B and C included."""
    from scipy.linalg import matrix_balance

    a, b, c = (np.abs(x).max(axis=0) for x in (system.A, system.B, system.C))
    n = system.order
    border = np.block([[a, b.max(axis=1, initial=0.0)[:, None]], [c.max(axis=0, initial=0.0)[None], np.zeros((1, 1))]])
    _, (scale, _) = matrix_balance(border, permute=False, separate=True)
    t = scale[:n] / scale[n]
    return _transformed(system, np.diag(1 / t), np.diag(t))


def _transformed(system: LPVStateSpace, left: np.ndarray, right: np.ndarray) -> LPVStateSpace:
    """x = right · z and z = left · x."""
    assert system.state_offset is not None
    gain = None if system.observer_gain is None else left @ system.observer_gain
    return system.replace(A=left @ system.A @ right, B=left @ system.B, C=system.C @ right,
                          state_offset=system.state_offset @ left.T, observer_gain=gain)


def _difference(full: Matrices, part: Matrices) -> Matrices:
    (a, b, c, d), (e, f, g, h) = full, part
    n, m = len(a), len(e)
    return (np.block([[a, np.zeros((n, m))], [np.zeros((m, n)), e]]), np.vstack([b, f]), np.hstack([c, -g]), d - h)


def _refuse_unstable(system: LPVStateSpace, a: np.ndarray, grid: np.ndarray) -> None:
    margins = pole_margins(a, system.sample_time is not None)
    if np.max(margins) >= 0:
        worst = grid[int(np.argmax(margins))]
        where = ", ".join(f"{n} = {v:.4g}" for n, v in zip(system.box.names, worst, strict=True))
        raise InputError("only a stable system has gramians", got=f"a pole beyond the limit at {where or 'all times'}",
                         mend="reduce the stable part, or the closed loop")
