"""best_currents: the current that a damper would have been given, had the whole road been known beforehand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError, NumericalError
from quartercar.criteria import RideFigures as Figures
from quartercar.criteria import judge
from quartercar.criteria.gradient import RideFigure, RideGradient
from quartercar.rides.tuning import CAP, Objective
from quartercar.roads.ride_roads import RideRoad
from quartercar.vehicle.adjoint import AdjointCar
from quartercar.vehicle.batch import Log, start_fleet
from quartercar.vehicle.nonlinear import QuarterCar
from quartercar.vehicle.passivity_balance import RidePassivity, ride_passivity
from quartercar.vehicle.result import CarRun

HELD = 1e-3
"""relative excess over a limit below which it counts as held: a tenth of the least difference that tables print"""
NOTHING = 1e-6
"""energy given, as a share of what the damper takes, that stands for none where the reference gives none"""
GIVEN_WEIGHT, FIGURE_WEIGHT = 0.2, 2.0
"""of the quadratic term of a limit of the energy given, of a figure, at first; they double with every round. From
0.2, 2, 10 for both on 4 s of ISO C: objective .893, .896, .898, least tyre load .842, .811, .816 of passive"""
FURTHER = 8
"""rounds more, at most, from a start that has met no point within the limits: the excess is about the multiplier's
error over the weight, so that 2⁸ times the weight makes of an excess of a few per cent one below `HELD`"""
OUT_OF_BOUNDS = 1e3
"""value of a car that leaves all bounds; the objective of one that does not is of order one"""
MEMORY = 20
"""pairs of L-BFGS-B"""


@dataclass(frozen=True)
class Effort:
    """How long to search; by default some 6 s per road of 20 s at 512 Hz.

    On ISO C the objective after 60, 120, 240, 480, 960 iterations is .8977, .8964, .8954, .8941, .8939 of the passive
    car's; starts differ by 2e-4.

    Attributes
    ----------
    iterations : int
        L-BFGS-B iterations from each start, over all rounds.
    rounds : int
        Updates of the limits' multipliers; up to `FURTHER` more where the limits have not been met by then.
    polish : int
        Further iterations from the best of the starts.
    """

    iterations: int = 40
    rounds: int = 4
    polish: int = 240


@dataclass(frozen=True, eq=False)
class BestCurrents:
    """The best current sequence found on one road.

    Attributes
    ----------
    command : (n,) array
        In the damper's current unit.
    run : CarRun
        The ride under that command, as `replay` gives it to nine digits.
    figures : RideFigures
        Of that run, computed as of any law.
    passivity : RidePassivity
    objective : float
        J, each figure over that of the passive car.
    limits : mapping of str to float
        Under which it was searched.
    by_start : mapping of str to float
        J of the local optimum that each start led to, before the best one was carried on.
    evaluations : int
        Runs with their gradients.
    """

    command: np.ndarray
    run: CarRun
    figures: Figures
    passivity: RidePassivity
    objective: float
    limits: Mapping[str, float]
    by_start: Mapping[str, float]
    evaluations: int


@dataclass(frozen=True, eq=False)
class CurrentSequenceProblem:
    """Minimise J(i) over lowest ≤ i(k) ≤ highest on a known road, figures held below limits.

    Attributes
    ----------
    car : QuarterCar
    road : RideRoad
    seed : int
    sample_time : float
        Of the loop [s].
    reference : RideFigures
        Unit of the figures: the passive car.
    objective : Objective
        As of a tuning.
    limits : mapping of str to float
        Highest value of figures of `RideGradient`: ``given`` [J], ``comfort``, ``tyre_load`` …
    """

    car: QuarterCar
    road: RideRoad
    seed: int
    sample_time: float
    reference: Figures
    objective: Objective
    limits: Mapping[str, float]

    def weights(self, figures: Mapping[str, RideFigure]) -> tuple[float, dict[str, float]]:
        """J as `Objective.of` has it for one ride, and its slopes by the figures.

        Parameters
        ----------
        figures : mapping of str to RideFigure
            Of one run, ``comfort``, ``tyre_load`` and ``stroke`` among them, ``room`` where there are bump stops.

        Returns
        -------
        value : float
            J.
        slopes : dict of str to float
            ∂J/∂figure by name [1/unit of the figure]; 0 for a figure that is not in J.
        """
        o, value = self.objective, 0.0
        slopes = dict.fromkeys(figures, 0.0)
        for name in ("comfort", "tyre_load", "stroke"):
            slopes[name] = getattr(o, name) / getattr(self.reference, name)
            value += slopes[name] * figures[name].value
        if "room" in figures and figures["room"].value > 1:
            value += o.penalty * (figures["room"].value - 1)
            slopes["room"] += o.penalty
        share = figures["tyre_load"].value / self.reference.tyre_load
        if o.tyre_cap is not None and share > o.tyre_cap:
            value += o.penalty * CAP * (share - o.tyre_cap)
            slopes["tyre_load"] += o.penalty * CAP / self.reference.tyre_load
        return value, slopes


class _Search:
    """Augmented Lagrangian of a problem: J + Σ ((μ + w h)_+² − μ²)/2w, h = figure/limit − 1 (Rockafellar 1974)."""

    def __init__(self, problem: CurrentSequenceProblem, effort: Effort) -> None:
        self.problem, self.effort = problem, effort
        elevation = problem.road.profile(problem.sample_time, problem.seed)
        self.elevation = elevation
        self._gradient = RideGradient(AdjointCar(problem.car, elevation, problem.sample_time), problem.road.settle)
        coil = problem.car.coil
        self._low, self._span = coil.lowest, coil.highest - coil.lowest
        if not np.isfinite(self._span):
            raise InputError("the best current needs limits of the current", got=f"up to {coil.highest:g}",
                             mend="a coil with a highest current")
        self.evaluations = 0
        self.best: tuple[float, np.ndarray] | None = None

    def _value(self, x: np.ndarray, multipliers: Mapping[str, float],
               weights: Mapping[str, float]) -> tuple[float, np.ndarray]:
        self.evaluations += 1
        try:
            run = self._gradient.car.run(self._low + self._span * x)
        except NumericalError:  # a step of the line search that throws the car off all bounds is too long
            self._last = np.inf, dict.fromkeys(self.problem.limits, np.inf)
            return OUT_OF_BOUNDS, np.zeros(x.size)
        figures = self._gradient.of(run)
        value, slopes = self.problem.weights(figures)
        self._last = value, {n: figures[n].value / limit - 1 for n, limit in self.problem.limits.items()}
        if max(self._last[1].values(), default=0.0) <= HELD and (self.best is None or value < self.best[0]):
            self.best = value, x.copy()
        for name, excess in self._last[1].items():
            weight = weights[name]
            push = max(0.0, multipliers[name] + weight * excess)
            value += (push**2 - multipliers[name] ** 2) / (2 * weight)
            slopes[name] += push / self.problem.limits[name]
        return value, self._span * self._gradient.gradient(run, figures, slopes)

    def descend(self, start: np.ndarray, iterations: int) -> tuple[float, np.ndarray]:
        """(J, x) of the best point within the limits from a start; J infinite where none was met."""
        from scipy.optimize import minimize

        x, self.best = np.clip((np.asarray(start, dtype=float) - self._low) / self._span, 0, 1), None
        multipliers = dict.fromkeys(self.problem.limits, 0.0)
        weights = {n: GIVEN_WEIGHT if n == "given" else FIGURE_WEIGHT for n in multipliers}
        rounds = self.effort.rounds if multipliers else 1
        for done in range(rounds + (FURTHER if multipliers else 0)):
            if done >= rounds and self.best is not None:
                break
            found = minimize(self._value, x, (multipliers, weights), jac=True, method="L-BFGS-B",
                             bounds=[(0.0, 1.0)] * x.size,
                             options={"maxiter": max(iterations // rounds, 1), "maxcor": MEMORY, "ftol": 1e-8,
                                      "gtol": 1e-9, "maxfun": 20 * iterations})
            x = found.x
            self._value(x, multipliers, weights)
            value, excess = self._last
            if not np.isfinite(value):
                break
            multipliers = {n: max(0.0, m + weights[n] * excess[n]) for n, m in multipliers.items()}
            weights = {n: 2 * w for n, w in weights.items()}
        return (np.inf, x) if self.best is None else self.best

    def run(self, x: np.ndarray) -> CarRun:
        """Every signal of the ride."""
        car = self._gradient.car
        return car.car_run(car.run(self.command(x)), self.command(x))

    def command(self, x: np.ndarray) -> np.ndarray:
        """(n,) in the damper's unit."""
        return self._low + self._span * x


def best_currents(problem: CurrentSequenceProblem, starts: Mapping[str, np.ndarray], effort: Effort | None = None,
                  report_progress: Callable[[str], None] = lambda text: None) -> BestCurrents:
    """Minimise over the whole current sequence at once, the road known, the states perfect, the coil's lag inside.

    L-BFGS-B (Byrd, Lu, Nocedal, Zhu 1995) with the exact gradient of the discrete run, limits by an augmented
    Lagrangian, from several starts; the best is carried on. The problem is not convex: what is found is a current that
    this damper could have had, so that the true optimum is at least as good. No law, which reads less, can be better
    than that optimum.

    Parameters
    ----------
    problem : CurrentSequenceProblem
    starts : mapping of str to (n,) array
        Commands to start from, by name.
    effort : Effort, optional
    report_progress : callable
        Receives what is being done.

    Returns
    -------
    BestCurrents

    Raises
    ------
    InputError
        A damper without gradient, a coil without limits, no start, a start of another length.
    NumericalError
        No point within the limits found.
    """
    effort = effort or Effort()
    search = _Search(problem, effort)
    size = search.elevation.size
    if not starts or any(np.shape(s) != (size,) for s in starts.values()):
        raise InputError("starts are commands, one for each sample of the road",
                         got=str([np.shape(s) for s in starts.values()]), mend=f"arrays of {size}")
    found: dict[str, tuple[float, np.ndarray]] = {}
    for name, start in starts.items():
        report_progress(f"{problem.road.name}, seed {problem.seed}: best current from {name}")
        found[name] = search.descend(start, effort.iterations)
    best = min(found, key=lambda n: found[n][0])
    value, x = found[best]
    if effort.polish:
        report_progress(f"{problem.road.name}, seed {problem.seed}: carrying on from {best}")
        further = search.descend(search.command(x), effort.polish)
        value, x = further if further[0] < value else (value, x)
    if not np.isfinite(value):
        raise NumericalError("no current sequence within the limits was found: "
                             + ", ".join(f"{n} at most {v:.4g}" for n, v in problem.limits.items()))
    run = search.run(x)
    figures = judge(run, problem.road.settle)
    counted = run.after(problem.road.settle) if problem.road.settle else run
    coil = problem.car.coil
    return BestCurrents(search.command(x), run, figures, ride_passivity(counted, (coil.lowest, coil.highest)),
                        problem.objective.of([figures], [problem.reference]), dict(problem.limits),
                        {n: f[0] for n, f in found.items()}, search.evaluations)


def lowest_current(car: QuarterCar, road: RideRoad, seed: int, sample_time: float) -> Figures:
    """Figures of the passive car under the lowest current.

    Parameters
    ----------
    car : QuarterCar
    road : RideRoad
    seed : int
        Of the road.
    sample_time : float
        Of the loop [s].

    Returns
    -------
    RideFigures
    """
    adjoint = AdjointCar(car, road.profile(sample_time, seed), sample_time)
    command = np.full(adjoint.road.size, car.coil.lowest)
    return judge(adjoint.car_run(adjoint.run(command), command), road.settle)


def replay(car: QuarterCar, elevation: np.ndarray, sample_time: float, command: np.ndarray) -> CarRun:
    """The ordinary ride under a given command: as `simulation.drive`, without sensors, observer and law.

    Step by step with the cars of `vehicle.batch`: the check of `best_currents`, a hundred times slower.

    Parameters
    ----------
    car : QuarterCar
    elevation, command : (n,) arrays
    sample_time : float
        [s].

    Returns
    -------
    CarRun
    """
    fleet = start_fleet(car, sample_time, elevation[:1], np.array([car.coil.lowest]))
    log = Log(fleet, elevation[:, None])
    for k in range(elevation.size):
        log.note(command[k:k + 1])
        if k + 1 < elevation.size:
            fleet.advance(elevation[k + 1:k + 2], command[k:k + 1])
    return log.run(0)


def energy_limit(passivity: RidePassivity) -> float:
    """Energy that the best current may have the damper give, from that given under a reference law [J].

    A model that gives energy where its records did not show it would otherwise be rewarded for it. A reference that
    gives none allows a millionth of what it takes.

    Parameters
    ----------
    passivity : RidePassivity
        Of the ride under the reference law.

    Returns
    -------
    float
        Above zero where the damper takes energy.
    """
    return max(passivity.negative_energy, NOTHING * abs(passivity.dissipated))
