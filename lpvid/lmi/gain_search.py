"""Candidates for a storage function that bounds a gain, by semidefinite programming.

Nothing here proves anything; every candidate goes through `lpvid.lmi.gain_certificate.recheck_gain`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from lpvid.lmi.affine import Affine
from lpvid.lmi.bernstein import nodes
from lpvid.lmi.box_positivity import Axis
from lpvid.lmi.certificate import tensor
from lpvid.lmi.driven import Driven
from lpvid.lmi.frame import Frame
from lpvid.lmi.program import Program
from lpvid.lmi.storage import Storage, symmetric_units
from lpvid.scheduling import Basis, Scheduling

MOST_INEQUALITIES = 240
MOST_UNKNOWNS = 2_500
INTERIOR = 1e-6
"""Margin kept by the first stage, in the frame."""
SOLVERS = ("CLARABEL", "MOSEK", "SDPA", "CVXOPT")
ROUGHLY = {"CLARABEL": {"tol_gap_abs": 1e-4, "tol_gap_rel": 1e-2, "tol_feas": 1e-6}}
"""For a margin of which any large share will do: a third of the iterations less."""


@dataclass(frozen=True, eq=False)
class StorageProposal:
    """Matrices of a storage function in the model's own coordinates, the gain they should prove, and its source."""

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

    def prepare(self, box: Scheduling) -> None:
        """State and compile the programs of both stages; in discrete time they depend on the rates of the box."""
        for stage in ("least", "interior"):
            self._program(stage, box)[0].prepare()

    def best(self, box: Scheduling) -> Iterator[StorageProposal]:
        """Least γ, one proposal for each solver."""
        yield from self._solved("least", box, None)

    def interior(self, box: Scheduling, gamma: float) -> Iterator[StorageProposal]:
        """The storage function with the largest margin at a given γ."""
        yield from self._solved("interior", box, gamma)

    def _solved(self, stage: str, box: Scheduling, gamma: float | None) -> Iterator[StorageProposal]:
        program, matrices = self._program(stage, box)
        values = {f"rate {i}": (box.rate[i] or 0.0) * self.frame.time for i in self._template(box).readings}
        if gamma is not None:
            values["gamma"] = gamma / self.frame.gain
        for solution in program.solve(values, solvers=SOLVERS, settings=None if gamma is None else ROUGHLY):
            found = np.stack([solution[m] for m in matrices])
            bound = gamma if gamma is not None else solution.objective * self.frame.gain
            yield StorageProposal(self.frame.outside(found), bound, solution.solver)

    def _program(self, stage: str, box: Scheduling) -> tuple[Program, list[Affine]]:
        key = stage if self.system.sample_time is None else f"{stage} {box.rate}"
        if key not in self._programs:
            self._programs[key] = self._stated(stage, box)
        return self._programs[key]

    # -- stating -----------------------------------------------------------------------------------------------------
    def _template(self, box: Scheduling) -> Storage:
        n = self.system.order
        return Storage(np.zeros((self.basis.size, n, n)), self.basis, box, self.system.sample_time)

    def _stated(self, stage: str, box: Scheduling) -> tuple[Program, list[Affine]]:
        program, n, template = Program(), self.system.order, self._template(box)
        matrices = [program.unknowns.symmetric(n) for _ in range(self.basis.size)]
        level = program.unknowns.scalar()
        points, moves = sample(self.system, template, self.density)
        a, b, c, d = self.frame.inside(self.system.matrices(points))
        psi, units = template.psi(points), symmetric_units(n)
        slopes = {i: self.basis.derivative(points[:, template.columns], box.names[i]) for i in template.readings}
        for k in range(len(points)):
            p = _combined(psi[k], units)
            program.require(p - (INTERIOR * np.eye(n) if stage == "least" else level.times(np.eye(n))))
            fixed = np.block([[np.zeros((n, n + b.shape[2])), c[k].T], [np.zeros((b.shape[2], n + b.shape[2])), d[k].T],
                              [c[k], d[k], np.zeros((len(d[k]), len(d[k])))]])
            if self.system.sample_time is None:
                still = Affine(fixed, _combined(psi[k], _supplied(units, a[k], b[k], len(fixed))).linear)
                wide = {i: _combined(slope[k], _padded(units, len(fixed))) for i, slope in slopes.items()}
                for signs in itertools.product((-1.0, 1.0), repeat=len(wide)):
                    moved = {f"rate {i}": sign * x for (i, x), sign in zip(wide.items(), signs, strict=True)}
                    self._require(program, stage, level, still, moved)
            else:
                now, then = _combined(psi[k], _padded(units, len(fixed))), _carried(units, a[k], b[k], len(fixed))
                for after in template.psi(template.scheduling_after(points[k : k + 1], moves)):
                    self._require(program, stage, level, now + _combined(after, then) + fixed, {})
        program.minimise(level if stage == "least" else -level)
        return program, matrices

    def _require(self, program: Program, stage: str, level: Affine, matrix: Affine, moved: dict[str, Affine]) -> None:
        n, size = self.system.order, matrix.shape[0]
        supply = np.diag(np.r_[np.zeros(n), np.ones(size - n)])
        if stage == "least":
            program.require(matrix + level.times(supply), margin=INTERIOR, scaled=moved)
        else:
            fixed = Affine(supply, (0.0 * level.times(supply)).linear)
            program.require(matrix - level.times(np.eye(size)), scaled={**moved, "gamma": fixed})


def sample(system: Driven, template: Storage, density: float, power: int | None = None
           ) -> tuple[np.ndarray, np.ndarray]:
    """Points and moves at which an inequality of a degree in the system's matrices is imposed."""
    axes, shifts = template.axes(system.readings, power or (1 if system.sample_time is None else 2))
    moves = _ends(shifts)
    corners = len(moves) if system.sample_time is not None else 2 ** len(template.readings)
    most = max(MOST_INEQUALITIES // corners, 2 ** len(axes))
    return _spread(axes, system, template, density, most), moves


def _spread(axes: list[Axis], system: Driven, template: Storage, share: float, most: int) -> np.ndarray:
    def grid(share: float) -> list[np.ndarray]:
        found = []
        for i, axis in enumerate(axes):
            if axis.high <= axis.low:
                found.append(np.array([axis.low]))
                continue
            affine = system.readings[i].degree <= 1 and i not in template.readings and not axis.frequency
            knots = axis.breaks if len(axes) == 1 else system.readings[i].breaks
            pieces = Axis(axis.low, axis.high, axis.degree, knots).cells()
            count = 1 if affine else max(2, round(share * (3 * axis.degree + 2) / len(pieces)))
            if axis.frequency:
                count = max(4, math.ceil(share * 1.5 * axis.frequency * (axis.high - axis.low) / len(pieces)))
            found.append(np.unique(np.concatenate([low + nodes(count) * (high - low) for low, high in pieces])))
        return found

    while math.prod(map(len, grid(share))) > most and share > 0.1:
        share *= 0.8
    return tensor(grid(share))


def _ends(shifts: list[Axis]) -> np.ndarray:
    return tensor([np.array([0.5]) if not (axis.degree or axis.frequency)
                   else np.unique(np.r_[nodes(axis.degree or 8),
                                        axis.breaks]) for axis in shifts])


def _combined(weights: np.ndarray, parts: np.ndarray) -> Affine:
    """Σ_j weights[j] Σ_q x_jq parts[q], for parts of shape (q, m, m)."""
    m = parts.shape[1]
    linear = np.einsum("j,qab->abjq", weights, parts).reshape(m * m, len(weights) * len(parts))
    return Affine(np.zeros((m, m)), sparse.csr_array(linear))


def _padded(units: np.ndarray, size: int) -> np.ndarray:
    out = np.zeros((len(units), size, size))
    out[:, : units.shape[1], : units.shape[1]] = units
    return out


def _supplied(units: np.ndarray, a: np.ndarray, b: np.ndarray, size: int) -> np.ndarray:
    """−He(PA) and −PB for each unit."""
    n, out = len(a), np.zeros((len(units), size, size))
    product, cross = units @ a, units @ b
    out[:, :n, :n] = -(product + product.swapaxes(1, 2))
    out[:, :n, n : n + b.shape[1]] = -cross
    out[:, n : n + b.shape[1], :n] = -cross.swapaxes(1, 2)
    return out


def _carried(units: np.ndarray, a: np.ndarray, b: np.ndarray, size: int) -> np.ndarray:
    """−[A B]ᵀP⁺[A B] for each unit."""
    both, out = np.hstack([a, b]), np.zeros((len(units), size, size))
    out[:, : both.shape[1], : both.shape[1]] = -(both.T @ units @ both)
    return out
