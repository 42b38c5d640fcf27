"""Skyhook and groundhook mixed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from quartercar.controllers.contract import Controller, Law, Memoryless, Setting, Values
from quartercar.controllers.laws.damping import HIGH, LOW, between
from quartercar.dampers.parameter import Parameter


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Hybrid(Controller):
    """F = α c_s ż_s − (1 − α) c_g ż_us, within what dampings from c_min to c_max can do.

    The signs are those of a force that is positive in extension (it pulls the body down and the wheel up); the equation
    sheet prints the force on the body.
    """

    name: ClassVar[str] = "hybrid"
    title: ClassVar[str] = "Hybrid"
    source: ClassVar[str] = "Ahmadian, Pare 2000; equation sheet 4.8"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        LOW, HIGH, Parameter("sky_damping", "N*s/m", "c_s", 2000.0, 100.0, 15000.0, log=True),
        Parameter("ground_damping", "N*s/m", "c_g", 1500.0, 100.0, 15000.0, log=True),
        Parameter("sky_share", "", "alpha", 0.5, 0.0, 1.0))
    reads: ClassVar[tuple[str, ...]] = "suspension_velocity", "body_velocity", "wheel_velocity"
    demands: ClassVar[str] = "force"

    def begin(self, values: Values, setting: Setting) -> Law:
        low, high = values["low_damping"], values["high_damping"]
        sky = values["sky_share"] * values["sky_damping"]
        ground = (1 - values["sky_share"]) * values["ground_damping"]
        return Memoryless(lambda s: between(sky * s["body_velocity"] - ground * s["wheel_velocity"],
                                            s["suspension_velocity"], low, high))
