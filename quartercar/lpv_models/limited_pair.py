"""E2: the limits of the yield force inside the plant, as the ratio of what is given to what is asked."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.toolkit import checks
from quartercar.dampers.laws.secant import secant
from quartercar.lpv_models.embedding import Embedding, Trajectory, car_states, road_velocity
from quartercar.lpv_models.region import Region
from quartercar.lpv_models.strip import pair_box, pair_hull, pair_plant
from quartercar.lpv_models.yielding import Reach, YieldingLaw, yield_force
from quartercar.parameters import CarParameters
from quartercar.vehicle.result import CarRun

LIMITERS = ("clip", "tanh")


@dataclass(frozen=True, eq=False)
class LimitedPair(Embedding):
    """E1 with u_I = sat(u_c) inside: ρ_1 = tanh ξ · sat(u_c)/u_c, ρ_2 = tanh ξ/ξ (E2).

    Do, Sename, Dugard (2010) take sat(u) = U tanh(u/U), for which the ratio is the secant of tanh; the coil's limits
    are a clip. The ratio lies in (0, 1], so that |ρ_1| ≤ |tanh ξ| and the hull of the strip (E4) holds every pair. The
    demand u_c is an input without limits; the ratio depends on it at the same instant, so that a controller has to be
    strictly proper, or the loop broken by a prefilter (`quartercar.lpv_models.prefilter`, E3).

    Attributes
    ----------
    parameters : CarParameters
    law : YieldingLaw
    reach : Reach
    tight : bool
        The hull of the strip (E4) rather than the box.
    limiter : {"clip", "tanh"}

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> plant = LimitedPair(MEGANE, YieldingLaw(800.0, 600.0, 13.8, 10.5, 100.0, 900.0))
    >>> plant.ratio(np.array([200.0, 800.0])).round(2)
    array([1. , 0.5])
    """

    number: ClassVar[str] = "E2"
    control: ClassVar[str] = "yield_demand"  # type: ignore[misc]

    parameters: CarParameters
    law: YieldingLaw
    reach: Reach = field(default_factory=Reach)
    tight: bool = True
    limiter: str = "clip"

    def __post_init__(self) -> None:
        checks.one_of(self.limiter, LIMITERS, "limiter")

    def ratio(self, demand: np.ndarray) -> np.ndarray:
        """(n,) sat(u_c)/u_c, 1 at 0.

        Parameters
        ----------
        demand : (n,) array
            u_c, the demanded yield force about the middle F_0 [N].

        Returns
        -------
        (n,) array
            Between 0 and 1.
        """
        share = np.asarray(demand, dtype=float) / self.law.half_range
        if self.limiter == "tanh":
            return secant(share)
        return 1.0 / np.maximum(np.abs(share), 1.0)

    @cached_property
    def region(self) -> Region:  # type: ignore[override]
        inside = (pair_hull if self.tight else pair_box)(self.law, self.reach)
        shares = (0.0, 0.5, 1.0)
        visited = np.vstack([inside.visited * (s, 1.0) for s in shares])
        return Region(inside.names, inside.corners, np.unique(visited, axis=0), inside.source)

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        return pair_plant(self.parameters, self.law, self.region, self.control)

    def along(self, run: CarRun) -> Trajectory:
        """As the base class; the demand at a sample is the command that was held up to it, before the coil's limits.

        Raises
        ------
        InputError
            A coil with a lag: the limited current is what lags, so that no ratio of one instant holds both.
        """
        coil = run.car.coil
        if coil.rise_time or coil.fall_time:
            raise InputError("E2 holds the limits of the coil, not its lag", got=f"{coil.rise_time:g} s",
                             mend="Prefiltered(SaturationPair(...), lag) (E3 on E1), for demands within the limits")
        x = car_states(run)
        xi = x @ self.law.argument
        given = yield_force(run) - self.law.middle
        demand = yield_force(run, "command") - self.law.middle
        asked = np.append(demand[:1], demand[:-1])
        ratio = np.where(np.abs(asked) > 1e-9, given / np.where(np.abs(asked) > 1e-9, asked, 1.0), 1.0)
        return Trajectory(x, np.column_stack([road_velocity(run), asked]),
                          np.column_stack([np.tanh(xi) * ratio, secant(xi)]))
