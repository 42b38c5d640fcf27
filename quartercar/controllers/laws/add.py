"""Acceleration-driven damping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from quartercar.controllers.contract import Controller, Law, Setting, Switching, Values
from quartercar.controllers.laws.damping import HIGH, LOW
from quartercar.dampers.parameter import Parameter


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class AccelerationDriven(Controller):
    """c = c_max while z̈_s v_d > 0, else c_min: best for the body above its resonance, without preview."""

    name: ClassVar[str] = "add"
    title: ClassVar[str] = "ADD"
    source: ClassVar[str] = "Savaresi, Silani, Bittanti 2005; equation sheet 4.8"
    parameters: ClassVar[tuple[Parameter, ...]] = LOW, HIGH
    reads: ClassVar[tuple[str, ...]] = "suspension_velocity", "body_acceleration"
    demands: ClassVar[str] = "force"

    def begin(self, values: Values, setting: Setting) -> Law:
        return Switching(values["low_damping"], values["high_damping"],
                         lambda s: s["body_acceleration"] * s["suspension_velocity"] > 0)
