"""E9 in continuous time: the car with the identified damper's own dynamics, and the force that the current adds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from quartercar.lpv_models.car_part import SPEED, bare_car, car_plant
from quartercar.lpv_models.embedding import Embedding, Trajectory, car_states, need_rate, road_velocity
from quartercar.lpv_models.frozen_damper import FrozenDamper, Matrices, filtered
from quartercar.lpv_models.region import Region
from quartercar.parameters import CarParameters
from quartercar.vehicle.result import CarRun

SECANT = "secant"


@dataclass(frozen=True, eq=False)
class ContinuousDamper(Embedding):
    """Car and damper frozen at i_0, scheduled on ρ_v, with the force f that the current adds as control.

    ::

        ẋ_d = A_d x_d + (B_v + ρ_v B_w) v_d + B_f f        ρ_v = tanh(v_d/v_0)/v_d
        F   = C_d x_d + (D_v + ρ_v D_w) v_d + D_f f        car: ẋ = A_0 x + B_w ż_r + B_F F
        τ ḟ = u − f    (or f = u without a lag)

    `FrozenDamper` defines f, by which the filter is exact for every course of the current; in E9's terms f = g r δ.
    Of a demand u the damper gives s u with 0 ≤ s ≤ 1: r runs through zero with the velocity, the current ends at the
    coil's limits, and in both the nearest force to be had is a share of the one demanded. So no box of r is needed; a
    design keeps its promise for every course of s (`lpvid.synthesis.dissipative_feedback`). At s = 0 the car with the
    frozen damper is left to itself. Where the damper is passive, the energy of masses, springs and damper decreases
    there, and the design is feasible.

    States are deviations from rest at i_0. Not exact are the bilinear map of the frozen filter, a reduction of it, and
    the lag, which stands for the coil.

    Attributes
    ----------
    parameters : CarParameters
    frozen : FrozenDamper
    filter : (A, B, C, D) or None
        Continuous, from (v, tanh(v/v_0), f) to F − F_0; the frozen damper's own where left out.
    lag : float
        τ [s]; 0 for none.
    limits : (float, float) or None
        Of ρ_v [s/m]; `around` finds them.

    Examples
    --------
    >>> from quartercar.rides.default_damper import identified_damper
    >>> from quartercar.parameters import MEGANE
    >>> plant = ContinuousDamper(MEGANE, FrozenDamper.of(identified_damper(), 0.0), lag=0.004, limits=(1.0, 39.0))
    >>> plant.system.order, plant.system.box.names
    (7, ('secant',))
    """

    number: ClassVar[str] = "E9 continuous"
    control: ClassVar[str] = "added_force"  # type: ignore[misc]

    parameters: CarParameters
    frozen: FrozenDamper
    filter: Matrices | None = None
    lag: float = 0.0
    limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not self.lag >= 0:
            raise InputError("the lag of a plant must not be negative", got=f"{self.lag:g} s")

    @property
    def held(self) -> tuple[str, ...]:  # type: ignore[override]
        """The demand, too, where a lag is driven by it."""
        return ("road_velocity", self.control) if self.lag else ("road_velocity",)

    @property
    def matrices(self) -> Matrices:
        """The filter that is embedded."""
        return self.frozen.continuous if self.filter is None else self.filter

    @property
    def names(self) -> tuple[str, ...]:
        """ρ_v where the velocity is shaped."""
        return (SECANT,) if self.frozen.shaped else ()

    @cached_property
    def region(self) -> Region:  # type: ignore[override]
        if not self.frozen.shaped:
            return Region((), np.zeros((1, 0)), np.zeros((1, 0)), "time-invariant")
        if self.limits is None:
            raise InputError("the secant of the shaped velocity is limited by recorded runs", got="no limits",
                             mend=".around(runs)")
        return Region.box(self.names, self.limits[:1], self.limits[1:], "recorded runs")

    def around(self, runs: Sequence[CarRun] | CarRun, margin: float = 1.1) -> ContinuousDamper:
        """The same with ρ_v between its least value on runs, over a margin, and its largest there is, 1/v_0.

        Parameters
        ----------
        runs : sequence of CarRun or CarRun
            Their suspension velocities count.
        margin : float
            Divides the least ρ_v of the runs.

        Returns
        -------
        ContinuousDamper
            With `limits` of ρ_v; itself where the velocity is not shaped.
        """
        listed = [runs] if isinstance(runs, CarRun) else runs
        found = [self.frozen.secant(run["suspension_velocity"]).min() for run in listed]
        return replace(self, limits=(float(min(found)) / margin, 1 / self.frozen.knee)) if self.frozen.shaped else self

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        (a, b, c, d), shaped, lagged = self.matrices, self.frozen.shaped, self.lag > 0
        n, m = len(a), 1 + shaped
        size = 4 + n + lagged
        demand = size + 1
        into = np.zeros((m, 3, size + 2))  # (v, shaped v, f) over states, ż_r and the demand
        into[0, 0, :4] = SPEED
        if shaped:
            into[1, 1, :4] = SPEED
        into[0, 2, size - 1 if lagged else demand] = 1.0
        rows = [0, 1, 2] if shaped else [0, 2]
        force = np.einsum("j,mjk->mk", d[0], into[:, rows])
        force[0, 4:4 + n] += c[0]
        inner = np.zeros((m, n + lagged, size + 2))
        inner[:, :n] = np.einsum("ij,mjk->mik", b, into[:, rows])
        inner[0, :n, 4:4 + n] += a
        if lagged:
            inner[0, -1, size - 1], inner[0, -1, demand] = -1 / self.lag, 1 / self.lag
        return car_plant(bare_car(self.parameters), force, inner, self.region, (Signal(self.control, "N"),),
                         ("s/m",) if shaped else ())

    def damper_inputs(self, run: CarRun) -> np.ndarray:
        """(n, 2 or 3) v, tanh(v/v_0) and f along a run at the damper's rate.

        Parameters
        ----------
        run : CarRun
            At the damper's rate.

        Returns
        -------
        (n, 2 or 3) array
            [m/s], dimensionless where the velocity is shaped, [N].

        Raises
        ------
        InputError
            A run at another rate.
        """
        need_rate(run, self.frozen.model.sample_time)
        v = np.asarray(run["suspension_velocity"])
        return np.column_stack([self.frozen.inputs(v), self.frozen.added(v, run["damper_force"])])

    def along(self, run: CarRun) -> Trajectory:
        """As the base class; the demand is what was given, and behind a lag what gives it at every sample."""
        drive = self.damper_inputs(run)
        inner, _ = filtered(self.matrices, drive, run.sample_time)
        car, f = car_states(run), drive[:, -1]
        car[:, 0] += (self.frozen.rest - run.car.preload) / self.parameters.spring_stiffness
        states, demand = [car, inner], f
        if self.lag:
            kept = np.exp(-run.sample_time / self.lag)
            demand = np.append(f[1:] - kept * f[:-1], (1 - kept) * f[-1]) / (1 - kept)
            states.append(f[:, None])
        p = self.frozen.secant(run["suspension_velocity"])[:, None][:, :len(self.names)]
        return Trajectory(np.hstack(states), np.column_stack([road_velocity(run), demand]), p)
