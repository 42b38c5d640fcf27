"""Power-driven damping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from quartercar.controllers.contract import Controller, Law, Memoryless, Setting, Signals, Values
from quartercar.controllers.laws.damping import HIGH, LOW
from quartercar.dampers.parameter import Parameter


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PowerDriven(Controller):
    """c_min where k z_d v_d + c_min v_d² ≥ 0, c_max where k z_d v_d + c_max v_d² < 0, else c = −k z_d/v_d.

    In between the damper takes all of the spring's force, F = −k z_d, so that no power reaches the body. At v_d = 0 no
    damping has a force.
    """

    name: ClassVar[str] = "pdd"
    title: ClassVar[str] = "PDD"
    source: ClassVar[str] = "Morselli, Zanasi 2008; equation sheet 4.8"
    parameters: ClassVar[tuple[Parameter, ...]] = LOW, HIGH
    reads: ClassVar[tuple[str, ...]] = "suspension_deflection", "suspension_velocity"
    demands: ClassVar[str] = "force"

    def begin(self, values: Values, setting: Setting) -> Law:
        k, low = setting.parameters.spring_stiffness, values["low_damping"]
        high = np.maximum(low, values["high_damping"])

        def force(s: Signals) -> np.ndarray:
            z, v = s["suspension_deflection"], s["suspension_velocity"]
            power = k * z * v
            soft, hard = power + low * v**2 >= 0, power + high * v**2 < 0
            return np.where(soft, low * v, np.where(hard, high * v, -k * z))

        return Memoryless(force)
