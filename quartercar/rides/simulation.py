"""ride: a nonlinear car under a controller, with sensors, observer, inverse damper model and coil in the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.errors import InputError, NumericalError
from lpvid.toolkit import checks
from quartercar.controllers.contract import Controller, Setting
from quartercar.controllers.loop.chain import ChainSettings, ControllerChain
from quartercar.criteria import RideFigures as Figures
from quartercar.criteria import judge
from quartercar.dampers.contract import Damper
from quartercar.lpv_models.active import active_frequency, active_region
from quartercar.parameters import CarParameters
from quartercar.rides.front_axle import EstimateError, look_ahead
from quartercar.rides.preview import Preview
from quartercar.roads.ride_roads import RideRoad
from quartercar.vehicle.batch import Log, start_fleet, true_signals
from quartercar.vehicle.nonlinear import Coil, QuarterCar
from quartercar.vehicle.passivity_balance import RidePassivity, ride_passivity
from quartercar.vehicle.result import CarRun

RATE = 500.0
"""rate of the loop where the damper has none of its own [Hz]"""
MOST = 192
"""cars side by side at most; more take more memory and no less time"""


@dataclass(frozen=True, eq=False)
class RideSettings:
    """What every law of a comparison shares.

    Attributes
    ----------
    chain : ChainSettings
        Sensors, observer, inverse.
    sample_time : float or None
        Of the loop [s]; None for the damper's own, or 2 ms.
    model : Damper or None
        The damper in the inverse and the observer; None for the car's own.
    parameters : CarParameters or None
        The car in laws and observer; None for its own.
    preview : Preview or None
        What the car has of the road ahead: it is then a rear axle behind a front one.
    """

    chain: ChainSettings = field(default_factory=ChainSettings)
    sample_time: float | None = None
    model: Damper | None = None
    parameters: CarParameters | None = None
    preview: Preview | None = None

    def period(self, car: QuarterCar) -> float:
        """Of the loop around this car [s].

        Parameters
        ----------
        car : QuarterCar

        Returns
        -------
        float
            [s].

        Raises
        ------
        InputError
            A known damper that runs at another rate only.
        """
        if self.sample_time is not None:
            found = checks.positive(self.sample_time, "sample_time", "s")
        else:
            found = (None if car.damper is None else car.damper.clock) or 1 / RATE
        known = self.model
        if known is not None and known.clock is not None and abs(known.clock / found - 1) > RATE_TOLERANCE:
            raise InputError(f"the damper as it is known, a '{known.name}', runs at {1 / known.clock:.6g} Hz only",
                             got=f"a loop at {1 / found:.6g} Hz", why="the loop runs at the rate of the car's damper",
                             mend=f"identify it again with --sample-rate {1 / found:.6g}")
        return found

    def setting(self, car: QuarterCar, cars: int) -> Setting:
        """What the laws of so many cars are given.

        Parameters
        ----------
        car : QuarterCar
        cars : int
            Side by side.

        Returns
        -------
        Setting
            Without preview.
        """
        coil = self.coil_of(car)
        return Setting(self.period(car), cars, self.parameters or car.parameters, self.model or car.damper,
                       (coil.lowest, coil.highest), coil)

    def coil_of(self, car: QuarterCar) -> Coil:
        """The coil of a car; of one whose damper follows no current, and is not known as one that does, with limits.

        A command then changes nothing, so that any range serves: 1 where the coil has no highest current.

        Parameters
        ----------
        car : QuarterCar

        Returns
        -------
        Coil
        """
        dampers = [d for d in (car.damper, self.model) if d is not None]
        if np.isfinite(car.coil.highest) or any("current" in d.reads for d in dampers):
            return car.coil
        return replace(car.coil, highest=car.coil.lowest + 1.0)


@dataclass(frozen=True, eq=False)
class Ride:
    """One ride of one car under one controller.

    Attributes
    ----------
    controller : Controller
    road : str
    seed : int
    run : CarRun
        Every signal, the start included.
    figures : RideFigures
        Comfort, tyre load, stroke, the start left out.
    passivity : RidePassivity
    at_limits : float or None
        Share of the samples whose command stood at a limit of the current; None where the damper follows no current.
    out_of_reach : float
        Share of the samples whose demand the damper could not meet.
    counts : mapping of str to float
        What the law counted, as a share of the samples.
    extrapolation : mapping of str to float
        ``current``, ``speed`` and ``stroke`` of the damper: share of the samples outside what its training records
        held, of those that its model reads and whose range is known.
    road_ahead_error : float or None
        Rms over the ride and over all places ahead of what the elevation there, less the present one, was estimated
        wrong by [m]; None without preview.
    """

    controller: Controller
    road: str
    seed: int
    run: CarRun
    figures: Figures
    passivity: RidePassivity
    at_limits: float | None
    out_of_reach: float
    counts: Mapping[str, float]
    extrapolation: Mapping[str, float] = field(default_factory=dict)
    road_ahead_error: float | None = None

    def __repr__(self) -> str:
        counted = "".join(f", {n.replace('_', ' ')} {v:.1%}" for n, v in self.counts.items())
        counted += "".join(f", {n} outside the damper's records {v:.1%}" for n, v in self.extrapolation.items() if v)
        if self.road_ahead_error is not None:
            counted += f", road ahead estimated to {1e3 * self.road_ahead_error:.2g} mm rms"
        share = self.at_limits
        current = "the damper follows none" if share is None else f"at a limit {share:.0%} of the time"
        return (f"Ride of {self.controller.name} on {self.road}, seed {self.seed}\n{self.figures}\n"
                f"current    {current}, demand out of reach {self.out_of_reach:.0%}{counted}\n"
                f"energy     {self.passivity}")


def ride(car: QuarterCar, road: RideRoad, controller: Controller, seed: int = 0,
         settings: RideSettings | None = None) -> Ride:
    """Drive a car over a road under a controller.

    Parameters
    ----------
    car : QuarterCar
        With a coil whose limits are finite where its damper follows a current.
    road : RideRoad
    controller : Controller
    seed : int
        Of the road and of the sensors' noise.
    settings : RideSettings, optional
        Sensors (stroke and body acceleration by default), observer, inverse, rate.

    Returns
    -------
    Ride

    Raises
    ------
    InputError
        A law that reads what is not measured, a coil without limits, rates that do not fit.
    NumericalError
        A car that leaves all bounds.

    Examples
    --------
    >>> from quartercar.vehicle.nonlinear import Coil
    >>> from quartercar.controllers import Skyhook
    >>> from quartercar.dampers import Guo
    >>> from quartercar.parameters import MEGANE
    >>> from quartercar.roads.ride_roads import IsoRoad
    >>> damper = Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0), hysteresis=False)
    >>> car = QuarterCar(MEGANE, damper, coil=Coil(0.005, 0.01, highest=2.0))
    >>> found = ride(car, IsoRoad("B", 20.0, 1.0), Skyhook())
    >>> 0 < found.figures.comfort < 2
    True
    """
    return drive(car, road, [controller], [seed], settings)[0]


def drive(car: QuarterCar, road: RideRoad, controllers: Sequence[Controller], seeds: Sequence[int],
          settings: RideSettings | None = None) -> list[Ride]:
    """Every controller with the seed beside it; laws run side by side as far as they demand the same thing.

    Parameters
    ----------
    car : QuarterCar
    road : RideRoad
    controllers : sequence of Controller
    seeds : sequence of int
        Of the road and of the sensors' noise, one for each controller.
    settings : RideSettings, optional

    Returns
    -------
    list of Ride
        In the order of the controllers.

    Raises
    ------
    InputError
        Another number of seeds than of controllers; as `ride`.
    NumericalError
        A car that leaves all bounds.
    """
    checks.instance(car, QuarterCar, "a ride is that of a QuarterCar")
    checks.instance(road, RideRoad, "a ride is over a road of quartercar.roads.ride_roads", 'IsoRoad("C", 20.0, 10.0)')
    for controller in controllers:
        checks.instance(controller, Controller, "a ride is under a control law", "quartercar.controllers.Skyhook()")
    if len(controllers) != len(seeds):
        raise InputError("every controller needs a seed", got=f"{len(seeds)} for {len(controllers)}")
    settings = settings or RideSettings()
    found: dict[int, Ride] = {}
    for part in side_by_side(controllers):
        rides = _together(car, road, [controllers[k] for k in part], [seeds[k] for k in part], settings)
        found.update(zip(part, rides, strict=True))
    return [found[k] for k in range(len(controllers))]


def side_by_side(controllers: Sequence[Controller]) -> list[list[int]]:
    """Which laws run side by side: those that demand the same thing, `MOST` at a time.

    Parameters
    ----------
    controllers : sequence of Controller

    Returns
    -------
    list of list of int
        Their places in the sequence.
    """
    found = []
    for kind in dict.fromkeys(c.demands for c in controllers):
        places = [k for k, c in enumerate(controllers) if c.demands == kind]
        found += [places[first:first + MOST] for first in range(0, len(places), MOST)]
    return found


def _together(car: QuarterCar, road: RideRoad, controllers: Sequence[Controller], seeds: Sequence[int],
              settings: RideSettings) -> list[Ride]:
    step = settings.period(car)
    profiles = {seed: road.profile(step, seed) for seed in dict.fromkeys(seeds)}
    elevation = np.column_stack([profiles[s] for s in seeds])
    n, cars = elevation.shape
    _long_enough(road, n, step)
    setting = settings.setting(car, cars)
    ahead = look_ahead(car, road, settings.preview, setting, settings.chain, seeds, elevation)
    setting = replace(setting, preview=ahead.samples, road_error=ahead.road_error)
    missed, settled = EstimateError(elevation, ahead.samples), int(np.ceil(road.settle / step))
    limits = setting.currents
    noise = [np.random.default_rng([s, 2631]) for s in seeds]
    chain = ControllerChain(controllers, setting, setting.coil, settings.chain, noise, n)
    fleet = start_fleet(car, step, elevation[0], np.full(cars, limits[0]))
    log = Log(fleet, elevation)
    try:
        for k in range(n):
            coming = ahead.look(k)
            if ahead.samples and settled <= k < n - ahead.samples:
                missed.note(k, coming)
            command = chain.step(true_signals(fleet), coming)
            log.note(command)
            if k + 1 < n:
                fleet.advance(elevation[k + 1], command)
    except NumericalError as error:
        raise NumericalError(f"{error}{_given_energy(car.damper, limits)}") from None
    counts = {name: a / n for name, a in chain.counted().items()}
    rides = [_ride(log.run(c), controllers[c], road, seeds[c], limits, chain.clipped[c] / n,
                   chain.out_of_reach[c] / n, {name: float(a[c]) for name, a in counts.items()})
             for c in range(cars)]
    if ahead.samples:
        rides = [replace(r, road_ahead_error=float(e)) for r, e in zip(rides, missed.rms, strict=True)]
    return rides


def _long_enough(road: RideRoad, samples: int, step: float) -> None:
    """Refuse a road that leaves no two samples after the start that no figure counts."""
    counted = samples - int(np.ceil(road.settle / step - 1e-9))
    if counted < 2:
        raise InputError(f"the ride on {road.name} is too short", got=f"{max(counted, 0)} samples of {step:.4g} s that "
                         "count", why="figures need at least 2", mend=road.longer)


def _ride(run: CarRun, controller: Controller, road: RideRoad, seed: int, limits: tuple[float, float],
          at_limits: float, out_of_reach: float, counts: Mapping[str, float]) -> Ride:
    counted = run.after(road.settle) if road.settle else run
    follows = run.car.damper is not None and "current" in run.car.damper.reads
    return Ride(controller, road.name, seed, run, judge(run, road.settle), ride_passivity(counted, limits),
                float(at_limits) if follows else None, float(out_of_reach), counts, extrapolation(run))


@lru_cache(maxsize=64)
def _given_energy(damper: Damper | None, currents: tuple[float, float]) -> str:
    """Where the damper of a car that left all bounds gives energy, and what to do about it."""
    if damper is None:
        return ""
    found = active_region(damper, currents) or active_frequency(damper, currents)
    stated = str(found) if found is not None else damper.passivity(0.5).description
    if stated:
        return (f". Of the '{damper.name}' damper: {stated}. Mend: fit or identify it again with --passive, or with "
                "more records at these currents and speeds")
    return (f". The '{damper.name}' damper takes energy at every current that is held. Mend: `lpvid stability` states "
            "whether it is stable while the current moves; else another structure, or --passive")


def extrapolation(run: CarRun) -> dict[str, float]:
    """Share of a run's samples at which its damper was evaluated outside its training records.

    A hundredth of the range, `Damper.slack` for the current, still counts as inside.

    Parameters
    ----------
    run : CarRun

    Returns
    -------
    dict of str to float
        ``current``, ``speed``, ``stroke``: those that the damper's model reads and whose range it has.
    """
    damper = run.car.damper
    if damper is None:
        return {}
    found = {}
    if "current" in damper.reads and damper.current_range is not None:
        found["current"] = damper.outside(run["current"])
    for name, role, signal in (("speed", "velocity", run["suspension_velocity"]),
                               ("stroke", "displacement", run["suspension_deflection"] + damper.centre)):
        span = damper.trained(role)
        if role in damper.reads and span is not None:
            slack = 0.01 * (span[1] - span[0])
            found[name] = float(np.mean((signal < span[0] - slack) | (signal > span[1] + slack)))
    return found


def without_run(found: Ride) -> Ride:
    """The same with its signals thinned to nothing, for collections of many rides.

    Parameters
    ----------
    found : Ride

    Returns
    -------
    Ride
        With the first two samples of its run.
    """
    return replace(found, run=short_run(found.run))


def short_run(run: CarRun) -> CarRun:
    """The first two samples of a run.

    Parameters
    ----------
    run : CarRun

    Returns
    -------
    CarRun
    """
    return CarRun(run.sample_time, {n: a[:2] for n, a in run.signals.items()}, run.units, run.static_load, run.car)
