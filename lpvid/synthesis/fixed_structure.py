"""FixedStructure: PID, static, low-order and observer-based controllers with gains over the scheduling."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid import _checks
from lpvid.analysis.gain import Gain, l2_gain
from lpvid.analysis.hull_certificate import hull_gain
from lpvid.errors import InputError
from lpvid.lmi.driven import driven
from lpvid.lmi.frame import frame_of
from lpvid.model.hull import Hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial
from lpvid.synthesis.assumptions import fault_of, refuse_dead_signals
from lpvid.synthesis.bilinear_descent import BilinearDescent
from lpvid.synthesis.block_proof import still_bound
from lpvid.synthesis.controller_structures import Attached, LowOrder, ObserverBased, StaticGain, Structure
from lpvid.synthesis.design_grid import (
    check_rates,
    columns,
    design_axes,
    is_affine,
    moving_basis,
    tensor,
    varies,
    with_breaks,
)
from lpvid.synthesis.frozen_descent import FrozenLoops, shortlist
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.output_feedback import OutputFeedback, Rate, _rated
from lpvid.synthesis.polytope import Polytope, refuse_beside_hull
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.shaped_loop import moves
from lpvid.synthesis.shaped_program import SignalCoordinates
from lpvid.synthesis.structure_starts import approximated, drawn, observed, shortened

KEPT = 1.12
"""verified over promised gain up to which a design counts as solved"""
NORM = 1.01
"""verified gain over the H-infinity norm of a loop that does not move above which another proof is tried: the share of
its coarsest one"""
FOLLOWED = 3
"""starts with the lowest frozen norms whose certified gain is looked at"""


@dataclass(frozen=True, eq=False)
class FixedStructure:
    """A controller of given structure whose gains are functions of the scheduling: G(p) = Σ G_k ψ_k(p).

    Two descents from several starts, neither of which finds more than a local minimum: of the largest frozen
    H-infinity norm over a grid (`lpvid.synthesis.frozen_descent`), then of the gain that a storage function proves
    while the scheduling moves (`lpvid.synthesis.bilinear_descent`). What is reported is the bound of `lpv.l2_gain` for
    the finished loop.

    Parameters
    ----------
    structure : Structure
        `StaticGain`, `PID`, `LowOrder` or `ObserverBased`.
    gain : Basis, optional
        ψ_k: `Polynomial` for formulas, `Spline` for a table of an ECU, ``Polynomial((), 0)`` for constants. Left out,
        affine in every scheduling variable.
    lyapunov : Basis, optional
        Functions of the storage function; in continuous time their variables need rate bounds. Left out, a constant.
    rate : float, sequence or mapping of name to float, optional
        In place of the plant's rate bounds.
    start : Synthesis or LPVStateSpace, optional
        A controller of any order to approximate; left out, the full-order one for the middle of the box.
    starts : int
        Further starts, drawn at random after zero.
    points : int
        Grid points per scheduling variable.
    seed : int
        Of the random starts.
    hull : Hull, optional
        A polytope within the box in which the scheduling stays; the loop must be affine in it (constant gains of
        controls and measurements, gains of degree one) and the storage function constant. Certified by `lpv.hull_gain`.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> system = LPVStateSpace([[[-1.0]]], [[[1.0, 1.0]]], [[[1.0], [0.0], [1.0]]],
    ...                        [[[0.0, 0.0], [0.0, 1.0], [0.0, 0.0]]], Polynomial((), 0), None,
    ...                        inputs=(Signal("road"), Signal("force")),
    ...                        outputs=(Signal("comfort"), Signal("effort"), Signal("sensor")))
    >>> found = FixedStructure(StaticGain(), starts=2).solve(GeneralizedPlant(system, ["force"], ["sensor"]))
    >>> round(found.gamma_verified, 2)                           # u = −k x: √(1 + k²)/(1 + k), least at k = 1
    0.71
    """

    structure: Structure = field(default_factory=StaticGain)
    gain: Basis | None = None
    lyapunov: Basis | None = None
    rate: Rate = None
    start: Synthesis | LPVStateSpace | None = None
    starts: int = 12
    points: int = 7
    seed: int = 0
    hull: Hull | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.structure, Structure):
            raise InputError("a fixed structure is needed", got=type(self.structure).__name__,
                             mend="StaticGain(), PID(filter=…), LowOrder(k) or ObserverBased()")
        _checks.count(self.starts, "starts of a descent", at_least=1)
        _checks.count(self.points, "points of a design grid", at_least=2)
        if self.start is not None and not isinstance(self.start, Synthesis | LPVStateSpace):
            raise InputError("a start is a Synthesis or a controller", got=type(self.start).__name__)
        object.__setattr__(self, "lyapunov", moving_basis(self.lyapunov))
        refuse_beside_hull(self.hull, self.lyapunov)

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The gains for a plant, with what its closed loop was shown to do.

        Parameters
        ----------
        plant : GeneralizedPlant
            Plant with performance signals, controls and measurements.

        Returns
        -------
        Synthesis
            Controller, closed loop and verified gain; where there is none, a verdict, why and what would mend it.

        Raises
        ------
        InputError
            Controls that reach readings directly, a Lyapunov matrix over a variable without a rate bound.
        """
        started = time.perf_counter()
        plant = _rated(plant, self.rate)
        problem = _Problem.of(self, plant)
        fault = fault_of(plant, plant.at(problem.points), problem.points, between=True)
        if fault is not None:
            return Synthesis(fault.verdict, why=fault.why, mend=fault.mend, method=problem.method)
        joined = problem.attached.plant
        fault = fault_of(joined, _over(joined, plant, problem.points), problem.points)
        if fault is not None:
            return Synthesis(fault.verdict, method=problem.method, why=f"{fault.why}: it belongs to the structure, and "
                             "the plant has a zero there", mend="leave the integral out (integral=False)")
        model, full = self._model(plant)
        tried = shortlist(problem.frozen, self._starts(problem, model))
        stable = [t for t in tried if np.isfinite(t[1])]
        if not stable:
            return Synthesis("numerical", method=problem.method, seconds=time.perf_counter() - started,
                             why=f"none of {len(tried)} starts led to gains that stabilise every frozen plant",
                             mend="a richer structure or gain basis, another `start`, or more starts")
        best: tuple[Gain, float, LPVStateSpace, LPVStateSpace] | None = None
        for theta, norm in stable[:FOLLOWED if plant.box.names else 1]:
            found = self._finished(problem, plant, theta, norm)
            if found is not None and (best is None or found[0].upper < best[0].upper):
                best = found
        seconds = time.perf_counter() - started
        if best is None:
            return Synthesis("numerical", method=problem.method, seconds=seconds,
                             why=f"gains reach {stable[0][1]:.4g} at every fixed scheduling, but no storage function "
                                 "bounds the gain while it moves",
                             mend="rate bounds with lyapunov=…, a narrower box, or a richer structure")
        gain, promised, controller, loop = best
        if self.hull is not None:
            polytope = Polytope.of(self.hull, plant.box)
            controller, loop = polytope.marked(controller), polytope.marked(loop)
        notes = [f"largest frozen gain of {len(tried)} starts: {', '.join(f'{v:.4g}' for _, v in tried[:4])}, …"]
        if full is not None:
            notes.append(f"full order reaches {full:.4g} {'' if self.start is not None else 'at the middle of the box'}"
                         .rstrip())
        return Synthesis("solved" if gain.upper <= KEPT * promised else "backed-off", promised,
                         gain.upper, gain.lower, controller, loop, gain.certificate,
                         gain.between_grid or not plant.box.names,
                         notes=tuple(notes), seconds=seconds, solver="descent", method=problem.method)

    def _finished(self, problem: _Problem, plant: GeneralizedPlant, theta: np.ndarray, norm: float
                  ) -> tuple[Gain, float, LPVStateSpace, LPVStateSpace] | None:
        """The certified descent from one frozen minimiser, and the verified gain of what it leads to."""
        gains = problem.frozen.coefficients(theta)
        descent, states = problem.descent(gains, norm)
        start = descent.proven(gains) or descent.relaxed(gains)
        if start is None:
            return None
        found = []
        for certified in dict.fromkeys((descent.descended(start), start)):
            controller = problem.attached.controller(problem.gain, problem.physical(certified.gains))
            loop = close_loop(plant, controller)
            gain = (l2_gain(loop, None, self.lyapunov, trajectories=False) if self.hull is None
                    else hull_gain(loop, self.hull))
            if not plant.box.names and gain.upper > NORM * gain.lower:
                found_still = still_bound(loop, states, gain.lower)
                gain = gain if found_still >= gain.upper else replace(gain, upper=found_still, certificate=None)
            if np.isfinite(gain.upper):
                found.append((gain, certified.gamma * descent.unit, controller, loop))
                if gain.upper <= KEPT * certified.gamma * descent.unit:
                    break
        return min(found, key=lambda x: x[0].upper) if found else None

    def _model(self, plant: GeneralizedPlant) -> tuple[LPVStateSpace | None, float | None]:
        """The controller to approximate, and its gain."""
        if isinstance(self.start, LPVStateSpace):
            return self.start, None
        found = self.start if self.start is not None else OutputFeedback().solve(_middle(plant))
        return found.controller, found.gamma_verified

    def _starts(self, problem: _Problem, model: LPVStateSpace | None) -> Iterator[np.ndarray]:
        plant, loops = problem.plant, problem.frozen
        tables = []
        if model is not None and isinstance(self.structure, LowOrder):
            tables += shortened(self.structure, problem.attached, model, plant, problem.points)
        elif model is not None:
            tables.append(approximated(self.structure, problem.attached, plant, model, problem.points))
        if isinstance(self.structure, ObserverBased):
            tables.append(observed(plant, problem.points))
        for table in tables:
            if table is not None:
                yield loops.parameters(problem.fitted(table))
        yield from drawn(loops.size, self.starts, np.random.default_rng(self.seed))


@dataclass(frozen=True, eq=False)
class _Problem:
    """One plant with a structure: its grid, bases and coordinates."""

    plant: GeneralizedPlant
    attached: Attached
    gain: Basis
    lyapunov: Basis
    points: np.ndarray
    few: np.ndarray
    coordinates: SignalCoordinates
    frozen: FrozenLoops
    method: str

    @classmethod
    def of(cls, design: FixedStructure, plant: GeneralizedPlant) -> _Problem:
        box, discrete = plant.box, plant.sample_time is not None
        gain = (Polynomial(box.names, 1) if design.gain is None else design.gain).bound(box)
        for name in gain.names:
            _checks.known_name(name, box.names, "scheduling variable of a gain")
        lyapunov = (design.lyapunov or Polynomial((), 0)).bound(box)
        check_rates(lyapunov, box, plant.sample_time)
        points = tensor(with_breaks(design_axes(box, design.points, False), box, gain, lyapunov))
        if design.hull is not None:
            points = Polytope.of(design.hull, box).within(points)
        refuse_dead_signals(plant, plant.at(points))
        attached = design.structure.attach(plant)
        raw = _over(attached.plant, plant, points)
        if raw.D22.any():
            raise InputError(
                "controls reach the measurements directly, which a fixed structure cannot undo",
                got=f"{', '.join(plant.controls)} in {', '.join(plant.measurements)}",
                mend="measure without that path, or put a fast lag into it: lpv.add_actuator_filters, lpv.weigh",
            )
        coordinates = SignalCoordinates.of(raw, discrete)
        scaled = _paced(coordinates.scaled(raw), coordinates.pace)
        few = points
        if not lyapunov.names and is_affine(gain) and is_affine(attached.plant.system.basis) and not any(
                varies(x) for x in (raw.B2, raw.D12, raw.C2, raw.D21)):
            few = tensor(design_axes(box, 2, True)) if design.hull is None else Polytope.of(design.hull, box).vertices
        elif design.hull is not None:
            raise InputError(
                "a hull needs a closed loop that is affine in the scheduling",
                got=", ".join((*attached.plant.system.basis.labels, *gain.labels)),
                mend="steady gains of controls and measurements (lpv.add_actuator_filters), gains of degree one",
            )
        frozen = FrozenLoops(scaled, columns(box, gain, points), attached.free, discrete)
        method = (f"{type(design.structure).__name__}, gains over {', '.join(gain.labels)}, "
                  f"{'P over ' + ', '.join(lyapunov.labels) if lyapunov.names else 'one quadratic P'}, "
                  f"{len(points)} points")
        return cls(plant, attached, gain, lyapunov, points, few, coordinates, frozen, method)

    def descent(self, gains: np.ndarray, norm: float) -> tuple[BilinearDescent, np.ndarray]:
        """The certified problem in the balanced coordinates x = T x̃ of the loop that some gains make, and T."""
        box, discrete = self.plant.box, self.plant.sample_time is not None
        loop = driven(close_loop(self.plant, self.attached.controller(self.gain, self.physical(gains))))
        frame = frame_of(loop, self.points[:, [box.names.index(r.label) for r in loop.readings]], norm)
        m = _framed(self.coordinates.scaled(_over(self.attached.plant, self.plant, self.few)),
                    self.coordinates.states[:, None] ** -1 * frame.states, frame.time, frame.gain)
        psi, steps = columns(box, self.lyapunov, self.few), []
        for point, here in zip(self.few, psi, strict=True):
            found = moves(box, self.lyapunov, point, self.plant.sample_time) or [here if discrete else 0 * here]
            steps.append(np.array(found) * (1.0 if discrete else frame.time))
        return BilinearDescent(m, columns(box, self.gain, self.few), psi, tuple(steps), self.attached.free, discrete,
                               frame.gain), frame.states

    def physical(self, gains: np.ndarray) -> np.ndarray:
        """Gains in the units of the signals."""
        return self.coordinates.controls[:, None] * gains / self.coordinates.measurements

    def fitted(self, table: np.ndarray) -> np.ndarray:
        """(K, n_v, n_ξ) scaled coefficients closest to physical gains at the points."""
        scaled = table * self.coordinates.measurements / self.coordinates.controls[:, None]
        return np.tensordot(np.linalg.pinv(self.frozen.psi), scaled, axes=1)


def _over(joined: GeneralizedPlant, plant: GeneralizedPlant, points: np.ndarray) -> PlantMatrices:
    """The joined plant at points over the plant's own variables."""
    return joined.at(points[:, [plant.box.names.index(n) for n in joined.box.names]])


def _paced(m: PlantMatrices, pace: float) -> PlantMatrices:
    """The plant in a time in which a typical rate is one."""
    root = np.sqrt(pace)
    return replace(m, A=m.A / pace, B1=m.B1 / root, B2=m.B2 / root, C1=m.C1 / root, C2=m.C2 / root)


def _framed(m: PlantMatrices, states: np.ndarray, time: float, gain: float) -> PlantMatrices:
    """The plant in states x = states·x̃, t = time·t̃ and with gains from w to z over `gain`."""
    back, pace, root = np.linalg.inv(states), np.sqrt(time), np.sqrt(gain)
    return PlantMatrices(time * back @ m.A @ states, pace * back @ m.B1 / root, pace * back @ m.B2,
                         pace * m.C1 @ states / root, m.D11 / gain, m.D12 / root, pace * m.C2 @ states, m.D21 / root,
                         m.D22)


def _middle(plant: GeneralizedPlant) -> GeneralizedPlant:
    """The plant at the middle of its box."""
    s = plant.system
    still = LPVStateSpace.still(*s.frozen(plant.box.centre), s.sample_time, inputs=s.inputs, outputs=s.outputs)
    return GeneralizedPlant(still, plant.controls, plant.measurements)
