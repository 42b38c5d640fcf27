"""compare_rides: control laws on the same roads with the same seeds, their figures with intervals, the best ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.report import number
from lpvid.toolkit import Shown, checks, in_forks
from quartercar.controllers.contract import Controller
from quartercar.controllers.laws.passive import Passive
from quartercar.dampers import Identified
from quartercar.rides.simulation import Ride, RideSettings, drive, side_by_side, without_run
from quartercar.roads.ride_roads import MeasuredRoad, RideRoad
from quartercar.vehicle.assembly import CarAssembly
from quartercar.vehicle.nonlinear import QuarterCar

FIGURES: Mapping[str, tuple[str, Callable[[Ride], float]]] = {
    "comfort": ("m/s^2", lambda r: r.figures.comfort),
    "acceleration": ("m/s^2", lambda r: r.figures.acceleration),
    "dose": ("m/s^1.75", lambda r: r.figures.dose),
    "transient": ("m/s^2", lambda r: r.figures.transient),
    "tyre_load": ("N", lambda r: r.figures.tyre_load),
    "off_road": ("", lambda r: r.figures.off_road),
    "stroke": ("m", lambda r: r.figures.stroke),
    "largest_stroke": ("m", lambda r: r.figures.largest_stroke),
    "dissipated": ("J", lambda r: r.passivity.dissipated),
    "at_limits": ("", lambda r: np.nan if r.at_limits is None else r.at_limits),
    "out_of_reach": ("", lambda r: r.out_of_reach),
    "negative_share": ("", lambda r: r.passivity.negative_share),
    "negative_energy": ("J", lambda r: r.passivity.negative_energy),
    "returned": ("J", lambda r: r.passivity.returned),
}
"""Figures of a ride by name: unit, and where they are found; NaN where a ride has none of the kind."""
_ROUNDING = 1e-12
"""relative difference of a figure that is the order of a sum over 1e4 samples and nothing else"""
AXES = ("comfort", "tyre_load", "stroke")
"""Figures between which a car has to choose; less is better in each."""


@dataclass(frozen=True)
class Interval(Encoded):
    """A mean over seeds and its 95 % interval by Student's t; the ends are None for a single seed.

    Attributes
    ----------
    mean : float
    low, high : float or None
    """

    mean: float
    low: float | None
    high: float | None

    @classmethod
    def of(cls, values: np.ndarray, share: float = 0.95) -> Interval:
        """Of values that stand for themselves, one per seed.

        Parameters
        ----------
        values : (seeds,) array
        share : float
            Probability that the interval covers the mean.

        Returns
        -------
        Interval
            Without ends for a single value, and for values that differ by rounding alone.

        Examples
        --------
        >>> Interval.of(np.array([1.0, 2.0, 3.0])).low.__round__(4)
        -0.4841
        """
        mean = float(np.mean(values))
        if values.size < 2:
            return cls(mean, None, None)
        from scipy.stats import t

        if np.ptp(values) <= values.size * np.finfo(float).eps * np.abs(values).max():
            return cls(mean, None, None)  # the seeds change nothing but the rounding: there is no spread
        half = float(t.ppf(0.5 + share / 2, values.size - 1) * np.std(values, ddof=1) / np.sqrt(values.size))
        return cls(mean, mean - half, mean + half)


@dataclass(frozen=True, eq=False)
class LawRow:
    """One law on one road.

    Attributes
    ----------
    name, title : str
        Of the law; unique within a comparison.
    controller : Controller
    road : str
    rides : tuple of Ride
        One per seed, without signals but for the first.
    """

    name: str
    title: str
    controller: Controller
    road: str
    rides: tuple[Ride, ...]

    def values(self, figure: str) -> np.ndarray:
        """(seeds,) of a figure of `FIGURES`.

        Parameters
        ----------
        figure : str

        Returns
        -------
        (seeds,) array
            In its unit there.
        """
        get = FIGURES[checks.known_name(figure, list(FIGURES), "figure of a ride")][1]
        return np.array([get(r) for r in self.rides])

    def interval(self, figure: str) -> Interval:
        """Mean and interval of a figure.

        Parameters
        ----------
        figure : str
            Of `FIGURES`.

        Returns
        -------
        Interval
        """
        return Interval.of(self.values(figure))

    def against(self, other: LawRow, figure: str) -> Interval:
        """Relative difference to another law, paired by seed: (this − other)/mean of the other.

        Parameters
        ----------
        other : LawRow
            On the same road with the same seeds.
        figure : str
            Of `FIGURES`.

        Returns
        -------
        Interval
            Below zero where this law has less of it.
        """
        theirs = other.values(figure)
        return Interval.of((self.values(figure) - theirs) / max(abs(float(theirs.mean())), 1e-300))

    @property
    def passive(self) -> bool | None:
        """Whether no ride gave energy that was never there; None where the damper's storage is unknown."""
        described = [r.passivity.holds for r in self.rides]
        return None if None in described else all(described)

    @property
    def extrapolation(self) -> dict[str, float]:
        """Mean share of the samples outside what the damper's training records held, as in `Ride`."""
        return {n: float(np.mean([r.extrapolation[n] for r in self.rides])) for n in self.rides[0].extrapolation}

    @property
    def road_ahead_error(self) -> float | None:
        """Rms over the seeds of `Ride.road_ahead_error` [m]."""
        found = [r.road_ahead_error for r in self.rides]
        return None if None in found else float(np.sqrt(np.mean(np.square(np.array(found, dtype=float)))))

    def to_dict(self, reference: LawRow) -> dict:
        """Plain data for JSON.

        Parameters
        ----------
        reference : LawRow
            On the same road, for the differences ``against``.

        Returns
        -------
        dict
            Means and intervals of the figures with their units, counts, extrapolation and passivity.
        """
        first = self.rides[0].passivity
        return {"controller": self.name, "title": self.title, "road": self.road,
                "figures": {n: {**self.interval(n).to_dict(), "unit": unit} for n, (unit, _) in FIGURES.items()},
                "against": {n: self.against(reference, n).to_dict() for n in AXES},
                "counts": {n: float(np.mean([r.counts[n] for r in self.rides])) for n in self.rides[0].counts},
                "extrapolation": self.extrapolation, "road_ahead_error": self.road_ahead_error,
                "passivity": {"storage": first.storage, "holds": self.passive,
                              "lowest": None if first.lowest is None else min(
                                  r.passivity.lowest for r in self.rides if r.passivity.lowest is not None)}}


@dataclass(frozen=True, eq=False)
class RideComparison(Shown):
    """Laws on roads.

    Attributes
    ----------
    rows : tuple of LawRow
        Road by road, the laws in the order given.
    seeds : tuple of int
    reference : str
        Name of the law that differences are taken from.
    notes : tuple of str
    """

    DRAWN_BY: ClassVar[str] = "quartercar.plot.drawings"
    rows: tuple[LawRow, ...]
    seeds: tuple[int, ...]
    reference: str
    notes: tuple[str, ...] = ()

    @property
    def roads(self) -> tuple[str, ...]:
        """Names of the roads."""
        return tuple(dict.fromkeys(r.road for r in self.rows))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the laws."""
        return tuple(dict.fromkeys(r.name for r in self.rows))

    def on(self, road: str) -> tuple[LawRow, ...]:
        """The rows of one road.

        Parameters
        ----------
        road : str
            Its name.

        Returns
        -------
        tuple of LawRow
            Empty for a road that is not in the comparison.
        """
        return tuple(r for r in self.rows if r.road == road)

    def row(self, name: str, road: str) -> LawRow:
        """One law on one road.

        Parameters
        ----------
        name, road : str
            Of the law and of the road; an unknown one is refused.

        Returns
        -------
        LawRow
        """
        checks.known_name(name, self.names, "controller")
        checks.known_name(road, self.roads, "road")
        return next(r for r in self.rows if r.name == name and r.road == road)

    @cached_property
    def front(self) -> Mapping[str, tuple[str, ...]]:
        """Road to the laws that no other beats in comfort and tyre load at once, by their means."""
        return {road: pareto({r.name: tuple(r.interval(a).mean for a in AXES[:2]) for r in self.on(road)})
                for road in self.roads}

    @property
    def verdict(self) -> str:
        """A sentence or two per road: most comfortable, best on the road, laws as good within the spread, the front."""
        stated = []
        for road in self.roads:
            (soft, near), (firm, close) = (self.leaders(road, axis) for axis in AXES[:2])
            stated.append(f"On {road} {soft.name} is the most comfortable ({soft.interval('comfort').mean:.4g} m/s^2 "
                        f"weighted{_tied(near)}) and {firm.name} loads the tyre least unevenly "
                        f"({firm.interval('tyre_load').mean:.4g} N rms{_tied(close)}). Unbeaten in the means of both: "
                        f"{', '.join(self.front[road])}.")
        return " ".join(stated)

    def leaders(self, road: str, figure: str) -> tuple[LawRow, tuple[str, ...]]:
        """The law of the least mean, and those whose paired difference to it may as well be none (95 %).

        Parameters
        ----------
        road : str
        figure : str
            Of `FIGURES`, of which less is better.

        Returns
        -------
        best : LawRow
        near : tuple of str
            Names of the laws that cannot be distinguished from it; for a single seed those whose figure is the same.
        """
        rows = self.on(road)
        best = min(rows, key=lambda r: r.interval(figure).mean)
        gaps = {r.name: r.against(best, figure) for r in rows if r is not best}
        return best, tuple(n for n, gap in gaps.items() if (gap.mean if gap.low is None else gap.low) <= _ROUNDING)

    def to_dict(self) -> dict:
        """ride.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"schema": "quartercar/ride/1", "verdict": self.verdict, "seeds": list(self.seeds),
                "reference": self.reference, "notes": list(self.notes), "front": {k: list(v) for k, v in
                                                                               self.front.items()},
                "rides": [r.to_dict(self.row(self.reference, r.road)) for r in self.rows],
                "controllers": {r.name: r.controller.to_dict() for r in self.on(self.roads[0])}}

    def __str__(self) -> str:
        lines = [self.verdict]
        for road in self.roads:
            several = len(self.seeds) > 1
            lines.append(f"{road}, {len(self.seeds)} seeds, mean ± half of the 95 % interval" if several else
                         f"{road}, one seed: no interval")
            lines += [_line(r) for r in self.on(road)]
        return "\n".join([*lines, *self.notes])

    __repr__ = __str__


def _tied(names: Sequence[str]) -> str:
    return f", not distinguishable from {', '.join(names)}" if names else ""


def _line(row: LawRow) -> str:
    def described(figure: str, scale: float = 1.0) -> str:
        i = row.interval(figure)
        half = "" if i.high is None else f" ± {number(scale * (i.high - i.mean), 2):<7}"
        return f"{scale * i.mean:8.4g}{half}"

    share = row.interval("at_limits").mean
    limits = f"  at limits {share:4.0%}" if np.isfinite(share) else ""
    return (f"  {row.name:<20}comfort {described('comfort')} m/s^2  tyre {described('tyre_load')} N  stroke "
            f"{described('stroke', 1e3)} mm{limits}")


def pareto(points: Mapping[str, tuple[float, ...]]) -> tuple[str, ...]:
    """Names of the points that no other one beats or equals in every coordinate, less being better.

    Parameters
    ----------
    points : mapping of str to tuple of float
        All of one length.

    Returns
    -------
    tuple of str
        In the order given; points that are equal do not beat each other.

    Examples
    --------
    >>> pareto({"a": (1.0, 2.0), "b": (2.0, 1.0), "c": (2.0, 2.0)})
    ('a', 'b')
    """
    def beaten(name: str) -> bool:
        mine = points[name]
        return any(other != mine and all(o <= m for o, m in zip(other, mine, strict=True))
                   for other in points.values())

    return tuple(n for n in points if not beaten(n))


def compare_rides(car: QuarterCar, roads: Sequence[RideRoad], controllers: Mapping[str, Controller],
                  seeds: Sequence[int], settings: RideSettings | None = None, reference: str | None = None,
                  report_progress: Callable[[str], None] = lambda text: None) -> RideComparison:
    """Drive every law over every road with every seed.

    Parameters
    ----------
    car : QuarterCar
    roads : sequence of RideRoad
    controllers : mapping of str to Controller
        By the name that tables give them.
    seeds : sequence of int
        Of roads and noise: the same for every law, so that differences are paired.
    settings : RideSettings, optional
    reference : str, optional
        Law that differences are taken from; ``"sh-add"`` where there is one, else the first.
    report_progress : callable
        Receives what is being done.

    Returns
    -------
    RideComparison

    Raises
    ------
    InputError
        No road, law or seed; as `ride`.
    """
    if not roads or not controllers or not seeds:
        raise InputError("a comparison needs roads, controllers and seeds",
                         got=f"{len(roads)}, {len(controllers)}, {len(seeds)}")
    if len(set(seeds)) < len(seeds) or len({r.name for r in roads}) < len(roads):
        raise InputError("a comparison names a road or a seed twice", got=", ".join(r.name for r in roads))
    names = list(controllers)
    chosen = reference or ("sh-add" if "sh-add" in names else names[0])
    checks.known_name(chosen, names, "controller")
    report_progress(f"riding {', '.join(r.name for r in roads)}")
    for law in controllers.values():
        checks.instance(law, Controller, "a ride is under a control law", "quartercar.controllers.Skyhook()")
    laws, theirs = [controllers[n] for n in names for _ in seeds], list(seeds) * len(names)
    parts = side_by_side(laws)

    def driven(job: tuple[RideRoad, list[int]]) -> list[Ride]:
        road, part = job
        rides = drive(car, road, [laws[k] for k in part], [theirs[k] for k in part], settings)
        return [r if theirs[k] == seeds[0] else without_run(r) for k, r in zip(part, rides, strict=True)]

    jobs = [(road, part) for road in roads for part in parts]
    held = (car, car.damper, *roads, *controllers.values())
    found = dict(zip([(road.name, k) for road, part in jobs for k in part],
                     [r for rides in in_forks(driven, jobs, held) for r in rides], strict=True))
    rows = [LawRow(name, controllers[name].title, controllers[name], road.name,
                   tuple(found[road.name, n * len(seeds) + k] for k in range(len(seeds))))
            for road in roads for n, name in enumerate(names)]
    return RideComparison(tuple(rows), tuple(seeds), chosen, (*_notes(car, rows), *_repeating(car, roads)))


def joined(first: RideComparison, second: RideComparison) -> RideComparison:
    """One comparison of two whose laws were driven apart, on the same roads with the same seeds.

    Parameters
    ----------
    first, second : RideComparison
        Of one car; the reference of the first stands.

    Returns
    -------
    RideComparison
        The figures of `compare_rides` of all laws at once, those of the first before those of the second.

    Raises
    ------
    InputError
        Other roads or seeds, or a law in both.
    """
    if first.roads != second.roads or first.seeds != second.seeds:
        raise InputError("two comparisons over other roads or seeds cannot be joined",
                         got=f"{', '.join(first.roads)} and {', '.join(second.roads)}",
                         why="differences are paired by seed on a road", mend="drive both over the same")
    twice = [n for n in second.names if n in first.names]
    if twice:
        raise InputError("two comparisons hold the same law", got=", ".join(twice), mend="drive it once")
    rows = [row for road in first.roads for row in (*first.on(road), *second.on(road))]
    car = rows[0].rides[0].run.car
    of_roads = tuple(n for n in first.notes if n not in _notes(car, first.rows))
    return RideComparison(tuple(rows), first.seeds, first.reference, (*_notes(car, rows), *of_roads))


def _notes(car: CarAssembly, rows: Sequence[LawRow]) -> tuple[str, ...]:
    return (*_bouncing(car), *_unmoved(car), *_holding(car, rows), *_extrapolating(rows), *_lifting(rows),
            *_estimating(rows))


def _bouncing(car: CarAssembly) -> Iterator[str]:
    """A car whose body is faster than its wheel: masses changed over, or in the wrong unit."""
    body, wheel = car.parameters.body_bounce, car.parameters.wheel_hop
    if body >= wheel:
        yield (f"The body bounces at {body:.3g} Hz and the wheel hops at {wheel:.3g} Hz: a body is the slower one in "
               "every car. Check masses and stiffnesses and their units.")


def _holding(car: CarAssembly, rows: Sequence[LawRow]) -> Iterator[str]:
    """At which current the passive car rides: what the laws gain over it depends on that."""
    damper = car.damper
    if damper is None or "current" not in damper.reads:
        return
    unit = "" if damper.current_unit == "1" else f" {damper.current_unit}"
    for row in rows:
        if row.road == rows[0].road and isinstance(row.controller, Passive):
            yield f"{row.name}: {float(row.rides[0].run['command'][-1]):.4g}{unit} held throughout."


def _repeating(car: CarAssembly, roads: Sequence[RideRoad]) -> Iterator[str]:
    """A track that is driven to and fro so often that its length is what the body is excited by.

    It then holds the frequency V/2L and multiples of it, nothing below.
    """
    body = car.parameters.body_bounce
    for road in roads:
        if isinstance(road, MeasuredRoad) and road.laps > 1:
            lowest = road.speed / (2 * road.track.length)
            if lowest > body:
                yield (f"On {road.name} a track of {road.track.length:.3g} m is driven forwards and backwards in turn: "
                       f"it excites nothing below {lowest:.3g} Hz, and the body bounces at {body:.3g} Hz. Give a "
                       "longer track, or a lower speed.")


def _lifting(rows: Sequence[LawRow]) -> Iterator[str]:
    """Where the wheel leaves the road, road by road."""
    for road in dict.fromkeys(r.road for r in rows):
        shares = {r.name: r.interval("off_road").mean for r in rows if r.road == road}
        worst = max(shares, key=lambda n: shares[n])
        if shares[worst] > 0:
            yield (f"On {road} the wheel is off the road in {_shares(shares)} % of the samples (most under {worst}).")


def _unmoved(car: CarAssembly) -> Iterator[str]:
    """A damper whose characteristic does not read the command: its laws have nothing to act with."""
    damper = car.damper
    if damper is not None and "current" not in damper.reads:
        mend = ("identify it with --schedule current" if isinstance(damper, Identified) else
                "fit a law that follows the current to records in which it varies")
        yield ("The damper's force does not depend on the command, so that every law gives the ride of the passive "
               f"car: {mend}.")


def _estimating(rows: Sequence[LawRow]) -> Iterator[str]:
    """How well the road ahead was estimated, road by road."""
    for road in dict.fromkeys(r.road for r in rows):
        found = next(r.road_ahead_error for r in rows if r.road == road)
        if found:
            yield (f"On {road} the road ahead of the rear axle, estimated from the front axle's sensors, is "
                   f"{1e3 * found:.2g} mm rms off (elevation against the present one, over the whole preview).")


def _extrapolating(rows: Sequence[LawRow]) -> Iterator[str]:
    """Where laws ask the damper for what its training records never held, road by road."""
    for road in dict.fromkeys(r.road for r in rows):
        for name in rows[0].rides[0].extrapolation:
            shares = {r.name: r.extrapolation[name] for r in rows if r.road == road}
            worst = max(shares, key=lambda n: shares[n])
            if shares[worst] > 0:
                yield (f"On {road} the damper's {name} leaves its training records, {_span(rows[0], name)}, in "
                       f"{_shares(shares)} % of the samples (most under {worst}): the force there is extrapolated.")


def _shares(shares: Mapping[str, float]) -> str:
    """The range of some shares in percent, one number where both ends read the same."""
    ends = dict.fromkeys(f"{100 * share:.2g}" for share in (min(shares.values()), max(shares.values())))
    return " to ".join(ends)


def _span(row: LawRow, name: str) -> str:
    """The training range of a quantity in its unit."""
    damper = row.rides[0].run.car.damper
    assert damper is not None
    if name == "current":
        low, high = damper.current_range or (0.0, 0.0)
        return f"{low:.3g} to {high:.3g} {'' if damper.current_unit == '1' else damper.current_unit}".rstrip()
    role, unit = ("velocity", "m/s") if name == "speed" else ("displacement", "m")
    low, high = damper.trained(role) or (0.0, 0.0)
    return f"{low:.3g} to {high:.3g} {unit}"
