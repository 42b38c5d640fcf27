"""What state feedbacks and observers share: their settings, and the grid, bases and coordinates of one plant."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.hull import Hull
from lpvid.scheduling import Basis, Polynomial
from lpvid.synthesis.assumptions import Fault
from lpvid.synthesis.criteria import Criterion, HInfinity, Region
from lpvid.synthesis.design_grid import (
    check_back_off,
    check_rates,
    design_axes,
    is_affine,
    moving_basis,
    richer,
    tensor,
    varies,
    with_breaks,
)
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.loop_check import LoopStorage
from lpvid.synthesis.polytope import MOVING, Polytope, affine_in, check_hull
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.shaped_design import ShapedProblem, check_criteria, listed, settle
from lpvid.synthesis.shaped_loop import moves
from lpvid.synthesis.shaped_program import Shaped, SignalCoordinates

P = TypeVar("P", bound="GainProblem")
ROOMS = (2e-2, 5e-3, 5e-2)
"""Shares of `MOVING` that a bound which is asked for leaves to the fit of a gain on a hull, the likeliest first."""


@dataclass(frozen=True, eq=False)
class GainProblem(ShapedProblem):
    """One plant with an unknown gain over the scheduling beside a Lyapunov matrix.

    Parameters
    ----------
    plant, criteria, regions, back_off
        As in `ShapedProblem`.
    lyapunov, gain : Basis
        Functions of the Lyapunov matrix and of the gain, bound to the plant's box.
    axes : tuple of arrays
        Grid values of each scheduling variable.
    coordinates : SignalCoordinates
        In which the program is stated.
    matrices : PlantMatrices
        The scaled plant at the points of the grid.
    """

    lyapunov: Basis
    gain: Basis
    axes: tuple[np.ndarray, ...]
    coordinates: SignalCoordinates
    matrices: PlantMatrices

    @property
    def points(self) -> np.ndarray:
        """(N, n_scheduling) where the inequalities stand."""
        return tensor(self.axes) if self.polytope is None else _points(
            self.polytope, self.lyapunov, self.plant, max(map(len, self.axes)))

    @property
    def slack(self) -> Basis:
        """Functions of the slack matrix in discrete time: those of P, but constant on a polytope, where they keep the
        gain affine."""
        return self.lyapunov if self.polytope is None else Polynomial((), 0)

    def steps(self, point: np.ndarray, psi: np.ndarray) -> list[np.ndarray]:
        """What P must be compared with, away from a point: as `moves`, or as `Polytope.steps`.

        Parameters
        ----------
        point : (n_scheduling,) array
        psi : (N, M) array
            Functions of P at `points`.

        Returns
        -------
        list of (M,) arrays
            Empty for a constant P.
        """
        if self.polytope is not None and self.lyapunov.names:
            return self.polytope.steps(self.lyapunov, point, psi, self.plant.sample_time)
        return moves(self.plant.box, self.lyapunov, point, self.plant.sample_time)

    def blocks_of(self, shaped: Shaped) -> LoopStorage | None:
        """On a polytope the constant storage function of `storage_of` as one block; None elsewhere."""
        values = None if self.polytope is None or self.lyapunov.names else self.storage_of(shaped)
        if values is None:
            return None
        first = values(self.points[:1])
        none = np.zeros((1, 0, 0))
        return LoopStorage(0.5 * (first + first.swapaxes(1, 2)), none, 0 * first[:, None], none[:, None],
                           np.eye(first.shape[1]))

    def summary(self, design: str, letter: str) -> str:
        """The design in a few words.

        Parameters
        ----------
        design, letter : str
            What it is, and what its Lyapunov matrix is called.

        Returns
        -------
        str
            With the functions of the Lyapunov matrix and the number of points.
        """
        kind = f"{letter} over {', '.join(self.lyapunov.labels)}" if self.lyapunov.names else f"one quadratic {letter}"
        return f"{design}, {kind}, {len(self.points)} points" + (
            "" if self.polytope is None else f" on {self.polytope.text}")


@dataclass(frozen=True, eq=False)
class GainDesign(ABC):
    """Settings of a design with one unknown gain.

    Parameters
    ----------
    criteria : HInfinity, H2, GeneralizedH2 or a sequence of them
        What to bound; those without a bound of their own are minimised.
    regions : Region or sequence of Region
        Where frozen poles must lie.
    lyapunov : Basis, optional
        Functions of the Lyapunov matrix; left out, one matrix, for arbitrarily fast scheduling.
    gain : Basis, optional
        Functions of the unknown gain; left out, the plant's own, or of degree higher by one beside a matrix that moves.
    points : int
        Grid points per scheduling variable, where corners are not enough.
    back_off : float
        Factor above the lowest level.
    hull : Hull, optional
        A polytope in which the scheduling stays, in place of its box, as for `OutputFeedback`; the gain is affine. The
        Lyapunov matrix may be a polynomial. In discrete time it is affine (``lyapunov=Polynomial(names, 1)``): with a
        slack matrix that is constant the inequalities of all steps between vertices, or of all corners of the rate
        bounds at the vertices, cover every step inside (Daafouz & Bernussou 2001), and the gain stays affine. In
        continuous time its variables need rate bounds, and the gain is a polynomial.
    """

    criteria: Criterion | Sequence[Criterion] = (HInfinity(),)
    regions: Region | Sequence[Region] = ()
    lyapunov: Basis | None = None
    gain: Basis | None = None
    points: int = 7
    back_off: float = 1.02
    hull: Hull | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "criteria", listed(self.criteria, Criterion, "the criteria"))
        object.__setattr__(self, "regions", listed(self.regions, Region, "the regions"))
        object.__setattr__(self, "lyapunov", moving_basis(self.lyapunov))
        check_back_off(self.back_off)
        check_hull(self.hull, self.lyapunov)
        if self.hull is not None and self.lyapunov is not None:
            criteria = tuple(self.criteria)  # type: ignore[arg-type]
            if self.regions or not criteria or not all(isinstance(c, HInfinity) for c in criteria):
                raise InputError("a Lyapunov matrix that moves on a hull bounds gains only",
                                 got="regions" if self.regions else "other criteria, or none",
                                 mend="leave lyapunov out, or give HInfinity criteria alone")
        if self.hull is not None and self.gain is not None and not affine_in(self.gain):
            raise InputError("a hull needs a gain of degree one", got=", ".join(self.gain.labels),
                             mend="leave the gain out")

    @abstractmethod
    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """What the design finds for a plant.

        Parameters
        ----------
        plant : GeneralizedPlant
            The plant.

        Returns
        -------
        Synthesis
            With its verdict.
        """

    def settled(self, problem: GainProblem, fault: Fault | None) -> Synthesis:
        """As `settle`; where the gain is fitted on a hull, a bound that is asked for leaves room for what that costs.

        Parameters
        ----------
        problem : GainProblem
        fault : Fault or None
            Why there is nothing to solve.

        Returns
        -------
        Synthesis
        """
        if self.hull is None or self.lyapunov is None:
            return settle(problem, fault)
        kept = 1 + MOVING[-1]
        asked = fault is None and problem.plant.sample_time is None and any(c.bound for c in problem.criteria)
        for room in ROOMS if asked else ():
            criteria = tuple(c if c.bound is None else replace(c, bound=c.bound / (1 + room)) for c in problem.criteria)
            found = settle(replace(problem, criteria=criteria, room=room), kept=kept)
            if found.solved:
                return found
        return settle(problem, fault, kept=kept)

    def problem(self, kind: type[P], plant: GeneralizedPlant, beside: Sequence[str], polytope: Polytope | None = None,
                **more: Any) -> P:
        """The inequalities of this design for a plant.

        Parameters
        ----------
        kind : type
            Of problem.
        plant : GeneralizedPlant
            The plant.
        beside : sequence of str
            Names of the blocks that multiply the gain: where they do not vary, corners of the box may be enough.
        polytope : Polytope, optional
            The scheduling set where that is no box.
        **more
            Further fields of the problem.

        Returns
        -------
        GainProblem
            Of that kind.

        Raises
        ------
        InputError
            Criteria that no controller can meet, or a Lyapunov matrix without the rate bounds that it needs.
        """
        box = plant.box
        criteria, regions = tuple(self.criteria), tuple(self.regions)  # type: ignore[arg-type]
        lyapunov = (self.lyapunov or Polynomial((), 0)).bound(box)
        if polytope is not None and plant.sample_time is not None and not affine_in(lyapunov):
            raise InputError("a Lyapunov matrix that moves on a hull in discrete time has degree one",
                             got=f"degree {lyapunov.degree}", why="steps between vertices cover no other",
                             mend=f"lpv.Polynomial({lyapunov.names!r}, 1)")
        check_rates(lyapunov, box, plant.sample_time)
        gain = None if self.gain is None else self.gain.bound(box)
        corners = plant.at(box.grid(2))
        steady = not any(varies(getattr(corners, name)) for name in beside)
        plain = steady and not lyapunov.names and gain is None and is_affine(plant.system.basis)
        axes = with_breaks(design_axes(box, self.points, plain), box, lyapunov, *(() if gain is None else (gain,)))
        if gain is None:
            free = polytope is None or plant.sample_time is None
            gain = richer(plant, lyapunov, axes) if lyapunov.names and free else plant.system.basis
        points = tensor(axes) if polytope is None else _points(polytope, lyapunov, plant, self.points)
        check_criteria(plant, criteria, regions, points)
        raw = plant.at(points)
        coordinates = SignalCoordinates.of(raw, plant.sample_time is not None)
        return kind(plant, criteria, regions, self.back_off, lyapunov, gain, axes, coordinates, coordinates.scaled(raw),
                    polytope=polytope, **more)


def _points(polytope: Polytope, lyapunov: Basis, plant: GeneralizedPlant, count: int) -> np.ndarray:
    """Where the inequalities of a gain stand: the vertices where these decide; else points between them too."""
    still = not lyapunov.names or plant.sample_time is not None
    return polytope.vertices if still else polytope.spread(count)
