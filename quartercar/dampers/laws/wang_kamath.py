"""WangKamath: the phase transition model, a nonlinear differential equation from force to velocity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.export.expression import Expr, RealConstant, call
from lpvid.export.step_builder import StepBuilder
from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.families import DynamicDamper
from quartercar.dampers.laws.expressions import named_parameters
from quartercar.dampers.laws.stepping import motion_steps
from quartercar.dampers.parameter import POSITIVE, Parameter
from quartercar.dampers.stepper import DamperStepper, StateStepper

MOST_STARTS = 8
"""starting vectors worth a search; more only cost time."""

COEFFICIENTS = (Parameter("force_inertia", "m*s", "w_1, on the second derivative of the force", 2e-6, POSITIVE,
                          log=True, search=(1e-10, math.inf)),
                Parameter("force_lag", "m", "w_2, on its rate", 1e-3, POSITIVE, log=True, search=(1e-8, math.inf)),
                Parameter("linear_flow", "m/s", "w_3", 0.02),
                Parameter("cubic_flow", "m/s", "w_4", 0.0),
                Parameter("quintic_flow", "m/s", "w_5, bounds the force", 0.1, POSITIVE, log=True,
                          search=(1e-8, math.inf)))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class WangKamath(DynamicDamper):
    """w_1 f̈ + w_2 ḟ + w_3 f + w_4 f³ + w_5 f⁵ = v, f = F/F_s, or with the current f = F/[F_s(1 + g i)].

    Wang, Kamath (2006), Smart Mater. Struct. 15(6), 1725-1733, after Landau's sixth-order free energy; (2.4) of seed
    004, reconstructed. In state form ẋ_1 = x_2, ẋ_2 = (v − w_2 x_2 − P(x_1))/w_1. The current enters in one of two
    ways:

    - `growing`: one law scaled by 1 + g i, so that w_1, w_2, w_3 fall as its inverse, w_4 and w_5 as its inverse third
      and fifth powers. One parameter, and it interpolates between currents.
    - `degree` 1 or 2: every w_j a polynomial in the current, in Bernstein form on [0, `current_scale`], so that
      coefficients above zero keep w_1, w_2 and w_5 above zero in between. `_0`, `_1`, `_2` separate them, the first
      and the last being the values at both ends, which also serve beyond them. Between currents of the fit it can be
      far off: w_4 and w_5 fall by decades over the range, which no such polynomial follows.

    What it can do: yield, post-yield softening or stiffening by one odd polynomial, lag that grows with the rate of the
    force, and, with w_3 < 0 or w_4 < 0, jumps between branches. What it cannot: it reads the velocity alone, so that it
    has no spring, no gas preload and no asymmetry; it has no lag from the current to the force.

    Attributes
    ----------
    growing : bool
        Whether the force grows with the current by one factor.
    degree : {0, 1, 2}
        Of the polynomials in the current.
    force_scale : float
        F_s [N], so that f is of the order of one.
    current_scale : float
        Upper end of the interval of the polynomials, in the unit of the current.
    """

    of_typical_size: ClassVar[bool] = True
    name: ClassVar[str] = "wang-kamath"
    title: ClassVar[str] = "Phase transition (Wang-Kamath)"
    source: ClassVar[str] = "Wang, Kamath 2006; source 004, equation (2.4)"
    growing: bool = False
    degree: int = 0
    force_scale: float = 1000.0
    current_scale: float = 1.0
    states: ClassVar[tuple[str, ...]] = ("f [1]", "df/dt [1/s]")

    def check_settings(self) -> None:
        """Degree 0 to 2, none beside `growing`, scales above zero."""
        if checks.count(self.degree, "degree") > 2:
            raise InputError("degree of the Wang-Kamath coefficients is 0, 1 or 2", got=self.degree)
        if self.growing and self.degree:
            raise InputError("a Wang-Kamath model depends on the current by growth or by polynomials, not by both",
                             got=f"growing with degree {self.degree}", why="two currents cannot separate them")
        checks.positive(self.force_scale, "force_scale", "N")
        checks.positive(self.current_scale, "current_scale")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        if not self.degree:
            unit = "" if self.current_unit == "1" else f"1/{self.current_unit}"
            growth = Parameter("force_growth", unit, "g, of the force with the current", 1.0, 0.0)
            return (*COEFFICIENTS, growth) if self.growing else COEFFICIENTS
        return tuple(replace(p, name=f"{p.name}_{m}", default=p.default * 0.4 ** (m / self.degree))
                     for p in COEFFICIENTS for m in range(self.degree + 1))

    @property
    def reads(self) -> tuple[str, ...]:
        return ("velocity", "current") if self.degree or self.growing else ("velocity",)

    @property
    def linear(self) -> tuple[str, ...]:
        """None: the equation is linear in them, the force is not."""
        return ()

    @classmethod
    def suited(cls, facts: Facts) -> WangKamath:
        share = 0.4 if facts.current_varies else 2.0
        return cls(growing=facts.current_varies, force_scale=float(f"{share * facts.force:.2g}"), **facts.common)

    # -- running -----------------------------------------------------------------------------------------------------
    def basis(self, current: np.ndarray | float) -> np.ndarray:
        """(n, degree + 1) Bernstein polynomials at currents, those outside the interval brought to its ends.

        Parameters
        ----------
        current : array or float
            In the damper's `current_unit`.

        Returns
        -------
        (n, degree + 1) array
            Rows sum to 1; one row for a number.
        """
        u = np.clip(np.atleast_1d(np.asarray(current, dtype=float)) / self.current_scale, 0.0, 1.0)
        d = self.degree
        return np.stack([math.comb(d, m) * u**m * (1 - u) ** (d - m) for m in range(d + 1)], axis=1)

    def coefficients(self, current: np.ndarray | float, vector: np.ndarray) -> np.ndarray:
        """(n, 5) w_1 … w_5 at currents.

        Parameters
        ----------
        current : array or float
            In the damper's `current_unit`.
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        (n, 5) array
            w_1 [m·s], w_2 [m], w_3, w_4, w_5 [m/s].
        """
        return self.basis(current) @ vector[: 5 * (self.degree + 1)].reshape(5, self.degree + 1).T

    def scale(self, current: np.ndarray | float, vector: np.ndarray) -> np.ndarray:
        """(n,) force where f = 1, at currents; those below zero count as none [N].

        Parameters
        ----------
        current : array or float
            In the damper's `current_unit`.
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        (n,) array
            `force_scale` itself without growth [N].
        """
        i = np.maximum(np.atleast_1d(np.asarray(current, dtype=float)), 0.0)
        return self.force_scale * (1.0 + vector[5] * i if self.growing else np.ones(i.size))

    def rest(self, displacement: float, velocity: float, current: float, force: float | None,
             vector: np.ndarray) -> np.ndarray:
        """The measured force, or the one settled from zero, and the rate that the equation gives it without w_1."""
        w = self.coefficients(current, vector)[0]
        if force is None:
            f = _settled(velocity, w.real) + 0.0 * w[0]
            flow, slope = _flow(f, w)
            f = f - (flow - velocity) / slope if abs(slope) > 0 else f
        else:
            f = force / self.scale(current, vector)[0] + 0.0 * w[0]
        return np.array([f, (velocity - _flow(f, w)[0]) / w[1]], dtype=vector.dtype)

    def stepper(self, step: float) -> DamperStepper:
        from quartercar.dampers.laws._wang_kamath_kernels import wang_kamath_move

        return StateStepper(self, wang_kamath_move(self, step))

    def flow(self, b: StepBuilder, x: Expr, v: Expr, i: Expr) -> Expr | None:
        values = list(named_parameters(b, self).values())
        d = self.degree
        u = b.let("share", call("fmin", call("fmax", i / self.current_scale, 0.0), 1.0)) if d else RealConstant(0.0)

        def coefficient(place: int) -> Expr:
            if not d:
                return values[place]
            rest = 1.0 - u
            total: Expr = RealConstant(0.0)
            for m in range(d + 1):
                term: Expr = values[place * (d + 1) + m] * float(math.comb(d, m))
                for factor in (*[u] * m, *[rest] * (d - m)):
                    term = term * factor
                total = total + term
            return total

        w = [b.let("w", coefficient(k)) for k in range(5)]
        f = b.state("scaled_force", "", "force by its scale")
        g = b.state("scaled_rate", "1/s", "its derivative")
        s = b.let("square", f * f)
        b.rate(f, g)
        b.rate(g, (v - w[1] * g - f * (w[2] + s * (w[3] + s * w[4]))) / w[0])
        scale: Expr = b.parameter("force_scale", self.force_scale, "N", "force scale F_s")
        return scale * (1.0 + values[5] * call("fmax", i, 0.0)) * f if self.growing else scale * f

    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        from quartercar.dampers.laws._wang_kamath_kernels import wang_kamath_run

        v, i = drive.velocity, drive.current
        first = None if drive.force is None else float(drive.force[0])
        f, g = self.rest(0.0, float(v[0]), float(i[0]), first, vector)
        theta = np.ascontiguousarray(self.coefficients(i, vector))
        return self.scale(i, vector) * wang_kamath_run(v, drive.sample_time, motion_steps(drive), theta, f, g)

    def rates(self, state: np.ndarray, displacement: float, velocity: float, current: float) -> np.ndarray:
        w = self.coefficients(current, self.vector)[0]
        return np.array([state[1], (velocity - w[1] * state[1] - _flow(state[0], w)[0]) / w[0]])

    def output(self, state: np.ndarray, displacement: float, velocity: float, current: float) -> float:
        return float(self.scale(current, self.vector)[0] * state[0])

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        """None."""
        return np.zeros(np.shape(displacement))

    def static_force(self, velocity: np.ndarray, current: float = 0.0, displacement: float = 0.0) -> np.ndarray:
        """Settled from zero force: the first root of w_3 f + w_4 f³ + w_5 f⁵ = v on the side of v."""
        w = self.coefficients(current, self.vector)[0]
        v = np.asarray(velocity, dtype=float)
        scale = self.scale(current, self.vector)[0]
        return scale * np.array([_settled(float(s), w) for s in v.ravel()]).reshape(v.shape)

    def to_lpv(self, sample_time: float):
        raise InputError("no LPV form of 'wang-kamath'", why="it would be scheduled by its own force",
                         mend="lpvid's own LPV estimates")

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """From the regression of v on F̈, Ḟ, F, F³, F⁵ of the measured force, linear in the coefficients."""
        from quartercar.dampers.fitting.starting import ranked_starts
        from quartercar.dampers.laws.wang_kamath_starts import regression_candidates

        candidates = regression_candidates(self.parameters, self.basis, self.force_scale, drives)
        return ranked_starts(self, drives, candidates, min(count, MOST_STARTS))


def _flow(f, w: np.ndarray) -> tuple:
    """(w_3 f + w_4 f³ + w_5 f⁵, its derivative)."""
    s = f * f
    return f * (w[2] + s * (w[3] + s * w[4])), w[2] + s * (3 * w[3] + 5 * s * w[4])


def _settled(velocity: float, w: np.ndarray) -> float:
    """Scaled force that a constant velocity leads to from zero."""
    if velocity == 0.0:
        return 0.0
    roots = np.roots([w[4], 0.0, w[3], 0.0, w[2], -velocity])
    real = roots.real[np.abs(roots.imag) <= 1e-7 * np.abs(roots) + 1e-300] * math.copysign(1.0, velocity)
    return math.copysign(float(real[real > 0].min()), velocity)
