"""The inequalities of scaled small gain (Apkarian & Gahinet 1995), their search, and the controller behind them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.linalg import null_space

from lpvid.lmi.affine import Affine, block, given
from lpvid.lmi.certificate import diagonal
from lpvid.lmi.program import Program
from lpvid.synthesis.fractional_plant import FractionalController, FractionalPlant
from lpvid.synthesis.fractional_recovery import by_feedback
from lpvid.synthesis.preconditioning import balancing
from lpvid.synthesis.scaled_gain import commuting, scaled_form
from lpvid.synthesis.shaped_program import INTERIOR_POINT

STRICT = 1e-9
APART = 4.0
"""How far the couplings [R, sI; sI, S] ⪰ 0 and [J, sI; sI, L] ⪰ 0 are pushed from their limit s = 1."""
FACTORS = (1.1, 2.0, 10.0, 100.0, 1e4)
"""multiples of the least ρ of the closed form: more conditioning and a larger Ω with each."""
ROUNDS = 4
"""of coordinates; each halves the decades between the largest and the smallest unknown, or better."""
SETTLED = 1e-3
"""relative change of the least γ from one round to the next at which it counts as found."""


def scaled_levels(plant: FractionalPlant, gamma: float | None = None, scale: float = 1.0
                  ) -> Iterator[tuple[float, dict[str, np.ndarray]]]:
    """Solve for R, S and the scalings J, L: the lowest γ, or at a given γ the least t/(s − 1).

    All four are below t, and their couplings at a distance s from the limit s = 1, where the recovery divides by zero.

    Parameters
    ----------
    plant : FractionalPlant
        What is controlled.
    gamma : float, optional
        Level to keep; left out, the lowest is looked for.
    scale : float
        About the norm of R, S, J and L; without meaning where no `gamma` is given.

    Yields
    ------
    (float, dict)
        γ and the matrices R, S, J, L; one for each solver.
    """
    program = Program()
    new, n = program.unknowns, plant.order
    r, s = new.symmetric(n), new.symmetric(n)
    j, l_ = (commuting(new.symmetric, plant.repetitions) for _ in range(2))
    level = new.scalar()
    _primal(program, plant, s, l_, level)
    _primal(program, plant.dual(), r, j, level)
    apart = given(1.0) if gamma is None else new.scalar()
    for a, b in ((r, s), (j, l_)):
        if a.shape[0]:
            coupling = apart.times(np.eye(a.shape[0]))
            program.require(block([[a, coupling], [coupling, b]]))
    if gamma is None:
        program.minimise(level)
    else:
        program.require(gamma - level)
        program.require(APART - apart)
        program.require(apart - 1.0)
        t = new.scalar()
        for matrix in (r, s, j, l_):
            if matrix.shape[0]:
                program.require(t.times(np.eye(matrix.shape[0])) - matrix)
        program.maximise_ratio(apart - 1.0, t, scale)
    for found in program.solve(solvers=INTERIOR_POINT):
        yield (float(found[level][0, 0]) if gamma is None else gamma,
               {"R": found[r], "S": found[s], "J": found[j], "L": found[l_]})


def settled_levels(plant: FractionalPlant, back_off: float
                   ) -> Iterator[tuple[float, FractionalPlant, dict[str, np.ndarray]]]:
    """The least γ in coordinates that follow the answers, and matrices at `back_off` times it; best coordinates first.

    In the coordinates of the last answer R = S and J = L are diagonal, so that no unknown is large because another is
    small. They are taken at a γ above the least one, where the matrices stay bounded.

    Parameters
    ----------
    plant : FractionalPlant
        What is controlled.
    back_off : float
        Factor, at least 1.

    Yields
    ------
    (float, FractionalPlant, dict)
        Least γ found in these coordinates, the plant in them, and R, S, J, L at `back_off` times it.
    """
    seen: list[tuple[float, FractionalPlant, dict[str, np.ndarray]]] = []
    for _ in range(ROUNDS):
        rough = next(scaled_levels(plant), None)
        if rough is None:
            break
        lowest, matrices = rough
        scale = max(float(np.abs(m).max(initial=1.0)) for m in matrices.values())
        found = next(scaled_levels(plant, lowest * back_off, scale), None)
        if found is None:
            break
        seen.append((lowest, plant, found[1]))
        if len(seen) > 1 and seen[-1][0] > (1 - SETTLED) * seen[-2][0]:
            break
        try:
            plant = plant.in_coordinates(balancing(found[1]["R"], found[1]["S"])[0],
                                         _balancing(found[1]["J"], found[1]["L"], plant.repetitions))
        except np.linalg.LinAlgError:
            break
    yield from sorted(seen, key=lambda s: s[0] * (1 + SETTLED) ** -seen.index(s))


def _balancing(r: np.ndarray, s: np.ndarray, repetitions: Sequence[int]) -> np.ndarray:
    """Block by block of what is repeated (`lpvid.synthesis.preconditioning.balancing`)."""
    ends = np.cumsum([0, *repetitions])
    return diagonal(*(balancing(r[a:b, a:b], s[a:b, a:b])[0] for a, b in itertools.pairwise(ends) if b > a))


def _primal(program: Program, plant: FractionalPlant, s: Affine, scaling: Affine, level: Affine) -> None:
    """The inequality in S and L, on the null space of [C2 D_2d D_21]."""
    n, r, (nw, _, nz, _) = plant.order, sum(plant.repetitions), plant.outer
    free = null_space(plant.stack("y", "xpw")) if plant.outer[3] else np.eye(n + r + nw)
    ahead, seen, out = (plant.stack(row, "xpw") for row in "xqz")
    total = scaled_form(ahead, seen, s, scaling, level, discrete=plant.discrete)
    below = out @ free
    program.require(block([[-(free.T @ total @ free), -below.T], [-below, level.times(np.eye(nz))]]), margin=STRICT)


def recovered(plant: FractionalPlant, gamma: float, found: dict[str, np.ndarray]
              ) -> Iterator[tuple[FractionalController, str]]:
    """Controllers that reach γ with the Lyapunov matrix and scaling completed from R, S, J and L, with their solver.

    First by output feedback of the plant with the scalings in it (`lpvid.synthesis.fractional_recovery`). Otherwise
    the inequality is Q + 𝓑Ω𝓒 + (𝓑Ω𝓒)ᵀ ≺ 0 in the controller Ω: the Ω of least norm, then the closed form, which needs
    no solver, but whose gains are large where the sensors carry little noise.

    Parameters
    ----------
    plant : FractionalPlant
        In the coordinates of the matrices.
    gamma : float
        Level to reach.
    found : dict of str to array
        R, S (n, n) and J, L (r, r), as `settled_levels` gives them.

    Yields
    ------
    FractionalController
        Not verified yet.
    str
        Solver, or what it was made by.
    """
    own = by_feedback(plant, gamma, _completed(found["L"], found["J"], plant.repetitions))
    if own is not None:
        yield own, "Riccati and closed form"
    n, r, (_, nu, _, ny) = plant.order, sum(plant.repetitions), plant.outer
    q, b, c = _inequality(plant, gamma, found)
    program = Program()
    unknown = program.unknowns.matrix(n + nu + r, n + ny + r)
    turned = b @ unknown @ c
    program.require(-q - turned - turned.T, margin=STRICT)
    t = program.unknowns.scalar()
    m, k = unknown.shape
    program.require(block([[t.times(np.eye(m)), unknown], [unknown.T, t.times(np.eye(k))]]))
    program.minimise(t)
    for answer in program.solve(solvers=INTERIOR_POINT):
        yield FractionalController(answer[unknown], n, plant.repetitions), answer.solver
    for omega in _central(q, b, c):
        yield FractionalController(omega, n, plant.repetitions), "closed form"


def _inequality(plant: FractionalPlant, gamma: float, found: dict[str, np.ndarray]
                ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Q, 𝓑 and 𝓒 of the bounded real lemma of the loop, in coordinates where the Lyapunov matrix and scalings are I.

    With 𝓐 = a + bΩc from (x, p, w) to (ẋ or x⁺, q, z), V = xᵀPx and the scaling Λ, in continuous time
    [PA + AᵀP, PB; BᵀP, −diag(Λ, γ)] + [C D]ᵀ diag(Λ, 1/γ) [C D] ≺ 0, its last term by a Schur complement.
    """
    n, r = plant.order, sum(plant.repetitions)
    lyapunov = _completed(found["S"], found["R"])
    scaling = _completed(found["L"], found["J"], plant.repetitions)
    (a, b, c), (nw, _, nz, _) = _extended(plant), plant.outer
    root, turn = np.linalg.cholesky(lyapunov).T, np.linalg.cholesky(scaling).T if r else np.zeros((0, 0))
    left = diagonal(root, turn, np.eye(nz) / np.sqrt(gamma))
    right = diagonal(*(np.linalg.inv(m) if len(m) else m for m in (root, turn)), np.eye(nw) / np.sqrt(gamma))
    a, b, c = left @ a @ right, left @ b, c @ right
    states, (tall, wide) = 2 * n, a.shape
    if plant.discrete:
        q = np.block([[-np.eye(wide), a.T], [a, -np.eye(tall)]])
        return q, np.vstack([np.zeros((wide, b.shape[1])), b]), np.hstack([c, np.zeros((len(c), tall))])
    inside = np.zeros((wide, wide))
    inside[:states] += a[:states]
    inside[:, :states] += a[:states].T
    inside[states:, states:] -= np.eye(wide - states)
    out, reach = a[states:], np.zeros((wide, b.shape[1]))
    reach[:states] = b[:states]
    q = np.block([[inside, out.T], [out, -np.eye(len(out))]])
    return q, np.vstack([reach, b[states:]]), np.hstack([c, np.zeros((len(c), len(out)))])


def _central(q: np.ndarray, b: np.ndarray, c: np.ndarray) -> Iterator[np.ndarray]:
    """Ω = −ρ 𝓑ᵀΦ𝓒ᵀ(𝓒Φ𝓒ᵀ)⁻¹, Φ = (ρ𝓑𝓑ᵀ − Q)⁻¹ ≻ 0 (Iwasaki & Skelton 1994), from the least ρ upwards.

    Examples
    --------
    >>> q, b, c = np.array([[1.0, 0.5], [0.5, -2.0]]), np.array([[1.0], [0.0]]), np.array([[1.0, 0.0]])
    >>> omega = next(_central(q, b, c))
    >>> bool(np.linalg.eigvalsh(q + b @ omega @ c + (b @ omega @ c).T).max() < 0)
    True
    """
    least = _least_weight(q, b)
    for factor in FACTORS if math.isfinite(least) else ():
        weight = factor * least
        try:
            phi = np.linalg.inv(np.linalg.cholesky(weight * b @ b.T - q))
        except np.linalg.LinAlgError:
            continue
        seen, reached = phi @ c.T, phi @ b
        yield -weight * reached.T @ np.linalg.lstsq(seen.T, np.eye(len(c)), rcond=None)[0]


def _least_weight(q: np.ndarray, b: np.ndarray) -> float:
    """Least ρ ≥ 0 with ρ𝓑𝓑ᵀ − Q ⪰ 0; infinite where Q is not negative on the null space of 𝓑ᵀ."""
    u, sizes, _ = np.linalg.svd(b)
    rank = int((sizes > 1e-12 * sizes.max(initial=0.0)).sum())
    reached, free = u[:, :rank], u[:, rank:]
    inner = -free.T @ q @ free
    if inner.size and np.linalg.eigvalsh(inner).min() <= 0:
        return math.inf
    cross = free.T @ q @ reached
    total = reached.T @ q @ reached + (cross.T @ np.linalg.solve(inner, cross) if inner.size else 0.0)
    return max(float(np.linalg.eigvalsh(total / np.outer(sizes[:rank], sizes[:rank])).max(initial=0.0)), 1e-6)


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
        g = diagonal(*(np.linalg.cholesky(gap[a:b, a:b]).T for a, b in itertools.pairwise(ends)))
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
