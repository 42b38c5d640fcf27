"""State observers and full-order filters by linear matrix inequalities; the Kalman filter is the still H2 case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.errors import InputError
from lpvid.lmi.affine import combined
from lpvid.lmi.program import Program
from lpvid.model.hull import Hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis
from lpvid.synthesis.assumptions import fault_of
from lpvid.synthesis.criteria import Criterion, HInfinity, Region
from lpvid.synthesis.design_grid import columns, fitted
from lpvid.synthesis.gain_design import GainDesign, GainProblem
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.matrix_function import MatrixFunction
from lpvid.synthesis.matrix_function import block as function_block
from lpvid.synthesis.multiobjective import MultiObjective
from lpvid.synthesis.plant_functions import assembled, named, plant_functions
from lpvid.synthesis.polytope import Polytope
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.shaped_design import Values, listed
from lpvid.synthesis.shaped_loop import ShapedLoop
from lpvid.synthesis.shaped_program import Shaped, Shaping, size_and_condition


@dataclass(frozen=True, eq=False)
class Observer(GainDesign):
    """x̂⁺ = A x̂ + B2 u + L(p)(y − C2 x̂ − D22 u), ẑ = C1 x̂ + D12 u: small error z − ẑ, or fast decay of x − x̂.

    With P the Lyapunov matrix of the error e⁺ = (A − L C2) e + (B1 − L D21) w and Y = P L (in discrete time Y = HᵀL
    with a slack matrix H), the bounded-real inequality is linear in P, Y:
    [He(PA − YC2) + Ṗ, PB1 − YD21, C1ᵀ; ⋆, −γI, D11ᵀ; ⋆, ⋆, −γI] ≺ 0. One H2 criterion on a plant that does not vary
    gives the Kalman filter.

    Parameters
    ----------
    criteria : HInfinity, H2, GeneralizedH2 or a sequence of them
        Bounds from w to the error of the performance signals; empty where only regions are requested.
    regions : Region or sequence of Region
        Where the frozen poles of the error must lie.
    lyapunov : Basis, optional
        Functions of P(p); left out, one P, for arbitrarily fast scheduling.
    gain : Basis, optional
        Functions of Y(p); left out, the plant's own for one P, and for P(p) those of degree higher by one.
    points : int
        Grid points per scheduling variable, where corners are not enough.
    back_off : float
        Factor above the lowest level at which the gain is then made small.
    hull : Hull, optional
        As in `GainDesign`. The inequalities are affine in a plant that is, and stand at the vertices. The gain is
        affine beside steady measurements, or constant (``gain=Polynomial((), 0)``).

    Examples
    --------
    >>> Observer(HInfinity("road", "speed"), regions=()).points
    7
    """

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The observer as `controller`, with inputs (controls, measurements) and outputs named ``…_estimate``.

        `closed_loop` is the error: from the disturbances to ``…_error``.

        Parameters
        ----------
        plant : GeneralizedPlant
            Its controls are known inputs of the observer.

        Returns
        -------
        Synthesis
            "undetectable" where measurements do not show a mode that does not decay.
        """
        problem = self.problem(_ObserverProblem, plant, ("C2", "D21"), self._polytope(plant))
        points = problem.points
        at = plant.at(points)
        reached = replace(at, B2=np.broadcast_to(np.eye(plant.order), at.A.shape))  # an observer moves nothing
        return self.settled(problem, fault_of(plant, reached, points))

    def _polytope(self, plant: GeneralizedPlant) -> Polytope | None:
        """The hull for a plant in which the error of the observer is affine."""
        if self.hull is None:
            return None
        found = Polytope.affine(self.hull, plant)
        moving = found.moving_measurements(plant)
        if moving and (self.gain is None or self.gain.names):
            raise InputError("a hull needs steady gains of measurements, or a constant gain of the observer",
                             got=", ".join(moving), mend="gain=lpv.Polynomial((), 0), or a fast constant filter behind "
                             "them (lpv.add_actuator_filters)")
        return found


@dataclass(frozen=True, eq=False)
class Filter:
    """Full-order filter x_F⁺ = A_F x_F + B_F y, ẑ = C_F x_F + D_F y with a small error z − ẑ.

    It is an output feedback whose control is the estimate itself and acts on nothing; known controls are further
    measurements. The plant must be stable on its own, since no filter moves it; for others use `Observer`.

    Parameters
    ----------
    criteria : HInfinity, H2, GeneralizedH2 or a sequence of them
    regions : Region or sequence of Region
    feedthrough : bool
        Allow D_F.
    points : int
    back_off : float
    hull : Hull, optional
        A polytope in which the scheduling stays, in place of its box, as for `MultiObjective`.
    """

    criteria: Criterion | Sequence[Criterion] = (HInfinity(),)
    regions: Region | Sequence[Region] = ()
    feedthrough: bool = True
    points: int = 7
    back_off: float = 1.02
    hull: Hull | None = None

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The filter as `controller`, from measurements (and known controls) to ``…_estimate``.

        Parameters
        ----------
        plant : GeneralizedPlant
            Stable without control.

        Returns
        -------
        Synthesis
            "unstabilisable" for a plant that is not stable on its own.
        """
        criteria = [replace(c, performance=tuple(f"{n}_error" for n in c.performance),
                            disturbances=(*c.disturbances, *plant.controls) if c.disturbances else ())
                    for c in listed(self.criteria, Criterion, "the criteria")]
        design = MultiObjective(criteria, self.regions, self.feedthrough, self.points, self.back_off,
                                hull=self.hull)
        found = design.solve(estimation_plant(plant))
        if found.verdict != "unstabilisable":
            return found
        return replace(found, why="the plant is unstable on its own, and a filter moves nothing",
                       mend="use Observer, whose gain stabilises the error")


def estimation_plant(plant: GeneralizedPlant) -> GeneralizedPlant:
    """The plant with an estimate of each performance signal as its control and the error as its performance.

    ::

        w, u ──> plant ──> z ──(−)──> z_error       measurements: y, and u as it is known
                      └──> y    └── z_estimate

    Parameters
    ----------
    plant : GeneralizedPlant
        With or without controls.

    Returns
    -------
    GeneralizedPlant
        Disturbances are w and u, controls ``…_estimate``, performance ``…_error``, measurements y and ``…_known``.
    """
    p, s, nz, ny = plant_functions(plant), plant.system, len(plant.performance), len(plant.measurements)
    nw, nu = len(plant.disturbances), len(plant.controls)
    whole = function_block([
        [p["A"], p["B1"], p["B2"], np.zeros((s.order, nz))], [p["C1"], p["D11"], p["D12"], -np.eye(nz)],
        [p["C2"], p["D21"], p["D22"], np.zeros((ny, nz))],
        [np.zeros((nu, s.order + nw)), np.eye(nu), np.zeros((nu, nz))]])
    estimates = named(plant, plant.performance, "_estimate")
    system = assembled(whole, s.order, plant, (*named(plant, (*plant.disturbances, *plant.controls)), *estimates),
                       (*named(plant, plant.performance, "_error"), *named(plant, plant.measurements),
                        *named(plant, plant.controls, "_known")))
    return GeneralizedPlant(system, tuple(e.name for e in estimates),
                            (*plant.measurements, *(f"{n}_known" for n in plant.controls)))


@dataclass(frozen=True, eq=False)
class _ObserverProblem(GainProblem):
    """One plant with an observer: its grid, bases and coordinates."""

    @property
    def method(self) -> str:
        return self.summary("observer", "P")

    @property
    def remedy(self) -> str:
        return (f"measure more than {', '.join(self.plant.measurements)}, raise the bounds or widen the regions")

    @property
    def storage(self) -> Basis | None:
        return self.lyapunov

    def storage_of(self, shaped: Shaped) -> Values | None:
        if self.polytope is None:
            return None
        p, scale = shaped.values("lyapunov"), np.outer(self.coordinates.states, self.coordinates.states)
        return lambda points: np.tensordot(columns(self.plant.box, self.lyapunov, points), p / scale, axes=1)

    def build(self, program: Program, scale: float) -> Shaping:
        plant, n, discrete = self.plant, self.plant.order, self.plant.sample_time is not None
        p = [program.unknowns.symmetric(n) for _ in range(self.lyapunov.size)]
        h = [program.unknowns.matrix(n, n) for _ in range(self.slack.size)] if discrete else p
        y = [program.unknowns.matrix(n, len(plant.measurements)) for _ in range(self.gain.size)]
        points = self.points
        psi, phi, chi = (columns(plant.box, basis, points) for basis in (self.lyapunov, self.gain, self.slack))
        loops: list[ShapedLoop] = []
        for k, point in enumerate(points):
            m = self.matrices.point(k)
            pk, hk, yk = combined(p, psi[k]), combined(h, chi[k] if discrete else psi[k]), combined(y, phi[k])
            steps = self.steps(point, psi)
            away = [hk + hk.T - combined(p, step) for step in steps or [psi[k]]] if discrete else [
                combined(p, step) for step in steps] or [None]
            front = hk.T if discrete else pk
            loops += [ShapedLoop(pk, move, front @ m.A - yk @ m.C2, front @ m.B1 - yk @ m.D21, m.C1, m.D11, discrete,
                                 self.coordinates.pace) for move in away]
        size = size_and_condition(program, above=[combined(p, w) for w in psi], below=[combined(y, w) for w in phi])
        return Shaping(tuple(loops), size, {"front": tuple(h), "gain": tuple(y), "lyapunov": tuple(p)})

    def observer_gain(self, shaped: Shaped) -> MatrixFunction:
        """L(p)."""
        front, y, c = shaped.values("front"), shaped.values("gain"), self.coordinates
        if len(front) == 1:
            solved = np.linalg.solve(np.broadcast_to(front[0].T, (len(y), *front[0].shape)), y)
            return MatrixFunction(self.gain, c.states[:, None] * solved / c.measurements)
        box = self.plant.box

        def law(points: np.ndarray) -> np.ndarray:
            here = np.tensordot(columns(box, self.lyapunov, points), front, axes=1).swapaxes(1, 2)
            solved = np.linalg.solve(here, np.tensordot(columns(box, self.gain, points), y, axes=1))
            return c.states[:, None] * solved / c.measurements

        if self.polytope is not None:
            return MatrixFunction(*self.polytope.fitted(law))
        return MatrixFunction(*fitted(law, box, self.axes, self.lyapunov))

    def controller(self, shaped: Shaped) -> LPVStateSpace:
        plant, p, gain = self.plant, plant_functions(self.plant), self.observer_gain(shaped)
        ny = len(plant.measurements)
        state, known = p["A"] - gain @ p["C2"], p["B2"] - gain @ p["D22"]
        whole = function_block([[state, known, gain], [p["C1"], p["D12"], np.zeros((len(plant.performance), ny))]])
        return assembled(whole, plant.order, plant, named(plant, (*plant.controls, *plant.measurements)),
                         named(plant, plant.performance, "_estimate"))

    def close(self, controller: LPVStateSpace) -> LPVStateSpace:
        """The error z − ẑ of the observer as it stands."""
        plant, p = self.plant, plant_functions(self.plant)
        gain = MatrixFunction(controller.basis, controller.B[:, :, len(plant.controls):])
        whole = function_block([[MatrixFunction(controller.basis, controller.A), p["B1"] - gain @ p["D21"]],
                                [p["C1"], p["D11"]]])
        return assembled(whole, plant.order, plant, named(plant, plant.disturbances),
                         named(plant, plant.performance, "_error"))
