"""Tuning of control laws with one budget for all: the same number of rides, roads and seeds for each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from lpvid.codec import Encoded
from lpvid.errors import InputError, LpvError, NumericalError
from lpvid.toolkit import checks, in_processes
from quartercar.controllers.contract import Controller
from quartercar.criteria import RideFigures as Figures
from quartercar.rides.simulation import RideSettings, drive
from quartercar.roads.ride_roads import RideRoad
from quartercar.vehicle.nonlinear import QuarterCar

CAP = 4.0
"""of the penalty, for the tyre load beyond its cap"""
ROUNDS = ((0.5, 1.0), (0.25, 0.3), (0.25, 0.1))
"""(share of the budget, width of the box as a share of the ranges): all of it first, then about the best so far."""
FAILURES = (LpvError, ArithmeticError, np.linalg.LinAlgError)
"""What a design may raise for some values of its parameters."""


@dataclass(frozen=True)
class Objective:
    """What a tuning makes small on a road: Σ weight·figure/reference over comfort, tyre load and stroke.

    ::

        J = w_c a_w/a_w0 + w_t σ(F_t)/σ_0(F_t) + w_z σ(z_d)/σ_0(z_d)
            + penalty·[(largest use of the room − 1)_+ + 4 (σ(F_t)/σ_0(F_t) − cap)_+]

    Means over the seeds of ratios to a reference law on the same road and seed.

    Attributes
    ----------
    comfort, tyre_load, stroke : float
        Weights.
    penalty : float
        For every further room's length beyond a bump stop.
    tyre_cap : float or None
        Share of the reference's tyre load beyond which it counts against a law: best comfort at no more than that.
    """

    comfort: float = 0.5
    tyre_load: float = 0.5
    stroke: float = 0.0
    penalty: float = 5.0
    tyre_cap: float | None = None

    def __post_init__(self) -> None:
        weights = (self.comfort, self.tyre_load, self.stroke, self.penalty)
        if min(weights) < 0 or max(weights[:3]) <= 0:
            raise InputError("weights of an objective are not negative, and not all zero", got=str(weights))
        if self.tyre_cap is not None:
            checks.positive(self.tyre_cap, "tyre_cap")

    @property
    def description(self) -> str:
        """In words."""
        parts = [f"{w:g}·{n}" for w, n in ((self.comfort, "comfort"), (self.tyre_load, "tyre load"),
                                           (self.stroke, "stroke")) if w]
        cap = "" if self.tyre_cap is None else f", at a tyre load of at most {self.tyre_cap:g}"
        return " + ".join(parts) + cap + ", each over that of the reference law, mean over the rides"

    def of(self, figures: Sequence[Figures], references: Sequence[Figures]) -> float:
        """J of the rides on one road, seed by seed.

        Parameters
        ----------
        figures : sequence of RideFigures
            One per seed.
        references : sequence of RideFigures
            Of the reference law with the same seeds.

        Returns
        -------
        float
            1 for the reference itself where the weights add up to one and no penalty applies.
        """
        comfort, tyre, stroke = (float(np.mean([getattr(f, n) / getattr(r, n) for f, r in
                                                zip(figures, references, strict=True)]))
                                 for n in ("comfort", "tyre_load", "stroke"))
        over = float(np.mean([0.0 if f.space_used is None else max(0.0, f.space_used - 1) for f in figures]))
        over += 0.0 if self.tyre_cap is None else CAP * max(0.0, tyre - self.tyre_cap)
        return self.comfort * comfort + self.tyre_load * tyre + self.stroke * stroke + self.penalty * over


@dataclass(frozen=True, eq=False)
class Tuned(Encoded):
    """A law after its tuning.

    Attributes
    ----------
    controller : Controller
        With the best values found.
    objective, before : float
        J of those and of the defaults.
    evaluations : int
        Candidates tried, the defaults included; each on every road and seed.
    tried : (evaluations, P) array
    costs : (evaluations,) array
    """

    JSON = ("controller", "objective", "before", "evaluations")

    controller: Controller
    objective: float
    before: float
    evaluations: int
    tried: np.ndarray
    costs: np.ndarray

    def __repr__(self) -> str:
        return (f"Tuned {self.controller.name}: {self.before:.4f} -> {self.objective:.4f} in {self.evaluations} "
                f"evaluations\n  {self.controller!r}")


@dataclass(frozen=True, eq=False)
class Trial:
    """The rides on which laws are tuned: the same for each of them.

    Attributes
    ----------
    car : QuarterCar
    roads : tuple of RideRoad
    seeds : tuple of int
        Others than those of the comparison.
    settings : RideSettings
    objective : Objective
    reference : Controller or None
        Law whose figures are the unit; None for the passive car under the lowest current.
    """

    car: QuarterCar
    roads: tuple[RideRoad, ...]
    seeds: tuple[int, ...] = (1000, 1001, 1002)
    settings: RideSettings = field(default_factory=RideSettings)
    objective: Objective = Objective()
    reference: Controller | None = None

    def references(self) -> Mapping[tuple[str, int], Figures]:
        """Figures of the reference law, by road and seed.

        Returns
        -------
        mapping of (str, int) to RideFigures
        """
        from quartercar.controllers.laws.passive import Passive

        law = self.reference or Passive(values={"fixed_current": self.car.coil.lowest})
        return {(road.name, r.seed): r.figures for road in self.roads
                for r in drive(self.car, road, [law] * len(self.seeds), self.seeds, self.settings)}

    def costs(self, controllers: Sequence[Controller], references: Mapping[tuple[str, int], Figures]) -> np.ndarray:
        """(n,) J of each controller over all roads and seeds; infinite for one that cannot be had or that diverges.

        Parameters
        ----------
        controllers : sequence of Controller
        references : mapping of (str, int) to RideFigures
            As from `references`.

        Returns
        -------
        (n,) array
            Means over the roads.
        """
        total = np.array([0.0 if self._starts(c) else np.inf for c in controllers])
        places = np.flatnonzero(np.isfinite(total)).tolist()
        for road in self.roads:
            try:
                total[places] += self._costs(road, [controllers[k] for k in places], references)
            except NumericalError:  # one of them throws the car off all bounds: which?
                total[places] += [self._alone(road, controllers[k], references) for k in places]
        return np.where(np.isnan(total), np.inf, total) / len(self.roads)

    def _costs(self, road: RideRoad, laws: Sequence[Controller],
               references: Mapping[tuple[str, int], Figures]) -> np.ndarray:
        rides = drive(self.car, road, [c for c in laws for _ in self.seeds], list(self.seeds) * len(laws),
                      self.settings)
        unit, count = [references[road.name, s] for s in self.seeds], len(self.seeds)
        return np.array([self.objective.of([r.figures for r in rides[k * count:(k + 1) * count]], unit)
                         for k in range(len(laws))])

    def _alone(self, road: RideRoad, law: Controller, references: Mapping[tuple[str, int], Figures]) -> float:
        try:
            return float(self._costs(road, [law], references)[0])
        except NumericalError:
            return np.inf

    def begin(self, law: Controller) -> None:
        """Start a law on one car; raises what its design raises.

        Parameters
        ----------
        law : Controller
            Given the setting of this car; nothing of its start is kept.
        """
        law.start(self.settings.setting(self.car, 1))

    def _starts(self, law: Controller) -> bool:
        """Whether it can be had at all: a design may fail."""
        try:
            self.begin(law)
        except FAILURES:
            return False
        return True


def tune(law: Controller, trial: Trial, budget: int = 64, seed: int = 0,
         references: Mapping[tuple[str, int], Figures] | None = None,
         report_progress: Callable[[str], None] = lambda text: None) -> Tuned:
    """Look for the best values of a law's parameters, within their ranges.

    Latin hypercubes (McKay, Beckman, Conover 1979): half of the budget over all of the ranges, the law's own values
    first, the rest in two rounds in ever smaller boxes about the best so far. Every law gets the same number of
    evaluations, whatever the number of its parameters.

    Parameters
    ----------
    law : Controller
    trial : Trial
    budget : int
        Evaluations.
    seed : int
        Of the points.
    references : mapping, optional
        `Trial.references`, where they are known already.
    report_progress : callable
        Receives what is being done.

    Returns
    -------
    Tuned

    Raises
    ------
    InputError
        A law that cannot work in this setting with its own values; other values that make no law cost infinitely much.
    """
    budget = checks.count(budget, "budget", at_least=4)
    references = references or trial.references()
    rng = np.random.default_rng([seed, 13])
    scale = _ParameterScale(law)
    with suppress(ArithmeticError, np.linalg.LinAlgError):
        trial.begin(law)
    places = scale.to_unit(law.vector)[None] if law.names else np.zeros((1, 0))
    costs = trial.costs([law], references)
    for share, width in ROUNDS:
        count = min(budget - len(costs), max(1, round(share * budget)))
        if not law.names or count < 1:
            break
        report_progress(f"tuning {law.name}: {len(costs)} of {budget}")
        points = _box(places[np.argmin(costs)], width, count, rng)
        found = trial.costs([law.with_vector(scale.to_values(p)) for p in points], references)
        places, costs = np.concatenate([places, points]), np.concatenate([costs, found])
    best = int(np.argmin(costs))
    values = np.array([scale.to_values(p) for p in places])
    chosen = law.with_vector(values[best]) if best else law
    return Tuned(chosen, float(costs[best]), float(costs[0]), len(costs), values, costs)


def tune_all(laws: Mapping[str, Controller], trial: Trial, budget: int = 64,
             report_progress: Callable[[str], None] = lambda text: None,
             workers: int | None = None) -> dict[str, Tuned]:
    """`tune` of several laws on the same rides, each in a process of its own; their number changes nothing.

    Parameters
    ----------
    laws : mapping of str to Controller
    trial : Trial
    budget : int
        Evaluations of each law.
    report_progress : callable
        Receives what is being done.
    workers : int, optional
        Processes; left out, one for each processor.

    Returns
    -------
    dict of str to Tuned

    Raises
    ------
    InputError
        As for `tune`.
    """
    references, names = trial.references(), list(laws)

    def stated(done: int, running: list[int], left: float | None) -> None:
        about = "" if left is None else f", about {left:.0f} s left"
        if running:
            report_progress(f"tuning {', '.join(names[k] for k in running)} ({done} of {len(names)} done{about})")

    ended = in_processes(_tuned, [(laws[n], trial, budget, references) for n in names], workers=workers,
                         report_progress=stated)
    found: dict[str, Tuned] = {}
    for name, one in zip(names, ended, strict=True):
        if one.error is not None:
            raise one.error
        if one.stopped:
            raise KeyboardInterrupt
        assert one.value is not None
        found[name] = one.value
    return found


def _tuned(job: tuple[Controller, Trial, int, Mapping[tuple[str, int], Figures]]) -> Tuned:
    law, trial, budget, references = job
    return tune(law, trial, budget, references=references)


class _ParameterScale:
    """Parameters of a law on [0, 1], logarithmic where marked."""

    def __init__(self, law: Controller) -> None:
        self._log = np.array([p.log for p in law.parameters], dtype=bool)
        low, high = (np.array([getattr(p, end) for p in law.parameters]) for end in ("lower", "upper"))
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise InputError(f"{law.name}: a parameter without a finite range cannot be tuned")
        self._low, self._high = self._inner(low), self._inner(high)
        self._ends = low, high

    def _inner(self, values: np.ndarray) -> np.ndarray:
        return np.where(self._log, np.log(np.where(self._log, values, 1.0)), values)

    def to_unit(self, values: np.ndarray) -> np.ndarray:
        return (self._inner(values) - self._low) / (self._high - self._low)

    def to_values(self, place: np.ndarray) -> np.ndarray:
        inner = self._low + place * (self._high - self._low)
        return np.clip(np.where(self._log, np.exp(np.where(self._log, inner, 0.0)), inner), *self._ends)


def _box(centre: np.ndarray, width: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, P) points of a Latin hypercube in a box of this width about a centre, inside [0, 1]."""
    strata = np.column_stack([rng.permutation(count) for _ in centre])
    low = np.clip(centre - 0.5 * width, 0.0, 1.0 - width)
    return low + width * (strata + rng.random(strata.shape)) / count
