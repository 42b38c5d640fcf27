"""E5: a nominal damping and a force beside it, the limits in the scheduling of the weight or of the force itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.toolkit import checks
from quartercar.lpv_models.car_part import SPEED, with_force
from quartercar.lpv_models.embedding import Embedding, Trajectory, car_states, road_velocity
from quartercar.lpv_models.region import Region
from quartercar.parameters import CarParameters
from quartercar.vehicle.result import CarRun


@dataclass(frozen=True, eq=False)
class NominalForce(Embedding):
    """F_d = c_nom v_d + F_I with a time-invariant plant; the limits schedule the weight on F_I (E5).

    Poussot-Vassal et al. (2008). `limit` gives ρ(ε) of a demand: large where the damper cannot give it, so that
    W_u(ρ) = ρ/(s/1000 + 1) drives the controller to the passive c_nom. Exact for every damper.

    Attributes
    ----------
    parameters : CarParameters
    nominal_damping : float
        c_nom [N·s/m].
    sharpness, height : float
        μ^(1/8)·1 N is where ρ bends, 10 is its top: ρ(ε) = h μ ε⁴/(μ ε⁴ + 1/μ), ε in newtons.

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> plant = NominalForce(MEGANE, 1000.0)
    >>> plant.limit(np.array([0.0, 0.01, 1.0])).round(3).tolist()
    [0.0, 10.0, 10.0]
    """

    number: ClassVar[str] = "E5"
    control: ClassVar[str] = "damper_demand"  # type: ignore[misc]

    parameters: CarParameters
    nominal_damping: float
    sharpness: float = 1e8
    height: float = 10.0

    def __post_init__(self) -> None:
        for name in ("nominal_damping", "sharpness", "height"):
            checks.positive(getattr(self, name), name)

    def limit(self, distance: np.ndarray) -> np.ndarray:
        """(n,) ρ(ε) of distances from the admissible forces [N].

        Parameters
        ----------
        distance : (n,) array
            ε, as `AdmissibleForce.distance` has it [N].

        Returns
        -------
        (n,) array
            Between 0 and `height`.
        """
        e4 = self.sharpness * np.asarray(distance, dtype=float) ** 4
        return self.height * e4 / (e4 + 1 / self.sharpness)

    @cached_property
    def region(self) -> Region:  # type: ignore[override]
        return Region((), np.zeros((1, 0)), np.zeros((1, 0)), "time-invariant: the weight is scheduled")

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        rows = {"": (self.nominal_damping * SPEED, np.ones(1))}
        return with_force(self.parameters, rows, self.region, (Signal(self.control, "N"),))

    def along(self, run: CarRun) -> Trajectory:
        x = car_states(run)
        u = run["damper_force"] - run.car.preload - self.nominal_damping * (x @ SPEED)
        return Trajectory(x, np.column_stack([road_velocity(run), u]), np.empty((len(x), 0)))


@dataclass(frozen=True, eq=False)
class LimitedForce(Embedding):
    """F_d = c_nom v_d + ρ u, ρ = sat(u)/u ∈ [0, 1]: E2's ratio on E5's force, for any damper.

    With c_nom v_d inside the admissible forces, F = sat_𝒟(c_nom v_d + u) gives ρ = (F − c_nom v_d)/u between 0 (the
    demand points the wrong way) and 1 (it is met). One scheduling variable holds every limit of the damper, whatever
    its law; a prefilter (E3) makes B_2 constant and breaks the loop from u to ρ.

    Attributes
    ----------
    parameters : CarParameters
    nominal_damping : float
        c_nom [N·s/m].
    least : float
        Smallest ρ of the design. Below it the controller is run at `least`.

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> LimitedForce(MEGANE, 1000.0).region.corners.ravel().tolist()
    [0.0, 1.0]
    """

    number: ClassVar[str] = "E2 on E5"
    control: ClassVar[str] = "damper_demand"  # type: ignore[misc]

    parameters: CarParameters
    nominal_damping: float
    least: float = 0.0

    @cached_property
    def region(self) -> Region:  # type: ignore[override]
        return Region.box(("given_share",), (self.least,), (1.0,), "share of a demand that a damper can give")

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        rows = {"": (self.nominal_damping * SPEED, np.zeros(1)), "given_share": (np.zeros(4), np.ones(1))}
        return with_force(self.parameters, rows, self.region, (Signal(self.control, "N"),))

    def share(self, force: np.ndarray, velocity: np.ndarray, demand: np.ndarray) -> np.ndarray:
        """(n,) ρ of a given force, within the region.

        Parameters
        ----------
        force : (n,) array
            Given, about the static equilibrium [N].
        velocity : (n,) array
            v_d [m/s].
        demand : (n,) array
            u, beside c_nom v_d [N]; a demand below 1e-9 N counts as met.

        Returns
        -------
        (n,) array
            Between `least` and 1.
        """
        given = np.asarray(force) - self.nominal_damping * np.asarray(velocity)
        small = np.abs(demand) < 1e-9
        return np.clip(np.where(small, 1.0, given / np.where(small, 1.0, demand)), self.least, 1.0)

    def along(self, run: CarRun) -> Trajectory:
        """As the base class; the demand is the force itself where nothing else is given: ρ = 1."""
        x = car_states(run)
        u = run["damper_force"] - run.car.preload - self.nominal_damping * (x @ SPEED)
        return Trajectory(x, np.column_stack([road_velocity(run), u]), np.ones((len(x), 1)))

    def demanded(self, run: CarRun, demand: np.ndarray) -> Trajectory:
        """The same for a known demand u [N], whose shortfall is ρ.

        Parameters
        ----------
        run : CarRun
            In which the controller worked.
        demand : (n,) array
            u at the samples of the run, beside c_nom v_d [N].

        Returns
        -------
        Trajectory
            With the demand as its input and ρ as its scheduling.
        """
        path = self.along(run)
        share = self.share(run["damper_force"] - run.car.preload, path.states @ SPEED, demand)
        return Trajectory(path.states, np.column_stack([path.inputs[:, 0], demand]), share[:, None])
