"""From weights to a gain over car and damper: the plant with the damper's own dynamics, a dissipative feedback."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from lpvid.synthesis.dissipative_feedback import DissipativeFeedback
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.synthesizing import synthesize
from lpvid.toolkit import checks
from quartercar.dampers.contract import Damper
from quartercar.lpv_models.identified_continuous import ContinuousDamper
from quartercar.lpv_models.identified_study import EmbeddedDamper, study
from quartercar.lpv_models.weighted import SuspensionWeights, WeightedCar
from quartercar.parameters import CarParameters

SLOW = (0.0, 1e-3, 1e-2)
"""shares of the mean square velocity below which the box of ρ_v may end, tried in turn"""


@dataclass(frozen=True)
class DamperTask:
    """What a controller on the identified plant is designed for; equal tasks share one design.

    Attributes
    ----------
    parameters : CarParameters
    damper : Damper
        With an identified transfer function inside.
    currents : (float, float)
        Limits of the command [A].
    weights : SuspensionWeights
    lag : float
        From demand to the force that the current adds: the coil [s].
    centre : float or None
        i_0 [A]; None for the lowest current at which the frozen car is stable.
    order : int or None
        Of the damper in the plant; None for the least that is good enough.
    back_off : float
        As in `DissipativeFeedback`.
    slow : float
        Share of the runs' mean square velocity below the box of ρ_v (`EmbeddedDamper.without_slow`).
    """

    parameters: CarParameters
    damper: Damper
    currents: tuple[float, float]
    weights: SuspensionWeights = field(default_factory=SuspensionWeights)
    lag: float = 0.004
    centre: float | None = None
    order: int | None = None
    back_off: float = 3.0
    slow: float = 0.0

    def __post_init__(self) -> None:
        checks.positive(self.lag, "lag", "s")

    @cached_property
    def embedded(self) -> EmbeddedDamper:
        """The damper in the car, with what each step costs; kept with the task, also where it is sent elsewhere."""
        return study(self.parameters, self.damper, self.currents, self.centre, self.order)

    @property
    def embedding(self) -> ContinuousDamper:
        """The plant behind the coil's lag."""
        return replace(self.embedded.without_slow(self.slow), lag=self.lag)

    @property
    def weighted(self) -> WeightedCar:
        """The same, weighted."""
        plant = self.embedding
        return WeightedCar(plant.system, plant.control, self.weights, ())

    def plant(self) -> GeneralizedPlant:
        """What is given to `lpvid.synthesize`: all states measured, car, damper, added force, weights.

        Returns
        -------
        GeneralizedPlant
            Continuous, scheduled on ρ_v where the velocity is shaped; its road and performance outputs are weighted.
        """
        return self.weighted.state_plant()


@lru_cache(maxsize=512)
def synthesized_gain(task: DamperTask) -> Synthesis:
    """u = K x with the bound of the car left to itself, for every ρ_v of the box and every share of u; found once.

    Parameters
    ----------
    task : DamperTask
        What to design for; equal tasks share the design.

    Returns
    -------
    Synthesis
        With its verdict and bound; of a task without a controller one that is not `solved`.
    """
    return synthesize(task.plant(), DissipativeFeedback(task.back_off))


@lru_cache(maxsize=512)
def feasible(task: DamperTask) -> DamperTask:
    """The task with the largest box of ρ_v of `SLOW` for which there is a controller; itself where there is none.

    Parameters
    ----------
    task : DamperTask
        Its own `slow` is the first share that is tried.

    Returns
    -------
    DamperTask
        The task with the first solvable share of `SLOW`, and so the largest box; `task` itself where no share is
        solvable.
    """
    tried = [replace(task, slow=share) for share in SLOW if share >= task.slow]
    return next((t for t in tried if synthesized_gain(t).solved), task)


def gain_vector(task: DamperTask) -> np.ndarray:
    """(n,) K over car, damper, added force and weights [N per unit of each].

    Parameters
    ----------
    task : DamperTask
        A task with a controller, as `feasible` returns it.

    Returns
    -------
    (n,) array
        K in the order of the plant's measurements.

    Raises
    ------
    NumericalError
        A design that failed, with why and mend.
    """
    controller, plant = synthesized_gain(task).required(), task.plant()
    places = [[s.name for s in controller.inputs].index(name) for name in plant.measurements]
    return controller.D[0, 0, places]
