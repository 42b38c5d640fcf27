"""E1: the yield force as control, embedded exactly by the saturation of the damper's argument and its secant."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.model.state_space import LPVStateSpace
from quartercar.dampers.laws.secant import secant
from quartercar.lpv_models.embedding import Embedding, Trajectory, car_states, road_velocity
from quartercar.lpv_models.region import Region
from quartercar.lpv_models.strip import pair_box, pair_hull, pair_plant
from quartercar.lpv_models.yielding import Reach, YieldingLaw, yield_force
from quartercar.parameters import CarParameters
from quartercar.vehicle.result import CarRun


@dataclass(frozen=True, eq=False)
class SaturationPair(Embedding):
    """ẋ = (A_0 + F_0 ρ_2 B_F C_2) x + ρ_1 B_F u_I + B_w ż_r, ρ_1 = tanh ξ, ρ_2 = tanh ξ/ξ, ξ = C_2 x (E1).

    Exact: tanh ξ = (tanh ξ/ξ) ξ. A_0 holds k_s + k_0 and c_0; u_I = f_I − F_0 ∈ [−U, U] is the control. Do, Sename,
    Dugard (2010), as in equation sheet 4.3. Control is lost at ρ_1 = 0.

    Attributes
    ----------
    parameters : CarParameters
    law : YieldingLaw
    reach : Reach
        Motion for which the box holds.
    tight : bool
        The hull of the strip (E4) rather than the box.

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> plant = SaturationPair(MEGANE, YieldingLaw(800.0, 600.0, 13.8, 10.5, 100.0, 900.0))
    >>> plant.system.box.names, len(plant.region.corners)
    (('saturation', 'secant'), 6)
    """

    number: ClassVar[str] = "E1"
    control: ClassVar[str] = "yield_control"  # type: ignore[misc]

    parameters: CarParameters
    law: YieldingLaw
    reach: Reach = field(default_factory=Reach)
    tight: bool = True

    @cached_property
    def region(self) -> Region:  # type: ignore[override]
        return (pair_hull if self.tight else pair_box)(self.law, self.reach)

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        return pair_plant(self.parameters, self.law, self.region, self.control)

    def along(self, run: CarRun) -> Trajectory:
        x = car_states(run)
        xi = x @ self.law.argument
        u = yield_force(run) - self.law.middle
        return Trajectory(x, np.column_stack([road_velocity(run), u]), np.column_stack([np.tanh(xi), secant(xi)]))
