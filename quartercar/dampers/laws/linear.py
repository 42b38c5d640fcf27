"""Linear: mass, viscous damper and spring in parallel, the baseline of rigs that are no dampers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from lpvid.errors import InputError
from quartercar.dampers.contract import LinearElements
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.families import LawDamper
from quartercar.dampers.parameter import Parameter

if TYPE_CHECKING:
    from lpvid.export.expression import Expr
    from lpvid.export.step_builder import StepBuilder


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Linear(LawDamper):
    """F = m a + c v + k x + F_0.

    The acceleration is the derivative of the sampled velocity (central differences). Without a displacement in the data
    the spring is left out.

    Attributes
    ----------
    spring : bool
        Whether k x is part of it.
    """

    of_typical_size: ClassVar[bool] = True
    name: ClassVar[str] = "linear"
    title: ClassVar[str] = "Mass, viscous, spring"
    source: ClassVar[str] = "linear baseline"
    spring: bool = True
    start: ClassVar[int] = 0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        spring = (Parameter("stiffness", "N/m", "spring k", 0.0),) if self.spring else ()
        return (Parameter("damping", "N*s/m", "viscous damping c", 1000.0, 0.0), *spring,
                Parameter("mass", "kg", "moved mass m", 0.0, 0.0), Parameter("offset", "N", "constant F_0", 0.0))

    @property
    def reads(self) -> tuple[str, ...]:
        return ("velocity", "displacement") if self.spring else ("velocity",)

    @property
    def linear(self) -> tuple[str, ...]:
        return self.names

    @property
    def linear_elements(self) -> LinearElements:
        return LinearElements(self.values["damping"], self.values["mass"], self.values.get("stiffness", 0.0))

    @classmethod
    def suited(cls, facts: Facts) -> Linear:
        return cls(spring=facts.has_displacement, **facts.common)

    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        damping, *spring, mass, offset = vector.tolist()
        force = damping * drive.velocity
        force += offset
        if spring and spring[0]:
            force += spring[0] * drive.displacement
        if mass:
            force += mass * drive.acceleration
        return force

    def jacobian(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        spring = [drive.displacement] if self.spring else []
        out = np.empty((len(spring) + 3, drive.n_samples))
        for row, column in zip(out, (drive.velocity, *spring, drive.acceleration, 1.0), strict=True):
            row[:] = column
        return out.T

    def sensitivity(self, drive: Drive, vector: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Columns of `jacobian`, which do not depend on the vector.

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
        return self.jacobian(drive, vector)[:, list(columns)]

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        return [self.vector]

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        return self.values.get("stiffness", 0.0) * np.asarray(displacement) + self.values["offset"]

    def static_force(self, velocity: np.ndarray, current: float = 0.0, displacement: float = 0.0) -> np.ndarray:
        return self.values["damping"] * np.asarray(velocity) + self.conservative_force(np.array(displacement))

    def expression(self, b: StepBuilder) -> Callable[[Expr, Expr, Expr], Expr]:
        if self.values["mass"]:
            raise InputError("'linear' with a mass has no exported step",
                             why="its acceleration is a central difference, which looks one sample ahead",
                             mend="set mass to 0 (damper.with_values(mass=0.0)), or export an 'lpv-arx' damper")

        def law(x: Expr, v: Expr, i: Expr) -> Expr:
            total = b.parameter("damping", self.values["damping"], "N*s/m", "viscous damping") * v
            if self.spring:
                total = total + b.parameter("stiffness", self.values["stiffness"], "N/m", "spring") * x
            return total + b.parameter("offset", self.values["offset"], "N", "constant force")

        return law

    def to_lpv(self, sample_time: float):
        raise InputError("no LPV form of 'linear'", why="it is linear and time-invariant, with an improper mass term",
                         mend="none is needed: no memory, no poles; quartercar fit states whether it is passive")
