"""Skyhook of two states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from quartercar.controllers.contract import Controller, Law, Setting, Switching, Values
from quartercar.controllers.laws.damping import HIGH, LOW
from quartercar.dampers.parameter import Parameter


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Skyhook(Controller):
    """c = c_max while ż_s v_d > 0, else c_min: hard while the damper's force opposes the body's motion."""

    name: ClassVar[str] = "skyhook"
    title: ClassVar[str] = "Skyhook, two-state"
    source: ClassVar[str] = "Karnopp, Crosby, Harwood 1974; equation sheet 4.8"
    parameters: ClassVar[tuple[Parameter, ...]] = LOW, HIGH
    reads: ClassVar[tuple[str, ...]] = "suspension_velocity", "body_velocity"
    demands: ClassVar[str] = "force"

    def begin(self, values: Values, setting: Setting) -> Law:
        return Switching(values["low_damping"], values["high_damping"],
                         lambda s: s["body_velocity"] * s["suspension_velocity"] > 0)
