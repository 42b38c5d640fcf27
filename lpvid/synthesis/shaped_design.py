"""From matrix inequalities to a controller whose closed loop was looked at: what all shaped designs share."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from types import UnionType
from typing import TypeVar

import numpy as np

from lpvid.analysis.frozen_norms import largest_frozen_norm
from lpvid.errors import InputError
from lpvid.lmi.driven import driven
from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis
from lpvid.synthesis.assumptions import Fault
from lpvid.synthesis.block_proof import gain_figure, moving_figure, searched_figure, variance_figure
from lpvid.synthesis.criteria import CovarianceCriterion, Criterion, HInfinity, Region
from lpvid.synthesis.figures import Figure, channel, measure, stays_inside
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.infeasibility import BEYOND
from lpvid.synthesis.loop_certificate import own_certificate
from lpvid.synthesis.loop_check import LoopStorage
from lpvid.synthesis.polytope import Polytope, affine_in
from lpvid.synthesis.progress import remember, stage, stopped
from lpvid.synthesis.rated_figures import RatedLoop
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.shaped_program import Shaped, ShapedProgram, Shaping

T = TypeVar("T")
Values = Callable[[np.ndarray], np.ndarray]
"""From points to matrices."""
SOFTER = (1.1, 1.4)
"""Factors tried where the controller of the design's own back-off does not keep its promise."""
SOLVED = 0.12
"""share above the least level up to which a verified figure is "solved"; beyond it is "backed-off" """
MOST = 6
"""Controllers that are examined before the best of them is taken."""
KEPT = 1.005
"""A promise is kept when the verified figure is at most this factor above it."""


@dataclass(frozen=True, eq=False)
class ShapedProblem(ABC):
    """One plant with one design: declares unknowns, and turns their values into a controller.

    Parameters
    ----------
    plant : GeneralizedPlant
    criteria : tuple of HInfinity, H2 or GeneralizedH2
    regions : tuple of Region
    back_off : float
    polytope : Polytope, optional
        The scheduling set where that is no box.
    room : float
        Share by which the bounds of the criteria lie below those that were asked for.
    """

    plant: GeneralizedPlant
    criteria: tuple[Criterion, ...]
    regions: tuple[Region, ...]
    back_off: float
    polytope: Polytope | None = field(default=None, kw_only=True)
    room: float = field(default=0.0, kw_only=True)

    @property
    def squared(self) -> bool:
        """A gain shares 𝐗 with a variance, and its V is measured in |w|²."""
        return any(isinstance(c, CovarianceCriterion) for c in self.criteria)

    @property
    @abstractmethod
    def method(self) -> str:
        """The design in a few words."""

    @property
    @abstractmethod
    def remedy(self) -> str:
        """What to do where the inequalities have no solution."""

    @property
    @abstractmethod
    def storage(self) -> Basis | None:
        """Functions of the storage function that shows what the closed loop does; None leaves them to the analysis."""

    @abstractmethod
    def storage_of(self, shaped: Shaped) -> Values | None:
        """(N, n, n) P at (N, n_scheduling) points of the box, as an answer has it; None where the analysis is as quick.

        Parameters
        ----------
        shaped : Shaped
            Values of the unknowns with the figures that they promise.

        Returns
        -------
        callable or None
            From points to P over the states of `close`.
        """

    @abstractmethod
    def blocks_of(self, shaped: Shaped) -> LoopStorage | None:
        """One storage function for the box, in two blocks, over the states of `close`; None where there is none.

        Parameters
        ----------
        shaped : Shaped
            Values of the unknowns with the figures that they promise.

        Returns
        -------
        LoopStorage or None
            At one point, with slopes of zero.
        """

    @abstractmethod
    def build(self, program: Program, scale: float) -> Shaping:
        """Declare the unknowns and shape the loops; `scale` is how large the unknowns were before.

        Parameters
        ----------
        program : Program
            Where the unknowns are declared.
        scale : float
            Largest entry of the unknowns in the first solve; 1 in that solve.

        Returns
        -------
        Shaping
            Loops and unknowns.
        """

    @abstractmethod
    def controller(self, shaped: Shaped) -> LPVStateSpace:
        """The controller of an answer.

        Parameters
        ----------
        shaped : Shaped
            Values of the unknowns with the figures that they promise.

        Returns
        -------
        LPVStateSpace
            In the plant's own units.
        """

    @abstractmethod
    def close(self, controller: LPVStateSpace) -> LPVStateSpace:
        """What the criteria are about, from the plant's disturbances to its performance signals (in its order).

        Parameters
        ----------
        controller : LPVStateSpace
            As `controller` gives it.

        Returns
        -------
        LPVStateSpace
            Closed loop, or the error of an estimate.
        """


Answers = Callable[[float], Iterator[tuple[ShapedProblem, Shaped]]]
"""From a back-off to answers of inequalities, each with the problem that has its coordinates."""


def listed(value: T | Sequence[T], kind: type | tuple[type, ...] | UnionType, what: str) -> tuple[T, ...]:
    """One object or several of a kind, as a tuple.

    Parameters
    ----------
    value : object or sequence of objects
        What was given.
    kind : type, tuple of types or union
        What every object must be.
    what : str
        Of the design, for the message.

    Returns
    -------
    tuple
        Empty for an empty sequence.

    Raises
    ------
    InputError
        An object of another kind.
    """
    items = tuple(value) if isinstance(value, (tuple, list)) else (value,)
    for item in items:
        if not isinstance(item, kind):
            raise InputError(f"{what} of a design must be objects of this package", got=repr(item),
                             mend="for example HInfinity(), H2(), GeneralizedH2(), HalfPlane(decay), Disc(centre, "
                                  "radius) or Cone(damping)")
    return items  # type: ignore[return-value]


def check_criteria(plant: GeneralizedPlant, criteria: Sequence[Criterion], regions: Sequence[Region],
                   points: np.ndarray) -> None:
    """Refuse what cannot be met by any controller: unknown signals, regions of the wrong plane, H2 of white noise.

    Parameters
    ----------
    plant : GeneralizedPlant
        Its signals, its kind of time and its D11.
    criteria : sequence of HInfinity, H2 or GeneralizedH2
        Bounds of its closed loop.
    regions : sequence of Region
        Where its poles are wanted.
    points : (N, n_scheduling) array
        Where the direct path is looked at.

    Raises
    ------
    InputError
        A region of the other kind of time, a criterion that names no signal of the plant, or a direct path from white
        noise to a performance signal in continuous time.
    """
    discrete = plant.sample_time is not None
    m = plant.at(points)
    for region in regions:
        if region.discrete is not None and region.discrete != discrete:
            raise InputError(f"{type(region).__name__} is a region of the {'z' if region.discrete else 's'} plane",
                             got=f"a {'discrete' if discrete else 'continuous'}-time plant",
                             mend="use Disc(0, radius) for a discrete plant" if discrete else
                             "use HalfPlane, Cone or Disc of the s plane")
    for criterion in criteria:
        into, out = criterion.selection(plant)
        through = out @ m.D11 @ into
        if isinstance(criterion, CovarianceCriterion) and not discrete and np.any(np.abs(through) > 1e-12):
            _, i, j = np.unravel_index(int(np.argmax(np.abs(through))), through.shape)
            z = np.array(plant.performance)[np.argmax(out, axis=1)][i]
            w = np.array(plant.disturbances)[np.argmax(into, axis=0)][j]
            raise InputError(f"the {criterion.kind} norm from {w} to {z} is infinite in continuous time", why=f"{w} "
                             f"reaches {z} directly", mend=f"filter {w} or {z}, or leave the pair out of the criterion")


def settle(problem: ShapedProblem, fault: Fault | None = None, *, kept: float = KEPT, answers: Answers | None = None
           ) -> Synthesis:
    """Solve, recover, close the loop, verify; soften the promise where it is not kept.

    Parameters
    ----------
    problem : ShapedProblem
    fault : Fault, optional
        Why there is nothing to solve.
    kept : float
        A promise is kept when the verified figure is at most this factor above it.
    answers : callable, optional
        From a back-off to answers, each with the problem in whose coordinates it is; left out, those of the problem's
        own program.

    Returns
    -------
    Synthesis
        "solved" if the figures of the closed loop keep the promise, "backed-off" if a larger promise had to be made.
    """
    if fault is not None:
        return Synthesis(fault.verdict, why=fault.why, mend=fault.mend, method=problem.method)
    started = time.perf_counter()
    program = ShapedProgram(problem.plant, problem.criteria, problem.regions, problem.build)
    given: Answers = answers or (lambda share: ((problem, shaped) for shaped in program.answers(share)))
    found: list[Synthesis] = []
    examined = 0
    for back_off in (problem.back_off, *(f for f in SOFTER if f > problem.back_off)):
        stage(f"matrix inequalities for {_asked(problem)}, back-off {back_off:g}")
        for stated, shaped in given(back_off):
            if stopped() and found:
                break
            examined += 1
            stage(f"verifying controller {examined} of at most {MOST}")
            outcome = _judged(stated, shaped, back_off, started, kept)
            if outcome is not None:
                if outcome[1]:
                    return remember(outcome[0])
                found.append(remember(outcome[0]))
            if examined >= MOST:
                break
        if not examined or examined >= MOST:
            break
    if found:
        return min(found, key=lambda s: s.gamma_verified if s.gamma_verified is not None else np.inf)
    seconds = time.perf_counter() - started
    if examined:
        lost = ("keeps the loop stable" if problem.polytope is None else
                f"has a bound that is proven on {problem.polytope.text}")
        return Synthesis("numerical", why=f"no controller recovered from the solvers' answers {lost}",
                         mend="scale the signals to similar size, or raise back_off", seconds=seconds,
                         method=problem.method)
    if answers is None and program.refuted() >= BEYOND:
        return Synthesis("infeasible", why=f"there are no matrices for {_asked(problem)} (shown by a dual matrix)",
                         mend=problem.remedy, seconds=seconds, method=problem.method)
    return Synthesis("numerical", why=f"no solver finds matrices for {_asked(problem)}; that none exist is not shown",
                     mend=problem.remedy, seconds=seconds, method=problem.method)


def _judged(problem: ShapedProblem, shaped: Shaped, back_off: float, started: float, most: float
            ) -> tuple[Synthesis, bool] | None:
    """A synthesis from one answer, and whether the promise is kept; None where the loop is not even stable."""
    try:
        controller = problem.controller(shaped)
    except np.linalg.LinAlgError:
        return None
    loop = problem.close(controller)
    if set(loop.box.names) - set(problem.plant.box.names):
        return _by_rates(problem, shaped, controller, loop, back_off, started, most)
    if problem.polytope is not None:
        return _on_polytope(problem, problem.polytope, shaped, controller, loop, back_off, started, most)
    inside, notes = stays_inside(problem.regions, loop)
    if not inside:
        return None
    figures = [_proven(c, problem, shaped, loop, promised, most)
               or measure(c, problem.plant, loop, promised, problem.storage)
               for c, promised in zip(problem.criteria, shaped.promised, strict=True)]
    bounded = _bounded(problem)
    main = HInfinity() if bounded is None else problem.criteria[bounded]
    gain = measure(main, problem.plant, loop, np.inf, problem.storage) if bounded is None else figures[bounded]
    return _stated(problem, shaped, controller, loop, (figures, gain, notes), back_off, started, most)


def _on_polytope(problem: ShapedProblem, polytope: Polytope, shaped: Shaped, controller: LPVStateSpace,
                 loop: LPVStateSpace, back_off: float, started: float, most: float) -> tuple[Synthesis, bool] | None:
    """A synthesis for a scheduling set that is no box: figures by the design's own storage function at its vertices."""
    moving = problem.storage is not None and bool(problem.storage.names)
    if not (moving or affine_in(loop.basis)) or not polytope.stable(loop):
        return None
    if moving:
        return _by_steps(problem, polytope, shaped, controller, loop, back_off, started, most)
    blocks = problem.blocks_of(shaped)
    if blocks is None:
        return None  # one without a storage function of its own has no designs on polytopes
    inside = [polytope.holds(region, loop, blocks) for region in problem.regions]
    if not all(inside):
        return None
    notes = tuple(f"frozen poles lie in {region!r} " + ("in the whole polytope" if where == "whole" else
                  f"at {len(polytope.looked)} points, not proven between them")
                  for region, where in zip(problem.regions, inside, strict=True))
    figures = []
    for criterion, promised in zip(problem.criteria, shaped.promised, strict=True):
        part = channel(loop, *criterion.indices(problem.plant))
        found = _figure_by_blocks(criterion, problem, blocks, part, promised, polytope)
        if isinstance(criterion, HInfinity) and not _kept_to(found, criterion.bound):
            found = searched_figure(criterion.description(problem.plant), part, promised, polytope) or found
        if found is None or (isinstance(criterion, HInfinity) and found.certificate is None):
            return None
        figures.append(found)
    bounded = _bounded(problem)
    gain = (searched_figure(HInfinity().description(problem.plant), loop, np.inf, polytope) if bounded is None
            else figures[bounded])
    if gain is None:
        return None
    return _stated(problem, shaped, polytope.marked(controller), polytope.marked(loop), (figures, gain, notes),
                   back_off, started, most)


def _by_steps(problem: ShapedProblem, polytope: Polytope, shaped: Shaped, controller: LPVStateSpace,
              loop: LPVStateSpace, back_off: float, started: float, most: float) -> tuple[Synthesis, bool] | None:
    """A synthesis whose Lyapunov matrix moves: gains by its own storage function, else by one that is looked for."""
    values, figures = problem.storage_of(shaped), []
    for criterion, promised in zip(problem.criteria, shaped.promised, strict=True):
        part, text = channel(loop, *criterion.indices(problem.plant)), criterion.description(problem.plant)
        limit = promised * (1 + problem.room if criterion.bound is not None else most)
        own = None if values is None or problem.storage is None else moving_figure(
            text, part, promised, polytope, values, problem.storage, limit)
        if own is None and loop.is_discrete and affine_in(loop.basis):
            own = searched_figure(text, part, promised, polytope, moving=True)
        figures.append(own)
    found = [f for f in figures if f is not None]
    if len(found) < len(figures):
        return None
    return _stated(problem, shaped, polytope.marked(controller), polytope.marked(loop), (found, found[0], ()), back_off,
                   started, most)


def _kept_to(found: Figure | None, bound: float | None) -> bool:
    """Whether a gain has a certificate, and one that keeps a requested bound to the last digit."""
    return found is not None and found.certificate is not None and (bound is None or found.verified <= bound)


def _by_rates(problem: ShapedProblem, shaped: Shaped, controller: LPVStateSpace, loop: LPVStateSpace, back_off: float,
              started: float, most: float) -> tuple[Synthesis, bool] | None:
    """A synthesis whose controller reads the rates: figures by the design's own storage function."""
    values, basis = problem.storage_of(shaped), problem.storage
    if values is None or basis is None:
        return None
    rated = RatedLoop(loop, problem.plant.box, values, basis)
    figures = [rated.figure(c, problem.plant, promised, most, promised if problem.squared else 1.0)
               for c, promised in zip(problem.criteria, shaped.promised, strict=True)]
    bounded = _bounded(problem)
    gain = rated.figure(HInfinity(), problem.plant, np.inf, most, None) if bounded is None else figures[bounded]
    return _stated(problem, shaped, controller, loop, (figures, gain, ()), back_off, started, most)


def _stated(problem: ShapedProblem, shaped: Shaped, controller: LPVStateSpace, loop: LPVStateSpace,
            found: tuple[list[Figure], Figure, tuple[str, ...]], back_off: float, started: float, most: float
            ) -> tuple[Synthesis, bool] | None:
    """The verdict from figures, of the criteria and of the gain; None where one is infinite."""
    figures, gain, notes = found
    if not all(np.isfinite(f.verified) for f in (*figures, gain)):
        return None
    bounded = _bounded(problem)
    main = HInfinity() if bounded is None else problem.criteria[bounded]
    room = 1 + problem.room
    kept = all(f.verified <= (most if c.bound is None else max(min(most, KEPT), room)) * f.promised
               for f, c in zip(figures, problem.criteria, strict=True))
    near = all(f.verified <= (room * f.promised if c.bound is not None else (1 + SOLVED) * low)
               for f, c, low in zip(figures, problem.criteria, shaped.lowest, strict=True))
    between = all(f.between_grid for f in (*figures, gain))
    return Synthesis(
        "solved" if near or (kept and back_off == problem.back_off) else "backed-off", between_grid=between,
        gamma=None if bounded is None else gain.promised, gamma_verified=gain.verified, gamma_lower=gain.lower,
        controller=controller, closed_loop=channel(loop, *main.indices(problem.plant)), certificate=gain.certificate,
        why=("the closed loop keeps what the inequalities promised"
             if all(f.verified <= KEPT * room * f.promised for f in figures) else
             "the closed loop was verified, but above the promise") + _beside(problem, shaped, figures),
        notes=(*map(str, figures), *notes, *_speed(controller)),
        seconds=time.perf_counter() - started, solver=shaped.solution.solver, method=problem.method,
        infimum=_infimum(problem, shaped), figures=tuple(f.to_dict() for f in figures)), kept


def _bounded(problem: ShapedProblem) -> int | None:
    """Which criterion the quoted gain belongs to."""
    return next((k for k, c in enumerate(problem.criteria) if isinstance(c, HInfinity)), None)


def _beside(problem: ShapedProblem, shaped: Shaped, figures: Sequence[Figure]) -> str:
    """The verified figures of free criteria beside the least ones."""
    pairs = [f"{f.verified:.6g} beside the least {min(low, f.verified):.6g}" for f, c, low in
             zip(figures, problem.criteria, shaped.lowest, strict=True) if c.bound is None and low > 0]
    return f" ({', '.join(pairs)})" if pairs else ""


def _infimum(problem: ShapedProblem, shaped: Shaped) -> float | None:
    """The least gain that the inequalities admit, where nothing else was requested."""
    only = problem.criteria[0] if len(problem.criteria) == 1 else None
    return shaped.lowest[0] if isinstance(only, HInfinity) and only.bound is None else None


def _proven(criterion: Criterion, problem: ShapedProblem, shaped: Shaped, loop: LPVStateSpace, promised: float,
            most: float) -> Figure | None:
    """The promise of a gain, by the design's own storage function; None where that does not prove it on the box.

    A bound that was requested is kept to the last digit, or left to the analysis.
    """
    blocks = problem.blocks_of(shaped)
    if blocks is not None:
        return _by_blocks(criterion, problem, blocks, loop, promised, most)
    own, basis = problem.storage_of(shaped), problem.storage
    if own is None or basis is None or not isinstance(criterion, HInfinity):
        return None
    unit = promised if problem.squared else 1.0
    part = channel(loop, *criterion.indices(problem.plant))
    most = most if len(part.box.names) > 1 else KEPT  # a search over one variable takes seconds, and is tighter
    found = own_certificate(lambda points: unit * own(points), basis, part, promised, most)
    if found is None or not found.between_grid or (criterion.bound is not None and found.gamma > criterion.bound):
        return None
    system = driven(part)
    lower = largest_frozen_norm(system, found.box)[0]
    return Figure("H-infinity", criterion.description(problem.plant), promised, found.gamma, lower, True, found)


def _by_blocks(criterion: Criterion, problem: ShapedProblem, blocks: LoopStorage, loop: LPVStateSpace, promised: float,
               most: float) -> Figure | None:
    """The promise by one storage function in two blocks; None where that does not prove it."""
    part = channel(loop, *criterion.indices(problem.plant))
    found = _figure_by_blocks(criterion, problem, blocks, part, promised, None)
    limit = promised if criterion.bound is not None else most * promised
    if found is None or not found.between_grid or found.verified > limit:
        return None
    return found if isinstance(criterion, CovarianceCriterion) or found.certificate is not None else None


def _figure_by_blocks(criterion: Criterion, problem: ShapedProblem, blocks: LoopStorage, part: LPVStateSpace,
                      promised: float, polytope: Polytope | None) -> Figure | None:
    """What one storage function in two blocks shows of a channel, over the box or a polytope."""
    description = criterion.description(problem.plant)
    if isinstance(criterion, CovarianceCriterion):
        return variance_figure(description, part, promised, blocks, criterion, polytope)
    unit = promised if problem.squared else 1.0
    return gain_figure(description, part, promised, replace(blocks, first=unit * blocks.first,
                                                            second=unit * blocks.second), polytope)


def _speed(controller: LPVStateSpace) -> tuple[str, ...]:
    """A remark on the fastest pole of a continuous controller, which has to be sampled."""
    if controller.is_discrete or not controller.order:
        return ()
    fastest = max(float(np.abs(controller.frozen_poles(p)).max()) for p in controller.box.grid(3))
    return (f"the fastest pole of the controller is at {fastest / (2 * np.pi):.3g} Hz",)


def _asked(problem: ShapedProblem) -> str:
    parts = [
        f"{type(c).__name__} from {c.description(problem.plant)}" + ("" if c.bound is None else f" below {c.bound:g}")
        for c in problem.criteria
    ]
    return " and ".join([*parts, *(repr(r) for r in problem.regions)])
