"""bound_rides: what the damper could have reached on the roads of a comparison, and each law as a share of that."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid.toolkit import checks
from quartercar.criteria import RideFigures as Figures
from quartercar.rides.clairvoyant import (
    BestCurrents,
    CurrentSequenceProblem,
    Effort,
    best_currents,
    energy_limit,
    lowest_current,
)
from quartercar.rides.comparison import Interval, RideComparison
from quartercar.rides.relaxation import RelaxedBound, relaxed_bound
from quartercar.rides.simulation import Ride, RideSettings, drive, short_run
from quartercar.rides.tuning import Objective
from quartercar.roads.ride_roads import RideRoad
from quartercar.vehicle.adjoint import refuse_without_gradient
from quartercar.vehicle.nonlinear import QuarterCar

AIMS: Mapping[str, tuple[Objective | None, str]] = {
    "objective": (None, ""), "comfort": (Objective(1.0, 0.0), "tyre_load"),
    "tyre_load": (Objective(0.0, 1.0), "comfort")}
"""What is made least, and which figure of the reference law limits it; None for the objective that is given."""
MEASURES = ("objective", "comfort", "tyre_load")
"""Of which each law's share is given."""


@dataclass(frozen=True)
class BoundSettings:
    """How a bound is searched.

    Attributes
    ----------
    seeds : int
        Of the comparison, the first ones.
    objective : Objective
        As of a tuning, over the passive car under the lowest current.
    ends : bool
        Also the least comfort at the reference law's tyre load, and the least tyre load at its comfort.
    linear : bool
        Also the car without bump stops and lift-off.
    effort : Effort
    """

    seeds: int = 2
    objective: Objective = field(default_factory=Objective)
    ends: bool = True
    linear: bool = True
    effort: Effort = field(default_factory=Effort)

    def __post_init__(self) -> None:
        checks.count(self.seeds, "seeds of a bound", at_least=1)


@dataclass(frozen=True, eq=False)
class Bound:
    """The best current sequences found on one road.

    Attributes
    ----------
    road, car : str
        Name of the road; ``"nonlinear"`` or ``"linear"`` (no bump stops, no lift-off).
    seeds : tuple of int
    objective : Objective
    reference : str
        Law whose given energy, and whose other figure at the ends, is the limit.
    best : mapping of str to tuple of BestCurrents
        By aim of `AIMS`, one per seed; without signals but for the first.
    passive : tuple of RideFigures
        The passive car of the same kind under the lowest current, one per seed.
    laws : mapping of str to tuple of RideFigures
        Laws of the comparison; empty for the linear car, in which they did not ride.
    floor : tuple of RelaxedBound
        Certified lower bounds of the objective, one per seed; of the linear car alone.
    """

    road: str
    car: str
    seeds: tuple[int, ...]
    objective: Objective
    reference: str
    best: Mapping[str, tuple[BestCurrents, ...]]
    passive: tuple[Figures, ...]
    laws: Mapping[str, tuple[Figures, ...]]
    floor: tuple[RelaxedBound, ...] = ()

    def values(self, figures: Sequence[Figures], measure: str) -> np.ndarray:
        """(seeds,) of a measure of `MEASURES`; the objective is over the passive car.

        Parameters
        ----------
        figures : sequence of RideFigures
            One per seed.
        measure : str
            Of `MEASURES`, or another figure's name.

        Returns
        -------
        (seeds,) array
            In the unit of the figure; the objective has none.
        """
        if measure != "objective":
            return np.array([getattr(f, measure) for f in figures])
        return np.array([self.objective.of([f], [p]) for f, p in zip(figures, self.passive, strict=True)])

    def at(self, aim: str = "objective") -> tuple[Figures, ...]:
        """Figures of the best currents, one per seed.

        Parameters
        ----------
        aim : str
            Of those in `best`.

        Returns
        -------
        tuple of RideFigures
        """
        return tuple(b.figures for b in self.best[aim])

    def share(self, law: str, measure: str = "objective") -> Interval | None:
        """(passive − law)/(passive − bound), by sums over the seeds; None where the bound wins nothing there.

        Its interval is that of the mean over the seeds of (passive − law)/(mean of passive − bound).

        Parameters
        ----------
        law : str
            Of those in `laws`.
        measure : str
            Of `MEASURES`.

        Returns
        -------
        Interval or None
            1 for a law as good as the bound, 0 for one as good as the passive car.
        """
        passive, best = self.values(self.passive, measure), self.values(self.at(), measure)
        won = float(np.mean(passive - best))
        return None if won <= 0 else Interval.of((passive - self.values(self.laws[law], measure)) / won)

    def against_reference(self, aim: str, measure: str) -> Interval | None:
        """Relative difference of the bound to the reference law, paired by seed.

        Parameters
        ----------
        aim : str
            Of those in `best`.
        measure : str
            Of `MEASURES`.

        Returns
        -------
        Interval or None
            (bound − reference)/mean of the reference; None where the reference law did not ride in this car.
        """
        if self.reference not in self.laws:
            return None
        theirs = self.values(self.laws[self.reference], measure)
        return Interval.of((self.values(self.at(aim), measure) - theirs) / float(theirs.mean()))

    def to_dict(self) -> dict:
        """Part of ride.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        def figures(aim: str) -> dict:
            return {m: Interval.of(self.values(self.at(aim), m)).to_dict() for m in (*MEASURES, "stroke")}

        best = {aim: {"figures": figures(aim),
                      "against": {m: None if (a := self.against_reference(aim, m)) is None else a.to_dict()
                                  for m in MEASURES},
                      "given": [b.passivity.negative_energy for b in found], "limits": [dict(b.limits) for b in found],
                      "by_start": [dict(b.by_start) for b in found], "evaluations": [b.evaluations for b in found]}
                for aim, found in self.best.items()}
        shares = {law: {m: None if (s := self.share(law, m)) is None else s.to_dict() for m in MEASURES}
                  for law in self.laws}
        return {"road": self.road, "car": self.car, "seeds": list(self.seeds), "objective": self.objective.description,
                "reference": self.reference, "obtained": obtained(self), "best": best, "shares": shares,
                "floor": [f.to_dict() for f in self.floor],
                "passive": {m: Interval.of(self.values(self.passive, m)).to_dict() for m in MEASURES}}

    def __str__(self) -> str:
        lines = [f"{self.road}, clairvoyant bound over the {self.car} car: {obtained(self)}"]
        names = {"objective": "least objective", "comfort": f"least comfort, tyre load of {self.reference}",
                 "tyre_load": f"least tyre load, comfort of {self.reference}"}
        for aim in self.best:
            comfort, tyre = (Interval.of(self.values(self.at(aim), m)).mean for m in MEASURES[1:])
            gaps = [self.against_reference(aim, m) for m in MEASURES[1:]]
            stated = "" if gaps[0] is None or gaps[1] is None else (
                f"  {100 * gaps[0].mean:+.1f} % and {100 * gaps[1].mean:+.1f} % to {self.reference}")
            lines.append(f"  {names[aim]:<36}comfort {comfort:8.4g} m/s^2  tyre {tyre:8.4g} N{stated}")
        if self.laws:
            lines.append("  share of the way from the car at the lowest current to that bound: objective, "
                         "comfort, tyre load")
            lines += [f"    {law:<18}" + "".join(f"{share_text(self.share(law, m)):>16}" for m in MEASURES)
                      for law in self.laws]
        if self.floor:
            lines.append(f"  {floor_text(self)}")
        return "\n".join(lines)

    __repr__ = __str__


def share_text(share: Interval | None) -> str:
    """A share with half of its interval.

    Parameters
    ----------
    share : Interval or None

    Returns
    -------
    str
        [%]; a dash for None, no half width for a single seed.

    Examples
    --------
    >>> share_text(Interval(0.25, 0.2, 0.3)), share_text(None)
    ('25 ± 5.0 %', '-')
    """
    if share is None:
        return "-"
    half = "" if share.high is None else f" ± {100 * (share.high - share.mean):.1f}"
    return f"{100 * share.mean:.0f}{half} %"


def floor_text(bound: Bound) -> str:
    """The certified lower bounds, in a sentence.

    Parameters
    ----------
    bound : Bound
        With a `floor`.

    Returns
    -------
    str
    """
    low, best = (float(np.mean(v)) for v in ([f.value for f in bound.floor],
                                             bound.values(bound.at(), "objective")))
    reach, slope = max(f.reach for f in bound.floor), float(np.mean([f.slope for f in bound.floor]))
    return (f"objective: {best:.4g} of the car at the lowest current found; certified that no force within "
            f"{reach:.4g} N of {slope:.4g} N*s/m, were it an active one, makes it less than {low:.4g}")


def obtained(bound: Bound) -> str:
    """How a bound was obtained, in one sentence.

    Parameters
    ----------
    bound : Bound

    Returns
    -------
    str
    """
    starts = len(bound.best["objective"][0].by_start)
    count = "one seed" if len(bound.seeds) == 1 else f"{len(bound.seeds)} seeds"
    return (f"best current sequence found for the known road, states perfect, coil's lag inside ({count}; exact "
            f"gradient, {starts} start{'s' if starts > 1 else ''}; a local optimum, so that the true bound is as good "
            f"or better); energy given by the damper held at that under {bound.reference}")


def bound_rides(car: QuarterCar, roads: Sequence[RideRoad], found: RideComparison,
                settings: RideSettings | None = None, how: BoundSettings | None = None,
                report_progress: Callable[[str], None] = lambda text: None) -> tuple[Bound, ...]:
    """Search the clairvoyant bound of every road of a comparison.

    Starts are the commands of the reference law, of the best law by the objective, and of the passive car; the linear
    car starts from the nonlinear car's best.

    Parameters
    ----------
    car : QuarterCar
    roads : sequence of RideRoad
        Those of the comparison.
    found : RideComparison
    settings : RideSettings, optional
        As of the comparison.
    how : BoundSettings, optional
    report_progress : callable
        Receives what is being done.

    Returns
    -------
    tuple of Bound
        Road by road; nonlinear before linear.

    Raises
    ------
    InputError
        A damper without gradient.
    """
    refuse_without_gradient(car.damper)
    settings, how = settings or RideSettings(), how or BoundSettings()
    seeds = found.seeds[:how.seeds]
    bounds: list[Bound] = []
    for road in roads:
        first = _road_bound(car, "nonlinear", road, found, seeds, settings, how, None, report_progress)
        bounds.append(first)
        if how.linear:
            straight = replace(car, stops=None, lift_off=False)
            bounds.append(_road_bound(straight, "linear", road, found, seeds, settings, how, first, report_progress))
    return tuple(replace(b, best={a: tuple(_thinned(x, k) for k, x in enumerate(v)) for a, v in b.best.items()})
                 for b in bounds)


def _thinned(best: BestCurrents, seed: int) -> BestCurrents:
    return best if seed == 0 else replace(best, run=short_run(best.run))


def _road_bound(car: QuarterCar, kind: str, road: RideRoad, found: RideComparison, seeds: tuple[int, ...],
                settings: RideSettings, how: BoundSettings, nonlinear: Bound | None,
                report_progress: Callable[[str], None]) -> Bound:
    """The bound of one kind of car on one road."""
    rows = found.on(road.name)
    reference = found.row(found.reference, road.name)
    period = settings.period(car)
    passive = tuple(lowest_current(car, road, seed, period) for seed in seeds)
    laws = {r.name: tuple(x.figures for x in r.rides[:len(seeds)]) for r in rows}
    costs = {n: how.objective.of(f, passive) for n, f in laws.items()}
    chosen = dict.fromkeys([found.reference, min(costs, key=lambda n: costs[n])])
    chosen_laws = [found.row(n, road.name).controller for n in chosen for _ in seeds]
    rides = drive(car, road, chosen_laws, list(seeds) * len(chosen), settings) if nonlinear is None else []
    floor: list[RelaxedBound] = []
    best: dict[str, list[BestCurrents]] = {aim: [] for aim in (AIMS if how.ends else ("objective",))}
    for k, seed in enumerate(seeds):
        held = reference.rides[k]
        if nonlinear is None:
            starts = {n: r.run["command"] for n, r in zip(chosen, rides[k::len(seeds)], strict=True)}
            starts["lowest current"] = np.full(rides[0].run.n_samples, car.coil.lowest)
        else:
            starts = {"nonlinear car": nonlinear.best["objective"][k].command}
        problem = CurrentSequenceProblem(car, road, seed, period, passive[k], how.objective,
                          {"given": energy_limit(held.passivity)})
        for aim in best:
            part, from_, effort = _aimed(problem, aim, held), starts, how.effort
            if aim != "objective":
                from_ = {"objective": best["objective"][k].command}
            if len(from_) == 1:  # from a neighbouring optimum
                effort = replace(effort, iterations=effort.polish // 2, polish=0)
            best[aim].append(best_currents(part, from_, effort, lambda text: report_progress(f"{text}, {kind} car")))
        if nonlinear is not None:
            floor.append(relaxed_bound(problem, best["objective"][k], report_progress=report_progress))
    return Bound(road.name, kind, seeds, how.objective, found.reference, {a: tuple(v) for a, v in best.items()},
                 passive, laws if nonlinear is None else {}, tuple(floor))


def _aimed(problem: CurrentSequenceProblem, aim: str, held: Ride) -> CurrentSequenceProblem:
    """The problem of another aim: its figure least, the other one held at the reference law's."""
    objective, limited = AIMS[aim]
    if objective is None:
        return problem
    return replace(problem, objective=objective,
                   limits={**problem.limits, limited: getattr(held.figures, limited)})
