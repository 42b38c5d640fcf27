"""Power-law dampers: a linear and a power term per direction, with and without friction and gas (source 000)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from lpvid.export.expression import Expr, call, select
from lpvid.export.step_builder import StepBuilder
from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.families import StaticDamper
from quartercar.dampers.laws.expressions import Law, named_parameters
from quartercar.dampers.parameter import Parameter

DIRECTIONS = ("extension", "compression")
PER_METRE = {"SI": 1.0, "mm": 1000.0}
"""Lengths per metre in which a power law may be printed."""
DAMPING = ("damping_extension", "power_force_extension", "exponent_extension",
           "damping_compression", "power_force_compression", "exponent_compression")
TINY = 1e-300


class PrintedTerm(NamedTuple):
    """One direction of C_1 v + C_n |v|^n sign v as a paper prints it.

    Attributes
    ----------
    linear : float
        C_1 [N·s/m] or [N/(mm/s)].
    power : float
        C_n [N/(m/s)^n] or [N/(mm/s)^n].
    exponent : float
        n.
    """

    linear: float
    power: float
    exponent: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PowerLawDamper(StaticDamper):
    """What the power-law dampers share: F_d = C_1 v + C_n |v|^n sign v in each direction.

    C_n carries the unit N/(m/s)^n, which changes with n, so that the two are all but the same parameter: with one digit
    of C_n the force of the seed is known to ±25 %. Here the power term is its force at a reference speed::

        C_n |v|^n = P (|v|/v_ref)^n        P = C_n v_ref^n  [N]

    `printed` and `from_printed` translate from and to a paper's constants.

    Attributes
    ----------
    reference_speed : float
        v_ref [m/s].
    """

    of_typical_size: ClassVar[bool] = True
    reference_speed: float = 0.5

    @property
    @abstractmethod
    def statics(self) -> tuple[Parameter, ...]:
        """Parameters of the forces that do not depend on how fast it moves; all enter linearly."""

    @abstractmethod
    def _static_columns(self, displacement: np.ndarray, velocity: np.ndarray) -> list[np.ndarray]:
        """Force per unit of each of `statics`."""

    @abstractmethod
    def with_statics(self, damping: Expr, x: Expr, v: Expr, weights: Sequence[Expr]) -> Expr:
        """The damping force as an expression, with the forces of `static_columns` beside it.

        Parameters
        ----------
        damping : Expr
        x, v : Expr
            Displacement from the centre, velocity.
        weights : sequence of Expr
            Of `statics`.

        Returns
        -------
        Expr
        """

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        typical = {"extension": (1000.0, 1000.0, 2.2), "compression": (600.0, 200.0, 1.8)}
        rows = []
        for side, (linear, power, exponent) in typical.items():
            rows += [Parameter(f"damping_{side}", "N*s/m", f"linear damping C_1, {side}", linear, 0.0),
                     Parameter(f"power_force_{side}", "N", f"power term at v_ref, C_n v_ref^n, {side}", power, 0.0),
                     Parameter(f"exponent_{side}", "", f"exponent n, {side}", exponent, 1.0, 3.0)]
        return (*rows, *self.statics)

    @property
    def linear(self) -> tuple[str, ...]:
        return tuple(n for n in self.names if not n.startswith("exponent"))

    def expression(self, b: StepBuilder) -> Law:
        named = named_parameters(b, self)
        theta = [named[n] for n in self.names]
        reference = b.parameter("reference_speed", self.reference_speed, "m/s",
                                "speed at which the power force is given")

        def law(x: Expr, v: Expr, i: Expr) -> Expr:
            rising, speed = v > 0.0, b.let("speed", call("fabs", v))
            linear, power, exponent = (b.let("side", select(rising, a, c)) for a, c in
                                       zip(theta[:3], theta[3:6], strict=True))
            sign = select(rising, 1.0, select(v < 0.0, -1.0, 0.0))
            damping = sign * (linear * speed + power * call("pow", speed / reference, exponent))
            return self.with_statics(damping, x, v, theta[6:])

        return law

    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        rising, speed = velocity > 0, np.abs(velocity)
        linear, power, exponent = (np.where(rising, a, b) for a, b in zip(vector[:3], vector[3:6], strict=True))
        force = np.sign(velocity) * (linear * speed + power * (speed / self.reference_speed) ** exponent)
        for weight, column in zip(vector[6:], self._static_columns(displacement, velocity), strict=True):
            force += weight * column
        return force

    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        out = self._columns(displacement, velocity, vector)
        log_speed = np.log(np.maximum(np.abs(velocity) / self.reference_speed, TINY))
        for k in (0, 3):
            out[:, k + 2] = vector[k + 1] * out[:, k + 1] * log_speed
        return out

    def _columns(self, displacement: np.ndarray, velocity: np.ndarray, vector: np.ndarray) -> np.ndarray:
        """(n, P) force per unit of each parameter; zeros for the exponents."""
        columns = []
        for sign, exponent in ((1.0, vector[2]), (-1.0, vector[5])):
            moving = np.maximum(sign * velocity, 0.0)
            columns += [sign * moving, sign * (moving / self.reference_speed) ** exponent, np.zeros(velocity.size)]
        return np.column_stack([*columns, *self._static_columns(displacement, velocity)])

    @staticmethod
    def _coefficients(vector: np.ndarray) -> np.ndarray:
        coefficients = vector.copy()
        coefficients[[2, 5]] = 0.0
        return coefficients

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """Bounded least squares for everything linear on a grid of exponents, the best first."""
        from quartercar.dampers.fitting.starting import best_starts

        grid = [(a, b) for a in (1.2, 1.6, 2.0, 2.5, 2.9) for b in (1.2, 1.6, 2.0, 2.5, 2.9)]
        names = ("exponent_extension", "exponent_compression")
        return best_starts(self, drives, [dict(zip(names, point, strict=True)) for point in grid], count)

    def printed(self, unit: str = "SI") -> dict[str, PrintedTerm]:
        """C_1, C_n and n per direction as a paper prints them.

        Parameters
        ----------
        unit : {"SI", "mm"}
            N and m/s, or N and mm/s.

        Returns
        -------
        dict of str to PrintedTerm
            By ``"extension"`` and ``"compression"``.

        Examples
        --------
        >>> from quartercar.dampers.bench.sine_work import SWIFT_2012
        >>> round(SWIFT_2012.printed("SI")["extension"].power)
        6294
        >>> round(SWIFT_2012.printed("mm")["extension"].power, 6)
        0.0002
        """
        scale = PER_METRE[checks.one_of(unit, tuple(PER_METRE), "unit")]
        out = {}
        for side in DIRECTIONS:
            n = self.values[f"exponent_{side}"]
            out[side] = PrintedTerm(self.values[f"damping_{side}"] / scale,
                                    self.values[f"power_force_{side}"] / (self.reference_speed * scale) ** n, n)
        return out

    @classmethod
    def from_printed(cls, extension: tuple[float, float, float], compression: tuple[float, float, float],
                     unit: str = "SI", reference_speed: float = 0.5, **values: float) -> Self:
        """From C_1, C_n, n per direction.

        Parameters
        ----------
        extension, compression : (C_1, C_n, n)
            In N and `unit`.
        unit : {"SI", "mm"}
            N and m/s, or N and mm/s.
        reference_speed : float
            v_ref [m/s].
        **values : float
            The other parameters, SI.

        Returns
        -------
        PowerLawDamper
            Of the kind that the method is called on.
        """
        scale = PER_METRE[checks.one_of(unit, tuple(PER_METRE), "unit")]
        terms: dict[str, float] = dict(values)
        for side, (linear, power, n) in zip(DIRECTIONS, (extension, compression), strict=True):
            terms |= {f"damping_{side}": linear * scale, f"exponent_{side}": n,
                      f"power_force_{side}": power * (reference_speed * scale) ** n}
        return cls(values=terms, reference_speed=reference_speed)

    def damping_force(self, velocity: np.ndarray | float) -> np.ndarray:
        """F_d alone, without friction and gas [N].

        Parameters
        ----------
        velocity : array or float
            [m/s].

        Returns
        -------
        (n,) array
            One entry for a number [N].
        """
        v = np.atleast_1d(np.asarray(velocity, dtype=float))
        return self._columns(np.zeros(v.size), v, self.vector)[:, :6] @ self._coefficients(self.vector)[:6]

    def to_lpv(self, sample_time: float) -> Any:
        raise self.without_lpv_form()


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PowerLaw(PowerLawDamper):
    """F = C_1 v + C_n |v|^n sign v, with its own C_1, C_n, n in extension and in compression.

    Source 000, (4). It has no friction, no gas force and no offset.

    Examples
    --------
    >>> law = PowerLaw.from_printed((1.1602, 0.0002, 2.4993), (0.61, 0.0, 1.0), unit="mm")
    >>> law.force(0.0, np.array([-0.7, 0.7])).round(0)
    array([-427., 3393.])
    """

    name: ClassVar[str] = "power-law"
    title: ClassVar[str] = "Power law"
    source: ClassVar[str] = "source 000, (4)"
    statics: ClassVar[tuple[Parameter, ...]] = ()
    reads: ClassVar[tuple[str, ...]] = ("velocity",)

    def check_settings(self) -> None:
        checks.positive(self.reference_speed, "reference_speed", "m/s")

    @classmethod
    def suited(cls, facts: Facts) -> PowerLaw:
        return cls(reference_speed=_reference(facts), **facts.common)

    def _static_columns(self, displacement: np.ndarray, velocity: np.ndarray) -> list[np.ndarray]:
        return []

    def with_statics(self, damping: Expr, x: Expr, v: Expr, weights: Sequence[Expr]) -> Expr:
        return damping

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        return np.zeros(np.shape(displacement))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PowerLawFrictionGas(PowerLawDamper):
    """F = C_1 v + C_n |v|^n sign v + F_c tanh(v/ε) − F_gst + K_gas x, the damping terms per direction.

    Source 000, (3)-(6), in the project's signs: the gas pushes the rod out, a negative force.

    Attributes
    ----------
    friction_speed : float
        ε, the speed over which friction turns its sign [m/s].
    spring : bool
        Whether K_gas x is part of it; left out where the data have no displacement.

    Examples
    --------
    >>> from quartercar.dampers.bench.sine_work import SWIFT_2012
    >>> SWIFT_2012.force(0.0, np.array([-0.6, 0.6])).round(1)
    array([-591. , 2320.9])
    """

    name: ClassVar[str] = "power-law-friction-gas"
    title: ClassVar[str] = "Power law, friction, gas"
    source: ClassVar[str] = "source 000, (3)-(6)"
    friction_speed: float = 2e-3
    spring: bool = True

    def check_settings(self) -> None:
        checks.positive(self.reference_speed, "reference_speed", "m/s")
        checks.positive(self.friction_speed, "friction_speed", "m/s")

    @property
    def statics(self) -> tuple[Parameter, ...]:
        spring = (Parameter("gas_stiffness", "N/m", "gas stiffness K_gas", 500.0, 0.0),) if self.spring else ()
        return (Parameter("friction", "N", "Coulomb friction F_c", 50.0, 0.0),
                Parameter("gas_preload", "N", "gas force at mid stroke F_gst, outwards", 180.0), *spring)

    @property
    def reads(self) -> tuple[str, ...]:
        return ("velocity", "displacement") if self.spring else ("velocity",)

    @classmethod
    def suited(cls, facts: Facts) -> PowerLawFrictionGas:
        return cls(reference_speed=_reference(facts), friction_speed=facts.turning_speed, spring=facts.has_displacement,
                   **facts.common)

    def _static_columns(self, displacement: np.ndarray, velocity: np.ndarray) -> list[np.ndarray]:
        spring = [displacement] if self.spring else []
        return [np.tanh(velocity / self.friction_speed), -np.ones(velocity.size), *spring]

    def with_statics(self, damping: Expr, x: Expr, v: Expr, weights: Sequence[Expr]) -> Expr:
        total = damping + weights[0] * call("tanh", v / self.friction_speed) - weights[1]
        return total + weights[2] * x if self.spring else total

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        return self.values.get("gas_stiffness", 0.0) * np.asarray(displacement) - self.values["gas_preload"]


def _reference(facts: Facts) -> float:
    """v_ref of data, to four digits [m/s]."""
    return float(f"{0.7 * facts.speed:.4g}") or 0.5
