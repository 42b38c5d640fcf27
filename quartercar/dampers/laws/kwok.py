"""Kwok's hyperbolic law of an MR damper: a tanh of velocity that is offset by the side of the stroke (source 004)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np

from lpvid.export.expression import Expr, call
from lpvid.export.step_builder import StepBuilder
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.families import StaticDamper
from quartercar.dampers.laws.coefficients import Controlled, settled_span
from quartercar.dampers.laws.expressions import Law, named_parameters
from quartercar.dampers.laws.secant import secant
from quartercar.dampers.laws.secant_model import secant_model
from quartercar.dampers.parameter import POSITIVE, Parameter

SECANTS = ("saturation", "turning")
"""Channels that schedule the LPV form."""
SLOPES = (0.5, 1.0, 2.0, 5.0, 12.0, 30.0, 80.0)
"""β of the starts, in terms of the root mean square speed."""
SHIFTS = (0.0, 0.2, 0.5, 1.0, 2.0)
"""δ of the starts."""
TYPICAL = {
    "viscous_damping": ("N*s/m", "viscous damping c", (900.0, 1500.0), 0.0),
    "stiffness": ("N/m", "stiffness k", (2000.0, 1000.0), -np.inf),
    "hysteresis_force": ("N", "scale of the hysteresis α", (200.0, 1000.0), 0.0),
    "hysteresis_shift": ("", "half width of the loop δ", (0.4, 0.8), 0.0),
    "offset": ("N", "offset f_0", (0.0, 0.0), -np.inf),
}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Kwok(StaticDamper):
    """F = c v + k x + α tanh(β v + δ sign x) + f_0; c, k, α, δ, f_0 affine in the current where it varies.

    Kwok, Ha, Nguyen, Li, Samali (2006), as (2.5) of source 004. sign x makes the force jump at mid stroke; here it is
    tanh(x/ε). δ does not depend on the amplitude, so that one δ fits one kind of motion.

    Attributes
    ----------
    degree : {0, 1}
        Of all but β in the current.
    span : (float, float) or None
        Currents over which c, α and δ are held positive; left out, those of the fit.
    turning_stroke : float
        ε, the stroke over which the offset turns its sign [m].

    Examples
    --------
    >>> law = Kwok(values={"viscous_damping": 1000.0, "stiffness": 0.0, "hysteresis_force": 500.0, "sharpness": 100.0,
    ...                    "hysteresis_shift": 0.5, "offset": 10.0})
    >>> law.force(np.array([-0.01, 0.01]), -0.005).round(3)       # β v = -δ: the hysteresis is zero on the side x > 0
    array([-375.797,    5.   ])
    """

    of_typical_size: ClassVar[bool] = True
    name: ClassVar[str] = "kwok"
    title: ClassVar[str] = "Kwok"
    source: ClassVar[str] = "source 004, (2.5)"
    degree: int = 0
    span: tuple[float, float] | None = None
    turning_stroke: float = 5e-4

    def check_settings(self) -> None:
        settled_span(self.span, self.current_range)
        checks.one_of(str(self.degree), ("0", "1"), "degree")
        checks.positive(self.turning_stroke, "turning_stroke", "m")

    @property
    def functions(self) -> dict[str, Controlled]:
        """c, k, α, δ, f_0 as functions of the current."""
        span = settled_span(self.span, self.current_range)
        return {name: Controlled(Parameter(name, unit, description, typical[1], lower),
                                 typical if self.degree else typical[1:], span)
                for name, (unit, description, typical, lower) in TYPICAL.items()}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        sharpness = Parameter("sharpness", "s/m", "slope of the hysteresis β", 60.0, POSITIVE, log=True,
                              search=(1e-2, 1e4))
        return (*(p for f in self.functions.values() for p in f.parameters), sharpness)

    @property
    def reads(self) -> tuple[str, ...]:
        return ("velocity", "displacement", "current") if self.degree else ("velocity", "displacement")

    @property
    def linear(self) -> tuple[str, ...]:
        return tuple(n for n in self.names if not n.startswith(("sharpness", "hysteresis_shift")))

    @classmethod
    def suited(cls, facts: Facts) -> Kwok:
        facts.need_displacement(cls.name)
        span = facts.current_range if facts.current_varies else None
        return cls(degree=int(facts.current_varies), span=span,
                   turning_stroke=0.02 * facts.stroke or cls.turning_stroke, **facts.common)

    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        c, k, alpha, delta, offset = self.coefficients(current, vector)
        return c * velocity + k * displacement + alpha * np.tanh(vector[-1] * velocity
                                                                 + delta * self._side(displacement)) + offset

    def tanh_form(self) -> Callable[[np.ndarray], np.ndarray]:
        def by_current(current: np.ndarray) -> np.ndarray:
            vector = self.vector
            c, k, alpha, delta, offset = self.coefficients(current, vector)
            out = np.zeros((current.size, 8))
            for column, values in enumerate((offset, c, k, alpha, np.full(current.size, vector[-1]))):
                out[:, column] = values
            out[:, 6], out[:, 7] = delta, self.turning_stroke
            return out

        return by_current

    def expression(self, b: StepBuilder) -> Law:
        named = named_parameters(b, self)
        width = b.parameter("turning_stroke", self.turning_stroke, "m", "stroke over which the offset turns its sign")
        c, k, alpha, delta, offset = (f.expression(named) for f in self.functions.values())

        def law(x: Expr, v: Expr, i: Expr) -> Expr:
            side = b.let("side", call("tanh", x / width))
            return (c(i) * v + k(i) * x + alpha(i) * call("tanh", named["sharpness"] * v + delta(i) * side)) + offset(i)

        return law

    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        _, _, alpha, delta, _ = self.coefficients(current, vector)
        side = self._side(displacement)
        curve = np.tanh(vector[-1] * velocity + delta * side)
        steep = alpha * (1 - curve**2)
        outer = (velocity, displacement, curve, steep * side, np.ones(velocity.size))
        blocks = [a[:, None] * f.gradient(current, vector[:0])
                  for a, f in zip(outer, self.functions.values(), strict=True)]
        return np.column_stack([*blocks, steep * velocity])

    def _side(self, displacement: np.ndarray) -> np.ndarray:
        return np.tanh(displacement / self.turning_stroke)

    def coefficients(self, current: np.ndarray, vector: np.ndarray) -> list[np.ndarray]:
        """c, k, α, δ, f_0, (n,) each.

        Parameters
        ----------
        current : (n,) array
            In the damper's `current_unit`.
        vector : (P,) array
            Parameters in the order of `names`, SI.

        Returns
        -------
        list of (n,) array
            [N·s/m], [N/m], [N], [1], [N].
        """
        size = self.degree + 1
        return [f.value(current, vector[j * size: (j + 1) * size]) for j, f in enumerate(self.functions.values())]

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """Bounded least squares for everything linear on a grid of β and δ, the best first."""
        from quartercar.dampers.fitting.starting import best_starts

        speed = float(np.sqrt(np.mean(np.concatenate([d.velocity for d in drives]) ** 2))) or 1.0
        shift = self.functions["hysteresis_shift"]
        grid = [{"sharpness": slope / speed, **shift.constant(delta)} for slope, delta in product(SLOPES, SHIFTS)]
        return best_starts(self, drives, grid, count)

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        """F at v = 0 and the current nearest to zero: k x + f_0 and the hysteresis that depends on the side alone."""
        x = np.asarray(displacement, dtype=float)
        nearest = float(np.clip(0.0, *settled_span(self.span, self.current_range)))
        return self.force(x, 0.0, nearest).reshape(x.shape)

    def to_lpv(self, sample_time: float) -> LPVTransferFunction:
        r"""Kwok's law as a static quasi-LPV model with inputs v and x, exact.

        With ρ = tanh(s)/s of s = β v + δ(i) tanh(x/ε), and χ = ρ tanh(x/ε)/(x/ε), both in (0, 1]::

            F = [c(i) + α(i) β ρ] v + [k(i) + α(i) δ(i) χ/ε] x + f_0(i)

        scheduled on the current, ρ (``saturation``) and χ (``turning``), which `with_secants` adds to a record.

        Parameters
        ----------
        sample_time : float
            Period of the model [s].

        Returns
        -------
        LPVTransferFunction
            Without memory; along records as measured: their polarity and zero of the displacement.
            It runs along ``damper.with_secants(record)``: the secants are channels that no record has.
        """
        blocks = dict(zip(self.functions, np.split(self.vector[:-1], len(self.functions)), strict=True))
        powers = {name: f.powers(blocks[name]) for name, f in self.functions.items()}
        quadratic = 2 * self.degree  # α δ is quadratic where both are affine

        def padded(c: np.ndarray) -> np.ndarray:
            return np.pad(c, (0, quadratic + 1 - c.size))

        none = np.zeros(quadratic + 1)
        sharpness, width = float(self.vector[-1]), self.turning_stroke
        alpha, delta = powers["hysteresis_force"], powers["hysteresis_shift"]
        return secant_model(
            self, sample_time, SECANTS, self.current_range or settled_span(self.span, None),
            np.column_stack([padded(powers["viscous_damping"]), padded(sharpness * alpha), none]),
            np.column_stack([padded(powers["stiffness"]), none, padded(np.convolve(alpha, delta) / width)]),
            np.column_stack([padded(powers["offset"]), none, none]))

    def with_secants(self, record: Record) -> Record:
        """The record with the channels ``saturation`` and ``turning`` that schedule the model of `to_lpv`.

        Parameters
        ----------
        record : Record
            With displacement, velocity and, where the law depends on it, current.

        Returns
        -------
        Record
            A copy with both channels [1].
        """
        drive = self.drive(record)
        _, _, _, delta, _ = self.coefficients(drive.current, self.vector)
        side = drive.displacement / self.turning_stroke
        rho = secant(self.vector[-1] * drive.velocity + delta * np.tanh(side))
        note = f"secant of the hysteresis of '{self.name}'"
        return record.with_channel(SECANTS[0], rho, note=note).with_channel(SECANTS[1], rho * secant(side), note=note)
