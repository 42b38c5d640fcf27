"""Kwok's hyperbolic law of an MR damper: a tanh of velocity that is offset by the side of the stroke (source 004)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.families import StaticDamper
from quartercar.dampers.laws.coefficients import Controlled, settled_span
from quartercar.dampers.parameter import Parameter

if TYPE_CHECKING:
    from lpvid.export.expression import Expr
    from lpvid.export.step_builder import StepBuilder

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
    tanh(x/ε). δ does not know the amplitude, so that one δ serves one kind of motion.

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
        sharpness = Parameter("sharpness", "s/m", "slope of the hysteresis β", 60.0, 1e-2, 1e4, log=True)
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
        return cls(degree=int(facts.current_varies), span=span, turning_stroke=0.02 * facts.stroke or 5e-4,
                   **facts.common)

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

    def expression(self, b: StepBuilder) -> Callable[[Expr, Expr, Expr], Expr]:
        from quartercar.dampers.laws.expressions import kwok_expression

        return kwok_expression(b, self)

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

    def to_lpv(self, sample_time: float) -> Any:
        """Quasi-LPV model, scheduled on the current and two secants; see `quartercar.dampers.laws.kwok_lpv`.

        The secants are channels that no record has: run it along ``damper.with_secants(record)``.
        """
        from quartercar.dampers.laws.kwok_lpv import to_lpv

        return to_lpv(self, sample_time)

    def with_secants(self, record: Record) -> Record:
        """The record with the channels that schedule `to_lpv`; see `quartercar.dampers.laws.kwok_lpv`.

        Parameters
        ----------
        record : Record
            With displacement, velocity and, where the law depends on it, current.

        Returns
        -------
        Record
            With two channels more, ``saturation`` and ``turning`` [1].
        """
        from quartercar.dampers.laws.kwok_lpv import with_secants

        return with_secants(self, record)
