"""E6: the damping itself as scheduling variable, for the analysis of the car over everything a damper can do."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.toolkit import checks
from quartercar.lpv_models.car_part import SPEED, with_force
from quartercar.lpv_models.embedding import Embedding, Trajectory, car_states, road_velocity
from quartercar.lpv_models.region import Region
from quartercar.parameters import CarParameters
from quartercar.vehicle.result import CarRun


@dataclass(frozen=True, eq=False)
class VariableDamping(Embedding):
    """ẋ = (A_0 + c A_c) x + B_w ż_r, A_c = B_F [0 1 0 −1], c ∈ [c_min, c_max] (E6).

    Bilinear with c as the control; as an LPV system it has none and tells what the car does whatever its damper does,
    at a bounded rate of c or at any. Along a run c = F_d/v_d, so that the force must vanish with the velocity: no
    hysteresis.

    Attributes
    ----------
    parameters : CarParameters
    least, most : float
        c_min, c_max [N·s/m].
    rate : float or None
        Bound on |ċ| [N/m].

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> VariableDamping(MEGANE, 900.0, 4300.0).system.frozen_poles([1500.0]).real.max().round(4)
    np.float64(-1.8594)
    """

    number: ClassVar[str] = "E6"
    control: ClassVar[None] = None  # type: ignore[misc]

    parameters: CarParameters
    least: float
    most: float
    rate: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= checks.real(self.least, "least damping") < checks.real(self.most, "most damping"):
            raise InputError("the damping needs room to move and must not be negative",
                             got=f"{self.least:g} to {self.most:g} N*s/m")

    @cached_property
    def region(self) -> Region:  # type: ignore[override]
        return Region.box(("damping",), (self.least,), (self.most,), "limits of the damper")

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        model = with_force(self.parameters, {"damping": (SPEED, np.zeros(0))}, self.region, (), ("N*s/m",))
        return model.replace(scheduling=self.region.scheduling(("N*s/m",), (self.rate,)))

    def along(self, run: CarRun) -> Trajectory:
        x = car_states(run)
        v, force = x @ SPEED, run["damper_force"] - run.car.preload
        still = np.abs(v) < 1e-12
        c = np.where(still, self.least, force / np.where(still, 1.0, v))
        return Trajectory(x, road_velocity(run)[:, None], c[:, None])
