"""From weights to a gain over car and damper: the plant with the damper's own dynamics, LPV H-infinity state feedback."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.scheduling import Polynomial
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.state_feedback import StateFeedback
from lpvid.synthesis.synthesizing import synthesize
from quartercar.dampers.contract import Damper
from quartercar.parameters import CarParameters
from quartercar.plant.identified_continuous import SECANT, ContinuousDamper
from quartercar.plant.identified_study import EmbeddedDamper, study
from quartercar.plant.weighted import SuspensionWeights, WeightedCar


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
    least_share : float
        Smallest share of a demand that the design reckons with.
    lag : float
        From demand to the force that the current adds: the coil [s].
    centre : float or None
        i_0 [A]; None for the lowest current at which the frozen car is stable.
    order : int or None
        Of the damper in the plant; None for the least that is good enough.
    """

    parameters: CarParameters
    damper: Damper
    currents: tuple[float, float]
    weights: SuspensionWeights = field(default_factory=SuspensionWeights)
    least_share: float = 0.0
    lag: float = 0.004
    centre: float | None = None
    order: int | None = None

    def __post_init__(self) -> None:
        _checks.positive(self.lag, "lag", "s")
        if not 0 <= _checks.real(self.least_share, "least share") < 1:
            raise InputError("the least share lies between 0 and 1", got=self.least_share)

    @property
    def embedded(self) -> EmbeddedDamper:
        """The damper in the car, with what each step costs."""
        return study(self.parameters, self.damper, self.currents, self.centre, self.order)

    @property
    def embedding(self) -> ContinuousDamper:
        """The plant behind the coil's lag."""
        return replace(self.embedded.plant, lag=self.lag, least=self.least_share)

    @property
    def weighted(self) -> WeightedCar:
        """The same, weighted."""
        plant = self.embedding
        return WeightedCar(plant.system, plant.control, self.weights, ())

    def plant(self) -> GeneralizedPlant:
        """What is given to `lpvid.synthesize`: all states measured, car, damper, added force, weights."""
        return self.weighted.state_plant()


@lru_cache(maxsize=512)
def synthesized_gain(task: DamperTask) -> Synthesis:
    """u = (K_0 + ρ_v K_1) x with one quadratic storage function, at the corners of ρ_v and s; found once.

    The gain does not read s, so that closed loop and inequality are affine in s and in ρ_v, each for itself: corners
    are enough, and s need not be known. u is then the same whatever is given of it, and the nearest force is s u.
    """
    plant = task.plant()
    basis = Polynomial((SECANT,), 1) if SECANT in plant.box.names else Polynomial((), 0)
    return synthesize(plant, StateFeedback(gain=basis, points=2))


def gains_of(task: DamperTask) -> tuple[np.ndarray, np.ndarray]:
    """(2,) values of ρ_v and (2, n) gains there, linear in between; one value twice where the velocity is not shaped.

    Raises
    ------
    NumericalError
        A design that failed, with why and mend.
    """
    controller, plant = synthesized_gain(task).required(), task.plant()
    places = [[s.name for s in controller.inputs].index(name) for name in plant.measurements]
    limits = np.array(task.embedding.limits or (0.0, 0.0))
    rows = [controller.frozen([p] if controller.box.names else [])[3][0, places] for p in limits]
    return limits, np.array(rows)
