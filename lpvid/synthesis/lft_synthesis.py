"""Gain scheduling by scaled small gain: a controller with its own copy of the scheduling block Δ.

Packard 1994; Apkarian & Gahinet 1995. The plant is a linear fractional form; a controller of the same form uses a copy
of Δ, and one scaling 𝓛 that commutes with diag(Δ, Δ) makes the loop contractive for every trajectory of the scheduling.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.lmi.affine import Affine, block
from lpvid.lmi.program import Program
from lpvid.model.lft import LFTModel
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial
from lpvid.synthesis.assumptions import fault_of
from lpvid.synthesis.criteria import HInfinity
from lpvid.synthesis.design_grid import fitted, over
from lpvid.synthesis.figures import measure
from lpvid.synthesis.forms import to_lft
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.plant_functions import named
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.shaped_program import PATIENT, Coordinates

STRICT = 1e-9
APART = 4.0
"""How far the couplings [R, sI; sI, S] ⪰ 0 and [J, sI; sI, L] ⪰ 0 are pushed from their limit s = 1."""


@dataclass(frozen=True, eq=False)
class LFTFeedback:
    """Output feedback whose controller holds a copy of Δ: scaled small gain, for rational dependence.

    ::

              ┌──────────┐                       N_Sᵀ(…S, L, γ…)N_S ≺ 0, N_Rᵀ(…R, J, γ…)N_R ≺ 0,
          ┌──>│ plant    │──┐   p = Δ q          [R, I; I, S] ⪰ 0, [J, I; I, L] ⪰ 0,
          │   └──────────┘  │   p_K = Δ q_K      J, L commute with Δ (Apkarian & Gahinet 1995)
          │   ┌──────────┐  │
          └───│ controller│<┘
              └──────────┘

    The scheduling may move arbitrarily fast. The controller, rational in the scheduling, is returned as a polynomial
    (or a table) that is fitted to it, and verified as returned.

    Parameters
    ----------
    back_off : float
        Factor above the lowest γ at which R, S and the scalings are then made small and kept apart.

    Examples
    --------
    >>> LFTFeedback(back_off=1.1).back_off
    1.1
    """

    back_off: float = 1.05

    def __post_init__(self) -> None:
        if not _checks.real(self.back_off, "back_off") >= 1:
            raise InputError("back_off must be at least 1", got=self.back_off, why="it multiplies the least gain",
                             mend="1.02 stops 2 % above it")

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The controller for a plant with a polynomial basis, its closed loop verified."""
        started, corners = time.perf_counter(), plant.box.grid(3)
        at = plant.at(corners)
        fault = fault_of(plant, at, corners)
        if fault is not None:
            return Synthesis(fault.verdict, why=fault.why, mend=fault.mend, method="scaled small gain")
        if at.D22.any():
            raise InputError(f"the controls {', '.join(plant.controls)} reach the measurements directly",
                             mend="delay them by a fast lag, or use OutputFeedback")
        c = Coordinates.of(at, plant.sample_time is not None)
        fractional = fractional_plant(plant, c)
        rough = next(scaled_levels(fractional), None)
        outcome = None if rough is None else self._best(plant, c, fractional, *rough, started)
        if outcome is not None:
            return outcome
        why = ("no scalings and Lyapunov matrix bound the gain for arbitrarily fast scheduling" if rough is None else
               "no controller recovered from the solvers' answers keeps the loop stable")
        return Synthesis("infeasible" if rough is None else "numerical", why=why, method="scaled small gain",
                         mend="use OutputFeedback with a Lyapunov matrix that depends on the scheduling, and rates",
                         seconds=time.perf_counter() - started)

    def _best(self, plant: GeneralizedPlant, c: Coordinates, fractional: FractionalPlant, lowest: float,
              rough: dict[str, np.ndarray], started: float) -> Synthesis | None:
        """The first controller that keeps its promise, or the best that was verified."""
        scale = max(float(np.abs(m).max(initial=1.0)) for m in rough.values())
        best: Synthesis | None = None
        for factor in dict.fromkeys((self.back_off, 1.2, 1.5)):
            for gamma, found in scaled_levels(fractional, lowest * factor, scale):
                for law, solver in _tried(fractional, gamma * 1.001, found):
                    controller = _written(plant, c, law)
                    loop = close_loop(plant, controller)
                    seen = measure(HInfinity(), plant, loop, gamma, Polynomial((), 0))
                    if not np.isfinite(seen.verified):
                        continue
                    kept = seen.verified <= 1.005 * gamma
                    result = Synthesis(
                        "solved" if kept and factor == self.back_off else "backed-off", gamma, seen.verified,
                        seen.lower, controller, loop, seen.certificate, seen.between_grid,
                        why=_why(kept, factor, self.back_off),
                        notes=tuple(f"the scheduling block repeats {n} {k} time(s)" for n, k in
                                    zip(plant.box.names, fractional.repetitions, strict=True)),
                        seconds=time.perf_counter() - started, solver=solver,
                        method="scaled small gain", infimum=lowest)
                    if kept:
                        return result
                    if best is None or seen.verified < (best.gamma_verified or np.inf):
                        best = result
        return best


def _why(kept: bool, factor: float, asked: float) -> str:
    if not kept:
        return "the closed loop was verified, but above the promise"
    if factor == asked:
        return "the closed loop keeps what the scaled small-gain inequalities promised"
    return (f"no controller was recovered at {asked:g} times the least bound of the scaled small-gain inequalities; "
            f"the closed loop keeps what they promise at {factor:g} times")


@dataclass(frozen=True, eq=False)
class FractionalPlant:
    """x⁺ = A x + B_d p + B1 w + B2 u, q = C_d x + …, z = C1 x + …, y = C2 x + …, p = Δ q, Δ = diag(δ_i I_{r_i}).

    Parameters
    ----------
    blocks : (n + r + n_z + n_y, n + r + n_w + n_u) array
        [A B_d B1 B2; C_d D_dd D_d1 D_d2; C1 D_1d D_11 D_12; C2 D_2d D_21 0], |δ_i| ≤ 1.
    order, repetitions : int and tuple of int
        n and r_i.
    outer : (int, int, int, int)
        n_w, n_u, n_z, n_y.
    discrete : bool
    """

    blocks: np.ndarray
    order: int
    repetitions: tuple[int, ...]
    outer: tuple[int, int, int, int]
    discrete: bool

    def part(self, row: str, column: str) -> np.ndarray:
        """A block by its letters: rows x, q, z, y; columns x, p, w, u."""
        nw, nu, nz, ny = self.outer
        n, r = self.order, sum(self.repetitions)
        tall, wide = np.cumsum([0, n, r, nz, ny]), np.cumsum([0, n, r, nw, nu])
        i, j = "xqzy".index(row), "xpwu".index(column)
        return self.blocks[tall[i] : tall[i + 1], wide[j] : wide[j + 1]]

    def stack(self, rows: str, columns: str) -> np.ndarray:
        """Several blocks side by side and above each other."""
        return np.block([[self.part(r, c) for c in columns] for r in rows])


@dataclass(frozen=True, eq=False)
class FractionalController:
    """x_K⁺, u, q_K = Ω [x_K; y; p_K] with p_K = Δ q_K."""

    matrix: np.ndarray
    order: int
    repetitions: tuple[int, ...]

    def at(self, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A_K, B_K, C_K, D_K at normalised scheduling values δ of shape (len(repetitions),)."""
        n, r = self.order, sum(self.repetitions)
        m = self.matrix
        outer, inner = m.shape[0] - r, m.shape[1] - r
        block_ = np.diag(np.repeat(delta, self.repetitions))
        closed = m[:outer, :inner] + m[:outer, inner:] @ block_ @ np.linalg.solve(
            np.eye(r) - m[outer:, inner:] @ block_, m[outer:, :inner])
        return closed[:n, :n], closed[:n, n:], closed[n:, :n], closed[n:, n:]


def fractional_plant(plant: GeneralizedPlant, c: Coordinates) -> FractionalPlant:
    """The linear fractional form of a plant, its signals sorted, in scaled coordinates."""
    model = to_lft(plant.system).model
    assert isinstance(model, LFTModel)
    n, r = model.order, model.width
    names_in, names_out = [s.name for s in model.inputs], [s.name for s in model.outputs]
    columns = [*range(n + r), *(n + r + names_in.index(x) for x in (*plant.disturbances, *plant.controls))]
    rows = [*range(n + r), *(n + r + names_out.index(x) for x in (*plant.performance, *plant.measurements))]
    nw, nz, root = len(plant.disturbances), len(plant.performance), np.sqrt(c.pace)
    right = np.concatenate([c.states / root, np.ones(r + nw), c.controls])
    left = np.concatenate([1 / (c.states * root), np.ones(r + nz), 1 / c.measurements])
    blocks = left[:, None] * model.matrix[np.ix_(rows, columns)] * right
    outer = (nw, len(plant.controls), nz, len(plant.measurements))
    return FractionalPlant(blocks, n, model.repetitions, outer, plant.sample_time is not None)


def _tried(plant: FractionalPlant, gamma: float, found: dict[str, np.ndarray]
           ) -> Iterator[tuple[FractionalController, str]]:
    try:
        yield from recovered(plant, gamma, found)
    except np.linalg.LinAlgError:
        return


def _written(plant: GeneralizedPlant, c: Coordinates, law: FractionalController) -> LPVStateSpace:
    """A controller over the scheduling in the plant's units: a polynomial through its values."""
    box, n, root = plant.box, law.order, np.sqrt(c.pace)
    half = np.where(box.half_width > 0, box.half_width, 1.0)
    left = np.concatenate([np.full(n, root), c.controls])
    right = np.concatenate([np.full(n, root), 1 / c.measurements])

    def values(points: np.ndarray) -> np.ndarray:
        parts = [law.at((p - box.centre) / half) for p in points]
        return np.array([left[:, None] * np.block([[a, b], [k, d]]) * right for a, b, k, d in parts])

    axes = tuple(np.unique(np.linspace(low, high, 5)) for low, high in zip(box.lower, box.upper, strict=True))
    basis, g = fitted(values, box, axes, Polynomial(box.names, 1))
    return LPVStateSpace(g[:, :n, :n], g[:, :n, n:], g[:, n:, :n], g[:, n:, n:], basis, plant.sample_time,
                         over(box, basis.names), inputs=named(plant, plant.measurements),
                         outputs=named(plant, plant.controls))


def scaled_levels(plant: FractionalPlant, gamma: float | None = None, scale: float = 1.0
                  ) -> Iterator[tuple[float, dict[str, np.ndarray]]]:
    """Solve for R, S and the scalings J, L: the lowest γ, or at a given γ the tamest matrices.

    Yields
    ------
    (float, dict)
        γ and the matrices R, S, J, L; one for each solver.
    """
    program = Program()
    new, n = program.unknowns, plant.order
    r, s = new.symmetric(n), new.symmetric(n)
    j, l_ = _commuting(program, plant.repetitions), _commuting(program, plant.repetitions)
    level = new.scalar()
    _primal(program, plant, s, l_, level)
    _primal(program, _dual(plant), r, j, level)
    apart = _constant(np.ones((1, 1))) if gamma is None else new.scalar()
    for a, b in ((r, s), (j, l_)):
        if a.shape[0]:
            coupling = apart.times(np.eye(a.shape[0]))
            program.require(block([[a, coupling], [coupling, b]]))
    if gamma is None:
        program.minimise(level)
    else:
        program.require(gamma - level)
        program.require(APART - apart)
        t = new.scalar()
        for matrix in (r, s, j, l_):
            if matrix.shape[0]:
                program.require(t.times(np.eye(matrix.shape[0])) - matrix)
        program.minimise((1 / scale) * t - apart)
    for found in program.solve(solvers=PATIENT):
        yield (float(found[level][0, 0]) if gamma is None else gamma,
               {"R": found[r], "S": found[s], "J": found[j], "L": found[l_]})


def _primal(program: Program, plant: FractionalPlant, s: Affine, scaling: Affine, level: Affine) -> None:
    """The inequality in S and L, on the null space of [C2 D_2d D_21]."""
    n, r, (nw, _, nz, _) = plant.order, sum(plant.repetitions), plant.outer
    free = null_space(plant.stack("y", "xpw")) if plant.outer[3] else np.eye(n + r + nw)
    state, inner, last = (np.eye(n + r + nw)[a:b] for a, b in ((0, n), (n, n + r), (n + r, n + r + nw)))
    ahead, seen, out = plant.stack("x", "xpw"), plant.stack("q", "xpw"), plant.stack("z", "xpw")
    if plant.discrete:
        total = ahead.T @ s @ ahead - state.T @ s @ state
    else:
        cross = state.T @ s @ ahead
        total = cross + cross.T
    if r:
        total = total + seen.T @ scaling @ seen - inner.T @ scaling @ inner
    total = total - level.times(last.T @ last)
    below = out @ free
    program.require(block([[-(free.T @ total @ free), -below.T], [-below, level.times(np.eye(nz))]]), margin=STRICT)


def _dual(plant: FractionalPlant) -> FractionalPlant:
    """The transposed plant, in which z and w, and y and u, change places."""
    nw, nu, nz, ny = plant.outer
    return FractionalPlant(plant.blocks.T, plant.order, plant.repetitions, (nz, ny, nw, nu), plant.discrete)


def _commuting(program: Program, repetitions: Sequence[int]) -> Affine:
    """A symmetric matrix that commutes with diag(δ_i I_{r_i})."""
    repetitions = [k for k in repetitions if k]
    parts = [program.unknowns.symmetric(k) for k in repetitions]
    if not parts:
        return program.unknowns.matrix(0, 0)
    return block([[p if i == k else np.zeros((repetitions[i], repetitions[k])) for k in range(len(parts))]
                  for i, p in enumerate(parts)])


def recovered(plant: FractionalPlant, gamma: float, found: dict[str, np.ndarray]
              ) -> Iterator[tuple[FractionalController, str]]:
    """Controllers that reach γ with the Lyapunov matrix and scaling completed from R, S, J and L, with their solver."""
    n, r = plant.order, sum(plant.repetitions)
    lyapunov = _completed(found["S"], found["R"])
    scaling = _completed(found["L"], found["J"], plant.repetitions)
    (a, b, c), (nw, nu, nz, ny) = _extended(plant), plant.outer
    program = Program()
    omega = program.unknowns.matrix(n + nu + r, n + ny + r)
    loop = a + b @ omega @ c
    rows, columns = np.eye(a.shape[0]), np.eye(a.shape[1])
    ahead, out = rows[: 2 * n] @ loop, rows[2 * n :] @ loop
    state, inner = columns[:, : 2 * n].T, columns[:, 2 * n :].T
    supply = _diagonal(scaling, gamma * np.eye(nw))
    limit = _diagonal(np.linalg.inv(scaling) if r else np.zeros((0, 0)), gamma * np.eye(nz))
    if plant.discrete:
        inside = state.T @ lyapunov @ state + inner.T @ supply @ inner
        inverse = np.linalg.inv(lyapunov)
        zero = np.zeros((2 * n, len(limit)))
        whole = block([[_constant(inside), ahead.T, out.T], [ahead, inverse, zero], [out, zero.T, limit]])
    else:
        cross = state.T @ lyapunov @ ahead
        inside = -(cross + cross.T) + inner.T @ supply @ inner
        whole = block([[inside, out.T], [out, limit]])
    program.require(whole, margin=STRICT)
    t = program.unknowns.scalar()
    m, k = omega.shape
    program.require(block([[t.times(np.eye(m)), omega], [omega.T, t.times(np.eye(k))]]))
    program.minimise(t)
    for answer in program.solve(solvers=PATIENT):
        yield FractionalController(answer[omega], n, plant.repetitions), answer.solver


def _constant(matrix: np.ndarray) -> Affine:
    from scipy import sparse

    return Affine(matrix, sparse.csr_array((matrix.size, 0)))


def _completed(s: np.ndarray, r: np.ndarray, repetitions: Sequence[int] | None = None) -> np.ndarray:
    """[S, Gᵀ; G, I] whose inverse has R in its first block: GᵀG = S − R⁻¹."""
    if not len(s):
        return np.zeros((0, 0))
    gap = s - np.linalg.inv(r)
    values, vectors = np.linalg.eigh(0.5 * (gap + gap.T))
    if values[0] <= 0:
        raise np.linalg.LinAlgError("R and S leave no room for a controller")
    if repetitions is None:
        g = np.sqrt(values)[:, None] * vectors.T
    else:
        ends = np.cumsum([0, *repetitions])
        g = _diagonal(*(np.linalg.cholesky(gap[a:b, a:b]).T for a, b in itertools.pairwise(ends)))
    return np.block([[s, g.T], [g, np.eye(len(s))]])


def _extended(plant: FractionalPlant) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Loop = a + b Ω c from (x, x_K, p, p_K, w) to (x⁺, x_K⁺, q, q_K, z); Ω from (x_K, y, p_K) to (x_K⁺, u, q_K)."""
    n, r, (nw, nu, nz, ny) = plant.order, sum(plant.repetitions), plant.outer
    tall, wide = np.cumsum([0, n, n, r, r, nz]), np.cumsum([0, n, n, r, r, nw])
    a = np.zeros((tall[-1], wide[-1]))
    for i, row in ((0, "x"), (2, "q"), (4, "z")):
        for k, column in ((0, "x"), (2, "p"), (4, "w")):
            a[tall[i] : tall[i + 1], wide[k] : wide[k + 1]] = plant.part(row, column)
    b, c = np.zeros((tall[-1], n + nu + r)), np.zeros((n + ny + r, wide[-1]))
    b[tall[1] : tall[2], :n] = np.eye(n)
    b[tall[3] : tall[4], n + nu :] = np.eye(r)
    for i, row in ((0, "x"), (2, "q"), (4, "z")):
        b[tall[i] : tall[i + 1], n : n + nu] = plant.part(row, "u")
    c[:n, wide[1] : wide[2]] = np.eye(n)
    c[n + ny :, wide[3] : wide[4]] = np.eye(r)
    for k, column in ((0, "x"), (2, "p"), (4, "w")):
        c[n : n + ny, wide[k] : wide[k + 1]] = plant.part("y", column)
    return a, b, c


def _diagonal(*blocks: np.ndarray) -> np.ndarray:
    """Blocks on a diagonal."""
    ends = np.cumsum([0, *(len(b) for b in blocks)])
    whole = np.zeros((ends[-1], ends[-1]))
    for part, a, b in zip(blocks, ends[:-1], ends[1:], strict=True):
        whole[a:b, a:b] = part
    return whole
