"""Mixed skyhook and acceleration-driven damping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from quartercar.controllers.contract import Controller, Law, Setting, Signals, Switching, Values
from quartercar.controllers.laws.damping import HIGH, LOW
from quartercar.dampers.parameter import Parameter


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SkyhookAccelerationDriven(Controller):
    """Skyhook while z̈_s² ≤ α² ż_s², that is for motion slower than α, else acceleration-driven."""

    name: ClassVar[str] = "sh-add"
    title: ClassVar[str] = "SH-ADD"
    source: ClassVar[str] = "Savaresi, Spelta 2007; equation sheet 4.8"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        LOW, HIGH, Parameter("crossover", "rad/s", "alpha", 12.0, 2.0, 60.0, log=True))
    reads: ClassVar[tuple[str, ...]] = "suspension_velocity", "body_velocity", "body_acceleration"
    demands: ClassVar[str] = "force"

    def begin(self, values: Values, setting: Setting) -> Law:
        alpha = values["crossover"]

        def hard(s: Signals) -> np.ndarray:
            slow = s["body_acceleration"] ** 2 <= (alpha * s["body_velocity"]) ** 2
            return np.where(slow, s["body_velocity"], s["body_acceleration"]) * s["suspension_velocity"] > 0

        return Switching(values["low_damping"], values["high_damping"], hard)
