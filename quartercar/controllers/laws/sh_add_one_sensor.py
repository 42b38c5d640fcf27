"""Mixed skyhook and acceleration-driven damping from one sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from quartercar.controllers.contract import Controller, Law, Setting, Switching, Values
from quartercar.controllers.laws.damping import HIGH, LOW
from quartercar.dampers.parameter import Parameter


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SkyhookAccelerationDrivenOneSensor(Controller):
    """c = c_max while z̈_s² ≤ α² v_d², else c_min."""

    name: ClassVar[str] = "sh-add-1s"
    title: ClassVar[str] = "SH-ADD, one sensor"
    source: ClassVar[str] = "Savaresi, Spelta 2009; equation sheet 4.8"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        LOW, HIGH, Parameter("crossover", "rad/s", "alpha", 12.0, 2.0, 60.0, log=True))
    reads: ClassVar[tuple[str, ...]] = "suspension_velocity", "body_acceleration"
    demands: ClassVar[str] = "force"

    def begin(self, values: Values, setting: Setting) -> Law:
        alpha = values["crossover"]
        return Switching(values["low_damping"], values["high_damping"],
                         lambda s: s["body_acceleration"] ** 2 <= (alpha * s["suspension_velocity"]) ** 2)
