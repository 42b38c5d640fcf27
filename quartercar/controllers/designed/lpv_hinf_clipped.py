"""H-infinity control designed without limits; what the damper cannot give is clipped outside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from quartercar.controllers.designed.lpv_hinf import WEIGHTS, DesignedLaw
from quartercar.dampers.parameter import Parameter


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LpvHinfClipped(DesignedLaw):
    """F = c_nom v_d + u, u = K y; K by H-infinity synthesis for a damper that could give any force.

    The same plant and weights as `LpvHinf` at ρ = 1 throughout; the inverse damper model then takes the nearest force
    that there is. The design does not take that into account.
    """

    name: ClassVar[str] = "lpv-hinf-clipped"
    title: ClassVar[str] = "H-infinity, clipped"
    source: ClassVar[str] = "Poussot-Vassal 2008; equation sheet 4.3"
    parameters: ClassVar[tuple[Parameter, ...]] = WEIGHTS

    def least_share(self, values: Mapping[str, float]) -> None:
        return None
