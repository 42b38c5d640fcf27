"""Relief-valve lag dampers: compressible oil, a main orifice and one spring-loaded poppet in each direction."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.families import DynamicDamper
from quartercar.dampers.parameter import POSITIVE, Parameter

if TYPE_CHECKING:
    from quartercar.dampers.laws.relief_valve_design import ReliefValveDesign
    from quartercar.dampers.stepper import DamperStepper

TOLERANCE = 3e-4
"""relative error of one integration step"""
ABOVE_ZERO = ("piston_area", "precompression", "seat_diameter", "discharge", "discharge_rise", "smoothing",
            "friction_speed")
SEATING, SEAT = 1e-4, 1e-5
"""in `rates` only: a poppet settles on a stop within `SEATING` [s], `SEAT` X_CRIT past it, where round-off cannot make
it chatter; the compiled run stops it at once"""

COMMON = (
    Parameter("hydraulic_stiffness", "N/m", "oil column A_P²/(β_eff 𝒱)", 1.5e7, POSITIVE, log=True,
              search=(1e2, 1e12)),
    Parameter("orifice_loss", "N*s^2/m^2", "main orifice, F = a_O v²: A_P³/K_O²", 4e6, POSITIVE, log=True,
              search=(1e-2, 1e12)),
    Parameter("opening_force", "N", "of the relief valve, A_P P_CRIT", 7000.0, POSITIVE, log=True,
              search=(1e-2, 1e8)),
    Parameter("valve_loss", "N*s^2/m^2", "valve at lift X_CRIT and full discharge", 2400.0, POSITIVE, log=True,
              search=(1e-6, 1e12)),
    Parameter("valve_frequency", "Hz", "poppet on its spring, √(k_V/m_V)/2π", 200.0, POSITIVE, log=True,
              search=(0.5, 1e5)),
    Parameter("valve_damping", "", "damping ratio b_V/(2√(k_V m_V))", 0.8, 1e-3, 1e3, log=True),
    Parameter("friction", "N", "seals F_f", 50.0, 0.0),
    Parameter("preload", "N", "constant force of gas or sensor", 0.0),
)

FRICTION, PRELOAD = (next(k for k, p in enumerate(COMMON) if p.name == name) for name in ("friction", "preload"))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LagDamper(DynamicDamper):
    """Five states [x_V1, ẋ_V1, x_V2, ẋ_V2, Δp] and the force on the piston rod that follows.

        dΔp/dt = (1 + ζ)/(β V_1 ζ) {A_P ẏ − sign(Δp)[|Q_O| + 𝒟|Q_V|]}                               (7), (10)
        m_V ẍ_V = Δp_V G(x_V) − b_V ẋ_V − k_V (x_V + X_CRIT),   x_V ≥ 0                              (8), each valve
        F_D = A_P Δp + F_f tanh(ẏ/v_f) + F_0                                                         (11)

    Force and motion determine no pressures, lifts or masses, only these in the force domain: A_P²/(β𝒱), the losses
    A_P³/K² of each restriction (F = a v²), A_P P_CRIT, and the poppet's frequency and damping ratio. Those are the
    parameters; what turns them into pascals, metres and kilograms are settings, known from the drawing. Of the settings
    only two numbers enter the force, γ X_CRIT and 4 C_D (X_CRIT/d_V) sin 2α, which shape discharge and jet force.

    A closed poppet lets nothing pass, as 𝒟 expresses; the routes are parallel, so that a poppet that still closes
    while the other opens is no exception. The friction enters with the sign that resists. The inertia of the piston,
    below 1 % in the paper, is left out. √ is regularised as Δp/(Δp² + δ²)^{1/4}.

    Titurus, Lieven, *Model validation and experimentally driven hydraulic damper model refinement* (ISMA).

    Attributes
    ----------
    piston_area, precompression, seat_diameter : float
        A_P [m²], X_CRIT [m], d_V [m].
    cone_half_angle : float
        α [rad].
    discharge, discharge_rise : float
        C_D,V0 and γ [1/m] of C_D,V = C_D,V0 γx/(1 + γx).
    lift_stop : float or None
        Largest lift [m]; None where there is none.
    chamber_lengths : (float, float) or None
        V_1/A_P and V_2/A_P at displacement 0 [m], ahead of a piston that extends and behind it: the volumes then follow
        the piston. None for constant volumes, as in the paper.
    smoothing : float
        δ relative to P_CRIT.
    friction_speed : float
        v_f [m/s].
    """

    of_typical_size: ClassVar[bool] = True
    exported_instead: ClassVar[str] = "force-map"
    piston_area: float = 1.5e-3
    precompression: float = 4.5e-3
    seat_diameter: float = 0.01
    cone_half_angle: float = math.radians(15)
    discharge: float = 0.7
    discharge_rise: float = 2000.0
    lift_stop: float | None = None
    chamber_lengths: tuple[float, float] | None = None
    smoothing: float = 1e-3
    friction_speed: float = 1e-3
    linear: ClassVar[tuple[str, ...]] = ()
    states: ClassVar[tuple[str, ...]] = (
        "x_V1 [m]", "x_V1' [m/s]", "x_V2 [m]", "x_V2' [m/s]", "pressure difference [Pa]")

    def check_settings(self) -> None:
        for name in ABOVE_ZERO:
            checks.positive(getattr(self, name), name)
        if not 0 < self.cone_half_angle < math.pi / 2:
            raise InputError("cone_half_angle lies between 0 and π/2", got=f"{self.cone_half_angle:g} rad")
        if self.lift_stop is not None:
            checks.positive(self.lift_stop, "lift_stop", "m")
        if self.chamber_lengths is not None:
            if len(self.chamber_lengths) != 2:
                raise InputError("chamber_lengths are two lengths", got=self.chamber_lengths)
            for length in self.chamber_lengths:
                checks.positive(length, "chamber length", "m")

    # -- what a kind adds --------------------------------------------------------------------------------------------
    @property
    @abstractmethod
    def further(self) -> tuple[Parameter, ...]:
        """Parameters beyond the common ones, at the end of the vector."""

    @abstractmethod
    def series_loss(self, vector: np.ndarray) -> complex:
        """Loss coefficient of the orifices behind a valve; 0 where there are none [N·s²/m²].

        Parameters
        ----------
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        float or complex
            A_P³/(N_O K_O)² [N·s²/m²].
        """

    # -- contract ----------------------------------------------------------------------------------------------------
    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return COMMON + self.further

    @property
    def reads(self) -> tuple[str, ...]:
        return ("velocity",) if self.chamber_lengths is None else ("velocity", "displacement")

    @classmethod
    def suited(cls, facts: Facts) -> Self:
        return cls(friction_speed=facts.turning_speed, **facts.common)

    @classmethod
    def from_design(cls, design: ReliefValveDesign, friction: float = 0.0, preload: float = 0.0) -> Self:
        """The damper of a drawing: geometry, fluid, springs; what this kind has no place for is left out.

        Parameters
        ----------
        design : ReliefValveDesign
        friction, preload : float
            [N].

        Returns
        -------
        LagDamper
            Of the kind that the method is called on.

        Raises
        ------
        InputError
            A design without by-pass holes where the model has them.
        """
        known = {**design.values, "friction": friction, "preload": preload}
        empty = cls()
        missing = [n for n in empty.names if n not in known]
        if missing:
            raise InputError(f"{cls.name} needs the holes behind the valve", got="none in this design",
                             mend="holes=, hole_area=, or the model 'relief-valve'")
        return cls(**design.settings, values={n: known[n] for n in empty.names})

    def stepper(self, step: float) -> DamperStepper:
        from quartercar.dampers.laws._relief_valve_run import ReliefValveStepper

        return ReliefValveStepper(self, step, TOLERANCE)

    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        from quartercar.dampers.laws._relief_valve_run import run, workspace

        self._check_stroke(drive.displacement)
        measured = None if drive.force is None else float(drive.force[0])
        out = np.empty(drive.n_samples, dtype=vector.dtype)
        z, mode, stages, slopes = workspace(vector.dtype)
        z[4] = self._start(float(drive.velocity[0]), measured, vector)
        run(drive.velocity, drive.displacement, drive.sample_time, tuple(self.law(vector)), self.shape, TOLERANCE,
            z, mode, stages, slopes, out)
        return out + self._outside(drive.velocity, vector)

    def sensitivity(self, drive: Drive, vector: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """By the complex step; what acts beside the oil is explicit, but for the hydraulic force that it starts with.

        With F = H(H_0) + c, c = f tanh(v/v_f) + p and H_0 what the measured force leaves, ∂F/∂p = 1 − S and
        ∂F/∂f = tanh(v/v_f) − S tanh(v_0/v_f): S = ∂H/∂H_0 takes one run for both, and none without a measured force.

        Parameters
        ----------
        drive : Drive
        vector : (P,) array
        columns : sequence of int

        Returns
        -------
        (n, len(columns)) array
            [N per unit of the parameter].
        """
        wanted = np.asarray(columns, dtype=int)
        explicit = (wanted == FRICTION) | (wanted == PRELOAD)
        out = np.empty((drive.n_samples, wanted.size))
        out[:, ~explicit] = super().sensitivity(drive, vector, wanted[~explicit].tolist())
        if explicit.any():
            begun: np.ndarray | float = 0.0
            if drive.force is not None:
                begun = 1.0 - super().sensitivity(drive, vector, [PRELOAD])[:, 0]
            sides = {FRICTION: np.tanh(drive.velocity / self.friction_speed), PRELOAD: np.ones(drive.n_samples)}
            for place in np.flatnonzero(explicit):
                side = sides[int(wanted[place])]
                out[:, place] = side - begun * side[0]
        return out

    def rest(self, displacement: float, velocity: float, current: float, force: float | None,
             vector: np.ndarray) -> np.ndarray:
        from quartercar.dampers.laws._relief_valve_kernels import settled_lift

        hydraulic = self._start(velocity, force, vector)
        law = tuple(self.law(vector))
        lifts = [self.precompression * settled_lift(side, law, self.shape) for side in (hydraulic, -hydraulic)]
        return np.array([lifts[0], 0.0 * hydraulic, lifts[1], 0.0 * hydraulic, hydraulic / self.piston_area])

    def rates(self, state: np.ndarray, displacement: float, velocity: float, current: float) -> np.ndarray:
        """(7), (8), (10) as printed, in metres and pascals; a poppet settles on a stop within `SEATING`.

        Parameters
        ----------
        state : (5,) array
            In the order of `states`.
        displacement : float
            Moves the volumes where `chamber_lengths` are given [m].
        velocity : float
            [m/s].
        current : float
            Not read.

        Returns
        -------
        (5,) array
            [unit of the state per second].
        """
        value, area = self.values, self.piston_area
        pressure = state[4]
        opening = value["opening_force"] / area
        root = pressure / (pressure**2 + (self.smoothing * opening) ** 2) ** 0.25
        series = float(np.real(self.series_loss(self.vector)))
        flow = math.sqrt(area**3 / value["orifice_loss"]) * root
        motion = []
        for lift, speed, side in ((state[0], state[1], pressure), (state[2], state[3], -pressure)):
            x = max(lift, 0.0)
            discharge = self.discharge_rise * x / (1 + self.discharge_rise * x)
            full = discharge * x / self.precompression
            share = value["valve_loss"] / (value["valve_loss"] + series * full**2)
            flow += full * math.sqrt(area**3 / value["valve_loss"] * share) * root
            jet = 4 * self.discharge * discharge * x / self.seat_diameter * math.sin(2 * self.cone_half_angle)
            push = max(side, 0.0) * share * self.seat_area * (1 - jet)
            thrust = push - self.poppet_damping * speed - self.spring_rate * (lift + self.precompression)
            seat = self._seat(lift, thrust)
            motion += [speed, thrust / self.poppet_mass if seat is None
                       else -2 * speed / SEATING - (lift - seat) / SEATING**2]
        ahead, behind = self._inverse_lengths
        stiffness = value["hydraulic_stiffness"] / ((1 - ahead * displacement) * (1 + behind * displacement))
        return np.array([*motion, stiffness / area**2 * (area * velocity - flow)])

    def output(self, state: np.ndarray, displacement: float, velocity: float, current: float) -> float:
        return float(self.piston_area * state[4] + self._outside(np.array([velocity]), self.vector)[0])

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        from quartercar.dampers.laws._relief_valve_starts import starting_vectors

        return starting_vectors(self, self.shape, drives, count)

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        return np.full(np.shape(displacement), self.values["preload"])

    def static_force(self, velocity: np.ndarray, current: float = 0.0, displacement: float = 0.0) -> np.ndarray:
        """β = 0: A_P ẏ = [K_O + K_V(x)]√Δp with the lift at which Δp_V G(x) = k_V (x + X_CRIT)."""
        from quartercar.dampers.laws._relief_valve_kernels import settled_forces

        v = np.atleast_1d(np.asarray(velocity, dtype=float)).ravel()
        return settled_forces(v, tuple(self.law(self.vector)), self.shape) + self._outside(v, self.vector)

    def to_lpv(self, sample_time: float):
        raise InputError(f"no LPV form of '{self.name}'", why="the poppets' stops switch its order",
                         mend="identify an LPV model from a simulation")

    # -- the poppet, by the settings -----------------------------------------------------------------------------------
    @property
    def seat_area(self) -> float:
        """A_s = π d_V²/4 [m²]."""
        return 0.25 * math.pi * self.seat_diameter**2

    @property
    def spring_rate(self) -> float:
        """k_V = P_CRIT A_s/X_CRIT [N/m]."""
        return self.values["opening_force"] / self.piston_area * self.seat_area / self.precompression

    @property
    def poppet_mass(self) -> float:
        """m_V [kg]."""
        return self.spring_rate / (2 * math.pi * self.values["valve_frequency"]) ** 2

    @property
    def poppet_damping(self) -> float:
        """b_V [N·s/m]."""
        return 2 * self.values["valve_damping"] * math.sqrt(self.spring_rate * self.poppet_mass)

    # -- for the kernels ---------------------------------------------------------------------------------------------
    @property
    def shape(self) -> tuple[float, ...]:
        """Settings as the kernels read them."""
        jet = 4 * self.discharge * self.precompression / self.seat_diameter * math.sin(2 * self.cone_half_angle)
        stop = math.inf if self.lift_stop is None else self.lift_stop / self.precompression
        return (self.discharge_rise * self.precompression, jet, stop, self.smoothing, *self._inverse_lengths)

    def law(self, vector: np.ndarray) -> np.ndarray:
        """(7,) parameters as the kernels read them.

        Parameters
        ----------
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        (7,) array
            Stiffness [N/m], orifice loss [N·s²/m²], opening force [N], valve loss [N·s²/m²], poppet frequency [rad/s]
            and damping ratio, loss behind the valve [N·s²/m²].
        """
        return np.array([*vector[:4], 2 * math.pi * vector[4], vector[5], self.series_loss(vector)], dtype=vector.dtype)

    @property
    def _inverse_lengths(self) -> tuple[float, float]:
        if self.chamber_lengths is None:
            return 0.0, 0.0
        return 1 / self.chamber_lengths[0], 1 / self.chamber_lengths[1]

    def _seat(self, lift: float, thrust: float) -> float | None:
        """Where a poppet that its seat or lift stop holds settles; None where neither does [m]."""
        if lift <= 0 and thrust <= 0:
            return -SEAT * self.precompression
        if self.lift_stop is not None and lift >= self.lift_stop and thrust >= 0:
            return self.lift_stop + SEAT * self.precompression
        return None

    def _check_stroke(self, displacement: np.ndarray) -> None:
        if self.chamber_lengths is not None and not (
                -self.chamber_lengths[1] < displacement.min() and displacement.max() < self.chamber_lengths[0]):
            raise InputError(f"{self.name}: the motion leaves the chambers",
                             got=f"{displacement.min():g} to {displacement.max():g} m",
                             why=f"chamber_lengths {self.chamber_lengths}", mend="centre=, or longer chambers")

    def _outside(self, velocity: np.ndarray, vector: np.ndarray) -> np.ndarray:
        """What acts beside the oil: friction and preload."""
        return vector[FRICTION] * np.tanh(velocity / self.friction_speed) + vector[PRELOAD]

    def _start(self, velocity: float, force: float | None, vector: np.ndarray) -> complex:
        """Hydraulic force to start with: what the measured force leaves for it, or that of the settled motion."""
        if force is not None:
            return force - self._outside(np.array([velocity]), vector)[0]
        from quartercar.dampers.laws._relief_valve_kernels import settled_force

        return settled_force(velocity, tuple(self.law(vector)), self.shape)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReliefValve(LagDamper):
    """The baseline, (7) and (8): past the poppet the oil is free. Once the valve is open its force grows concave.

    Examples
    --------
    >>> force = ReliefValve().static_force([0.2, 0.4, 0.6])
    >>> bool(force[2] - 2 * force[1] + force[0] < 0)
    True
    """

    name: ClassVar[str] = "relief-valve"
    title: ClassVar[str] = "Relief valve"
    source: ClassVar[str] = "Titurus & Lieven, (7)-(8)"
    further: ClassVar[tuple[Parameter, ...]] = ()

    def series_loss(self, vector: np.ndarray) -> complex:
        return 0.0


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReliefValveOrifice(LagDamper):
    """The extension, (9)-(11): N_O holes behind each poppet; the valve bears Δp K_V⁻²/(K_V⁻² + (N_O K_O)⁻²) only.

    At speed the holes rule, the force is quadratic again, hence convex.

    Examples
    --------
    >>> force = ReliefValveOrifice().static_force([0.2, 0.4, 0.6])
    >>> bool(force[2] - 2 * force[1] + force[0] > 0)
    True
    """

    name: ClassVar[str] = "relief-valve-orifice"
    title: ClassVar[str] = "Relief valve with series orifice"
    source: ClassVar[str] = "Titurus & Lieven, (9)-(11)"
    further: ClassVar[tuple[Parameter, ...]] = (
        Parameter("series_loss", "N*s^2/m^2", "holes behind a valve, A_P³/(N_O K_O)²", 27000.0, POSITIVE, log=True,
              search=(1e-6, 1e12)),)

    def series_loss(self, vector: np.ndarray) -> complex:
        return vector[8]
