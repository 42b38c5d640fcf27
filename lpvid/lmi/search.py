"""Candidates for a Lyapunov function: closed forms first, then semidefinite programs of rising degree.

Nothing here proves anything; every candidate goes through `lpvid.lmi.bounds.recheck_decrease`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.lmi.bernstein import nodes
from lpvid.lmi.certificate import grid, tensor
from lpvid.lmi.driven import Driven
from lpvid.lmi.storage import Storage, symmetric_units
from lpvid.scheduling import Polynomial, Scheduling

if TYPE_CHECKING:
    from lpvid.lmi.program import ProgramInequality

MAX_UNKNOWNS = 1_200
MAX_INEQUALITIES = 240


def frozen_rates(system: Driven, points: np.ndarray) -> np.ndarray:
    """(N,) exponential rate [1/s] of the slowest frozen mode at each point; negative means decay.

    Discrete models: ln ρ(A)/T_s, no lower than that of a modulus of 1e-3.
    """
    if not system.order:
        return np.full(len(points), -math.inf)
    poles = np.linalg.eigvals(system.state_matrices(points))
    if system.sample_time is None:
        return poles.real.max(axis=1)
    return np.log(np.maximum(np.abs(poles).max(axis=1), 1e-3)) / system.sample_time


def dependent(system: Driven, box: Scheduling) -> tuple[str, ...]:
    """Variables that P may depend on: those that have width and, in continuous time, a bounded rate."""
    return tuple(name for name, low, high, rate in zip(box.names, box.lower, box.upper, box.rate, strict=True)
                 if high > low and (system.sample_time is not None or rate is not None))


@dataclass(frozen=True, eq=False)
class LyapunovSearch:
    """Looks for P(p) for one system on one box, in coordinates where the frozen systems are nearly contractions.

    Parameters
    ----------
    system : Driven
        Frozen-stable at the sampled points.
    box : Scheduling
    """

    system: Driven
    box: Scheduling

    def basis(self, degree: int) -> Polynomial:
        """The monomials of P."""
        return Polynomial(dependent(self.system, self.box) if degree else (), degree).bound(self.box)

    def _storage(self, matrices: np.ndarray, degree: int) -> Storage:
        return Storage(matrices, self.basis(degree), self.box, self.system.sample_time)

    def frozen_solutions(self, points: np.ndarray) -> np.ndarray:
        """(N, n, n) Lyapunov matrices of the frozen systems, each with some decay to spare."""
        a = self.system.state_matrices(points)
        worst = float(frozen_rates(self.system, points).max())
        if self.system.sample_time is not None:
            a = a / math.sqrt(0.5 * (1 + math.exp(2 * worst * self.system.sample_time)))
        else:
            eye = np.eye(self.system.order)
            shifted = (a - 0.5 * worst * eye) / max(float(np.abs(a).sum(axis=2).max()), 1e-300)
            a = (eye + shifted) @ np.linalg.inv(eye - shifted)
        weight = np.broadcast_to(np.diag(_balance(np.abs(a).mean(axis=0)) ** -2.0), a.shape)
        return np.array([frozen_gramian(x, w) for x, w in zip(a, weight, strict=True)])

    def closed_forms(self) -> Iterator[Storage]:
        """The mean of the frozen Lyapunov matrices: exact for a time-invariant model, and no solver."""
        yield self._storage(self._centre()[None], 0)

    def fitted(self, degree: int) -> Storage | None:
        """A polynomial through the frozen Lyapunov matrices, which serves slow variation; no solver."""
        basis = self.basis(degree)
        points = grid(self.box, 2 * degree + 3 if len(self.box.names) < 3 else degree + 1)
        phi = basis.evaluate(points[:, [self.box.names.index(n) for n in basis.names]])
        solutions = self.frozen_solutions(points)
        if not np.all(np.isfinite(solutions)):
            return None
        fit = np.linalg.lstsq(phi, solutions.reshape(len(points), -1), rcond=None)[0]
        matrices = fit.reshape(basis.size, *solutions.shape[1:])
        return self._storage(0.5 * (matrices + matrices.swapaxes(1, 2)), degree)

    def solved(self, degree: int, exponent: float = 0.0) -> Iterator[tuple[Storage, str]]:
        """Candidates of a degree by semidefinite programming, with the solver's name; none where it sees no margin."""
        basis, n = self.basis(degree), self.system.order
        unknowns = basis.size * n * (n + 1) // 2
        if unknowns > MAX_UNKNOWNS:
            return
        try:
            factor = np.linalg.cholesky(self._centre())
        except np.linalg.LinAlgError:
            return
        units = symmetric_units(n)
        template = self._storage(np.zeros((basis.size, n, n)), degree)
        from lpvid.lmi.program import largest_margin  # here, so that checking a certificate needs numpy alone

        for candidate in largest_margin(self._inequalities(template, exponent, factor, units)):
            matrices = np.tensordot(candidate.x.reshape(basis.size, -1), units, axes=1)
            matrices = factor @ matrices @ factor.T
            yield self._storage(0.5 * (matrices + matrices.swapaxes(1, 2)), degree), candidate.solver
            if candidate.margin < 1e-7:
                return

    def _centre(self) -> np.ndarray:
        points = grid(self.box, {0: 1, 1: 9, 2: 4}.get(len(self.box.names), 2))
        if not self.system.order:
            return np.zeros((0, 0))
        solutions = self.frozen_solutions(points)
        solutions = solutions / np.trace(solutions, axis1=1, axis2=2)[:, None, None]
        return solutions.mean(axis=0)

    def _samples(self, template: Storage) -> tuple[np.ndarray, np.ndarray]:
        """Points and moves at which the inequalities are imposed."""
        degree, variables = max((r.degree for r in template.readings.values()), default=0), len(self.box.names)
        per = [max(2, 2 * r.degree + degree + 1) if degree or r.degree > 1 else 2 for r in self.system.readings]
        ends = [np.array([0.0, 0.5, 1.0]) if variables == 1 and degree > 1 and self.system.sample_time is not None
                else np.array([0.0, 1.0]) if i in template.moving else np.array([0.5]) for i in range(variables)]
        moves = tensor([e if i in template.moving else np.array([0.5]) for i, e in enumerate(ends)])
        cells = [a.cells() for a in template.axes(self.system.readings, 1 if self.system.sample_time is None else 2)[0]]
        while True:
            axes = [np.unique(np.concatenate([low + nodes(count - 1) * (high - low) for low, high in own]))
                    for own, count in zip(cells, per, strict=True)]
            if math.prod(map(len, axes)) * len(moves) <= MAX_INEQUALITIES or max(per, default=2) <= 2:
                return tensor(axes), moves
            per = [max(2, count - 1) for count in per]

    def _inequalities(self, template: Storage, exponent: float, factor: np.ndarray, units: np.ndarray
                      ) -> list[ProgramInequality]:
        from lpvid.lmi.program import ProgramInequality

        points, moves = self._samples(template)
        n = self.system.order
        inverse = np.linalg.inv(factor)
        a = factor.T @ self.system.state_matrices(points) @ inverse.T
        psi = template.psi(points)
        blocks = []
        for k in range(len(points)):
            now = _products(psi[k], units)
            blocks += [(np.zeros((n, n)), now), (np.eye(n), -now)]
            decrease = (self._discrete if self.system.sample_time is not None else self._continuous)
            blocks += [(np.zeros((n, n)), linear)
                       for linear in decrease(template, exponent, a[k], points[k], moves, units, now)]
        return [ProgramInequality(constant, linear, 0.0 if constant.any() else 1.0) for constant, linear in blocks]

    def _discrete(self, template: Storage, exponent: float, a: np.ndarray, point: np.ndarray, moves: np.ndarray,
                  units: np.ndarray, now: np.ndarray) -> list[np.ndarray]:
        assert self.system.sample_time is not None
        rho2 = math.exp(-2 * exponent * self.system.sample_time)
        moved, ahead = a.T @ units @ a, template.scheduling_after(point[None], moves)
        return [rho2 * now - _products(psi, moved) for psi in template.psi(ahead)]

    def _continuous(self, template: Storage, exponent: float, a: np.ndarray, point: np.ndarray, moves: np.ndarray,
                    units: np.ndarray, now: np.ndarray) -> list[np.ndarray]:
        basis, columns = template.basis, template.columns
        fastest = max(float(np.abs(np.linalg.eigvals(a)).max()), 1e-300)
        psi = template.psi(point[None])[0]
        still = -_products(psi, a.T @ units + units @ a) - 2 * exponent * now
        slopes = {i: basis.derivative(point[None, columns], self.box.names[i])[0] for i in template.moving}
        out = []
        for move in moves:
            drift = sum(((self.box.rate[i] or 0.0) * (2 * move[i] - 1) * s for i, s in slopes.items()),
                        np.zeros(basis.size))
            out.append((still - _products(drift, units)) / fastest)
        return out


def _products(psi: np.ndarray, units: np.ndarray) -> np.ndarray:
    """(n, n, K·q) all ψ_k E_q, flattened with q fastest."""
    n = units.shape[1]
    return np.einsum("k,qij->ijkq", psi, units).reshape(n, n, -1)


def frozen_gramian(a: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Σ (Aᵏ)ᵀ W Aᵏ by doubling."""
    total, power = np.array(weight), np.array(a)
    for _ in range(60):
        total = total + power.T @ total @ power
        power = power @ power
        size = float(np.abs(power).max())
        if size < 1e-18 or size > 1e150:
            break
    return 0.5 * (total + total.T)


def _balance(size: np.ndarray) -> np.ndarray:
    """Diagonal d that makes rows and columns of |D⁻¹AD| equally large, in a few sweeps."""
    n = len(size)
    d = np.ones(n)
    off = size * (1 - np.eye(n))
    for _ in range(10):
        for i in range(n):
            row, column = float((off[i] * d).sum() / d[i]), float((off[:, i] / d).sum() * d[i])
            if row > 0 and column > 0:
                d[i] *= float(np.clip(math.sqrt(row / column), 0.1, 10.0))
    return np.clip(d / d.mean(), 1e-6, 1e6)
