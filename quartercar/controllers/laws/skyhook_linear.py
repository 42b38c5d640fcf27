"""Skyhook of continuous damping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from quartercar.controllers.contract import Controller, Law, Memoryless, Setting, Values
from quartercar.controllers.laws.damping import HIGH, LOW, between
from quartercar.dampers.parameter import Parameter


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LinearSkyhook(Controller):
    """F = α c_max v_d + (1 − α) c_max ż_s, within what dampings from c_min to c_max can do.

    That is c = sat[(α c_max v_d + (1 − α) c_max ż_s)/v_d] without the division. α = 0 is the ideal skyhook where it can
    be had, α = 1 a passive damper of c_max.
    """

    name: ClassVar[str] = "skyhook-linear"
    title: ClassVar[str] = "Skyhook, linear"
    source: ClassVar[str] = "Sammier, Sename, Dugard 2003; equation sheet 4.8"
    parameters: ClassVar[tuple[Parameter, ...]] = LOW, HIGH, Parameter("passive_share", "", "alpha", 0.2, 0.0, 1.0)
    reads: ClassVar[tuple[str, ...]] = "suspension_velocity", "body_velocity"
    demands: ClassVar[str] = "force"

    def begin(self, values: Values, setting: Setting) -> Law:
        low, high, share = values["low_damping"], values["high_damping"], values["passive_share"]
        return Memoryless(lambda s: between(
            high * (share * s["suspension_velocity"] + (1 - share) * s["body_velocity"]), s["suspension_velocity"],
            low, high))
