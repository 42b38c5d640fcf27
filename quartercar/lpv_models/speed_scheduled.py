"""E7: the suspension's velocity as scheduling variable, the damping beside a nominal one as control."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from quartercar.lpv_models.car_part import SPEED, with_force
from quartercar.lpv_models.embedding import Embedding, Trajectory, car_states, road_velocity
from quartercar.lpv_models.region import Region
from quartercar.lpv_models.yielding import Reach
from quartercar.parameters import CarParameters
from quartercar.vehicle.result import CarRun


@dataclass(frozen=True, eq=False)
class SpeedScheduled(Embedding):
    """F_d = c_nom v_d + ρ u, ρ = v_d ∈ [−v̂, v̂], u = c − c_nom (E7).

    Control is lost at ρ = 0, so that no controller does better there than the nominal damping: the bound of a design is
    never below the passive car's at c_nom.

    Attributes
    ----------
    parameters : CarParameters
    nominal_damping : float
        c_nom [N·s/m].
    reach : Reach
        v̂ is its speed.

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> SpeedScheduled(MEGANE, 1500.0, Reach(speed=0.8)).region.corners.ravel().tolist()
    [-0.8, 0.8]
    """

    number: ClassVar[str] = "E7"
    control: ClassVar[str] = "extra_damping"  # type: ignore[misc]

    parameters: CarParameters
    nominal_damping: float
    reach: Reach = field(default_factory=Reach)

    @cached_property
    def region(self) -> Region:  # type: ignore[override]
        v = self.reach.speed
        return Region.box(("suspension_velocity",), (-v,), (v,), f"|v_d| <= {v:g} m/s")

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        rows = {"": (self.nominal_damping * SPEED, np.zeros(1)), "suspension_velocity": (np.zeros(4), np.ones(1))}
        return with_force(self.parameters, rows, self.region, (Signal(self.control, "N*s/m"),), ("m/s",))

    def along(self, run: CarRun) -> Trajectory:
        x = car_states(run)
        v, force = x @ SPEED, run["damper_force"] - run.car.preload
        still = np.abs(v) < 1e-12
        u = np.where(still, 0.0, force / np.where(still, 1.0, v) - self.nominal_damping)
        return Trajectory(x, np.column_stack([road_velocity(run), u]), v[:, None])
