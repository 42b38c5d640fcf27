"""Matrix inequalities that are linear in a storage function P(p), and their re-check with numpy alone.

Everything is stated after the congruence that turns P at the centre of the box into the identity. Rounding errors are
bounded by evaluating the same expression with absolute values throughout.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.lmi.bernstein import Positivity
from lpvid.lmi.box_positivity import everywhere
from lpvid.lmi.certificate import EPS, GRID, Recheck, grid, tensor
from lpvid.lmi.driven import Driven
from lpvid.lmi.storage import Storage


@dataclass(frozen=True, eq=False)
class Pieces:
    """What an inequality is made of, at N points and T moves.

    Attributes
    ----------
    A, B, C, D : (N, 1, …) arrays
    P : (N, 1, n, n) array
    later : (N, T, n, n) array
        P one sample later; in continuous time Ṗ.
    sign : float
        −1 for values; +1 for magnitudes, where nothing may cancel.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    P: np.ndarray
    later: np.ndarray
    sign: float = -1.0

    @classmethod
    def of(cls, system: Sequence[np.ndarray], p: np.ndarray, later: np.ndarray, sign: float = -1.0) -> Pieces:
        """Of matrices at points.

        Parameters
        ----------
        system : (A, B, C, D), each (N, …)
            At the points.
        p : (N, n, n) array
            P there.
        later : (N, T, n, n) array
            P one sample later; in continuous time Ṗ.
        sign : float
            −1 for values; +1 for magnitudes.

        Returns
        -------
        Pieces
            With an axis for the moves.
        """
        a, b, c, d = (x[:, None] for x in system)
        return cls(a, b, c, d, p[:, None], later, sign)

    def eye(self, n: int, value: float) -> np.ndarray:
        """(N, T, n, n) value·I.

        Parameters
        ----------
        n : int
            Size.
        value : float
            Entry on the diagonal.

        Returns
        -------
        (N, T, n, n) array
            Read-only.
        """
        return np.broadcast_to(value * np.eye(n), (*self.later.shape[:2], n, n))


class LyapunovInequality(ABC):
    """F(p, move) ≻ 0, linear in P and of degree `power` in A, B, C, D.

    Attributes
    ----------
    system : Driven
    storage : Storage
    """

    system: Driven
    storage: Storage
    power: int

    @abstractmethod
    def matrix(self, pieces: Pieces) -> np.ndarray:
        """(N, T, m, m) F.

        Parameters
        ----------
        pieces : Pieces
            System and storage function at N points and T moves; with sign +1 their magnitudes.

        Returns
        -------
        (N, T, m, m) array
            F, symmetric; of magnitudes a bound of its entries.
        """

    @abstractmethod
    def congruence(self, root: np.ndarray) -> np.ndarray:
        """(m, m) what multiplies F from both sides, given W with W P(centre) Wᵀ = I.

        Parameters
        ----------
        root : (n, n) array
            W, the storage function's coordinates.

        Returns
        -------
        (m, m) array
            The scaling.
        """

    def evaluate(self, points: np.ndarray, moves: np.ndarray, scale: np.ndarray,
                 landing: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """(N, T, m, m) scaled F at `points` (N, s) and moves τ ∈ [0, 1] (T, s), and a bound of its rounding.

        Parameters
        ----------
        points : (N, s) array
            Scheduling, in the units of the variables.
        moves : (T, s) array
            Share of the rate range of each variable, τ ∈ [0, 1].
        scale : (m, m) array
            What `congruence` returned.
        landing : (T, s) array, optional
            In discrete time: scheduling one sample later, from every point, in place of the moves.

        Returns
        -------
        (N, T, m, m) array, float
            Scaled F and a bound of the rounding of its eigenvalues.
        """
        system, storage = self.system, self.storage
        if landing is None:
            later, later_size = (storage.later if system.sample_time is not None else storage.drift)(points, moves)
        else:
            later, later_size = (np.broadcast_to(x, (len(points), *x.shape)) for x in
                                 (storage.values(landing), storage.magnitudes(landing)))
        value = self.matrix(Pieces.of(system.matrices(points), storage.values(points), later, -1.0))
        size = self.matrix(Pieces.of(system.magnitudes(points), storage.magnitudes(points), later_size, 1.0))
        value, size = scale @ value @ scale.T, np.abs(scale) @ size @ np.abs(scale.T)
        rounding = (6 * value.shape[-1] + 30) * EPS * float(size.sum(axis=-1).max(initial=0.0))
        return 0.5 * (value + value.swapaxes(2, 3)), rounding

    def ceiling(self, scale: np.ndarray) -> float:
        """Bound of the largest absolute row sum of scaled F, trigonometric functions over their whole period.

        Parameters
        ----------
        scale : (m, m) array
            What `congruence` returned.

        Returns
        -------
        float
            The bound over the box.
        """
        size, speed = self.storage.ceilings()
        later = size if self.system.sample_time is not None else speed
        pieces = Pieces.of(self.system.ceilings(self.storage.box), size[None], later[None, None], 1.0)
        return float((np.abs(scale) @ self.matrix(pieces) @ np.abs(scale.T)).sum(axis=-1).max(initial=0.0))


def root_of(storage: Storage) -> np.ndarray | None:
    """W with W P(centre) Wᵀ = I, or None when P(centre) is not positive definite.

    Parameters
    ----------
    storage : Storage
        P(p).

    Returns
    -------
    (n, n) array or None
        W.
    """
    if not np.all(np.isfinite(storage.matrices)):
        return None
    try:
        root = np.linalg.inv(np.linalg.cholesky(storage.values(storage.box.centre[None, :])[0]))
    except np.linalg.LinAlgError:
        return None
    return root if np.all(np.isfinite(root)) else None


def recheck_inequality(problem: LyapunovInequality, *, budget: int | None = None) -> Recheck:
    """Check P ≻ 0 and F ≻ 0 on the box: between grid points where the budget allows, else on a grid.

    Parameters
    ----------
    problem : LyapunovInequality
    budget : int, optional
        Matrices that subdivision may examine; left out, about a second's worth.

    Returns
    -------
    Recheck
        Its `why` states what fails, or how it was shown.
    """
    storage, n = problem.storage, problem.system.order
    if storage.unbounded:
        return Recheck(False, False, -math.inf, "P depends on a variable whose rate has no bound")
    root = root_of(storage)
    if root is None:
        return Recheck(False, False, -math.inf, "P is not positive definite at the centre of the box")
    scale = problem.congruence(root)
    budget = budget or budget_for(len(scale))
    positive = positive_everywhere(storage, root, budget) if n else Positivity(True, 1.0, 0)
    if positive.holds is False:
        return Recheck(False, False, positive.bound, "P(p) is not positive definite at every point of the box")
    if positive.holds:
        points, moves = storage.axes(problem.system.readings, problem.power)
        waves = any(a.frequency for a in (*points, *moves))
        proof = everywhere(lambda p, t: problem.evaluate(p, t, scale), points, moves, budget=budget,
                           ceiling=problem.ceiling(scale) if waves else math.inf)
        if proof.holds:
            return Recheck(True, True, proof.bound, "proven on the whole box by Bernstein coefficients")
        if proof.holds is False:
            return Recheck(False, False, proof.bound, "the inequality fails somewhere in the box")
    return _on_grid(problem, root, scale)


def recheck_vertices(problem: LyapunovInequality, vertices: np.ndarray) -> Recheck:
    """Check P ≻ 0 and F ≻ 0 on the polytope of some vertices: one P, a system that is affine in its readings.

    F is affine in the system, or concave: AᵀPA is convex, (ΣλA)ᵀP(ΣλA) ⪯ Σ λAᵀPA for λ ≥ 0 with Σλ = 1. So it holds
    at every mixture where it holds at the vertices.

    Parameters
    ----------
    problem : LyapunovInequality
        With a storage function of degree zero.
    vertices : (V, readings) array

    Returns
    -------
    Recheck
        Its margin is that of the worst vertex.
    """
    storage, root = problem.storage, root_of(problem.storage)
    if root is None:
        return Recheck(False, False, -math.inf, "P is not positive definite")
    with np.errstate(over="ignore", invalid="ignore"):
        values, rounding = problem.evaluate(vertices, np.full((1, vertices.shape[1]), 0.5), problem.congruence(root))
    if not np.all(np.isfinite(values)):
        return Recheck(False, False, math.nan, "the inequality is not finite at a vertex")
    size = np.abs(root) @ np.abs(storage.matrices[0]) @ np.abs(root.T)
    positive = float(np.linalg.eigvalsh(root @ storage.matrices[0] @ root.T).min(initial=math.inf))
    positive -= (4 * len(root) + 30) * EPS * float(size.sum(axis=1).max(initial=0.0))
    margin = min(float(np.linalg.eigvalsh(values)[..., 0].min()) - rounding, math.inf if positive > 0 else positive)
    why = "proven on the polytope by its vertices" if margin > 0 else "the inequality fails at a vertex"
    return Recheck(margin > 0, margin > 0, margin, why)


def is_decidable(problem: LyapunovInequality) -> bool:
    """Whether what lies between grid points can be decided at all.

    Parameters
    ----------
    problem : LyapunovInequality

    Returns
    -------
    bool
        False where pieces of the storage function and of the system do not meet at known places.
    """
    points, moves = problem.storage.axes(problem.system.readings, problem.power)
    return all(axis.decidable for axis in (*points, *moves))


def budget_for(size: int) -> int:
    """How many matrices subdivision may examine: about a second's worth.

    Parameters
    ----------
    size : int
        Rows of a matrix.

    Returns
    -------
    int
    """
    return max(4_000_000 // (size ** 2 + 8), 2_000)


def positive_everywhere(storage: Storage, root: np.ndarray, budget: int) -> Positivity:
    """Whether P(p) ≻ 0 on the whole box.

    Parameters
    ----------
    storage : Storage
        P(p).
    root : (n, n) array
        W with W P(centre) Wᵀ = I.
    budget : int
        Matrices that may be examined.

    Returns
    -------
    Positivity
    """
    def scaled(points: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, float]:
        values = root @ storage.values(points) @ root.T
        size = np.abs(root) @ storage.magnitudes(points) @ np.abs(root.T)
        rounding = (4 * len(root) + 30) * EPS * float(size.sum(axis=2).max(initial=0.0))
        return 0.5 * (values + values.swapaxes(1, 2))[:, None], rounding

    ceiling = float((np.abs(root) @ storage.ceilings()[0] @ np.abs(root.T)).sum(axis=1).max(initial=0.0))
    return everywhere(scaled, storage.still(), [], ceiling=ceiling, budget=budget, sharpness=0.0)


def _on_grid(problem: LyapunovInequality, root: np.ndarray, scale: np.ndarray) -> Recheck:
    storage = problem.storage
    points = grid(storage.box, GRID.get(len(storage.box.names), 3))
    moves = tensor([np.array([0.0, 0.5, 1.0]) if i in storage.moving else np.array([0.5])
                    for i in range(points.shape[1])])
    margin = math.inf
    for part in np.array_split(points, max(1, len(points) * len(moves) // 20_000)):
        values, rounding = problem.evaluate(part, moves, scale)
        p = root @ storage.values(part) @ root.T
        margin = min(margin, float(np.linalg.eigvalsh(values)[..., 0].min()) - rounding)
        if len(root):
            margin = min(margin, float(np.linalg.eigvalsh(p)[..., 0].min()) - rounding)
    text = f"shown on a grid of {len(points)} points only, not between them"
    return Recheck(margin > 0, False, margin, text if margin > 0 else "the inequality fails at a grid point")
