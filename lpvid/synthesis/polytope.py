"""Scheduling sets that are no boxes: where a design's inequalities stand, and the certificate of its loop.

With one X and Y, a plant that is affine in p and steady gains of controls and measurements, the inequalities of a
design are affine in p for a controller that is affine too (in discrete time concave): on a polytope they hold where
they hold at its vertices.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog

from lpvid.analysis.frozen import pole_margins
from lpvid.analysis.hull_certificate import hull_gain
from lpvid.analysis.hull_stability import region_on
from lpvid.errors import InputError
from lpvid.lmi.certificate import Recheck, diagonal
from lpvid.lmi.driven import driven
from lpvid.lmi.gain_certificate import GainCertificate, recheck_gain
from lpvid.lmi.hull_certificate import HullCertificate, affine_driven, recheck_at
from lpvid.lmi.polytope_positivity import lattice, simplices
from lpvid.lmi.readings import box_of
from lpvid.lmi.storage import Storage
from lpvid.model.hull import GRID, KEY, Hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial, Scheduling
from lpvid.synthesis.controller_formula import FeedbackLaw
from lpvid.synthesis.criteria import Region
from lpvid.synthesis.design_grid import MISFIT, columns, is_affine, varies
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.loop_check import LoopStorage
from lpvid.synthesis.plant_functions import named
from lpvid.synthesis.scaling import Matrices
from lpvid.synthesis.shaped_loop import moves

ROUNDING = 1e-12
"""of the largest entries, for the eigenvalues of a loop over states of condition up to 1e3"""
SHARES = (1e-6, 1e-5, 1e-4, 5e-4, 2e-3)
"""by which the certified bound may lie above the one that the storage function keeps in two blocks: rounding of one
matrix of both"""
MOVING = (1e-6, 5e-4, 2e-3, 5e-3, 1e-2, 2e-2, 3.5e-2, 5e-2)
"""the same for one that moves, whose controller is fitted between the points of the design (`moving_feedback.ABOVE`)"""
MOST_DEGREE = {1: 10, 2: 8}
"""Highest degree of a controller on a polytope, by the number of variables; 3 for more. A loop of degree 9 in two takes
100 Bernstein coefficients for each simplex and corner of the rates."""
EXACT = 1e-8
"""share of the largest entry by which a storage function may miss a sum over its functions: the rounding of inverses of
a condition up to 1e7"""


@dataclass(frozen=True, eq=False)
class Polytope:
    """A hull over the variables of a plant's box.

    Parameters
    ----------
    hull : Hull
    box : Scheduling
        Of the plant.
    vertices : (V, n_scheduling) array
        In the order of the box's variables, and their units.
    """

    hull: Hull
    box: Scheduling
    vertices: np.ndarray

    @classmethod
    def of(cls, hull: Hull, box: Scheduling) -> Polytope:
        """A hull for a plant.

        Parameters
        ----------
        hull : Hull
        box : Scheduling
            Of the plant.

        Returns
        -------
        Polytope

        Raises
        ------
        InputError
            A hull of other variables, one without inside, or one that shares no point with the box.
        """
        if set(hull.names) != set(box.names):
            raise InputError("the hull names other variables than the plant", got=", ".join(hull.names),
                             why=f"the plant has {', '.join(box.names) or 'no scheduling'}")
        vertices = hull.vertices()[:, [hull.names.index(n) for n in box.names]]
        if not _meets(vertices, box):
            shown = "; ".join(f"{n} from {low:.4g} to {high:.4g}" for n, low, high in
                              zip(box.names, vertices.min(axis=0), vertices.max(axis=0), strict=True))
            limits = "; ".join(f"{n} from {low:.4g} to {high:.4g}" for n, low, high in
                               zip(box.names, box.centre - box.half_width, box.centre + box.half_width, strict=True))
            raise InputError("the hull lies outside the plant's scheduling box", got=shown,
                             why=f"the plant holds for {limits}",
                             mend="points in the units and in the range of the plant's scheduling variables")
        return cls(hull, box, vertices)

    @classmethod
    def full_order(cls, hull: Hull, plant: GeneralizedPlant) -> Polytope:
        """A hull for which a full-order controller of a plant can be affine in the scheduling, and so its loop.

        Parameters
        ----------
        hull : Hull
        plant : GeneralizedPlant

        Returns
        -------
        Polytope

        Raises
        ------
        InputError
            A plant that is not affine, gains of controls or measurements that vary, and as `of`.
        """
        found = cls.affine(hull, plant)
        at = plant.at(found.vertices)
        moving = [n for j, n in enumerate(plant.controls) if varies(at.B2[:, :, j]) or varies(at.D12[:, :, j])]
        moving += found.moving_measurements(plant)
        if moving or at.D22.any():
            raise InputError("a hull needs steady gains of controls and measurements, and no direct path between them",
                             got=", ".join(moving) or f"{', '.join(plant.controls)} in {', '.join(plant.measurements)}",
                             mend="put a fast constant filter in front of them (lpv.add_actuator_filters)")
        return found

    @classmethod
    def affine(cls, hull: Hull, plant: GeneralizedPlant) -> Polytope:
        """A hull for a plant that is affine in its scheduling.

        Parameters
        ----------
        hull : Hull
        plant : GeneralizedPlant

        Returns
        -------
        Polytope

        Raises
        ------
        InputError
            Another plant, and as `of`.
        """
        found = cls.of(hull, plant.box)
        if not is_affine(plant.system.basis) or plant.system.basis.size > 1 + len(plant.box.names):
            raise InputError("a hull needs a plant that is affine in its scheduling variables",
                             got=", ".join(plant.system.basis.labels),
                             mend="take its functions for variables (lpv.lift), or design for the box")
        return found

    @classmethod
    def polynomial(cls, hull: Hull, plant: GeneralizedPlant) -> Polytope:
        """A hull for a plant that is polynomial in its scheduling.

        Parameters
        ----------
        hull : Hull
        plant : GeneralizedPlant

        Returns
        -------
        Polytope

        Raises
        ------
        InputError
            Another plant, a direct path from controls to measurements, and as `of`.
        """
        found = cls.of(hull, plant.box)
        if not isinstance(plant.system.basis, Polynomial):
            raise InputError("a hull with matrices that move needs a plant that is polynomial in its scheduling",
                             got=", ".join(plant.system.basis.labels), why="of other functions nothing is decided "
                             "between the vertices", mend="take its functions for variables (lpv.lift)")
        if plant.at(found.vertices).D22.any():
            raise InputError("a hull needs no direct path from controls to measurements",
                             got=f"{', '.join(plant.controls)} in {', '.join(plant.measurements)}",
                             why="the loop around it is a ratio of polynomials",
                             mend="put a fast constant filter in front of them (lpv.add_actuator_filters)")
        return found

    def moving_measurements(self, plant: GeneralizedPlant) -> list[str]:
        """Measurements whose gains from states or disturbances vary over the polytope.

        Parameters
        ----------
        plant : GeneralizedPlant

        Returns
        -------
        list of str
        """
        at = plant.at(self.vertices)
        return [n for j, n in enumerate(plant.measurements) if varies(at.C2[:, j]) or varies(at.D21[:, j])]

    @property
    def text(self) -> str:
        """The set in a few words."""
        return f"a polytope of {len(self.vertices)} vertices over {', '.join(self.box.names)}"

    def within(self, points: np.ndarray) -> np.ndarray:
        """The vertices and those of some points that lie inside, each once.

        Parameters
        ----------
        points : (N, n_scheduling) array

        Returns
        -------
        (·, n_scheduling) array
        """
        inside = self.hull.contains(points[:, [self.box.names.index(n) for n in self.hull.names]])
        return np.unique(np.vstack([self.vertices, points[inside]]), axis=0)

    def spread(self, count: int) -> np.ndarray:
        """About as many points as a grid of so many along each variable has: a lattice on the simplices, its edges too.

        Parameters
        ----------
        count : int

        Returns
        -------
        (N, n_scheduling) array
            With the vertices among them.
        """
        parts = len(simplices(self.vertices)) ** (1 / len(self.box.names))
        return lattice(self.vertices, max(1, round(count / parts)))

    @property
    def looked(self) -> np.ndarray:
        """(N, n_scheduling) points at which frozen loops are looked at."""
        return self.within(self.box.grid(GRID.get(len(self.box.names), 4)))

    def over(self, loop: LPVStateSpace, points: np.ndarray) -> Matrices:
        """A loop at points over the variables of the box.

        Parameters
        ----------
        loop : LPVStateSpace
            Scheduled on some of them.
        points : (N, n_scheduling) array

        Returns
        -------
        (A, B, C, D), each (N, …)
        """
        return loop.at(points[:, [self.box.names.index(n) for n in loop.basis.names]])

    def stable(self, loop: LPVStateSpace) -> bool:
        """Whether the loop has decaying poles at every point of `looked`.

        Parameters
        ----------
        loop : LPVStateSpace

        Returns
        -------
        bool
        """
        return not loop.order or bool(pole_margins(self.over(loop, self.looked)[0], loop.is_discrete).max() < 0)

    def holds(self, region: Region, loop: LPVStateSpace, storage: LoopStorage) -> str:
        """Where the poles of a loop of held scheduling lie in a region: "whole", "points", or "" where one is outside.

        −(L ⊗ P + M ⊗ PA + Mᵀ ⊗ AᵀP) ≻ 0 is affine in A: with one P, at the vertices, it holds on the polytope (Chilali
        & Gahinet 1996, theorem 2.2). P of the design is tried in its two blocks, then one that an analysis finds.

        Parameters
        ----------
        region : Region
        loop : LPVStateSpace
            Affine in the scheduling.
        storage : LoopStorage
            One constant storage function of the design, (1, …) blocks.

        Returns
        -------
        str
        """
        poles = np.linalg.eigvals(self.over(loop, self.looked)[0]).ravel()
        if float(region.distance(poles).max(initial=-1.0)) >= 0:
            return ""
        fixed, varying = region.matrices()
        into = storage.mix @ diagonal(*(np.linalg.inv(np.linalg.cholesky(p[0]).T)
                                        for p in (storage.first, storage.second)))
        a = np.linalg.inv(into) @ self.over(loop, self.vertices)[0] @ into  # over states in which P is the identity
        rows = [np.kron(fixed, np.eye(loop.order)) + np.kron(varying, m) + np.kron(varying.T, m.T) for m in a]
        worst, size = max(float(np.linalg.eigvalsh(r)[-1]) for r in rows), max(float(np.linalg.norm(r)) for r in rows)
        proven = worst < -ROUNDING * size or region_on(loop, self.hull, region.matrices()) is not None
        return "whole" if proven else "points"

    def motion(self, sample_time: float | None) -> Scheduling:
        """The least box around the set, with the rates that count.

        In discrete time none where one sample takes a variable half of its width or more: from the middle it then
        reaches an end, and steps from vertex to vertex ask for no more than steps that leave the set.

        Parameters
        ----------
        sample_time : float or None
            [s]

        Returns
        -------
        Scheduling
        """
        around = self.hull.enclosing(self.box)
        if sample_time is None:
            return around
        slow = all(r is not None and r * sample_time < half for r, half in
                   zip(around.rate, around.half_width, strict=True))
        return around if slow else replace(around, rate=(None,) * len(around.names))

    def steps(self, lyapunov: Basis, point: np.ndarray, psi: np.ndarray, sample_time: float | None
              ) -> list[np.ndarray]:
        """What a matrix that moves must be compared with, away from a point, as `moves` for a box.

        In discrete time, for one of degree one: at every corner of a step of the rate bounds, from inside of the set to
        outside of it too; without rate bounds at every vertex.

        Parameters
        ----------
        lyapunov : Basis
            Of the matrix.
        point : (n_scheduling,) array
        psi : (V, M) array
            Its functions at the vertices.
        sample_time : float or None
            [s]

        Returns
        -------
        list of (M,) arrays
        """
        box = self.motion(sample_time)
        if sample_time is None:
            return moves(box, lyapunov, point, None)
        if any(box.rate[box.names.index(n)] is None for n in lyapunov.names):
            return list(psi)
        reach = [(r or 0.0) * sample_time if n in lyapunov.names else 0.0
                 for n, r in zip(box.names, box.rate, strict=True)]
        signs = itertools.product(*([-1.0, 1.0] if r else [0.0] for r in reach))
        return list(columns(self.box, lyapunov, point + np.array(list(signs)) * np.array(reach)))

    def moving_proof(self, loop: LPVStateSpace, values: Callable[[np.ndarray], np.ndarray], lyapunov: Basis,
                     bound: float, shares: Sequence[float] = MOVING, states: np.ndarray | None = None
                     ) -> GainCertificate | None:
        """The certificate of a loop by a storage function of which it, or its inverse, is a sum over given functions.

        Parameters
        ----------
        loop : LPVStateSpace
            w → z, polynomial in the scheduling.
        values : callable
            (N, n, n) P at (N, n_scheduling) points.
        lyapunov : Basis
            Its functions, or those of its inverse.
        bound : float
            Gain that it keeps.
        shares : sequence of float
            Rising, by which the certified gain may be above it.
        states : (n, n) array, optional
            T of x = Tξ, over whose ξ P is.

        Returns
        -------
        GainCertificate or None
            None where it fails, and for a loop that reads none of the variables of P.
        """
        system = driven(loop, tuple(n for n in lyapunov.names if n in loop.box.names))
        box = box_of(system.readings, self.motion(loop.sample_time))
        if not set(lyapunov.names) <= set(box.names):
            return None
        corners = self.hull.over(box.names).vertices()
        points = lattice(self.vertices, (lyapunov.degree or 1) + 1)
        phi, at = columns(self.box, lyapunov, points), values(points)
        for inverse in (False, True):
            wanted = np.linalg.inv(at) if inverse else at
            matrices = np.tensordot(np.linalg.pinv(phi), wanted, axes=1)
            matrices = 0.5 * (matrices + matrices.swapaxes(1, 2))
            if np.abs(np.tensordot(phi, matrices, axes=1) - wanted).max() > EXACT * np.abs(wanted).max():
                continue
            storage = Storage(matrices, lyapunov, box, loop.sample_time)

            def checked(gamma: float, storage: Storage = storage, inverse: bool = inverse) -> Recheck:
                return recheck_gain(system, storage, gamma, states=states, inverse=inverse, vertices=corners)

            proven, low = None, 0
            high = len(shares)
            while low < high:  # what holds for a gain holds for any larger one
                middle = high - 1 if proven is None else (low + high) // 2
                found = checked(bound * (1 + shares[middle]))
                if found.holds:
                    proven, high = (bound * (1 + shares[middle]), found), middle
                elif proven is None:
                    break
                else:
                    low = middle + 1
            if proven is not None:
                return GainCertificate.of(system, storage, *proven, states=states, inverse=inverse, vertices=corners)
        return None

    def fitted(self, values: Callable[[np.ndarray], np.ndarray]) -> tuple[Basis, np.ndarray]:
        """A matrix known at every point of the set as a polynomial: of the least degree that misses it by a thousandth.

        Parameters
        ----------
        values : callable
            (N, …) values at (N, n_scheduling) points.

        Returns
        -------
        Polynomial
            Of the highest degree tried where none is as near.
        (M, …) array
            Coefficients over it.
        """
        highest = MOST_DEGREE.get(len(self.box.names), 3)
        points = self.spread(2 * highest)
        table = values(points)
        flat = table.reshape(len(points), -1)
        sizes = np.abs(flat).max(axis=0, initial=0.0)
        sizes = sizes + 1e-6 * sizes.max(initial=1e-300)
        for degree in range(1, highest + 1):
            basis = Polynomial(self.box.names, degree).bound(self.hull.enclosing(self.box))
            phi = columns(self.box, basis, points)
            found = np.linalg.lstsq(phi, flat, rcond=None)[0]
            if degree == highest or np.all(np.abs(phi @ found - flat) <= MISFIT * sizes):
                break
        return basis, found.reshape(basis.size, *table.shape[1:])

    def marked(self, system: LPVStateSpace) -> LPVStateSpace:
        """A controller or loop whose metadata name the set for which it was designed.

        Parameters
        ----------
        system : LPVStateSpace

        Returns
        -------
        LPVStateSpace
        """
        return system.replace(metadata={**system.metadata, KEY: self.hull.to_dict()})

    def proof(self, loop: LPVStateSpace, matrix: np.ndarray, bound: float, shares: Sequence[float] = SHARES
              ) -> HullCertificate | None:
        """The certificate of a loop by a given storage function, re-checked at the vertices; None where it fails.

        Parameters
        ----------
        loop : LPVStateSpace
            w → z.
        matrix : (n, n) array
            P over the states of the loop.
        bound : float
            Gain that it keeps.
        shares : sequence of float
            Rising.

        Returns
        -------
        HullCertificate or None
            None also for a loop that is not affine in the scheduling.
        """
        if not affine_in(loop.basis):
            return None
        subject, p = affine_driven(loop, self.box.names), 0.5 * (matrix + matrix.T)
        for share in shares:
            gamma = bound * (1 + share)
            found = recheck_at(subject, self.box.names, self.vertices, p, gamma)
            if found.holds:
                return HullCertificate(gamma, p, self.box.names, self.vertices, subject.sample_time, subject.digest,
                                       subject.inputs, subject.outputs, found.margin)
        return None

    def searched(self, loop: LPVStateSpace, moving: bool = False) -> HullCertificate | None:
        """The certificate of the least gain that an analysis finds for a loop; None for none.

        Parameters
        ----------
        loop : LPVStateSpace
        moving : bool
            In discrete time: by a P that follows the scheduling.

        Returns
        -------
        HullCertificate or None
        """
        found = hull_gain(loop, self.hull, moving=moving).certificate if affine_in(loop.basis) else None
        return found if isinstance(found, HullCertificate) else None


def _meets(vertices: np.ndarray, box: Scheduling) -> bool:
    """Whether some mean of the vertices lies in the box: a linear program over its (V,) weights."""
    unit = np.where(box.half_width > 0, box.half_width, 1.0)
    z, edge = (vertices - box.centre) / unit, box.half_width / unit
    found = linprog(np.zeros(len(z)), np.vstack([z.T, -z.T]), np.concatenate([edge, edge]), np.ones((1, len(z))),
                    np.ones(1), bounds=(0, None))
    return found.status != 2  # infeasible


def check_hull(hull: Hull | None, lyapunov: Basis | None) -> None:
    """Refuse what is no hull, and beside one a Lyapunov matrix that is no polynomial.

    With P(p) of some degree the inequality He(PA) + Ṗ is of a higher one, and the gain F(p)X(p)⁻¹ (or that of the
    change of variables) is a ratio, fitted by a polynomial: vertices do not decide about that loop, Bernstein
    coefficients on simplices do, for polynomials (`lpvid.lmi.polytope_positivity`).

    Parameters
    ----------
    hull : Hull or None
    lyapunov : Basis or None

    Raises
    ------
    InputError
        Another object in the hull's place, or another basis beside one.
    """
    if hull is None:
        return
    if not isinstance(hull, Hull):
        raise InputError("`hull` is a set of scheduling values", got=type(hull).__name__,
                         mend="lpv.Hull.of(names, samples), or lpv.Hull.disc(names) for cos and sin of an angle")
    if lyapunov is not None and not isinstance(lyapunov, Polynomial):
        raise InputError("a Lyapunov matrix that moves on a hull is a polynomial", got=type(lyapunov).__name__,
                         why="of other functions nothing is decided between the vertices",
                         mend="lpv.Polynomial(names, 1); an angle whose rate is bounded has a Fourier basis over its "
                              "box")


def refuse_beside_hull(hull: Hull | None, lyapunov: Basis | None, mend: str = "leave one of the two out") -> None:
    """Refuse what is no hull, and one together with a Lyapunov matrix that moves.

    Parameters
    ----------
    hull : Hull or None
    lyapunov : Basis or None
    mend : str
        What to do instead.

    Raises
    ------
    InputError
        Either beside a hull, or another object in its place.
    """
    check_hull(hull, None)
    if hull is not None and lyapunov is not None:
        raise InputError("a hull needs constant Lyapunov matrices here", got="hull and lyapunov", mend=mend)


def affine_in(basis: Basis) -> bool:
    """Whether functions are those of degree one, without products.

    Parameters
    ----------
    basis : Basis

    Returns
    -------
    bool
    """
    return isinstance(basis, Polynomial) and basis.degree <= 1


def affine_controller(formula: FeedbackLaw, polytope: Polytope) -> LPVStateSpace:
    """The controller as an affine function of the scheduling, fitted at the vertices by least squares.

    Exact where only A of the plant varies in continuous time: the formula's F and B_K are then constant, and A_K is
    affine in A.

    Parameters
    ----------
    formula : FeedbackLaw
        The controller for every p; it reads no rates.
    polytope : Polytope

    Returns
    -------
    LPVStateSpace
        Near the formula; its bound must be checked.
    """
    plant = formula.plant.plant
    basis = Polynomial(plant.box.names, 1).bound(plant.box)
    inverse = np.linalg.pinv(columns(plant.box, basis, polytope.vertices))
    a, b, c, d = (np.tensordot(inverse, m, axes=1) for m in formula.at(polytope.vertices)[0])
    return LPVStateSpace(a, b, c, d, basis, plant.sample_time, plant.box.part(basis.names),
                         inputs=named(plant, plant.measurements), outputs=named(plant, plant.controls))
