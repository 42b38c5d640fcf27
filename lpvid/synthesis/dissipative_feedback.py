"""State feedback for controls that may be met with any share of what they ask, none included."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lpvid import _checks
from lpvid.analysis.frozen import pole_margins
from lpvid.analysis.frozen_norms import h_infinity_norm, largest_frozen_norm
from lpvid.errors import InputError
from lpvid.lmi.affine import Affine, block, trace
from lpvid.lmi.driven import driven
from lpvid.lmi.gain_certificate import GainCertificate
from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Product, Scheduling
from lpvid.synthesis._gramians import averaged_gramian
from lpvid.synthesis.design_grid import check_back_off, design_axes, is_affine, tensor, varies
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.loop_certificate import own_certificate
from lpvid.synthesis.plant_functions import named, written
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.scaling import Units
from lpvid.synthesis.shaped_program import INTERIOR_POINT
from lpvid.synthesis.state_feedback import state_reading

SHARE = "given_share"
KEPT = 1.005
"""A promise is kept when the verified figure is at most this factor above it."""
STRICT = 1e-9
"""margin of the inequalities, in balanced units; what is reported is checked apart from it."""
SHARPER = (1.001, 1.01)
"""factors above the least bound at which a solver's matrix is checked: it holds the least one to its accuracy only."""
TIE = 1e-3
"""weight of tr PΣ, Σ of trace one, beside γ²: without it P has no upper limit where no disturbance drives a state."""
UNSEEN = 1e-6
"""share of the mean state's weight that a state gets which nothing excites, so that P is bounded there"""


@dataclass(frozen=True, eq=False)
class DissipativeFeedback:
    """u = −R⁻¹ B2ᵀ P x, P a storage function of the plant without control; of u the plant gets s u, any s(t) ∈ [0, 1].

    ::

        ẋ = A(p) x + B1 w + s B2 u      z = (C1(p) x + D11 w, s D12 u)      R = D12ᵀ D12

        [ He(PA) + C1ᵀC1    PB1 + C1ᵀD11 ]
        [ ⋆                 D11ᵀD11 − γ²I ] ≺ 0 on the box         (‖z‖ ≤ γ‖w‖ without control)

    With V = xᵀPx the control adds −(2s − s²) xᵀPB2 R⁻¹ B2ᵀPx ≤ 0 to V̇ + |z|² − γ²|w|², whatever s does: the bound
    of the plant left to itself is kept for every course of s (up to s = 2), and so is the mean square tr B1ᵀPB1 for
    white w where D11 = 0. It is the steepest descent of V that the effort allows (Tseng & Hedrick 1994, Vehicle System
    Dynamics 23, 545-569; Scruggs, Taflanidis & Iwan 2007, Struct. Control Health Monit. 14, 1101-1120). γ cannot be
    less than that of the plant alone, since s may be zero throughout; what the control brings shows where it is given.

    Among all P that keep γ the one with the least tr PΣ is taken, Σ the covariance of the states for white disturbances
    and controls (each control by R^(−1/2)): the tightest on what the plant does.

    Parameters
    ----------
    back_off : float
        γ over the least that a constant P proves. Near 1 P is bound by the worst disturbance, far above by Σ alone. It
        is what the design promises; the closed loop is then given the best constant storage function of its own.
    points : int
        Grid points per scheduling variable where the plant is not affine in it.

    Raises
    ------
    InputError
        On `solve`: a discrete plant, measurements that are not all states, controls whose effect varies with the
        scheduling, an effort that is not a performance signal of its own.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> system = LPVStateSpace([[[-1.0]]], [[[1.0, 1.0]]], [[[1.0], [0.0], [1.0]]], [[[0.0, 0.0], [0.0, 1.0], [0, 0]]],
    ...                        Polynomial((), 0), None, inputs=(Signal("push"), Signal("force")),
    ...                        outputs=(Signal("offset"), Signal("effort"), Signal("x")))
    >>> result = DissipativeFeedback().solve(GeneralizedPlant(system, ["force"], ["x"]))
    >>> result.solved, result.between_grid, round(result.gamma_verified, 3)
    (True, True, 1.001)
    """

    back_off: float = 3.0
    points: int = 7

    def __post_init__(self) -> None:
        check_back_off(self.back_off)
        _checks.count(self.points, "points of a design grid", at_least=2)

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The gain for a plant, with what its closed loop was shown to do for every share.

        Parameters
        ----------
        plant : GeneralizedPlant
            Continuous, all states measured.

        Returns
        -------
        Synthesis
            "infeasible" where no constant P bounds the plant without control; "numerical" where no solver's P passes
            the check.
        """
        started = time.perf_counter()
        reading = state_reading(plant)
        points = tensor(design_axes(plant.box, self.points, is_affine(plant.system.basis)))
        at = plant.at(points)
        root = _effort(plant, at)
        fault = _left_alone(plant, at, points)
        if fault is not None:
            return replace(fault, seconds=time.perf_counter() - started)
        units = Units.of(at)
        scaled, excited = units.apply(at), at.B2[0] @ np.linalg.inv(root)
        driven_by = np.concatenate([at.B1, np.broadcast_to(excited, at.B2.shape)], axis=2)
        covariance = averaged_gramian(at.A, driven_by, False)
        spread = _normal(covariance, units)
        tried = 0
        for rough, _ in _least(scaled, spread):
            gamma = self.back_off * rough
            for storage, solver in _tightest(scaled, gamma, spread):
                tried += 1
                p = storage / np.outer(units.states, units.states)
                gain = -np.linalg.solve(root.T @ root, at.B2[0].T @ p)
                found = _judged(plant, p, gain, reading, gamma, covariance)
                if found is not None:
                    return replace(found, infimum=rough, solver=solver, seconds=time.perf_counter() - started)
        seconds = time.perf_counter() - started
        if tried:
            return Synthesis("numerical", why="no solver's storage function keeps the bound when it is checked",
                             mend="raise back_off, or scale the signals to similar size", seconds=seconds,
                             method=_method(points))
        return Synthesis("infeasible", why="no constant storage function proves a bound of the plant left to itself",
                         mend="a narrower box of the scheduling, or a plant that is passive there", seconds=seconds,
                         method=_method(points))


def _method(points: np.ndarray) -> str:
    count = f"{len(points)} point{'s' if len(points) != 1 else ''}"
    return f"dissipative state feedback, one storage function, {count}, every share from 0 to 1"


def _effort(plant: GeneralizedPlant, at: PlantMatrices) -> np.ndarray:
    """D12 of the effort alone, square root of R."""
    if plant.sample_time is not None:
        raise InputError("a dissipative feedback is designed in continuous time", got="a discrete plant",
                         mend="lpvid.synthesis.discretising.to_continuous")
    controls = ", ".join(plant.controls)
    if SHARE in plant.box.names:
        raise InputError(f"'{SHARE}' is the variable that this design adds", got=", ".join(plant.box.names))
    if varies(at.B2) or varies(at.D12) or varies(at.B1):
        raise InputError(f"a dissipative feedback needs controls ({controls}) and disturbances whose effect does not "
                         "vary with the scheduling", mend="put a fast constant filter in front of them")
    rows = np.abs(at.D12[0]).sum(axis=1) > 0
    if np.linalg.matrix_rank(at.D12[0]) < len(plant.controls):
        raise InputError(f"nothing limits the controls ({controls})", got="an effort that is not weighted",
                         mend="a performance signal for each control")
    if at.C1[:, rows].any() or at.D11[:, rows].any():
        raise InputError("the effort needs a performance signal of its own", got="one that states or disturbances "
                         "reach as well", mend="weight controls and states apart")
    return np.linalg.cholesky(at.D12[0].T @ at.D12[0]).T


def _left_alone(plant: GeneralizedPlant, at: PlantMatrices, points: np.ndarray) -> Synthesis | None:
    """Why nothing can be promised: the plant without control does not settle somewhere."""
    margins = pole_margins(at.A, False)
    worst = int(np.argmax(margins))
    if margins[worst] < 0:
        return None
    where = ", ".join(f"{n} = {v:.4g}" for n, v in zip(plant.box.names, points[worst], strict=True)) or "all of the box"
    return Synthesis("unstabilisable", why=f"at {where} a mode of the plant grows by {margins[worst]:.3g} 1/s where "
                     "none of the control is given", mend="a plant that is stable by itself, or StateFeedback for a "
                     "control that is always given", method=_method(points))


def _program(scaled: PlantMatrices) -> tuple[Program, Affine]:
    """A program with P ≻ 0."""
    program = Program()
    p = program.unknowns.symmetric(scaled.A.shape[1])
    program.require(p, margin=STRICT)
    return program, p


def _bounded(program: Program, p: Affine, scaled: PlantMatrices, level: Affine | np.ndarray) -> None:
    """The bounded-real inequality at every point; `level` is γ², or γ² I."""
    nw, nz = scaled.B1.shape[2], scaled.C1.shape[1]
    for k in range(len(scaled.A)):
        m = scaled.point(k)
        flow, drive = -1.0 * (p @ m.A + (p @ m.A).T), -1.0 * (p @ m.B1)
        size = level if isinstance(level, np.ndarray) else level.times(np.eye(nw))
        program.require(block([[flow, drive, m.C1.T], [drive.T, size, m.D11.T], [m.C1, m.D11, np.eye(nz)]]),
                        margin=STRICT)


def _least(scaled: PlantMatrices, spread: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
    """γ about the least that a constant P proves, and that P, as one solver after the other has it."""
    program, p = _program(scaled)
    level = program.unknowns.scalar()
    _bounded(program, p, scaled, level)
    program.minimise(level + TIE * trace(p, spread))
    for found in program.solve(solvers=INTERIOR_POINT):
        value = float(found[level][0, 0])
        if value > 0:
            yield float(np.sqrt(value)), 0.5 * (found[p] + found[p].T)


def _tightest(scaled: PlantMatrices, gamma: float, spread: np.ndarray) -> Iterator[tuple[np.ndarray, str]]:
    """(P, solver) of the least tr PΣ at a bound."""
    program, p = _program(scaled)
    _bounded(program, p, scaled, gamma**2 * np.eye(scaled.B1.shape[2]))
    program.minimise(trace(p, spread))
    for found in program.solve(solvers=INTERIOR_POINT):
        yield 0.5 * (found[p] + found[p].T), found.solver


def _judged(plant: GeneralizedPlant, p: np.ndarray, gain: np.ndarray, reading: np.ndarray, gamma: float,
            spread: np.ndarray) -> Synthesis | None:
    """The controller with its loop, if the storage function proves the bound for every share; None where not."""
    loop = _loop(plant, gain)
    found = _proof(p, loop, gamma)
    if found is None:
        return None
    better = _sharpened(plant, loop, spread)
    found = better if better is not None and better.gamma < found.gamma else found
    controller = written(plant, (gain @ reading)[None], 0, Polynomial((), 0))
    b1 = plant.at(plant.box.centre[None]).B1[0]
    notes = [f"with every demand met the frozen gain is at most {_frozen(loop, 1.0):.4g}, with none "
             f"{_frozen(loop, 0.0):.4g}"]
    if not plant.at(plant.box.grid(2)).D11.any():
        notes.append(f"the rms of z for white disturbances of unit intensity is at most "
                     f"{np.sqrt(np.trace(b1.T @ p @ b1)):.4g} for every share")
    return Synthesis("solved", gamma=max(gamma, found.gamma), gamma_verified=found.gamma,
                     gamma_lower=largest_frozen_norm(driven(loop), found.box)[0], between_grid=found.between_grid,
                     controller=controller, closed_loop=loop, certificate=found, notes=tuple(notes),
                     method=_method(plant.box.grid(2)),
                     why="the closed loop keeps the bound for every share of the control")


def _proof(p: np.ndarray, loop: LPVStateSpace, gamma: float) -> GainCertificate | None:
    """V̇ + |z|² ≤ γ²|w|² of the loop, checked; None where it does not hold."""
    return own_certificate(lambda at: np.broadcast_to(p / gamma, (len(at), *p.shape)), Polynomial((), 0), loop, gamma,
                           KEPT)


def _sharpened(plant: GeneralizedPlant, loop: LPVStateSpace, spread: np.ndarray) -> GainCertificate | None:
    """The least bound that a constant storage function of the loop itself proves; None for none."""
    points = tensor(design_axes(loop.box, 3, is_affine(loop.basis)))
    a, b, c, d = loop.at(points)
    idle = replace(plant.at(np.repeat(plant.box.centre[None], len(points), axis=0)), A=a, B1=b, C1=c, D11=d)
    units = Units.of(idle)
    whole = units.apply(idle)
    for factor in SHARPER:
        for gamma, p in _least(whole, _normal(spread, units)):
            found = _proof(p / np.outer(units.states, units.states), loop, factor * gamma)
            if found is not None:
                return found
    return None


def _normal(covariance: np.ndarray, units: Units) -> np.ndarray:
    """Σ of the states in balanced units, of trace one, with a floor."""
    spread = covariance / np.outer(units.states, units.states)
    return spread / np.trace(spread) + UNSEEN / len(spread) * np.eye(len(spread))


def _loop(plant: GeneralizedPlant, gain: np.ndarray) -> LPVStateSpace:
    """w → z with s u in place of u, scheduled on the plant's variables and s."""
    s, box = plant.system, plant.box
    at = plant.at(box.centre[None]).point(0)
    places = [k for k, label in enumerate(s.basis.labels) if label == "1"]
    if not places:
        raise InputError("a dissipative feedback needs a constant among the basis functions",
                         got=", ".join(s.basis.labels), mend="a Polynomial basis")
    own = Polynomial((SHARE,), 1)
    a, b1, _, c1, d11, *_ = plant.parted(s.A, s.B, s.C, s.D)
    parts = []
    for matrix, added in ((a, at.B2 @ gain), (b1, None), (c1, at.D12 @ gain), (d11, None)):
        wide = np.zeros((2 * len(matrix), *matrix.shape[1:]))
        wide[::2] = matrix
        if added is not None:
            wide[2 * places[0] + 1] = added
        parts.append(wide)
    scheduling = Scheduling((*box.names, SHARE), (*box.lower, 0.0), (*box.upper, 1.0), (*box.rate, None),
                            (*box.units, ""))
    basis = Product(s.basis, own) if s.basis.names else own
    if not s.basis.names:
        parts = [x[:2] for x in parts]
    a, b, c, d = parts
    return LPVStateSpace(a, b, c, d, basis, None, scheduling, inputs=named(plant, plant.disturbances),
                         outputs=named(plant, plant.performance))


def _frozen(loop: LPVStateSpace, share: float) -> float:
    """Largest gain at frozen scheduling with a given share, over a grid of the rest."""
    points = loop.box.grid({1: 2, 2: 9}.get(len(loop.box.names), 4))
    points[:, -1] = share
    return max(h_infinity_norm(loop.frozen(p))[0] for p in np.unique(points, axis=0))
