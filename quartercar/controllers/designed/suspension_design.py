"""From weights to a controller that runs: plant, LPV H-infinity synthesis, sampling at the loop's rate."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling, Spline
from lpvid.synthesis.criteria import H2, HInfinity
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.multiobjective import MultiObjective
from lpvid.synthesis.output_feedback import OutputFeedback
from lpvid.synthesis.progress import was_interrupted
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.state_feedback import StateFeedback
from lpvid.synthesis.synthesizing import synthesize
from lpvid.toolkit import checks
from quartercar.dampers.contract import Damper
from quartercar.lpv_models.active import active_region
from quartercar.lpv_models.admissible import AdmissibleForce
from quartercar.lpv_models.car_part import STATES
from quartercar.lpv_models.embedding import Embedding
from quartercar.lpv_models.nominal_force import LimitedForce, NominalForce
from quartercar.lpv_models.prefilter import prefiltered
from quartercar.lpv_models.weighted import MEASUREMENTS, SensorNoise, SuspensionWeights, WeightedCar
from quartercar.parameters import CarParameters

if TYPE_CHECKING:
    from functools import _lru_cache_wrapper
from quartercar.vehicle.linear import OUTPUTS

CRITERIA = ("hinf", "h2")
NODES = 5
"""values of the given share at which a controller is sampled; linear in between"""


@dataclass(frozen=True)
class Task:
    """What a controller is designed for; equal tasks share one design.

    Attributes
    ----------
    parameters : CarParameters
    nominal_damping : float
        c_nom [N·s/m].
    weights : SuspensionWeights
    least_share : float or None
        Smallest share of a demand that the design reckons with (`LimitedForce`); None leaves the limits out.
    measured : str
        A name of `quartercar.lpv_models.weighted.MEASUREMENTS`.
    lag : float
        Of the coil, from demand to force [s].
    noise : SensorNoise
    criterion : {"hinf", "h2"}
        The least induced gain from road and noise to everything weighted, or the least H2 norm of it: the rms on a
        random road.
    """

    parameters: CarParameters
    nominal_damping: float
    weights: SuspensionWeights = field(default_factory=SuspensionWeights)
    least_share: float | None = 0.0
    measured: str = "stroke-body"
    lag: float = 0.008
    noise: SensorNoise = field(default_factory=SensorNoise)
    criterion: str = "hinf"

    def __post_init__(self) -> None:
        checks.one_of(self.criterion, CRITERIA, "criterion")
        checks.one_of(self.measured, tuple(MEASUREMENTS), "measured")
        checks.positive(self.nominal_damping, "nominal damping", "N*s/m")
        if self.least_share is not None and not 0 <= checks.real(self.least_share, "least share") < 1:
            raise InputError("the least share lies between 0 and 1", got=self.least_share)

    @property
    def embedding(self) -> Embedding:
        """The car with the limits in its scheduling, or without."""
        if self.least_share is None:
            return NominalForce(self.parameters, self.nominal_damping)
        return LimitedForce(self.parameters, self.nominal_damping, self.least_share)

    @property
    def weighted(self) -> WeightedCar:
        """The car behind the coil's lag, weighted."""
        embedding = self.embedding
        assert embedding.control is not None
        system = prefiltered(embedding.system, embedding.control, self.lag)
        return WeightedCar(system, embedding.control, self.weights, MEASUREMENTS[self.measured], self.noise)

    def plant(self) -> GeneralizedPlant:
        """What is given to `lpvid.synthesize`.

        Returns
        -------
        GeneralizedPlant
            Continuous; with all states measured where `measured` is "observed", with the noisy signals of that name
            otherwise.
        """
        return self.weighted.state_plant() if self.measured == "observed" else self.weighted.plant()


@lru_cache(maxsize=512)
def synthesized(task: Task) -> Synthesis:
    """State feedback of the observed car, or output feedback without feedthrough; found once.

    Parameters
    ----------
    task : Task
        What to design for; equal tasks share the design.

    Returns
    -------
    Synthesis
        With its verdict and bound; a failed search is a result that is not `solved`.
    """
    plant = task.plant()
    criteria = (H2(),) if task.criterion == "h2" else (HInfinity(),)
    if task.measured == "observed":
        return synthesize(plant, StateFeedback(criteria))
    if task.criterion == "h2":
        return synthesize(plant, MultiObjective(criteria, feedthrough=False))
    return synthesize(plant, OutputFeedback(strictly_proper=True, back_off=0.05))


def to_the_end(cached: _lru_cache_wrapper[Synthesis], task: Hashable,
               *built_on_it: _lru_cache_wrapper[Any]) -> Synthesis:
    """A synthesis found once; where Ctrl-C ended the earlier search, it is looked for anew.

    Parameters
    ----------
    cached : function
        The synthesis of a task, cached.
    task : Task or DamperTask
    *built_on_it : function
        Cached results that use the synthesis; cleared with it.

    Returns
    -------
    Synthesis
    """
    hits = cached.cache_info().hits
    found = cached(task)
    if cached.cache_info().hits == hits or not was_interrupted(found):
        return found
    for function in (cached, *built_on_it):
        function.cache_clear()
    return cached(task)


@lru_cache(maxsize=512)
def running(task: Task, sample_time: float) -> LPVStateSpace:
    """The controller of a task at the loop's rate, from the car's own signals to the demand beside c_nom v_d.

    Parameters
    ----------
    task : Task
        What to design for; equal tasks share the design.
    sample_time : float
        Of the loop [s].

    Returns
    -------
    LPVStateSpace
        Discrete; inputs named as in `contract.SIGNALS`, one output, the demand beside c_nom v_d [N].

    Raises
    ------
    NumericalError
        A design that failed, with why and mend.
    """
    return held(nodes_of(task), sample_time)


def nodes_of(task: Task) -> Nodes:
    """The continuous controller of a task at values of its scheduling, from the car's own signals.

    Parameters
    ----------
    task : Task
        What to design for; its synthesis is looked up, or run where there is none yet.

    Returns
    -------
    Nodes
        In SI units. State feedback of the observed car carries the states of lag and weights (`with_memory`).

    Raises
    ------
    NumericalError
        A design that failed, with why and mend.
    """
    found = synthesized(task).required()
    return with_memory(task, found) if task.measured == "observed" else _frozen(task.weighted.physical(found))


@dataclass(frozen=True, eq=False)
class Nodes:
    """A continuous controller at values of its scheduling.

    Attributes
    ----------
    inputs, outputs : tuple of Signal
    box : Scheduling
        Of its scheduling variable, if any.
    points : (N, 0 or 1) array
        Values of it.
    matrices : tuple of four (N, …) arrays
        A, B, C, D.
    """

    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    box: Scheduling
    points: np.ndarray
    matrices: tuple[np.ndarray, ...]


def _frozen(controller: LPVStateSpace, nodes: int = NODES) -> Nodes:
    """A controller at an even grid of its scheduling.

    Parameters
    ----------
    controller : LPVStateSpace
        Continuous, of one scheduling variable or none.
    nodes : int
        Points of the grid, both ends of the box included; without a scheduling variable there is one.

    Returns
    -------
    Nodes
        The matrices at every point.

    Raises
    ------
    InputError
        More than one scheduling variable.
    """
    if len(controller.box.names) > 1:
        raise InputError("a controller of one scheduling variable can be sampled here",
                         got=", ".join(controller.box.names))
    points = controller.box.grid(nodes)
    matrices = tuple(np.array(m) for m in zip(*(controller.frozen(p) for p in points), strict=True))
    return Nodes(controller.inputs, controller.outputs, controller.box, points, matrices)


def with_memory(task: Task, gain: LPVStateSpace, nodes: int = NODES) -> Nodes:
    """State feedback as a controller of the car's own signals, with the states that only the designer's plant has.

    ::

        x = (x_car, x_m):   ẋ_m = A_mm x_m + A_mc x_car + B_m u,   u = K_c x_car + K_m x_m

    x_m are the coil's lag and the weights' filters: known exactly, since what drives them is measured or demanded.

    Parameters
    ----------
    task : Task
        The task whose plant the gain was designed for.
    gain : LPVStateSpace
        Static state feedback, scheduled as the plant or on its first variables; inputs named as the plant's
        measurements.
    nodes : int
        Points of the grid over the plant's box, both ends included.

    Returns
    -------
    Nodes
        Inputs are the four states of the observed car, the output is the demand beside c_nom v_d [N].
    """
    plant = task.plant()
    n, points = len(STATES), plant.box.grid(nodes)
    at = plant.at(points)
    places = [[s.name for s in gain.inputs].index(name) for name in plant.measurements]
    k = np.array([gain.frozen(p[:len(gain.box.names)])[3][:, places] for p in points])
    b = at.B2[:, n:]
    matrices = at.A[:, n:, n:] + b @ k[:, :, n:], at.A[:, n:, :n] + b @ k[:, :, :n], k[:, :, n:], k[:, :, :n]
    inputs = tuple(Signal(name, OUTPUTS[name]) for name in MEASUREMENTS["observed"])
    return Nodes(inputs, (Signal(plant.controls[0], "N"),), plant.box, points, matrices)


def held(controller: Nodes, sample_time: float) -> LPVStateSpace:
    """A continuous controller sampled: exact at every node of the scheduling for readings held between samples.

    The states stay those of the continuous controller, so that the scheduling may jump. Between two nodes the sampled
    matrices are interpolated.

    Parameters
    ----------
    controller : Nodes
        At most one scheduling variable.
    sample_time : float
        Of the loop [s].

    Returns
    -------
    LPVStateSpace
        Discrete, with a linear spline over the nodes as its basis; constant without a scheduling variable.
    """
    from scipy.linalg import expm

    a, b, c, d = controller.matrices
    n = a.shape[1]
    block = np.zeros((n + b.shape[2], n + b.shape[2]))
    stepped = []
    for k in range(len(a)):
        block[:n, :n], block[:n, n:] = a[k], b[k]
        stepped.append(expm(sample_time * block)[:n])
    e, names = np.array(stepped), controller.box.names
    knots = tuple(controller.points[:, 0]) if names else ()
    basis = Spline(names[0], len(knots) - 1, 1, knots) if names else Polynomial()
    return LPVStateSpace(e[:, :, :n], e[:, :, n:], c, d, basis, sample_time, controller.box, inputs=controller.inputs,
                         outputs=controller.outputs)


@lru_cache(maxsize=64)
def admissible(damper: Damper, currents: tuple[float, float]) -> AdmissibleForce:
    """The damper's admissible forces, tabulated once.

    Parameters
    ----------
    damper : Damper
        Any model with a static characteristic.
    currents : (float, float)
        Limits of the command [A].

    Returns
    -------
    AdmissibleForce
        Least and greatest force over the suspension velocity; shared by equal arguments.
    """
    return AdmissibleForce.of(damper, currents)


def nominal_damping(damper: Damper, currents: tuple[float, float], share: float = 0.0) -> float:
    """c_nom of a line through the damper's admissible forces (`AdmissibleForce.nominal`) [N·s/m].

    Parameters
    ----------
    damper : Damper
        Any model with a static characteristic.
    currents : (float, float)
        Limits of the command [A].
    share : float
        Place between the weakest line, 0, and the strongest, 1; values outside lie beyond them.

    Returns
    -------
    float
        c_nom [N·s/m], positive.

    Raises
    ------
    InputError
        A line that gives energy, with the currents and speeds at which the law does.
    """
    try:
        band = admissible(damper, currents)
        found = band.nominal(share)
    except InputError:
        if np.isfinite(damper.static_force(np.array([0.3, -0.3]), currents[0])).all():
            raise
        found = np.nan
    if found > 0:
        return found
    where = active_region(damper, currents)
    raise InputError(f"the nominal damping of the '{damper.name}' damper must be positive", got=f"{found:.4g} N*s/m",
                     why=str(where) if where is not None else f"the share of {share:g} lies below its weakest force",
                     mend="fit or identify it again with --passive, or with more records at these currents and speeds"
                     if where is not None else "a larger nominal_share")
