"""BoucWen: the modified Bouc-Wen model of Spencer and Dyke, in parameters that data can determine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.export.expression import Expr, RealConstant, call, select
from lpvid.export.step_builder import StepBuilder
from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.families import DynamicDamper, complex_slope
from quartercar.dampers.laws.expressions import named_parameters
from quartercar.dampers.laws.stepping import motion_steps
from quartercar.dampers.parameter import POSITIVE, Parameter
from quartercar.dampers.stepper import DamperStepper, StateStepper


@dataclass(frozen=True)
class SpencerParameters:
    """The model as it is printed, in SI: fourteen numbers, of which the data can determine thirteen.

    F = c_1 ẏ + k_1(x − x_0), ẏ = [α z + c_0 ẋ + k_0(x − y)]/(c_0 + c_1), r = ẋ − ẏ,
    ż = −γ|r| z|z|^{n−1} − β r|z|^n + A r, with α, c_0, c_1 affine in w and ẇ = −η(w − V).

    Attributes
    ----------
    c_0a, c_1a : float
        [N·s/m].
    alpha_a : float
        [N/m].
    c_0b, c_1b, alpha_b : float
        The same per unit of current or voltage.
    k_0, k_1, x_0 : float
        [N/m], [N/m], [m].
    beta, gamma : float
        [m⁻ⁿ].
    A, n : float
    eta : float
        [1/s]; 0 where the current acts at once.
    """

    c_0a: float
    c_1a: float
    alpha_a: float
    k_0: float
    k_1: float
    x_0: float
    beta: float
    gamma: float
    A: float
    n: float = 2.0
    c_0b: float = 0.0
    c_1b: float = 0.0
    alpha_b: float = 0.0
    eta: float = 0.0

    @property
    def scheduled(self) -> bool:
        """Whether anything depends on the current."""
        return any((self.c_0b, self.c_1b, self.alpha_b))


LORD = SpencerParameters(c_0a=2100.0, c_0b=350.0, k_0=4690.0, c_1a=28300.0, c_1b=295.0, k_1=500.0, x_0=0.143,
                         alpha_a=14000.0, alpha_b=69500.0, gamma=363e4, beta=363e4, A=301.0, n=2.0, eta=190.0)
"""Prototype MR damper of Lord at 0 to 2.25 V: Dyke, Spencer, Sain, Carlson (1996), Smart Mater. Struct. 5, 565-575."""


MOST_STARTS = 8
"""starting vectors worth a search; more only cost time."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class BoucWen(DynamicDamper):
    """Modified Bouc-Wen model: a hysteretic yield force, a dashpot and a spring, behind a series dashpot, with gas.

    ::

        ── c_1 ──┬── F_y z ──┬──        F = c_1 ẏ + k_1 x + F_g
                 ├── c_0 ────┤          ẏ = [F_y z + c_0 ẋ + k_0(x − y)]/(c_0 + c_1),  r = ẋ − ẏ
                 └── k_0 ────┘          ż = [r − (1−b)|r| z|z|^{n−1} − b r|z|^n]/x_y
        ── k_1, gas ───────────

    Spencer, Dyke, Sain, Carlson (1997), J. Eng. Mech. 123, 230-238; equation (2.2) of source 004. In the printed form z
    may be scaled at will; here it saturates at ±1, F_y is then a force and x_y the slip in which it builds up. With the
    current, F_y, c_0 and c_1 grow in proportion to w, ẇ = −η(w − i); currents below zero count as none.

    Attributes
    ----------
    scheduled : bool
        Whether F_y, c_0 and c_1 depend on the current.
    springs : bool
        Whether k_0 and k_1 are part of it; they need the displacement.
    exponent : float
        n; the value used where it is not fitted, else the default.
    free_exponent : bool
        Whether n is a parameter.
    """

    of_typical_size: ClassVar[bool] = True
    forward: ClassVar[bool] = True
    name: ClassVar[str] = "bouc-wen"
    title: ClassVar[str] = "Modified Bouc-Wen"
    source: ClassVar[str] = "Spencer et al. 1997; source 004, equation (2.2)"
    scheduled: bool = True
    springs: bool = True
    exponent: float = 2.0
    free_exponent: bool = False

    def check_settings(self) -> None:
        """The exponent is at least one."""
        if checks.real(self.exponent, "exponent") < 1.0:
            raise InputError("the exponent of a Bouc-Wen model is at least 1", got=self.exponent)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = self.current_unit
        per = "" if unit == "1" else f"/{unit}"
        out = [Parameter("viscous_damping", "N*s/m", "c_0, beside the hysteresis", 2100.0, POSITIVE, log=True,
                         search=(1e-3, math.inf)),
               Parameter("series_damping", "N*s/m", "c_1, in series with it", 28300.0, POSITIVE, log=True,
                         search=(1.0, math.inf)),
               Parameter("yield_force", "N", "F_y = alpha z_max", 200.0, POSITIVE, log=True, search=(1e-3, math.inf)),
               Parameter("yield_displacement", "m", "x_y = z_max/A, slip that builds up F_y", 2e-4, POSITIVE,
                         log=True, search=(1e-7, 1.0)),
               Parameter("hysteresis_shape", "", "b = beta/(beta + gamma); dissipative up to 0.5", 0.5, -20.0, 1.0)]
        if self.scheduled:
            out += [Parameter("viscous_damping_per_current", f"N*s/m{per}", "c_0b", 350.0, 0.0),
                    Parameter("series_damping_per_current", f"N*s/m{per}", "c_1b", 295.0, 0.0),
                    Parameter("yield_force_per_current", f"N{per}", "alpha_b z_max", 450.0, 0.0),
                    Parameter("current_rate", "1/s", "eta of the lag from the current", 190.0, POSITIVE, log=True,
                              search=(1.0, 1e5))]
        if self.springs:
            out += [Parameter("parallel_stiffness", "N/m", "k_0, beside the hysteresis", 4690.0, 0.0),
                    Parameter("gas_stiffness", "N/m", "k_1", 500.0, 0.0)]
        out.append(Parameter("gas_force", "N", "F_g = -k_1 x_0, at zero displacement", 0.0))
        if self.free_exponent:
            out.append(Parameter("exponent", "", "n", self.exponent, 1.0, 20.0))
        return tuple(out)

    @property
    def reads(self) -> tuple[str, ...]:
        return ("velocity", *(("displacement",) if self.springs else ()), *(("current",) if self.scheduled else ()))

    @property
    def linear(self) -> tuple[str, ...]:
        """None: the gas force enters the initial state, too, where that is taken from the measured force."""
        return ()

    @property
    def states(self) -> tuple[str, ...]:
        return ("y [m]", "z [1]", f"w [{self.current_unit}]") if self.scheduled else ("y [m]", "z [1]")

    @classmethod
    def suited(cls, facts: Facts) -> BoucWen:
        return cls(scheduled=facts.current_varies, springs=facts.has_displacement, **facts.common)

    def all_free(self) -> BoucWen:
        """With the exponent n among the parameters: of 2 held, friction is sought for what n = 1 would do."""
        return self.replace(free_exponent=True)

    # -- running -----------------------------------------------------------------------------------------------------
    def coefficients(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((12,) coefficients as `_bouc_wen_kernels.spencer_run` takes them, (2,) gas stiffness and force).

        Parameters
        ----------
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        theta : (12,) array
            c_0, its share per current, k_0, c_1, its share per current, F_y, its share per current, β, γ, δ, n, η, of a
            z that saturates at 1.
        springs : (2,) array
            k_1 [N/m] and F_g [N].
        """
        p = dict(zip(self.names, vector, strict=True))
        rate, b = 1.0 / p["yield_displacement"], p["hysteresis_shape"]
        theta = [p["viscous_damping"], p.get("viscous_damping_per_current", 0.0), p.get("parallel_stiffness", 0.0),
                 p["series_damping"], p.get("series_damping_per_current", 0.0),
                 p["yield_force"], p.get("yield_force_per_current", 0.0),
                 b * rate, (1.0 - b) * rate, rate, p.get("exponent", self.exponent), p.get("current_rate", 0.0)]
        return np.array(theta, dtype=vector.dtype), np.array([p.get("gas_stiffness", 0.0), p["gas_force"]])

    def rest(self, displacement: float, velocity: float, current: float, force: float | None,
             vector: np.ndarray) -> np.ndarray:
        """Spring k_0 relaxed, current settled, and z that gives the measured force as far as the yield force allows."""
        theta, (stiffness, gas) = self.coefficients(vector)
        current = max(current, 0.0)
        c0, c1, yielding = _at(theta, current)
        z = 0.0 * yielding
        if force is not None:
            z = ((force - stiffness * displacement - gas) * (c0 + c1) / c1 - c0 * velocity) / yielding
            if abs(z.real) > 1.0:
                z = np.sign(z.real) + 0.0 * z
        start = [displacement, z, current] if self.scheduled else [displacement, z]
        return np.array(start, dtype=vector.dtype)

    def stepper(self, step: float) -> DamperStepper:
        from quartercar.dampers.laws._bouc_wen_kernels import bouc_wen_move

        return StateStepper(self, bouc_wen_move(self, step))

    def flow(self, b: StepBuilder, x: Expr, v: Expr, i: Expr) -> Expr | None:
        values = named_parameters(b, self)
        zero = RealConstant(0.0)
        y, z = b.state("node", "m", "internal node y"), b.state("hysteresis", "", "hysteretic state z, saturated at 1")
        felt = None
        if self.scheduled:
            felt = b.state("current_felt", self.current_unit, "current behind the lag")

        def at(name: str) -> Expr:
            return values[name] if felt is None else values[name] + values[f"{name}_per_current"] * felt

        c0, c1 = b.let("c0", at("viscous_damping")), b.let("c1", at("series_damping"))
        spring = values["parallel_stiffness"] * (x - y) if self.springs else zero
        rise = b.let("rise", (at("yield_force") * z + c0 * v + spring) / (c0 + c1))
        slip = b.let("slip", v - rise)
        exponent = values.get("exponent", RealConstant(self.exponent))
        size = b.let("size", call("pow", call("fabs", z), exponent))
        sign = select(z > 0.0, 1.0, select(z < 0.0, -1.0, 0.0))
        shape = values["hysteresis_shape"]
        bend = (1.0 - shape) * call("fabs", slip) * sign + shape * slip
        b.rate(y, rise)
        b.rate(z, (slip - bend * size) / values["yield_displacement"])
        if felt is not None:
            b.rate(felt, values["current_rate"] * (call("fmax", i, 0.0) - felt))
        force = c1 * rise + values["gas_force"]
        return force + values["gas_stiffness"] * x if self.springs else force

    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        from quartercar.dampers.laws._bouc_wen_kernels import spencer_run

        theta, (stiffness, gas) = self.coefficients(vector)
        force = spencer_run(drive.displacement, drive.velocity, self.command(drive), drive.sample_time,
                            motion_steps(drive), theta, self.initial_state(drive, vector))
        return force + stiffness * drive.displacement + gas

    def sensitivity(self, drive: Drive, vector: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Tangents carried along the run in its coefficients and first state, then the chain rule.

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
        from quartercar.dampers.laws._bouc_wen_tangents import spencer_tangents

        theta, _ = self.coefficients(vector)
        along = spencer_tangents(drive.displacement, drive.velocity, self.command(drive), drive.sample_time,
                                 motion_steps(drive), theta, self.initial_state(drive, vector))

        def inner(moved: np.ndarray) -> np.ndarray:
            shifted, springs = self.coefficients(moved)
            return np.concatenate([shifted, self.initial_state(drive, moved), springs])

        chain = np.empty((along.shape[0] + 2, len(columns)))
        for place, j in enumerate(columns):
            chain[:, place] = complex_slope(inner, vector, j)
        return along.T @ chain[:-2] + np.column_stack([drive.displacement, np.ones(drive.n_samples)]) @ chain[-2:]

    def command(self, drive: Drive) -> np.ndarray:
        """(n,) current that counts [A]; none where it is not read.

        Parameters
        ----------
        drive : Drive

        Returns
        -------
        (n,) array
        """
        return np.maximum(drive.current, 0.0) if self.scheduled else np.zeros(drive.n_samples)

    def initial_state(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        """(3,) y [m], z and lagged current [A] at the first sample.

        Parameters
        ----------
        drive : Drive
        vector : (P,) array

        Returns
        -------
        (3,) array
        """
        first = None if drive.force is None else float(drive.force[0])
        state = self.rest(float(drive.displacement[0]), float(drive.velocity[0]), float(self.command(drive)[0]), first,
                          vector)
        return state if self.scheduled else np.append(state, 0.0)

    def rates(self, state: np.ndarray, displacement: float, velocity: float, current: float) -> np.ndarray:
        theta, _ = self.coefficients(self.vector)
        y, z, w = state if self.scheduled else (*state, 0.0)
        c0, c1, yielding = _at(theta, w)
        rise = (yielding * z + c0 * velocity + theta[2] * (displacement - y)) / (c0 + c1)
        slip = velocity - rise
        size = abs(z) ** theta[10]
        turn = theta[9] * slip - (theta[8] * abs(slip) * np.sign(z) + theta[7] * slip) * size
        return np.array([rise, turn, theta[11] * (max(current, 0.0) - w)][: len(state)])

    def output(self, state: np.ndarray, displacement: float, velocity: float, current: float) -> float:
        theta, (stiffness, gas) = self.coefficients(self.vector)
        y, z, w = state if self.scheduled else (*state, 0.0)
        c0, c1, yielding = _at(theta, w)
        rise = (yielding * z + c0 * velocity + theta[2] * (displacement - y)) / (c0 + c1)
        return float(c1 * rise + stiffness * displacement + gas)

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        return self.values.get("gas_stiffness", 0.0) * np.asarray(displacement, dtype=float) + self.values["gas_force"]

    def static_force(self, velocity: np.ndarray, current: float = 0.0, displacement: float = 0.0) -> np.ndarray:
        """Steady slip: z settled, the spring k_0 not yet wound up (its time constant (c_0 + c_1)/k_0 is seconds).

        F = c_1 v up to the yield force, beyond it c_1/(c_0 + c_1)·(c_0 v + F_y sign v).
        """
        theta, _ = self.coefficients(self.vector)
        c0, c1, yielding = _at(theta, max(current, 0.0))
        v = np.asarray(velocity, dtype=float)
        z = np.clip(c1 * v / yielding, -1.0, 1.0)
        return c1 / (c0 + c1) * (c0 * v + yielding * z) + self.conservative_force(np.array(displacement))

    def to_lpv(self, sample_time: float):
        raise InputError("no LPV form of 'bouc-wen'", why="its scheduling variable would be its hysteretic state, "
                         "which is not measured",
                         mend="the compliance model of `quartercar.dampers`, or lpvid's own LPV estimates")

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """From the shape of the loop: plateau and slope at high speed, and a grid over what makes the hysteresis."""
        from quartercar.dampers.fitting.starting import ranked_starts
        from quartercar.dampers.laws.bouc_wen_starts import loop_candidates

        candidates = loop_candidates(self.parameters, self.exponent, drives)
        return ranked_starts(self, drives, candidates, min(count, MOST_STARTS))

    # -- the printed form --------------------------------------------------------------------------------------------
    @classmethod
    def from_published(cls, printed: SpencerParameters, current_unit: str = "V",
                       current_range: tuple[float, float] | None = None) -> BoucWen:
        """The model of a printed set of parameters in SI.

        Parameters
        ----------
        printed : SpencerParameters
            In SI.
        current_unit : str
            Unit of what schedules the printed set: ``"V"``, ``"A"`` or ``"1"``.
        current_range : (float, float), optional
            Currents for which it was found.

        Returns
        -------
        BoucWen
            A printed η of 0, current at once, becomes a rate of 1e5 1/s; without dependence on the current there is
            none.

        Raises
        ------
        InputError
            A ≤ 0 or β + γ ≤ 0: z does not saturate.

        Examples
        --------
        >>> from quartercar.dampers.laws.bouc_wen import LORD
        >>> lord = BoucWen.from_published(LORD, current_range=(0.0, 2.25))
        >>> round(lord.values["yield_force"], 2), round(1e6 * lord.values["yield_displacement"], 2)
        (90.15, 21.39)
        >>> round(lord.published(301.0).beta)
        3630000
        """
        if not (printed.beta + printed.gamma > 0 and printed.A > 0):
            raise InputError("a printed Bouc-Wen set needs A > 0 and beta + gamma > 0",
                             got=f"A={printed.A:g}, beta={printed.beta:g}, gamma={printed.gamma:g}")
        top = (printed.A / (printed.beta + printed.gamma)) ** (1 / printed.n)
        values = {"viscous_damping": printed.c_0a, "series_damping": printed.c_1a, "yield_force": printed.alpha_a * top,
                  "yield_displacement": top / printed.A, "parallel_stiffness": printed.k_0,
                  "hysteresis_shape": printed.beta / (printed.beta + printed.gamma), "gas_stiffness": printed.k_1,
                  "gas_force": -printed.k_1 * printed.x_0}
        if printed.scheduled:
            values |= {"viscous_damping_per_current": printed.c_0b, "series_damping_per_current": printed.c_1b,
                       "yield_force_per_current": printed.alpha_b * top, "current_rate": printed.eta or 1e5}
        return cls(values=values, scheduled=printed.scheduled, exponent=printed.n, current_unit=current_unit,
                   current_range=current_range)

    def published(self, A: float = 1.0) -> SpencerParameters:
        """The printed form for a chosen A, the number that the data cannot determine (z in metres).

        Parameters
        ----------
        A : float
            The printed A, dimensionless.

        Returns
        -------
        SpencerParameters
            In SI.

        Raises
        ------
        InputError
            A gas force without a gas spring, which the printed form cannot hold.
        """
        theta, (stiffness, gas) = self.coefficients(self.vector)
        c0a, c0b, k0, c1a, c1b, ya, yb, beta, gamma, delta, n, eta = map(float, theta)
        top = A / delta
        scale = A / (delta * top**n)
        if stiffness == 0.0 and gas != 0.0:
            raise InputError("the printed form has no gas force without a gas spring", got=f"gas_force {gas:g} N")
        length = -float(gas / stiffness) if stiffness else 0.0
        return SpencerParameters(c0a, c1a, ya / top, k0, float(stiffness), length, scale * beta, scale * gamma, A, n,
                                 c0b, c1b, yb / top, eta)


def _at(theta: np.ndarray, current) -> tuple:
    """c_0, c_1 and yield force at a lagged current."""
    return theta[0] + theta[1] * current, theta[3] + theta[4] * current, theta[5] + theta[6] * current
