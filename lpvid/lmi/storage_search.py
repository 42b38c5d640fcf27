"""Candidates for a storage function that carries any `Inequality`, by semidefinite programming.

The inequality itself is evaluated at a basis of the symmetric matrices, so that nothing is written twice. Nothing here
proves anything; every candidate goes through `lpvid.lmi.inequality.recheck_inequality`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse

from lpvid.lmi.affine import Affine
from lpvid.lmi.driven import Driven
from lpvid.lmi.frame import Frame
from lpvid.lmi.gain_search import INTERIOR, MOST_UNKNOWNS, SOLVERS, sample
from lpvid.lmi.inequality import LyapunovInequality, Pieces
from lpvid.lmi.program import Program
from lpvid.lmi.storage import Storage, symmetric_units
from lpvid.scheduling import Basis, Scheduling

Claim = Callable[[Driven, Storage], LyapunovInequality]


@dataclass(frozen=True, eq=False)
class StorageSearch:
    """Looks for P(p) with a given basis, in balanced coordinates and a time unit in which the system is unhurried.

    Parameters
    ----------
    system : Driven
    box : Scheduling
    basis : Basis
    frame : Frame
        Its states and time are used; signals keep their size.
    density : float
    """

    system: Driven
    box: Scheduling
    basis: Basis
    frame: Frame
    density: float = 2.0

    @property
    def affordable(self) -> bool:
        """Small enough to be worth solving."""
        n = self.system.order
        return self.basis.size * n * (n + 1) // 2 <= MOST_UNKNOWNS

    def effort(self, claim: Claim) -> int:
        """Unknowns times inequalities times entries of P, which is what a solver's time goes with."""
        inner, storage = self._inside()
        n = self.system.order
        points, moves = sample(self.system, storage, self.density, claim(inner, storage).power)
        count = len(moves) if self.system.sample_time is not None else 2 ** len(storage.moving)
        return self.basis.size * n * (n + 1) // 2 * len(points) * count * n**2

    def least(self, claim: Callable[[float], Claim]) -> Iterator[tuple[np.ndarray, float, str]]:
        """Matrices of P and the least ℓ whose square enters claim(ℓ) linearly: its inequality at ℓ² = level."""
        inner, storage = self._inside()
        zero, one = claim(0.0)(inner, storage), claim(1.0)(inner, storage)
        program, matrices, level = self._program()
        for const, linear, points in self._pieces(zero, storage):
            rise = self._constant(one, points) - self._constant(zero, points)
            program.require(Affine(const, linear) + level.times(rise), margin=INTERIOR)
        for p in self._storage(storage):
            program.require(p, margin=INTERIOR)
        program.minimise(level)
        for solution in program.solve(solvers=SOLVERS):
            if solution.objective > 0:
                yield self._outside(np.stack([solution[m] for m in matrices])), math.sqrt(solution.objective), \
                    solution.solver

    def roomiest(self, claim: Claim, capped: bool = True, settings: Mapping[str, Mapping[str, Any]] | None = None
                 ) -> Iterator[tuple[np.ndarray, float, str]]:
        """Matrices of P with the largest margin t in F ≽ tI and P ≽ tI, and t; `capped` for claims homogeneous in P."""
        inner, storage = self._inside()
        program, matrices, level = self._program()
        for const, linear, _ in self._pieces(claim(inner, storage), storage):
            program.require(Affine(const, linear) - level.times(np.eye(len(const))))
        for p in self._storage(storage):
            program.require(p - level.times(np.eye(self.system.order)))
            if capped:
                program.require(-p + np.eye(self.system.order))
        program.minimise(-level)
        for solution in program.solve(solvers=SOLVERS, settings=settings):
            yield self._outside(np.stack([solution[m] for m in matrices])), -solution.objective, solution.solver

    # -- stating -----------------------------------------------------------------------------------------------------
    def _inside(self) -> tuple[Driven, Storage]:
        """The system in the frame, ẋ̃ = τT⁻¹AT x̃ + √τT⁻¹B w, and an empty storage function with rates to match."""
        n, states, time = self.system.order, self.frame.states, self.frame.time
        left, right = np.linalg.inv(states), states
        moved = self.system.coefficients.copy()
        moved[:, :n] = left @ moved[:, :n]
        moved[:, :, :n] = moved[:, :, :n] @ right
        moved[:, :n, :n] *= time
        moved[:, :n, n:] *= math.sqrt(time)
        box = replace(self.box, rate=tuple(None if r is None else r * time for r in self.box.rate))
        if self.system.sample_time is not None:
            box = self.box
        empty = Storage(np.zeros((self.basis.size, n, n)), self.basis, box, self.system.sample_time)
        return replace(self.system, coefficients=moved), empty

    def _outside(self, matrices: np.ndarray) -> np.ndarray:
        return self.frame.outside(matrices)

    def _program(self) -> tuple[Program, list[Affine], Affine]:
        program = Program()
        matrices = [program.unknowns.symmetric(self.system.order) for _ in range(self.basis.size)]
        return program, matrices, program.unknowns.scalar()

    def _storage(self, storage: Storage) -> Iterator[Affine]:
        points, _ = sample(self.system, storage, self.density)
        units = symmetric_units(self.system.order)
        for psi in np.unique(storage.psi(points), axis=0):
            yield _affine(np.zeros(units.shape[1:]), np.einsum("j,qab->jqab", psi, units))

    def _pieces(self, problem: LyapunovInequality, storage: Storage) -> Iterator[tuple[np.ndarray, Any, np.ndarray]]:
        """(constant, linear, point) of the inequality at every sampled point and move."""
        points, moves = sample(self.system, storage, self.density, problem.power)
        units = symmetric_units(self.system.order)
        empty = np.zeros((1, *units.shape[1:]))
        for k in range(len(points)):
            point = points[k : k + 1]
            const = _at(problem, point, empty, empty)[0]
            now = _at(problem, point, units, 0 * units) - const
            then = _at(problem, point, 0 * units, units) - const
            psi = storage.psi(point)[0]
            for after in self._after(storage, point, moves):
                terms = np.einsum("j,qab->jqab", psi, now) + np.einsum("j,qab->jqab", after, then)
                yield const, _affine(const, terms).linear, point

    def _constant(self, problem: LyapunovInequality, point: np.ndarray) -> np.ndarray:
        empty = np.zeros((1, self.system.order, self.system.order))
        return _at(problem, point, empty, empty)[0]

    def _after(self, storage: Storage, point: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """(T, K) what multiplies the matrices of P in Ṗ, or in P one sample later."""
        if self.system.sample_time is not None:
            return storage.psi(storage.scheduling_after(point, moves))
        slopes = {i: storage.basis.derivative(point[:, storage.columns], storage.box.names[i])[0]
                  for i in storage.moving}
        ends = np.array(list(itertools.product((-1.0, 1.0), repeat=len(slopes)))).reshape(2 ** len(slopes), -1)
        rates = [(storage.box.rate[i] or 0.0) * slope for i, slope in slopes.items()]
        return ends @ np.array(rates).reshape(len(slopes), storage.basis.size)


def _at(problem: LyapunovInequality, point: np.ndarray, p: np.ndarray, later: np.ndarray) -> np.ndarray:
    """(q, m, m) the inequality at one point for q storage functions."""
    a, b, c, d = (x[:, None] for x in problem.system.matrices(point))
    return problem.matrix(Pieces(a, b, c, d, p[:, None], later[:, None]))[:, 0]


def _affine(constant: np.ndarray, terms: np.ndarray) -> Affine:
    """constant + Σ x_jq terms[j, q]."""
    flat = terms.reshape(-1, constant.size).T
    return Affine(constant, sparse.csr_array(flat))
