"""Full-order dynamic output feedback with a bounded induced gain: H-infinity for LTI and LPV plants."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.hull import Hull
from lpvid.scheduling import Basis, Scheduling
from lpvid.synthesis.controller_formula import Variations
from lpvid.synthesis.criteria import HInfinity, Region
from lpvid.synthesis.design_grid import check_rates, design_axes, moving_basis, tensor
from lpvid.synthesis.fast_states import too_fast
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.moving_feedback import lowest, moving_feedback
from lpvid.synthesis.multiobjective import MultiObjective
from lpvid.synthesis.output_feedback_search import SOLVED, STEPS, kept_near
from lpvid.synthesis.polytope import Polytope, affine_in, check_hull
from lpvid.synthesis.projected_feedback import FeedbackGrid, inspected, projected_feedback, remarked
from lpvid.synthesis.result import Synthesis

Rate = float | Sequence[float | None] | Mapping[str, float | None] | None
VARYING = ("both", "controls", "measurements")


@dataclass(frozen=True, eq=False)
class OutputFeedback:
    """x_K⁺ = A_K(p) x_K + B_K(p) y, u = C_K(p) x_K + D_K(p) y with the least bound of ‖z‖/‖w‖ that can be kept.

    Two projected inequalities decide whether a bound can be had (`lpvid.synthesis.projection`); the controller follows
    from their answer in closed form. With a constant X and Y the scheduling may jump; with X(p), Y(p) it keeps to the
    rate bounds of the plant's box. In discrete time the Lyapunov matrix that moves is compared with itself one sample
    later, by slack matrices (`lpvid.synthesis.moving_feedback`): a variable without a rate bound may then jump.

    Parameters
    ----------
    lyapunov : Basis, optional
        Functions of X(p) and Y(p); in continuous time their variables need rate bounds. Left out, constants.
    varying : {"both", "controls", "measurements"}
        Which of X (what the controls can do) and Y (what the measurements can observe) depends on p. With "both" the
        controller reads the rates too, as further scheduling variables ``<name>_rate``. In discrete time one of them
        moves and the controller reads p alone; "both" tries either, and keeps the lower bound.
    rate : float, sequence or mapping of name to float, optional
        Bounds on |dp/dt| [units per second] in place of those of the plant's box.
    strictly_proper : bool
        No feedthrough D_K.
    regions : Region or sequence of Region
        Where the frozen poles of the closed loop must lie; X and Y are then constants.
    bound : float, optional
        A gain that is good enough; a plant that does not admit it is reported as infeasible. Left out, the least.
    back_off : float
        Share by which the bound is raised above the least one, for a controller of moderate gains.
    points : int
        Grid points per scheduling variable, where corners of the box are not enough.
    hull : Hull, optional
        A polytope in which the scheduling stays (``lpv.Hull.of`` samples, ``lpv.Hull.disc`` for cos θ and sin θ) in
        place of its box. With constant X and Y the plant must be affine in the scheduling with steady gains of controls
        and measurements: the inequalities stand at the vertices, the controller is affine too, and the certificate is a
        `HullCertificate`. With `lyapunov`, a polynomial, X or Y moves ("both" tries either), and the certificate is a
        `GainCertificate` of the polytope. In continuous time the plant and the controller are polynomials. In discrete
        time P moves, of degree one, beside constant slack matrices, and plant and controller are affine.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.model.state_space import LPVStateSpace
    >>> from lpvid.scheduling import Polynomial
    >>> system = LPVStateSpace([[[-1.0]]], [[[1.0, 1.0]]], [[[1.0], [0.0], [1.0]]],
    ...                        [[[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]]], Polynomial((), 0), None,
    ...                        inputs=(Signal("road"), Signal("force")),
    ...                        outputs=(Signal("comfort"), Signal("effort"), Signal("sensor")))
    >>> result = OutputFeedback().solve(GeneralizedPlant(system, ["force"], ["sensor"]))
    >>> result.verdict, round(result.gamma_verified, 2)
    ('solved', 0.71)
    """

    lyapunov: Basis | None = None
    varying: str = "both"
    rate: Rate = None
    strictly_proper: bool = False
    regions: Region | Sequence[Region] = ()
    bound: float | None = None
    back_off: float = 0.01
    points: int = 7
    hull: Hull | None = None

    def __post_init__(self) -> None:
        _checks.one_of(self.varying, VARYING, "varying")
        if not 0 <= _checks.real(self.back_off, "back_off") <= 1:
            raise InputError("back_off is a share between 0 and 1", got=self.back_off)
        if self.bound is not None:
            _checks.positive(self.bound, "the bound of the gain")
        _checks.count(self.points, "points of a design grid", at_least=2)
        regions = (self.regions,) if isinstance(self.regions, Region) else tuple(self.regions)
        object.__setattr__(self, "regions", regions)
        object.__setattr__(self, "lyapunov", moving_basis(self.lyapunov))
        if regions and self.lyapunov is not None:
            raise InputError("pole regions need constant Lyapunov matrices", got="lyapunov and regions",
                             mend="leave one of the two out")
        check_hull(self.hull, self.lyapunov)

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The controller for a plant, with what its closed loop was shown to do.

        Parameters
        ----------
        plant : GeneralizedPlant
            Continuous or discrete.

        Returns
        -------
        Synthesis
            Infeasible, or without an answer, is an outcome with its reason, no error.

        Raises
        ------
        InputError
            A Lyapunov matrix over unknown variables or over one without a rate bound; a control or measurement that is
            connected to nothing or changes its polarity within the box.
        """
        started = time.perf_counter()
        plant = _rated(plant, self.rate)
        grid = self._grid(plant)
        notes = inspected(plant, grid)
        if isinstance(notes, Synthesis):
            return replace(notes, seconds=time.perf_counter() - started)
        constant = self.lyapunov is None
        if self.regions or (constant and self.strictly_proper and plant.sample_time is not None):
            return self._shaped(plant, notes, started)
        if self.lyapunov is not None and plant.sample_time is not None:
            found = self._moving(plant, grid.axes)
        else:
            basis = None if self.lyapunov is None else self.lyapunov.bound(plant.box)
            if self.hull is not None and basis is not None:
                return remarked(self._either(plant, grid, basis), grid, notes, started)
            found = projected_feedback(plant, grid, Variations(basis, self.varying, plant.box),
                                       strictly_proper=self.strictly_proper, bound=self.bound, back_off=self.back_off)
            if self.hull is not None and _farther(found, self.bound, self.back_off):
                found = self._affine(plant, grid.points, found)
        return remarked(found, grid, notes, started)

    def _moving(self, plant: GeneralizedPlant, axes: tuple[np.ndarray, ...]) -> Synthesis:
        """Discrete time: the lowest verified gain of what may move, and of a constant X and Y."""
        assert self.lyapunov is not None
        basis, sides = self.lyapunov.bound(plant.box), {"controls": (False,), "measurements": (True,)}
        polytope = None if self.hull is None else Polytope.full_order(self.hull, plant)
        if polytope is not None and not affine_in(basis):
            raise InputError("a Lyapunov matrix that moves on a hull in discrete time has degree one",
                             got=f"degree {basis.degree}", why="steps between vertices cover no other",
                             mend=f"lpv.Polynomial({basis.names!r}, 1)")
        moving = [moving_feedback(plant, basis, axes, turned=turned, strictly_proper=self.strictly_proper,
                                  bound=self.bound, back_off=self.back_off, polytope=polytope)
                  for turned in sides.get(self.varying, (False, True))]
        proper = self.strictly_proper or bool(plant.at(tensor(axes)).D22.any())
        return lowest(moving, replace(self, lyapunov=None, strictly_proper=proper).solve(plant))

    def _either(self, plant: GeneralizedPlant, grid: FeedbackGrid, basis: Basis) -> Synthesis:
        """A hull, continuous time: the lowest verified gain of X or Y that moves, and of constants."""
        sides = ("controls", "measurements") if self.varying == "both" else (self.varying,)
        moving = [projected_feedback(plant, grid, Variations(basis, side, plant.box), bound=self.bound,
                                     strictly_proper=self.strictly_proper, back_off=self.back_off) for side in sides]
        try:
            return lowest(moving, replace(self, lyapunov=None).solve(plant))
        except InputError as error:  # constants ask more of the plant
            return lowest(moving, Synthesis("numerical", why=str(error)))

    def _grid(self, plant: GeneralizedPlant) -> FeedbackGrid:
        """Where the inequalities are imposed."""
        if self.lyapunov is not None:
            check_rates(self.lyapunov, plant.box, plant.sample_time)
        if self.hull is not None:
            moves = self.lyapunov is not None and plant.sample_time is None
            return (FeedbackGrid.moving_over(plant, self.hull, self.points) if moves
                    else FeedbackGrid.over(plant, self.hull))
        if self.lyapunov is None:
            return FeedbackGrid.constant(plant, self.points)
        if plant.sample_time is not None:
            return FeedbackGrid(design_axes(plant.box, self.points, False))
        return FeedbackGrid.moving(plant, self.lyapunov, self.points)

    def _affine(self, plant: GeneralizedPlant, vertices: np.ndarray, projected: Synthesis) -> Synthesis:
        """On a hull: affine unknowns in the change of variables, for a projected answer whose controller is not affine.

        Of the steps of the back-off the first whose controller is not far faster than the plant and the projected
        answer's controller; every step lies below the gain that the affine part of this keeps.
        """
        fast = projected
        for step in STEPS:
            if step * self.back_off >= (projected.gamma_verified or np.inf) / (projected.infimum or np.inf) - 1:
                break
            design = MultiObjective(HInfinity(bound=self.bound), (), not self.strictly_proper, self.points,
                                    1 + step * self.back_off, hull=self.hull)
            found = design.by_change_of_variables(plant)
            if found.controller is None or not too_fast(plant, found.controller, vertices,
                                                              beside=projected.controller):
                return _nearer(projected, found)
            fast = _nearer(fast, found)
            if self.bound is not None:
                break
        return fast if projected.controller is None else projected

    def _shaped(self, plant: GeneralizedPlant, notes: tuple[str, ...], started: float) -> Synthesis:
        """Pole regions, no feedthrough in discrete time, and a controller that is affine where the projected answer's
        is not, need the change of variables."""
        design = MultiObjective(HInfinity(bound=self.bound), self.regions, not self.strictly_proper, self.points,
                                1 + self.back_off, hull=self.hull)
        found = design.solve(plant) if self.hull is None else design.by_change_of_variables(plant)
        return replace(found, notes=(*notes, *found.notes), seconds=time.perf_counter() - started)


def _farther(found: Synthesis, bound: float | None, back_off: float) -> bool:
    """Whether a controller on a hull is beyond the first step of the back-off: another affine one may be nearer."""
    if found.controller is None:
        return found.verdict == "numerical"
    least = 0.5 * sum(STEPS[:2]) * back_off
    return bound is None and (found.gamma_verified or np.inf) > (1 + least) * (found.infimum or 0.0)


def _nearer(projected: Synthesis, shaped: Synthesis) -> Synthesis:
    """Of two syntheses on one hull the one of lower verified gain, beside the least bound of the projected program.

    The affine controller of the second may keep more than they admit: they let every point have a controller.
    """
    if shaped.gamma_verified is None or shaped.gamma_verified >= (projected.gamma_verified or np.inf):
        return projected
    least = projected.infimum or shaped.gamma_verified
    near = shaped.gamma_verified <= (1 + SOLVED) * least
    return replace(shaped, infimum=min(least, shaped.gamma_verified), verdict="solved" if near else "backed-off",
                   why=kept_near(shaped.gamma_verified, min(least, shaped.gamma_verified)))


def _rated(plant: GeneralizedPlant, rate: Rate) -> GeneralizedPlant:
    """The plant with other rate bounds."""
    if rate is None:
        return plant
    box = plant.box
    if isinstance(rate, Mapping):
        for name in rate:
            _checks.known_name(name, box.names, "scheduling variable")
        rates = tuple(rate.get(n, r) for n, r in zip(box.names, box.rate, strict=True))
    elif isinstance(rate, Sequence):
        rates = tuple(rate)
    else:
        rates = (float(rate),) * len(box.names)
    scheduling = Scheduling(box.names, box.lower, box.upper, rates, box.units)
    return GeneralizedPlant(plant.system.replace(scheduling=scheduling), plant.controls, plant.measurements)
