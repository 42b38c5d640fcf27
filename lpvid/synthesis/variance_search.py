"""One H2 criterion by output feedback: the change of variables with the controller's own dynamics eliminated.

With X, Y, Ĉ and B̂ of Scherer, Gahinet & Chilali 1997 and no feedthrough, Â stands in one block alone,

    [He(AX + B2Ĉ)   A + Âᵀ         B1         ]             [Z   C1X + D12Ĉ   C1]
    [⋆              He(YA + B̂C2)   YB1 + B̂D21 ] ≺ 0,        [⋆   X            I ] ≻ 0,    trace Z ≤ ν,
    [⋆              ⋆              −νI        ]             [⋆   ⋆            Y ]

so that it can be had exactly if the two parts without that block hold (projection lemma), and then as
Âᵀ = −A − B1(YB1 + B̂D21)ᵀ/ν, which leaves the two parts apart. X and Y are unknown in coordinates in which the last
answer was the identity; the first is that of the linear-quadratic regulator and the Kalman filter at the middle of the
box: X is the covariance of the states, Y⁻¹ that of the estimate's error, both over ν.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from lpvid.lmi.affine import Affine, block, combined, he, trace
from lpvid.lmi.program import Program
from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.progress import Rounds, stop_at
from lpvid.synthesis.projected_half import congruent
from lpvid.synthesis.projection import definite_root
from lpvid.synthesis.regularised_plants import regular
from lpvid.synthesis.riccati import FREE, STRICT

ROUNDS = 8
SETTLED = 1e-3
"""relative change of the level from one round of coordinates to the next at which it counts as found"""
COST = 0.05
"""share of the least level that the further disturbance and weight may cost at the start: the more of them, the better
conditioned it is"""
ROOM = 1.5
"""times X and Y of the middle point at which they are a start: at the least level itself they fit no other point"""


@dataclass(frozen=True, eq=False)
class VarianceAnswer:
    """X, Y (n, n) and Ĉ (K, n_u, n), B̂ (K, n, n_y) over the plant's basis, and the level ν that they promise.

    Parameters
    ----------
    x, y : (n, n) array
        X and Y.
    c : (K, n_u, n) array
        Ĉ over the plant's basis.
    b : (K, n, n_y) array
        B̂ over the plant's basis.
    level : float
        ν, in the problem's scaled units.
    solver, status : str
        Which solver found it, and its own verdict.
    """

    x: np.ndarray
    y: np.ndarray
    c: np.ndarray
    b: np.ndarray
    level: float
    solver: str = ""
    status: str = ""


@dataclass(frozen=True, eq=False)
class VarianceProblem:
    """The inequalities of a plant at N points.

    Parameters
    ----------
    plant : PlantMatrices
        Continuous, in balanced units of time; B1 and C1 of the criterion alone.
    phi : (N, K) array
        Values of the plant's basis at the points.
    """

    plant: PlantMatrices
    phi: np.ndarray

    def least(self, solvers: Sequence[str]) -> VarianceAnswer | None:
        """The answer of least level, in coordinates that follow the answers until it settles.

        Parameters
        ----------
        solvers : sequence of str
            Tried in this order.

        Returns
        -------
        VarianceAnswer or None
            None where no solver found one.
        """
        best, known, rounds = None, self._start(), Rounds("the least H2 norm", ROUNDS)
        for _ in range(ROUNDS if known is not None else 0):
            assert known is not None
            try:
                rounds.enter()
                found = self._solved(known, None, solvers)
            except KeyboardInterrupt as error:
                if best is None:
                    raise
                stop_at(error)
                break
            if found is None or (best is not None and found.level > (1 + SETTLED) * best.level):
                break
            settled = best is not None and found.level > (1 - SETTLED) * best.level
            best = known = found
            if settled and found.status == "optimal":
                break
        return best

    def gentle(self, least: VarianceAnswer, level: float, solvers: Sequence[str]) -> Iterator[VarianceAnswer]:
        """Answers at a level above the least, each better conditioned than the last; where no solver finds one, that of
        the least level, which then has room.

        Parameters
        ----------
        least : VarianceAnswer
            The answer of least level.
        level : float
            Above it.
        solvers : sequence of str
            Tried in this order.

        Yields
        ------
        VarianceAnswer
            At most two.
        """
        known = replace(least, level=level)
        for attempt in range(2):
            found = self._solved(known, level, solvers)
            if found is None:
                if not attempt:
                    yield known
                return
            known = found
            yield found

    def dynamics(self, answer: VarianceAnswer) -> np.ndarray:
        """(K, n, n) Â over the basis, for B1 and D21 that do not vary.

        Parameters
        ----------
        answer : VarianceAnswer
            X, Y, Ĉ, B̂ and level.

        Returns
        -------
        (K, n, n) array
            Â over the plant's basis.
        """
        p = self.plant
        one = np.linalg.lstsq(self.phi, np.ones(len(self.phi)), rcond=None)[0]
        a = np.tensordot(np.linalg.pinv(self.phi), p.A, axes=1)
        into = one[:, None, None] * (answer.y @ p.B1[0]) + answer.b @ p.D21[0]
        return -(a.swapaxes(1, 2) + into @ p.B1[0].T / answer.level)

    def _start(self) -> VarianceAnswer | None:
        """That of the middle point, by its Riccati equations."""
        found = regulated(regular(self.plant, FREE).point(len(self.plant.A) // 2))
        if found is None:
            return None
        x, y, level = found
        many, (nu, ny) = self.phi.shape[1], (self.plant.B2.shape[2], self.plant.C2.shape[1])
        return VarianceAnswer(ROOM * x / level, ROOM * y * level, np.zeros((many, nu, len(x))),
                              np.zeros((many, len(x), ny)), level)

    def _solved(self, known: VarianceAnswer, level: float | None, solvers: Sequence[str]) -> VarianceAnswer | None:
        """The least level, or at a given one small matrices with a coupling far from its limit."""
        p, program = self.plant, Program()
        new, n, (nw, nz) = program.unknowns, p.A.shape[1], (p.B1.shape[2], p.C1.shape[1])
        t, u = (definite_root(m) for m in (known.x, known.y))
        into, out = np.linalg.inv(t), np.linalg.inv(u)
        x, y = new.symmetric(n), new.symmetric(n)
        ch = [new.matrix(p.B2.shape[2], n) for _ in range(self.phi.shape[1])]
        bh = [new.matrix(n, p.C2.shape[1]) for _ in range(self.phi.shape[1])]
        free = new.scalar()  # the level itself, or at a given one how far the coupling is from its limit
        bound: Affine | np.ndarray = free if level is None else level * np.eye(1)
        w: Affine | np.ndarray = free.times(np.eye(nw)) if level is None else level * np.eye(nw)
        cross = into @ out.T
        for k, weights in enumerate(self.phi):
            z = new.symmetric(nz)
            program.require(bound - trace(z))
            c, b = combined(ch, weights), combined(bh, weights)
            a1, a2 = into @ p.A[k] @ t, u.T @ p.A[k] @ out.T
            drive = b @ p.D21[k] + y @ (u.T @ p.B1[k])
            first = block([[-he(a1 @ x + (into @ p.B2[k]) @ c), into @ p.B1[k]], [(into @ p.B1[k]).T, w]])
            second = block([[-he(y @ a2 + b @ (p.C2[k] @ out.T)), drive], [drive.T, w]])
            for matrix, part, size in ((first, a1, into @ p.B1[k]), (second, a2, u.T @ p.B1[k])):
                program.require(congruent(matrix, _scale(part, size, nw, known.level)))
            shown = (p.C1[k] @ t) @ x + p.D12[k] @ c
            program.require(block([[z, shown, p.C1[k] @ out.T], [shown.T, x, cross],
                                   [(p.C1[k] @ out.T).T, cross.T, y]]))
        if level is not None:
            pushed = free.times(cross)
            program.require(block([[x, pushed], [pushed.T, y]]))
            program.require(free - 1.0)
            program.require(2.0 - free)
        program.minimise(free if level is None else trace(x) + trace(y) - (100.0 * n) * free)
        found = next(iter(program.solve(solvers=solvers)), None)
        if found is None:
            return None
        reached = float(found[free][0, 0]) if level is None else level
        if not reached > 0:
            return None
        return VarianceAnswer(t @ found[x] @ t.T, u @ found[y] @ u.T, np.array([found[m] for m in ch]) @ t.T,
                              u @ np.array([found[m] for m in bh]), reached, found.solver, found.status)


def regulated(p: PlantMatrices) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Covariance of the states, inverse covariance of the estimate's error, and the least ν, of one frozen plant.

    The regulator S and the filter P of the linear-quadratic problem, with a small further disturbance and weight on
    every state where nothing else reaches it; the estimate's covariance X̂ of its closed loop: X = P + X̂, Y = P⁻¹.

    Parameters
    ----------
    p : PlantMatrices
        One frozen plant in continuous time.

    Returns
    -------
    tuple or None
        X (n, n), Y (n, n) and ν; None where a Riccati equation has no stabilising solution.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> z, zero = np.array([[1.0], [0.0]]), np.zeros((2, 2))
    >>> point = PlantMatrices(-one, np.array([[1.0, 0.0]]), one, z, zero, z[::-1], one, np.array([[0.0, 1.0]]), 0 * one)
    >>> x, y, level = regulated(point)
    >>> root = np.sqrt(2.0)  # P = S = √2 − 1, closed loop −√2, ν² = P + X̂ (1 + S²)
    >>> bool(np.isclose(level**2, root - 1 + (root - 1) ** 2 / (2 * root) * (1 + (root - 1) ** 2), rtol=1e-3))
    True
    """
    found = [f for share in STRICT if (f := _regulated(p, share)) is not None]
    if not found:
        return None
    least = min(level for _, _, level in found)
    return next(f for f in found if f[2] <= (1 + COST) * least)


def _regulated(p: PlantMatrices, share: float) -> tuple[np.ndarray, np.ndarray, float] | None:
    """With a disturbance into, and a weight on, every state of a share of the plant's own."""
    eye, effort, noise = np.eye(len(p.A)), p.D12.T @ p.D12, p.D21 @ p.D21.T
    weight, drive = p.C1.T @ p.C1, p.B1 @ p.B1.T
    weight = weight + share**2 * float(np.linalg.norm(weight, 2)) * eye
    drive = drive + share**2 * float(np.linalg.norm(drive, 2)) * eye
    try:
        s = solve_continuous_are(p.A, p.B2, weight, effort, s=p.C1.T @ p.D12)
        e = solve_continuous_are(p.A.T, p.C2.T, drive, noise, s=p.B1 @ p.D21.T)
        f = -np.linalg.solve(effort, p.B2.T @ s + p.D12.T @ p.C1)
        gain = np.linalg.solve(noise, (e @ p.C2.T + p.B1 @ p.D21.T).T).T
        moved = solve_continuous_lyapunov(p.A + p.B2 @ f, -gain @ noise @ gain.T)
        np.linalg.cholesky(e)
        np.linalg.cholesky(e + moved)
        y = np.linalg.inv(e)
    except (np.linalg.LinAlgError, ValueError):
        return None
    shown = p.C1 + p.D12 @ f
    square = float(np.trace(p.C1 @ e @ p.C1.T) + np.trace(shown @ moved @ shown.T))
    return (e + moved, 0.5 * (y + y.T), float(np.sqrt(square))) if square > 0 and np.isfinite(square) else None


def _scale(a: np.ndarray, b: np.ndarray, nw: int, level: float) -> np.ndarray:
    """Diagonal that gives the rows of [He A, B; Bᵀ, −νI] size one where X is the identity."""
    rows = np.sqrt((np.hstack([a + a.T, b]) ** 2).sum(axis=1))
    rows = np.maximum(rows, 1e-5 * rows.max(initial=1e-300))
    return 1 / np.sqrt(np.concatenate([rows, np.full(nw, level)]))
