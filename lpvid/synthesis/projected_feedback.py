"""Output feedback with one X and Y for every scheduling: where its inequalities stand, and the search on them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid import _checks
from lpvid.model.hull import Hull
from lpvid.scheduling import Basis
from lpvid.synthesis.assumptions import fault_of, refuse_dead_signals, remarks
from lpvid.synthesis.balanced_plant import BalancedPlant, convex_axes, corners_suffice, linear_axes, varying_signals
from lpvid.synthesis.controller_formula import Variations
from lpvid.synthesis.design_grid import design_axes, tensor
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.output_feedback_search import FeedbackProblem, search
from lpvid.synthesis.polytope import Polytope
from lpvid.synthesis.result import Synthesis


@dataclass(frozen=True, eq=False)
class FeedbackGrid:
    """Where the inequalities of an output feedback are imposed.

    Attributes
    ----------
    axes : tuple of arrays
        Values of each scheduling variable.
    corners : bool
        The inequalities then hold on the whole box.
    notes : tuple of str
        What keeps them from that.
    linear : mapping of name to array
        Variables along which the values of `axes` stand for all between them.
    polytope : Polytope or None
        The scheduling set where that is no box: its vertices take the place of `axes`, with a lattice between them
        where X or Y moves.
    """

    axes: tuple[np.ndarray, ...]
    corners: bool = False
    notes: tuple[str, ...] = ()
    linear: Mapping[str, np.ndarray] = field(default_factory=dict)
    polytope: Polytope | None = None

    @classmethod
    def over(cls, plant: GeneralizedPlant, hull: Hull) -> FeedbackGrid:
        """For one X and Y on a scheduling set that is no box: its vertices.

        Parameters
        ----------
        plant : GeneralizedPlant
        hull : Hull
            Over the plant's scheduling variables.

        Returns
        -------
        FeedbackGrid

        Raises
        ------
        InputError
            As `Polytope.full_order`.
        """
        return cls(convex_axes(plant), True, polytope=Polytope.full_order(hull, plant))

    @classmethod
    def moving_over(cls, plant: GeneralizedPlant, hull: Hull, points: int) -> FeedbackGrid:
        """For X or Y over polynomials of the scheduling, on a set that is no box, in continuous time.

        Parameters
        ----------
        plant : GeneralizedPlant
            Polynomial in its scheduling.
        hull : Hull
        points : int
            Of each scheduling variable.

        Returns
        -------
        FeedbackGrid

        Raises
        ------
        InputError
            As `Polytope.polynomial`.
        """
        polytope = Polytope.polynomial(hull, plant)
        return cls(design_axes(hull.enclosing(plant.box), points, False), polytope=polytope)

    @classmethod
    def moving(cls, plant: GeneralizedPlant, lyapunov: Basis, points: int) -> FeedbackGrid:
        """For X or Y over functions of the scheduling, in continuous time.

        Parameters
        ----------
        plant : GeneralizedPlant
        lyapunov : Basis
        points : int
            Of each scheduling variable along which all values matter.

        Returns
        -------
        FeedbackGrid
        """
        linear = linear_axes(plant, lyapunov)
        return cls(design_axes(plant.box, points, False, linear), linear=linear)

    @classmethod
    def constant(cls, plant: GeneralizedPlant, points: int) -> FeedbackGrid:
        """For one X and Y: the corners of the box where they suffice, else `points` values of each variable.

        Parameters
        ----------
        plant : GeneralizedPlant
        points : int
            Of each scheduling variable.

        Returns
        -------
        FeedbackGrid
        """
        if corners_suffice(plant):
            return cls(convex_axes(plant), True)
        moving = varying_signals(plant)
        note = (f"the gains of {moving} vary with the scheduling, so that the design holds at grid points: put a fast "
                "constant filter in front of them for one that holds in between",) if moving else ()
        linear = linear_axes(plant, None)
        return cls(design_axes(plant.box, points, False, linear), False, note, linear)

    @property
    def points(self) -> np.ndarray:
        """(N, n_scheduling) all combinations, or the vertices, with combinations inside where they do not suffice."""
        if self.polytope is None:
            return tensor(self.axes)
        return self.polytope.vertices if self.corners else self.polytope.spread(max(map(len, self.axes)))


def remarked(found: Synthesis, grid: FeedbackGrid, notes: tuple[str, ...], started: float) -> Synthesis:
    """A synthesis with the remarks on its plant, and its time; a proof on the whole box answers those on the grid.

    Parameters
    ----------
    found : Synthesis
    grid : FeedbackGrid
    notes : tuple of str
        Of `inspected`.
    started : float
        Of `time.perf_counter` [s].

    Returns
    -------
    Synthesis
    """
    own = [n for n in notes if not (found.between_grid and n in grid.notes)]
    return replace(found, notes=tuple(dict.fromkeys((*own, *found.notes))), seconds=time.perf_counter() - started)


def inspected(plant: GeneralizedPlant, grid: FeedbackGrid) -> Synthesis | tuple[str, ...]:
    """Why a plant has no output feedback at all, or the remarks on one that may have it.

    Parameters
    ----------
    plant : GeneralizedPlant
    grid : FeedbackGrid

    Returns
    -------
    Synthesis or tuple of str
        A verdict without a controller; or remarks, those of the grid among them.

    Raises
    ------
    InputError
        A control or measurement that is connected to nothing or changes its polarity within the box.
    """
    at = plant.at(grid.points)
    refuse_dead_signals(plant, at)
    fault = fault_of(plant, at, grid.points, between=grid.polytope is None)
    if fault is not None:
        return Synthesis(fault.verdict, why=fault.why, mend=fault.mend, method="output feedback")
    return (*grid.notes, *remarks(plant, at))


def projected_feedback(plant: GeneralizedPlant, grid: FeedbackGrid, variations: Variations, *, strictly_proper: bool,
                       bound: float | None, back_off: float) -> Synthesis:
    """The controller of the least bound that the projected inequalities admit; see `OutputFeedback`.

    Parameters
    ----------
    plant : GeneralizedPlant
    grid : FeedbackGrid
    variations : Variations
        Of X and Y.
    strictly_proper : bool
    bound : float or None
        A gain that is good enough; None for the least.
    back_off : float
        Share by which the bound is raised above the least one.

    Returns
    -------
    Synthesis
    """
    points = grid.points
    problem = FeedbackProblem(BalancedPlant.of(plant, points), variations, grid.axes, grid.corners, strictly_proper,
                              points[:0], linear=grid.linear, polytope=grid.polytope)
    return search(problem, bound, back_off)


def constant_feedback(plant: GeneralizedPlant, bound: float | None, back_off: float, points: int,
                      hull: Hull | None = None) -> Synthesis:
    """One bound of the gain with one X and Y and a feedthrough: what `OutputFeedback` solves without further settings.

    Parameters
    ----------
    plant : GeneralizedPlant
    bound : float or None
        A gain that is good enough; None for the least.
    back_off : float
        Share by which the bound is raised above the least one.
    points : int
        Grid points per scheduling variable, where corners of the box are not enough.
    hull : Hull, optional
        The scheduling set where that is no box.

    Returns
    -------
    Synthesis

    Raises
    ------
    InputError
        As `inspected` and `FeedbackGrid.over`; fewer than two points.
    """
    started = time.perf_counter()
    count = _checks.count(points, "points of a design grid", at_least=2)
    grid = FeedbackGrid.constant(plant, count) if hull is None else FeedbackGrid.over(plant, hull)
    notes = inspected(plant, grid)
    if isinstance(notes, Synthesis):
        return replace(notes, seconds=time.perf_counter() - started)
    found = projected_feedback(plant, grid, Variations(None, "both", plant.box), strictly_proper=False, bound=bound,
                               back_off=back_off)
    return remarked(found, grid, notes, started)
