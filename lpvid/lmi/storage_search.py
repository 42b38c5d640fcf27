"""Candidates for a storage function that carries any `LyapunovInequality`, by semidefinite programming.

The inequality itself is evaluated at a basis of the symmetric matrices, so that nothing is written twice: stability,
gain, H2 norm, decay, covariance and pole regions differ in what they claim alone. Nothing here proves anything; every
candidate goes through `lpvid.lmi.inequality.recheck_inequality`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import sparse

from lpvid.lmi.affine import Affine, given
from lpvid.lmi.bernstein import nodes
from lpvid.lmi.box_positivity import Axis
from lpvid.lmi.certificate import tensor
from lpvid.lmi.driven import Driven
from lpvid.lmi.frame import Frame
from lpvid.lmi.inequality import LyapunovInequality, Pieces
from lpvid.lmi.polytope_positivity import lattice, simplices, stepped_box
from lpvid.lmi.program import Program
from lpvid.lmi.storage import Storage, symmetric_units
from lpvid.scheduling import Basis, Scheduling

Claim = Callable[[Driven, Storage], LyapunovInequality]
Claims = Callable[[float], Claim]
MOST_INEQUALITIES = 240
MOST_UNKNOWNS = 2_500
INTERIOR = 1e-6
"""Margin kept where the least level is looked for, in the frame."""
SOLVERS = ("CLARABEL", "MOSEK", "SDPA", "CVXOPT")
ROUGHLY = {"CLARABEL": {"tol_gap_abs": 1e-4, "tol_gap_rel": 1e-2, "tol_feas": 1e-6}}
"""For a margin of which any large share will do: a third of the iterations less."""


@dataclass(frozen=True, eq=False)
class StorageProposal:
    """A candidate.

    Attributes
    ----------
    matrices : (K, n, n) array
        Of P, in the model's own coordinates.
    level : float
        That it should prove, in the frame.
    margin : float
        t of F ≽ tI and P ≽ tI in the frame, as the solver has it.
    solver : str
    """

    matrices: np.ndarray
    level: float
    margin: float
    solver: str


@dataclass(frozen=True, eq=False)
class StorageSearch:
    """Looks for P(p) with a given basis, in coordinates and a time unit in which the system is well scaled.

    In continuous time the rates of the scheduling, and the level at which the most room is looked for, are parameters
    of one compiled program: a sweep over them compiles once.

    Parameters
    ----------
    system : Driven
    box : Scheduling
        Which rates are None decides what P may depend on.
    basis : Basis
        Of P, over names of `box`.
    frame : Frame
        A, B, C, D are stated in it.
    claims : callable
        The claim of a level ℓ about the system in the frame. Its constant part is affine in ℓ; what multiplies P does
        not change with it.
    density : float
        Points along each variable, over the usual number.
    vertices : (V, readings) array, optional
        Of a polytope in place of the box, which encloses it.
    """

    system: Driven
    box: Scheduling
    basis: Basis
    frame: Frame
    claims: Claims
    density: float = 2.0
    vertices: np.ndarray | None = None
    _programs: dict[tuple, tuple[Program, list[Affine]]] = field(default_factory=dict, repr=False)

    @property
    def affordable(self) -> bool:
        """Small enough to be worth solving."""
        return self._unknowns <= MOST_UNKNOWNS

    @property
    def effort(self) -> int:
        """Unknowns times inequalities times entries of P, which is what a solver's time goes with."""
        storage = self._empty(self.box)
        points, moves = self._sample(storage, self._claim(0.0, storage).power)
        count = len(moves) if self.system.sample_time is not None else 2 ** len(storage.moving)
        return self._unknowns * len(points) * count * self.system.order**2

    @property
    def _unknowns(self) -> int:
        n = self.system.order
        return self.basis.size * n * (n + 1) // 2

    def prepare(self, box: Scheduling) -> None:
        """State and compile ahead both programs.

        Parameters
        ----------
        box : Scheduling
            In discrete time the programs depend on its rates.
        """
        for least in (True, False):
            self._program(box, least, False)[0].prepare()

    def least(self, box: Scheduling | None = None) -> Iterator[StorageProposal]:
        """Candidates of the least level, one for each solver.

        Parameters
        ----------
        box : Scheduling, optional
            The same range with other rates.

        Yields
        ------
        StorageProposal
            The next solver is only started when the generator is advanced.
        """
        box = box or self.box
        program, matrices = self._program(box, True, False)
        for found in program.solve(self._rates(box), solvers=SOLVERS):
            yield StorageProposal(self._outside(found, matrices), found.objective, INTERIOR, found.solver)

    def roomiest(self, level: float = 0.0, box: Scheduling | None = None, *, capped: bool = False,
                 settings: Mapping[str, Mapping[str, Any]] | None = None) -> Iterator[StorageProposal]:
        """Candidates of the largest margin t in F ≽ tI and P ≽ tI, one for each solver.

        Parameters
        ----------
        level : float
            At which the claim is made, in the frame.
        box : Scheduling, optional
            The same range with other rates.
        capped : bool
            P ≼ I besides, for claims that are homogeneous in P.
        settings : mapping of solver to its options, optional

        Yields
        ------
        StorageProposal
            The next solver is only started when the generator is advanced.
        """
        box = box or self.box
        program, matrices = self._program(box, False, capped)
        for found in program.solve({**self._rates(box), "level": level}, solvers=SOLVERS, settings=settings):
            yield StorageProposal(self._outside(found, matrices), level, -found.objective, found.solver)

    # -- stating -----------------------------------------------------------------------------------------------------
    def _program(self, box: Scheduling, least: bool, capped: bool) -> tuple[Program, list[Affine]]:
        moving = tuple(self._empty(box).moving)
        key = (least, capped, moving if self.system.sample_time is None else box.rate)
        if key not in self._programs:
            self._programs[key] = self._stated(box, least, capped)
        return self._programs[key]

    def _stated(self, box: Scheduling, least: bool, capped: bool) -> tuple[Program, list[Affine]]:
        program, n = Program(), self.system.order
        matrices = [program.unknowns.symmetric(n) for _ in range(self.basis.size)]
        level, eye = program.unknowns.scalar(), np.eye(n)
        for matrix, rise, moved in self._inequalities(box):
            if least:
                program.require(matrix + level.times(rise), margin=INTERIOR, scaled=moved)
            else:
                program.require(matrix - level.times(np.eye(len(rise))), scaled={**moved, "level": given(rise)})
        for p in self._matrices(box):
            program.require(p - (INTERIOR * eye if least else level.times(eye)))
            if capped:
                program.require(-p + eye)
        program.minimise(level if least else -level)
        return program, matrices

    def _matrices(self, box: Scheduling) -> Iterator[Affine]:
        """P at the sampled points."""
        storage, units = self._empty(box), symmetric_units(self.system.order)
        points, _ = self._sample(storage)
        for psi in np.unique(storage.psi(points), axis=0):
            yield _combined(psi, units)

    def _inequalities(self, box: Scheduling) -> Iterator[tuple[Affine, np.ndarray, dict[str, Affine]]]:
        """F at ℓ = 0 at the sampled points and moves, what ℓ adds, and what the rates of the scheduling multiply."""
        storage, units = self._empty(box), symmetric_units(self.system.order)
        zero, one = self._claim(0.0, storage), self._claim(1.0, storage)
        points, moves = self._sample(storage, zero.power)
        empty = np.zeros((1, *units.shape[1:]))
        for k in range(len(points)):
            point = points[k : k + 1]
            constant = _at(zero, point, empty, empty)[0]
            rise = _at(one, point, empty, empty)[0] - constant
            now = _at(zero, point, units, 0 * units) - constant
            then = _at(zero, point, 0 * units, units) - constant
            still = _combined(storage.psi(point)[0], now) + constant
            if self.system.sample_time is not None:
                for after in storage.psi(storage.scheduling_after(point, moves)):
                    yield still + _combined(after, then), rise, {}
                continue
            slopes = {i: _combined(storage.basis.derivative(point[:, storage.columns], box.names[i])[0], then)
                      for i in storage.moving}
            for signs in itertools.product((-1.0, 1.0), repeat=len(slopes)):
                yield still, rise, {_rate(i): sign * x for (i, x), sign in zip(slopes.items(), signs, strict=True)}

    def _claim(self, level: float, storage: Storage) -> LyapunovInequality:
        """Of the system in the frame, τT⁻¹AT, τT⁻¹B/√g, CT/√g, D/g."""
        n, time, root = self.system.order, self.frame.time, math.sqrt(self.frame.gain)
        moved = self.system.coefficients.copy()
        moved[:, :n] = time * np.linalg.inv(self.frame.states) @ moved[:, :n]
        moved[:, :, :n] = moved[:, :, :n] @ self.frame.states
        moved[:, :, n:] /= root
        moved[:, n:] /= root
        return self.claims(level)(replace(self.system, coefficients=moved), storage)

    def _empty(self, box: Scheduling) -> Storage:
        n = self.system.order
        storage = Storage(np.zeros((self.basis.size, n, n)), self.basis, box, self.system.sample_time)
        stepped = self.vertices is not None and self.system.sample_time is not None
        return replace(storage, box=stepped_box(storage)) if stepped else storage

    def _sample(self, storage: Storage, power: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """As `sample`; on a polytope a lattice on its simplices, as fine as is affordable."""
        if self.vertices is None:
            return sample(self.system, storage, self.density, power)
        moves = tensor([np.array([0.0, 1.0]) if i in storage.moving else np.array([0.5])
                        for i in range(self.vertices.shape[1])])
        most, n = max(MOST_INEQUALITIES // len(moves), len(self.vertices)), self.vertices.shape[1]
        degree = (self.basis.degree or 0) + (power or 1) * max((r.degree for r in self.system.readings), default=0)
        wanted = round(self.density * (3 * degree + 2))  # as many along an edge as along a side of a box
        order = max(1, min(wanted, int((most * math.factorial(n) / len(simplices(self.vertices))) ** (1 / n))))
        points = next((p for k in range(order, 1, -1) if len(p := lattice(self.vertices, k)) <= most), None)
        return lattice(self.vertices, 1) if points is None else points, moves

    def _rates(self, box: Scheduling) -> dict[str, float]:
        """Rates of the scheduling in the frame's unit of time."""
        return {_rate(i): (box.rate[i] or 0.0) * self.frame.time for i in self._empty(box).moving}

    def _outside(self, found: Any, matrices: list[Affine]) -> np.ndarray:
        return self.frame.outside(np.stack([found[m] for m in matrices]))


def sample(system: Driven, template: Storage, density: float, power: int | None = None
           ) -> tuple[np.ndarray, np.ndarray]:
    """Points and moves at which an inequality of a degree in the system's matrices is imposed.

    Parameters
    ----------
    system : Driven
        For its readings and its kind of time.
    template : Storage
        For the basis of P, the box and its rates.
    density : float
        Points along each variable, over the usual number.
    power : int, optional
        Degree in the system's matrices; left out, 1 in continuous and 2 in discrete time.

    Returns
    -------
    (N, variables) array
        Points; fewer where the inequalities would be more than `MOST_INEQUALITIES`.
    (T, variables) array
        Moves τ ∈ [0, 1].
    """
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


def _rate(i: int) -> str:
    return f"rate {i}"


def _at(problem: LyapunovInequality, point: np.ndarray, p: np.ndarray, later: np.ndarray) -> np.ndarray:
    """(q, m, m) the inequality at one point for q storage functions."""
    return problem.matrix(Pieces.of(problem.system.matrices(point), p, later[:, None]))[:, 0]


def _combined(weights: np.ndarray, parts: np.ndarray) -> Affine:
    """Σ_j weights[j] Σ_q x_jq parts[q], for parts of shape (q, m, m)."""
    m = parts.shape[1]
    linear = np.einsum("j,qab->abjq", weights, parts).reshape(m * m, len(weights) * len(parts))
    return Affine(np.zeros((m, m)), sparse.csr_array(linear))
