"""Re-check of a Lyapunov certificate with numpy alone: no solver, and no trust in one.

In discrete time the claim is, for every p in the box and every p⁺ that the rate bound lets p reach in one sample,

    P(p) ≻ 0        ρ² P(p) − A(p)ᵀ P(p⁺) A(p) ≻ 0                         ρ = exp(−α T_s)

and in continuous time, for every p in the box and every admissible ṗ,

    P(p) ≻ 0        −A(p)ᵀP(p) − P(p)A(p) − Σ_i ṗ_i ∂P/∂p_i − 2α P(p) ≻ 0.

Both are polynomial in p and in a parameter τ of the move, so Bernstein coefficients decide them between grid points.
Everything is stated after the congruence that turns P at the centre of the box into the identity.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.lmi import bernstein
from lpvid.lmi.autonomous import Autonomous
from lpvid.scheduling import Polynomial, Scheduling

EPS = float(np.finfo(float).eps)
GRID = {0: 1, 1: 201, 2: 31, 3: 11}  # points for each variable where a proof between them is out of reach


@dataclass(frozen=True, eq=False)
class Lyapunov:
    """V = xᵀP(p)x with P(p) = Σ_k matrices[k] ψ_k(p).

    Parameters
    ----------
    matrices : (K, n, n) array
        Symmetric.
    basis : Polynomial
        The K monomials ψ_k, over the labels of the readings.
    """

    matrices: np.ndarray
    basis: Polynomial

    @property
    def degree(self) -> int:
        """Degree of P in p."""
        return self.basis.degree

    def values(self, points: np.ndarray, columns: list[int]) -> np.ndarray:
        """(N, n, n) P at `points` of shape (N, variables), of which `columns` are the basis's."""
        return np.tensordot(self.basis.evaluate(points[:, columns]), self.matrices, axes=1)

    def magnitudes(self, points: np.ndarray, columns: list[int]) -> np.ndarray:
        """(N, n, n) Σ |matrix| |ψ|, which bounds the rounding errors of `values`."""
        return np.tensordot(np.abs(self.basis.evaluate(points[:, columns])), np.abs(self.matrices), axes=1)


@dataclass(frozen=True)
class Recheck:
    """What numpy finds about a claim.

    Parameters
    ----------
    holds : bool
    between_grid : bool
        Proven on the whole box; otherwise on the points of a grid only.
    margin : float
        Smallest eigenvalue, after the congruence that makes P(centre) the identity and less a bound of the rounding
        error; a pure number in discrete time, 1/s in continuous time.
    why : str
        What failed, or how it was shown.
    """

    holds: bool
    between_grid: bool
    margin: float
    why: str


@dataclass(frozen=True, eq=False)
class Decrease:
    """The claim as a matrix inequality, its values at points, and the polynomial pieces it is made of."""

    system: Autonomous
    lyapunov: Lyapunov
    box: Scheduling
    exponent: float = 0.0

    @cached_property
    def columns(self) -> list[int]:
        """Which variables of the box P depends on."""
        return [self.box.names.index(n) for n in self.lyapunov.basis.names]

    @cached_property
    def moving(self) -> list[int]:
        """Variables whose move matters: those P depends on, unless their rate is zero."""
        if not self.lyapunov.degree:
            return []
        return [i for i in self.columns if self.box.rate[i] != 0 and self.box.upper[i] > self.box.lower[i]]

    def reach(self, i: int) -> float:
        """Largest move of variable i in one sample, in its unit."""
        bound = self.box.rate[i]
        assert self.system.sample_time is not None
        return math.inf if bound is None else bound * self.system.sample_time

    def congruence(self) -> np.ndarray | None:
        """W with W P(centre) Wᵀ = I, or None when P(centre) is not positive definite."""
        if not np.all(np.isfinite(self.lyapunov.matrices)):
            return None
        try:
            factor = np.linalg.cholesky(self.lyapunov.values(self.box.centre[None, :], self.columns)[0])
            return np.linalg.inv(factor)
        except np.linalg.LinAlgError:
            return None

    def evaluate(self, points: np.ndarray, moves: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, float]:
        """(N, T, n, n) inequality at `points` (N, s) and moves τ ∈ [0, 1] (T, s), and a bound of its rounding."""
        p0, a = self.lyapunov.values(points, self.columns)[:, None], self.system.matrices(points)[:, None]
        p0_abs, a_abs = (self.lyapunov.magnitudes(points, self.columns)[:, None],
                         self.system.magnitudes(points)[:, None])
        at = a.swapaxes(2, 3)
        if self.system.sample_time is not None:
            rho2 = math.exp(-2 * self.exponent * self.system.sample_time)
            ahead = self.scheduling_after(points, moves).reshape(len(points) * len(moves), points.shape[1])
            shape = (len(points), len(moves), *p0.shape[2:])
            p1 = self.lyapunov.values(ahead, self.columns).reshape(shape)
            p1_abs = self.lyapunov.magnitudes(ahead, self.columns).reshape(shape)
            matrix = rho2 * p0 - at @ p1 @ a
            size = rho2 * p0_abs + a_abs.swapaxes(2, 3) @ p1_abs @ a_abs
        else:
            drift, drift_abs = self._drift(points, moves)
            matrix = -(at @ p0) - p0 @ a - drift - 2 * self.exponent * p0
            size = 2 * (p0_abs @ a_abs) + drift_abs + 2 * abs(self.exponent) * p0_abs
            size = size + size.swapaxes(2, 3)
        matrix = scale @ matrix @ scale.T
        size = np.abs(scale) @ size @ np.abs(scale.T)
        rounding = (6 * matrix.shape[-1] + 30) * EPS * float(size.sum(axis=3).max(initial=0.0))
        return 0.5 * (matrix + matrix.swapaxes(2, 3)), rounding

    def scheduling_after(self, points: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """(N, T, s) scheduling after one sample: between the lowest and the highest value it can reach."""
        ahead = np.repeat(points[:, None, :], len(moves), axis=1)
        for i in self.moving:
            step = self.reach(i)
            low = np.maximum(points[:, i] - step, self.box.lower[i])[:, None]
            high = np.minimum(points[:, i] + step, self.box.upper[i])[:, None]
            ahead[:, :, i] = low + moves[None, :, i] * (high - low)
        return ahead

    def _drift(self, points: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, T, n, n) Σ ṗ_i ∂P/∂p_i for ṗ_i = (2τ_i − 1)·rate_i, and its magnitude."""
        n = self.system.order
        drift, size = np.zeros((2, len(points), len(moves), n, n))
        for i in self.moving:
            slope = self.lyapunov.basis.derivative(points[:, self.columns], self.box.names[i])
            speed = (self.box.rate[i] or 0.0) * (2 * moves[:, i] - 1)
            drift = drift + np.tensordot(slope, self.lyapunov.matrices, axes=1)[:, None] * speed[None, :, None, None]
            size = size + (np.tensordot(np.abs(slope), np.abs(self.lyapunov.matrices), axes=1)[:, None]
                           * np.abs(speed)[None, :, None, None])
        return drift, size

    def edges(self, i: int) -> list[float]:
        """Ends of the box, and where the polynomial changes: at knots of A, and where the box cuts a move short."""
        low, high = self.box.lower[i], self.box.upper[i]
        cuts = list(self.system.readings[i].breaks)
        if self.system.sample_time is not None and i in self.moving and self.reach(i) < high - low:
            cuts += [low + self.reach(i), high - self.reach(i)]
        tiny = 1e-12 * (high - low)
        inside: list[float] = []
        for cut in sorted(cuts):
            if low + tiny < cut < high - tiny and (not inside or cut > inside[-1] + tiny):
                inside.append(cut)
        return [low, *inside, high]

    def degrees(self) -> tuple[list[int], list[int]]:
        """Degree of the inequality in each variable, and in each move."""
        discrete = self.system.sample_time is not None
        own = [self.lyapunov.degree if i in self.columns else 0 for i in range(len(self.box.names))]
        z = [(2 if discrete else 1) * r.degree + d for r, d in zip(self.system.readings, own, strict=True)]
        tau = [(d if discrete else 1) if i in self.moving else 0 for i, d in enumerate(own)]
        return z, tau


def recheck(system: Autonomous, lyapunov: Lyapunov, box: Scheduling, exponent: float = 0.0, *,
            budget: int | None = None) -> Recheck:
    """Check P(p) ≻ 0 and the decrease of V on a box, between grid points if the budget allows.

    Parameters
    ----------
    system : Autonomous
    lyapunov : Lyapunov
        Over the names of `box`, or some of them.
    box : Scheduling
        One entry for each reading of `system`; its rates in units per second, None for arbitrary variation.
    exponent : float
        α ≥ 0 [1/s]: the claim is V decreasing at least as exp(−2αt).
    budget : int, optional
        Matrices that subdivision may examine; left out, about a second's worth.

    Returns
    -------
    Recheck
    """
    problem = Decrease(system, lyapunov, box, exponent)
    if system.order == 0:
        return Recheck(True, True, 1.0, "the model has no memory")
    if system.sample_time is None and any(box.rate[i] is None for i in problem.moving):
        return Recheck(False, False, -math.inf, "P depends on a variable whose rate has no bound")
    scale = problem.congruence()
    if scale is None or not np.all(np.isfinite(scale)):
        return Recheck(False, False, -math.inf, "P is not positive definite at the centre of the box")
    budget = budget or max(4_000_000 // (system.order**2 + 8), 2_000)
    positive = _positive_everywhere(problem, scale, budget)
    if positive.holds is False:
        return Recheck(False, False, positive.bound, "P(p) is not positive definite at every point of the box")
    z, tau = problem.degrees()
    cells = list(itertools.product(*(itertools.pairwise(problem.edges(i)) for i in range(len(box.names)))))
    total = len(cells) * math.prod(d + 1 for d in z + tau)
    if positive.holds and total <= budget:
        boxes, rounding = _bernstein(problem, scale, cells, z, tau)
        proof = bernstein.positive(boxes, len(z) + len(tau), above=rounding, budget=budget)
        if proof.holds:
            return Recheck(True, True, proof.bound - rounding, "proven on the whole box by Bernstein coefficients")
        if proof.holds is False:
            return Recheck(False, False, proof.bound - rounding, "V does not decrease somewhere in the box")
    return _on_grid(problem, scale)


def _positive_everywhere(problem: Decrease, scale: np.ndarray, budget: int) -> bernstein.Positivity:
    degree, count = problem.lyapunov.degree, len(problem.columns)
    unit = tensor([bernstein.nodes(degree)] * count)
    low, high = np.array(problem.box.lower), np.array(problem.box.upper)
    points = np.repeat(problem.box.centre[None, :], len(unit), axis=0)
    points[:, problem.columns] = low[problem.columns] + unit * (high - low)[problem.columns]
    values = scale @ problem.lyapunov.values(points, problem.columns) @ scale.T
    size = np.abs(scale) @ problem.lyapunov.magnitudes(points, problem.columns) @ np.abs(scale.T)
    n = values.shape[-1]
    rounding = (4 * n + 30) * EPS * float(size.sum(axis=2).max()) * bernstein.amplification((degree,) * count)
    boxes = bernstein.coefficients(values.reshape(1, *(degree + 1,) * count, n, n), count)
    return bernstein.positive(boxes, count, above=rounding, budget=budget, sharpness=0.0)


def _bernstein(problem: Decrease, scale: np.ndarray, cells: list, z: list[int],
               tau: list[int]) -> tuple[np.ndarray, float]:
    unit, moves = (tensor([bernstein.nodes(d) for d in degrees]) for degrees in (z, tau))
    low, high = np.moveaxis(np.array(cells, dtype=float).reshape(len(cells), len(z), 2), 2, 0)
    points = low[:, None, :] + unit[None] * (high - low)[:, None, :]
    values, rounding = problem.evaluate(points.reshape(len(cells) * len(unit), len(z)), moves, scale)
    n = values.shape[-1]
    values = values.reshape(len(cells), *(d + 1 for d in z + tau), n, n)
    rounding *= bernstein.amplification(tuple(z + tau))
    return bernstein.coefficients(values, len(z) + len(tau)), rounding


def _on_grid(problem: Decrease, scale: np.ndarray) -> Recheck:
    points = grid(problem.box, GRID.get(len(problem.box.names), 3))
    moves = tensor([np.array([0.0, 0.5, 1.0]) if i in problem.moving else np.array([0.5])
                    for i in range(points.shape[1])])
    margin = math.inf
    for part in np.array_split(points, max(1, len(points) * len(moves) // 20_000)):
        values, rounding = problem.evaluate(part, moves, scale)
        p = scale @ problem.lyapunov.values(part, problem.columns) @ scale.T
        lowest = min(float(np.linalg.eigvalsh(values)[..., 0].min()), float(np.linalg.eigvalsh(p)[..., 0].min()))
        margin = min(margin, lowest - rounding)
    text = f"shown on a grid of {len(points)} points only, not between them"
    return Recheck(margin > 0, False, margin, text if margin > 0 else "V does not decrease at a grid point")


def grid(box: Scheduling, points: int) -> np.ndarray:
    """(N, variables) tensor grid over a box; a variable without width counts once."""
    return tensor([np.linspace(lo, up, points) if up > lo else np.array([lo])
                    for lo, up in zip(box.lower, box.upper, strict=True)])


def tensor(axes: list[np.ndarray]) -> np.ndarray:
    """(N, axes) all combinations of the values on several axes."""
    return np.array(list(itertools.product(*axes)), dtype=float).reshape(math.prod(map(len, axes)), len(axes))
