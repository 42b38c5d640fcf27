"""Candidates for a storage function that bounds a gain, by semidefinite programming.

Nothing here proves anything; every candidate goes through `lpvid.lmi.gain_certificate.recheck_gain`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from lpvid.lmi.affine import Affine, block
from lpvid.lmi.bernstein import nodes
from lpvid.lmi.certificate import tensor
from lpvid.lmi.driven import Driven
from lpvid.lmi.everywhere import Axis
from lpvid.lmi.frame import Frame
from lpvid.lmi.program import Program
from lpvid.lmi.storage import Storage
from lpvid.scheduling import Basis, Scheduling

MOST_POINTS = 120
MOST_UNKNOWNS = 2_500
INTERIOR = 1e-6
"""Margin kept by the first stage, in the frame."""
SOLVERS = ("CLARABEL", "MOSEK", "SDPA", "CVXOPT")


@dataclass(frozen=True, eq=False)
class Proposal:
    """Matrices of a storage function in the model's own coordinates, the gain they should prove, and who says so."""

    matrices: np.ndarray
    gamma: float
    solver: str


@dataclass(eq=False)
class GainSearch:
    """min γ such that P(p) ≻ 0 and the bounded-real inequality holds at sampled points and at all corners of the rates.

    In continuous time the rates are parameters of one compiled program: a sweep over them compiles once.

    Parameters
    ----------
    system : Driven
    box : Scheduling
        Which rates are None decides what P may depend on; their values are given to `proposals`.
    basis : Basis
        Of P, over names of `box`.
    frame : Frame
    density : float
        Points along each variable, over the usual number.
    """

    system: Driven
    box: Scheduling
    basis: Basis
    frame: Frame
    density: float = 1.0
    _programs: dict[str, tuple[Program, list[Affine]]] = field(default_factory=dict)

    @property
    def affordable(self) -> bool:
        """Small enough to be worth solving."""
        n = self.system.order
        return self.basis.size * n * (n + 1) // 2 <= MOST_UNKNOWNS

    def best(self, box: Scheduling) -> Iterator[Proposal]:
        """Least γ, one proposal for each solver."""
        yield from self._solved("least", box, None)

    def interior(self, box: Scheduling, gamma: float) -> Iterator[Proposal]:
        """The storage function with the largest margin at a given γ."""
        yield from self._solved("interior", box, gamma)

    def _solved(self, stage: str, box: Scheduling, gamma: float | None) -> Iterator[Proposal]:
        continuous = self.system.sample_time is None
        key = stage if continuous else f"{stage} {box.rate}"
        if key not in self._programs:
            self._programs[key] = self._stated(stage, box)
        program, matrices = self._programs[key]
        values = {f"rate {i}": (box.rate[i] or 0.0) * self.frame.time for i in self._template(box).readings}
        if gamma is not None:
            values["gamma"] = gamma / self.frame.gain
        for solution in program.solve(values, solvers=SOLVERS):
            found = np.array([solution[m] for m in matrices]).reshape(-1, self.system.order, self.system.order)
            bound = gamma if gamma is not None else solution.objective * self.frame.gain
            yield Proposal(self.frame.outside(found), bound, solution.solver)

    # -- stating -----------------------------------------------------------------------------------------------------
    def _template(self, box: Scheduling) -> Storage:
        n = self.system.order
        return Storage(np.zeros((self.basis.size, n, n)), self.basis, box, self.system.sample_time)

    def _stated(self, stage: str, box: Scheduling) -> tuple[Program, list[Affine]]:
        program, n, template = Program(), self.system.order, self._template(box)
        matrices = [program.unknowns.symmetric(n) for _ in range(self.basis.size)]
        level = program.unknowns.scalar()
        points, moves = self.samples(template)
        a, b, c, d = self.frame.inside(self.system.matrices(points))
        psi = template.psi(points)
        slopes = {i: self.basis.derivative(points[:, template.columns], box.names[i]) for i in template.readings}
        for k in range(len(points)):
            p = _mixed(matrices, psi[k])
            program.require(p - (INTERIOR * np.eye(n) if stage == "least" else level.times(np.eye(n))))
            if self.system.sample_time is None:
                drift = {i: _mixed(matrices, slope[k]) for i, slope in slopes.items()}
                self._continuous(program, stage, level, (a[k], b[k], c[k], d[k]), p, drift)
            else:
                for after in template.psi(template.ahead(points[k : k + 1], moves)):
                    matrix = _discrete((a[k], b[k], c[k], d[k]), p, _mixed(matrices, after))
                    self._require(program, stage, level, matrix, {}, d.shape[1] + d.shape[2])
        program.minimise(level if stage == "least" else -level)
        return program, matrices

    def _continuous(self, program: Program, stage: str, level: Affine, system: tuple[np.ndarray, ...], p: Affine,
                    drift: dict[int, Affine]) -> None:
        a, b, c, d = system
        nz, nw = d.shape
        product = p @ a
        cross = -(p @ b)
        matrix = block([[-(product + product.T), cross, c.T], [cross.T, np.zeros((nw, nw)), d.T],
                        [c, d, np.zeros((nz, nz))]])
        pad = [np.zeros((len(a), nw + nz)), np.zeros((nw + nz, len(a))), np.zeros((nw + nz, nw + nz))]
        wide = {i: block([[x, pad[0]], [pad[1], pad[2]]]) for i, x in drift.items()}
        for signs in itertools.product((-1.0, 1.0), repeat=len(wide)):
            moved = {f"rate {i}": sign * x for (i, x), sign in zip(wide.items(), signs, strict=True)}
            self._require(program, stage, level, matrix, moved, nw + nz)

    def _require(self, program: Program, stage: str, level: Affine, matrix: Affine, moved: dict[str, Affine],
                 signals: int) -> None:
        n = self.system.order
        supply = np.diag(np.r_[np.zeros(n), np.ones(signals)])
        if stage == "least":
            program.require(matrix + level.times(supply), margin=INTERIOR, scaled=moved)
        else:
            fixed = Affine(supply, (0.0 * level.times(supply)).linear)
            program.require(matrix - level.times(np.eye(n + signals)), scaled={**moved, "gamma": fixed})

    def samples(self, template: Storage) -> tuple[np.ndarray, np.ndarray]:
        """Points and moves at which the inequalities are imposed."""
        power = 1 if self.system.sample_time is None else 2
        axes, shifts = template.axes(self.system.readings, power)
        return _spread(axes, self.system, template, self.density), _ends(shifts)


def _spread(axes: list[Axis], system: Driven, template: Storage, share: float) -> np.ndarray:
    def grid(share: float) -> list[np.ndarray]:
        found = []
        for i, axis in enumerate(axes):
            if axis.high <= axis.low:
                found.append(np.array([axis.low]))
                continue
            affine = system.readings[i].degree <= 1 and i not in template.readings and not axis.frequency
            count = 1 if affine else max(2, round(share * (3 * axis.degree + 2)))
            plain = Axis(axis.low, axis.high, axis.degree, axis.breaks)
            pieces = plain.cells()
            if axis.frequency:
                count = max(4, math.ceil(share * 1.5 * axis.frequency * (axis.high - axis.low) / len(pieces)))
            found.append(np.unique(np.concatenate([low + nodes(count) * (high - low) for low, high in pieces])))
        return found

    while math.prod(map(len, grid(share))) > MOST_POINTS and share > 0.3:
        share *= 0.8
    return tensor(grid(share))


def _ends(shifts: list[Axis]) -> np.ndarray:
    return tensor([np.array([0.5]) if not (axis.degree or axis.frequency)
                   else np.unique(np.r_[nodes(1 if axis.degree == 1 else 2 * axis.degree + 2 if axis.degree else 8),
                                        axis.breaks]) for axis in shifts])


def _mixed(matrices: list[Affine], weights: np.ndarray) -> Affine:
    total = matrices[0] * float(weights[0])
    for matrix, weight in zip(matrices[1:], weights[1:], strict=True):
        if weight:
            total = total + matrix * float(weight)
    return total


def _discrete(system: tuple[np.ndarray, ...], p: Affine, after: Affine) -> Affine:
    a, b, c, d = system
    nz = len(d)
    cross = -(a.T @ (after @ b))
    return block([[p - a.T @ (after @ a), cross, c.T], [cross.T, -(b.T @ (after @ b)), d.T],
                  [c, d, np.zeros((nz, nz))]])
