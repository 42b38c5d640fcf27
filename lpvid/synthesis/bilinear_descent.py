"""Descent of the certified gain: storage function and gains together, by convex steps that keep what is proven.

The bounded-real inequality of the loop A + B2GC2, B1 + B2GD21, C1 + D12GC2, D11 + D12GD21 is bilinear in P and G. About
a point (P₀, G₀) that satisfies it,

    P B2 G [C2 D21 0] = P₀B2G[…] + P B2G₀[…] − P₀B2G₀[…] + X Y,    X = (P − P₀)B2,  Y = (G − G₀)[C2 D21 0],
    He(XY) ⪯ ½ (X + Yᵀ)(X + Yᵀ)ᵀ,

so with the last term by a Schur complement the inequality becomes linear, implies the bilinear one, and holds at the
point itself: the bound never rises (Dinh, Gumussoy, Michiels & Diehl, IEEE TAC 57 (2012) 1377-1390). In discrete time
P⁺ stands in place of P in the block that is bilinear, and the inequality has P⁺ and P on the diagonal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from lpvid.lmi.affine import Affine, block, combined, given, he
from lpvid.lmi.program import Program
from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.shaped_program import INTERIOR_POINT

STRICT = 1e-7
"""margin of the inequalities, in scaled units"""
ENOUGH = 2e-3
"""share by which a step must lower the bound for another to be made"""
FAR = 30.0
"""the gain, over the frozen one, for which any storage function is looked for where none proves a bound at once"""
SHARES = (1.0, 1 / 30, 30.0)
"""of the weight between the steps of P and of G that are tried, after the even one"""


@dataclass(frozen=True, eq=False)
class Certified:
    """Gains with a storage function, in scaled units: G(p), P(p) over their bases, and the gain they prove.

    Parameters
    ----------
    gains : (L, n_v, n_ξ) array
        G(p) over the gain basis.
    storage : (K, n, n) array
        P(p) over the storage basis.
    gamma : float
        The gain that they prove; with a slack, the slack.
    """

    gains: np.ndarray
    storage: np.ndarray
    gamma: float


@dataclass(frozen=True, eq=False)
class BilinearDescent:
    """The certified gain of one structure on a grid.

    Parameters
    ----------
    plant : PlantMatrices
        At N points, in scaled units of time and signals; no D22.
    phi : (N, L) array
        Functions of the gain.
    psi : (N, K) array
        Functions of P.
    steps : tuple of (T, K) arrays
        For each point: in discrete time the functions one sample later; in continuous time their derivatives.
    free : (n_v, n_ξ) bool array
    discrete : bool
    unit : float
        What a gain of 1 here is in the plant's units.
    """

    plant: PlantMatrices
    phi: np.ndarray
    psi: np.ndarray
    steps: tuple[np.ndarray, ...]
    free: np.ndarray
    discrete: bool
    unit: float = 1.0

    def proven(self, gains: np.ndarray) -> Certified | None:
        """The least gain that a storage function proves for given gains; None where a solver finds none.

        Parameters
        ----------
        gains : (L, n_v, n_ξ) array
            Gains over the basis, held fixed.

        Returns
        -------
        Certified or None
            Gains, storage function and bound.
        """
        return next(self._solved(gains, None), None)

    def relaxed(self, gains: np.ndarray, most: int = 12) -> Certified | None:
        """Gains near by for which a storage function proves something: the inequality with γ far up and a slack t·I,
        of which t is brought below zero. None where it stays above.

        Parameters
        ----------
        gains : (L, n_v, n_ξ) array
            Where the search begins.
        most : int
            Steps at most.

        Returns
        -------
        Certified or None
            Gains with a proof, or None.
        """
        about, slack = None, np.inf
        for _ in range(most):
            found = next(self._solved(gains if about is None else about.gains, about, slack=True), None)
            if found is None or (about is not None and found.gamma > slack - ENOUGH * abs(slack)):
                return None
            about, slack = found, found.gamma
            if slack < 0:
                return self.proven(about.gains)
        return None

    def descended(self, start: Certified, most: int = 15) -> Certified:
        """The last of at most so many steps, none of which raises the bound.

        Parameters
        ----------
        start : Certified
            Gains with a proof.
        most : int
            Steps at most.

        Returns
        -------
        Certified
            Its bound is at most that of the start.
        """
        weight = 1.0
        for _ in range(most):
            found = None
            for share in SHARES:
                trial = next(self._solved(start.gains, start, weight * share), None)
                if trial is not None and trial.gamma < start.gamma * (1 - ENOUGH):
                    found, weight = trial, weight * share
                    break
            if found is None:
                break
            start = found
        return start

    def _solved(self, gains: np.ndarray, about: Certified | None, weight: float = 1.0, slack: bool = False
                ) -> Iterator[Certified]:
        """Answers of the step about a point; of the inequality in P alone where there is none. With `slack` their
        `gamma` is the slack."""
        program, m = Program(), self.plant
        n = m.A.shape[1]
        p = [program.unknowns.symmetric(n) for _ in range(self.psi.shape[1])]
        level = program.unknowns.scalar()
        gamma = given(FAR) if slack else level
        moved = None if about is None else self._unknown_gains(program)
        for k in range(len(m.A)):
            at, now = m.point(k), combined(p, self.psi[k])
            old = np.zeros((n, n)) if about is None else np.tensordot(self.psi[k], about.storage, axes=1)
            before = np.tensordot(self.phi[k], gains, axes=1)
            gain = None if moved is None else combined(moved, self.phi[k])
            program.require(now, margin=STRICT)
            for step in self.steps[k]:
                then = combined(p, step)
                known = old if about is None or not self.discrete else np.tensordot(step, about.storage, axes=1)
                matrix = self._inequality(at, now, then, known, before, gain, gamma, weight)
                program.require(matrix + level.times(np.eye(matrix.shape[0])) if slack else matrix, margin=STRICT)
        program.minimise(level)
        for found in program.solve(solvers=INTERIOR_POINT):
            least = float(found[level][0, 0])
            if least > 0 or slack:
                new = gains if moved is None else np.array([found[g] for g in moved])
                yield Certified(new, np.array([found[x] for x in p]), least)

    def _inequality(self, m: PlantMatrices, now: Affine, then: Affine, known: np.ndarray, before: np.ndarray,
                    gain: Affine | None, level: Affine, weight: float) -> Affine:
        """−F ⪰ 0 at one point and one move: linear in P where `gain` is None, else the convex step."""
        n, nw, nz = len(m.A), m.B1.shape[1], m.C1.shape[0]
        a, b = m.A + m.B2 @ before @ m.C2, m.B1 + m.B2 @ before @ m.D21
        front = then if self.discrete else now
        flow, drive = front @ a, front @ b
        out: Affine | np.ndarray = m.C1 + m.D12 @ before @ m.C2
        direct: Affine | np.ndarray = m.D11 + m.D12 @ before @ m.D21
        if gain is not None:
            change = gain - before
            push = known @ m.B2
            flow, drive = flow + push @ change @ m.C2, drive + push @ change @ m.D21
            out, direct = m.C1 + m.D12 @ gain @ m.C2, m.D11 + m.D12 @ gain @ m.D21
        size = level.times(np.eye(nw)), level.times(np.eye(nz))
        cross = np.zeros((n, nz))
        if self.discrete:
            whole = block([[front, flow, drive, cross], [flow.T, now, np.zeros((n, nw)), out.T],
                           [drive.T, np.zeros((nw, n)), size[0], direct.T], [cross.T, out, direct, size[1]]])
        else:
            whole = block([[-he(flow) - then, -drive, out.T], [-drive.T, size[0], direct.T], [out, direct, size[1]]])
        if gain is None:
            return whole
        nv = m.B2.shape[1]
        shift = (front - known) @ m.B2 * weight
        seen = (gain - before) @ np.hstack([m.C2, m.D21]) * (1 / weight)
        if self.discrete:
            side = block([[shift], [-seen.T], [np.zeros((nz, nv))]])
        else:
            wide = block([[shift], [np.zeros((nw, nv))]])
            side = block([[wide + seen.T], [np.zeros((nz, nv))]])
        return block([[whole, side], [side.T, 2 * np.eye(nv)]])

    def _unknown_gains(self, program: Program) -> list[Affine]:
        rows, columns = np.nonzero(self.free)
        into, across, one = np.eye(self.free.shape[0])[rows], np.eye(self.free.shape[1])[columns], np.eye(len(rows))

        def placed(entries: Affine) -> Affine:
            return reduce(add, (np.outer(r, e) @ entries @ c[None] for r, e, c in zip(into, one, across, strict=True)))

        return [placed(program.unknowns.matrix(len(rows), 1)) for _ in range(self.phi.shape[1])]
