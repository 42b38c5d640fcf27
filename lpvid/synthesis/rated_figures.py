"""What a design's own storage function shows of a loop whose controller reads how fast the scheduling moves.

The variables ``p_rate`` of such a loop are ṗ, while an analysis of the loop alone would take them as free of p. With
P(p) and A affine in ṗ every inequality is affine in ṗ: corners of the rates suffice at each p. p is looked at on a
grid; the certificate of a gain is then proven between its points too, where that can be decided.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from lpvid.analysis.rated_certificate import RatedGainCertificate
from lpvid.lmi.affine import combined
from lpvid.lmi.certificate import GRID, grid
from lpvid.lmi.frame import gramian
from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Scheduling
from lpvid.synthesis.controller_table import RATE
from lpvid.synthesis.criteria import CovarianceCriterion, Criterion
from lpvid.synthesis.design_grid import columns
from lpvid.synthesis.figures import Figure, channel
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.loop_certificate import fits, own_and_richer
from lpvid.synthesis.loop_check import SAFETY, LoopStorage, frozen_gain, gain_bounds
from lpvid.synthesis.scaling import Matrices
from lpvid.synthesis.shaped_loop import ShapedLoop
from lpvid.synthesis.shaped_program import INTERIOR_POINT

SEARCHED = {1: 41, 2: 6}
"""Points per variable at which a storage function is looked for, 3 for more variables; it is verified on a finer grid.
With 9, 21 and 41 points a loop whose gain is at least .438 is verified at .468, .443 and .440."""
SHARES = (1e-6, 1e-4, 1e-3)
"""by which the certified gain may lie above the one computed at the same points: rounding, and the points' distance"""
UNITS = (1e-8, 1e8)
"""between which the unit of a storage function is looked for where none comes with it, over that of the promise"""


@dataclass(frozen=True, eq=False)
class RatedLoop:
    """A closed loop over p and ``p_rate`` with P(p) in a basis, at a grid of p and every corner of the rates.

    Parameters
    ----------
    loop : LPVStateSpace
        Continuous.
    box : Scheduling
        Of p alone, with the bounds of ṗ.
    values : callable
        From (N, n_scheduling) points to (N, n, n) P, of the design.
    basis : Basis
        Functions in which P is written down, and what richer ones are made of.
    """

    loop: LPVStateSpace
    box: Scheduling
    values: Callable[[np.ndarray], np.ndarray]
    basis: Basis

    def figure(self, criterion: Criterion, plant: GeneralizedPlant, promised: float, most: float,
               unit: float | None) -> Figure:
        """A criterion of the loop, verified.

        Parameters
        ----------
        criterion : HInfinity, H2 or GeneralizedH2
        plant : GeneralizedPlant
            Whose signals the loop has, in its order.
        promised : float
        most : float
            Further functions are tried for P while the figure is more than so many times the promise.
        unit : float, optional
            In which P is a storage function of the gain; left out, the best is looked for.

        Returns
        -------
        Figure
            Infinite where nothing was shown.
        """
        into, out = criterion.indices(plant)
        part = RatedLoop(channel(self.loop, into, out), self.box, self.values, self.basis)
        found, at, description = (np.inf, None), part._matrices_at_rest(), criterion.description(plant)
        own = next(part._proposals())
        searched = part._searched(criterion, *own)
        for basis, matrices in itertools.chain([] if searched is None else [searched], part._proposals()):
            scale = 1.0 if searched is not None and matrices is searched[1] else unit
            if isinstance(criterion, CovarianceCriterion):
                bound = part._variance(basis, matrices, criterion.peak), None
            else:
                bound = part._gain(basis, matrices, scale)
            found = min(found, bound, key=lambda pair: pair[0])
            if found[0] <= most * promised:
                break
        if isinstance(criterion, CovarianceCriterion):
            return Figure(criterion.kind, description, promised, found[0], _frozen_variance(at, criterion.peak), False)
        proven = found[1] is not None and found[1].between_grid
        return Figure("H-infinity", description, promised, found[0], frozen_gain(at), proven, found[1])

    def _proposals(self) -> Iterator[tuple[Basis, np.ndarray]]:
        points = self._points()
        return fits(self.values(points), self.box, points, own_and_richer(self.basis, self.box))

    def _searched(self, criterion: Criterion, basis: Basis, matrices: np.ndarray) -> tuple[Basis, np.ndarray] | None:
        """P of the least figure of this criterion alone, over states in which the design's own is near the identity."""
        points = grid(self.box, SEARCHED.get(len(self.box.names), 3))
        p = np.tensordot(columns(self.box, basis, points), matrices, axes=1)
        try:
            root = np.linalg.cholesky(p.mean(axis=0)).T
        except np.linalg.LinAlgError:
            return None
        into, program = np.linalg.inv(root), Program()
        corners = [self._matrices(speeds, points) for speeds in self._speeds()]
        size = max(frozen_gain(self._matrices_at_rest(points)), 1e-300)
        pace = float(np.median(np.abs(np.linalg.eigvals(corners[0][0]))))
        unknown = [program.unknowns.symmetric(len(root)) for _ in range(basis.size)]
        level, loops = program.unknowns.scalar(), []
        for k in range(len(points)):
            here = combined(unknown, columns(self.box, basis, points)[k])
            for (a, b, c, d), slopes in zip(corners, self._slopes(basis, points), strict=True):
                loops.append(ShapedLoop(here, combined(unknown, slopes[k]), here @ (root @ a[k] @ into),
                                        here @ (root @ b[k] / np.sqrt(size)), c[k] @ into / np.sqrt(size), d[k] / size,
                                        False, pace))
            program.require(here)
        eyes = np.eye(corners[0][1].shape[2]), np.eye(corners[0][2].shape[1])
        criterion.require(program, loops, level, eyes, squared=isinstance(criterion, CovarianceCriterion))
        program.minimise(level)
        solved = next(iter(program.solve(solvers=INTERIOR_POINT)), None)
        if solved is None:
            return None
        return basis, np.array([root.T @ solved[m] @ root for m in unknown])

    def _points(self) -> np.ndarray:
        return grid(self.box, GRID.get(len(self.box.names), 3))

    def _matrices(self, rates: tuple[float, ...], points: np.ndarray | None = None) -> Matrices:
        """(N, …) at points, or at every point of the grid, with the rates as given."""
        points, names = self._points() if points is None else points, self.loop.box.names
        speed = dict(zip(self._rates(), rates, strict=True))
        whole = np.stack([points[:, self.box.names.index(n)] if n in self.box.names
                          else np.full(len(points), speed[n]) for n in names], axis=1)
        return self.loop.at(whole)

    def _matrices_at_rest(self, points: np.ndarray | None = None) -> Matrices:
        return self._matrices((0.0,) * len(self._rates()), points)

    def _rates(self) -> tuple[str, ...]:
        return tuple(n for n in self.loop.box.names if n not in self.box.names)

    def _speeds(self) -> list[tuple[float, ...]]:
        """Corners of the rates."""
        limits = [self.loop.box.upper[self.loop.box.names.index(n)] for n in self._rates()]
        return list(itertools.product(*([-r, r] for r in limits)))

    def _slopes(self, basis: Basis, points: np.ndarray) -> list[np.ndarray]:
        """(N, M) dψ/dt at points, for every corner of the rates."""
        own = points[:, [self.box.names.index(n) for n in basis.names]]
        names = [n.removesuffix(RATE) for n in self._rates()]
        each = [basis.derivative(own, n) if n in basis.names else np.zeros((len(points), basis.size)) for n in names]
        return [np.tensordot(np.array(speeds), np.array(each), axes=1) for speeds in self._speeds()]

    def _corners(self, basis: Basis, matrices: np.ndarray) -> Iterator[tuple[Matrices, np.ndarray, np.ndarray]]:
        """The loop, P and Ṗ at the points, for every corner of the rates."""
        points = self._points()
        p = np.tensordot(columns(self.box, basis, points), matrices, axes=1)
        for speeds, slopes in zip(self._speeds(), self._slopes(basis, points), strict=True):
            yield self._matrices(speeds), p, np.tensordot(slopes, matrices, axes=1)

    def _gain(self, basis: Basis, matrices: np.ndarray, unit: float | None
              ) -> tuple[float, RatedGainCertificate | None]:
        """The least gain that P shows, with its certificate."""
        corners = list(self._corners(basis, matrices))

        def bound(size: float) -> float:
            return max(float(gain_bounds(at, _storage(size * p, size * slope), 0).max()) for at, p, slope in corners)

        if unit is None:
            if not np.isfinite(bound(1.0)):
                return np.inf, None
            best = minimize_scalar(lambda x: np.log(bound(float(np.exp(x)))), bounds=tuple(np.log(UNITS)),
                                   method="bounded", options={"xatol": 1e-3})
            unit = float(np.exp(best.x))
        found = bound(unit)
        if not np.isfinite(found):
            return np.inf, None
        made = RatedGainCertificate.within(self.loop, unit * matrices, basis, [found * (1 + s) for s in SHARES])
        return (np.inf, None) if made is None else (made.gamma, made)

    def _variance(self, basis: Basis, matrices: np.ndarray, peak: bool) -> float:
        """ν² = s·max trace(CP⁻¹Cᵀ) with the least s for which He(PA) + Ṗ + PBBᵀP/s ≼ 0 (`variance_figure`)."""
        share, square = 0.0, 0.0
        for (a, b, c, _), p, slope in self._corners(basis, matrices):
            try:
                root = np.linalg.cholesky(p).swapaxes(1, 2)
            except np.linalg.LinAlgError:
                return np.inf
            into = np.linalg.inv(root)
            a, b, c = root @ a @ into, root @ b, c @ into
            m = -(a + a.swapaxes(1, 2)) - into.swapaxes(1, 2) @ slope @ into
            if not np.all(np.isfinite(m)) or np.any(np.linalg.eigvalsh(m)[:, 0]
                                                    <= 1e-12 * np.linalg.norm(m, axis=(1, 2))):
                return np.inf
            share = max(share, float(np.linalg.eigvalsh(b.swapaxes(1, 2) @ np.linalg.solve(m, b))[:, -1].max()))
            seen = c @ c.swapaxes(1, 2)
            each = np.linalg.eigvalsh(seen)[:, -1] if peak else np.trace(seen, axis1=1, axis2=2)
            square = max(square, float(each.max()))
        return float(np.sqrt(share * square)) * (1 + SAFETY)


def _storage(p: np.ndarray, slope: np.ndarray) -> LoopStorage:
    none = np.zeros((len(p), 0, 0))
    return LoopStorage(p, none, slope[:, None], none[:, None], np.eye(p.shape[1]))


def _frozen_variance(at: Matrices, peak: bool) -> float:
    a, b, c, _ = at
    seen = np.array([ck @ gramian(ak, bk @ bk.T, False) @ ck.T for ak, bk, ck in zip(a, b, c, strict=True)])
    each = np.linalg.eigvalsh(seen)[:, -1] if peak else np.trace(seen, axis1=1, axis2=2)
    return float(np.sqrt(each.max()))
