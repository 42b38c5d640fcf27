"""FrontAxle: the axle that meets a road first, and what its sensors make of it for the axle behind."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from quartercar.controllers.contract import Setting
from quartercar.controllers.loop.chain import ChainSettings, ControllerChain
from quartercar.controllers.loop.road_estimate import RoadEstimator
from quartercar.controllers.loop.sensing import Sensing
from quartercar.rides.preview import Preview
from quartercar.roads.ride_roads import RideRoad
from quartercar.vehicle.batch import start_fleet, true_signals
from quartercar.vehicle.nonlinear import QuarterCar

KNOWN_ERROR = 1e-6
"""share of the road's spectrum that an observer is given where the road is known: none, but for a Riccati equation that
needs noise"""


class Ahead(ABC):
    """What is known of the road ahead of (cars,) rear axles, sample by sample.

    Attributes
    ----------
    samples : int
        P, how far ahead.
    road_error : float
        As in `contract.Setting`.
    """

    samples: int = 0
    road_error: float = 1.0

    @abstractmethod
    def look(self, k: int) -> np.ndarray:
        """(cars, P) elevations at the samples k + 1 … k + P less that at k [m]; called once for each k, in order.

        Parameters
        ----------
        k : int
            From 0 on.

        Returns
        -------
        (cars, P) array
            [m].
        """


class _Blind(Ahead):
    """No preview."""

    def __init__(self, cars: int) -> None:
        self._none = np.zeros((cars, 0))

    def look(self, k: int) -> np.ndarray:
        return self._none


class Known(Ahead):
    """The profile itself; beyond its end the road stays as it is there.

    Parameters
    ----------
    profiles : (n, cars) array
        Elevations under the rear axles [m].
    samples : int
        P.
    """

    def __init__(self, profiles: np.ndarray, samples: int) -> None:
        self.samples, self.road_error = samples, KNOWN_ERROR
        self._profiles = np.concatenate([profiles, np.repeat(profiles[-1:], samples, axis=0)])

    def look(self, k: int) -> np.ndarray:
        return (self._profiles[k + 1:k + 1 + self.samples] - self._profiles[k]).T


class FrontAxle(Ahead):
    """A front axle for each seed: a quarter car of its own with sensors, law and the estimate of its road.

    It is the rear car once more, at rest at the start where the road is that much ahead; the two do not act on each
    other (no pitch). The front reaches a place wheelbase/speed before the rear does; between samples the register is
    linear.

    Parameters
    ----------
    car : QuarterCar
    profiles : (n, seeds) array
        Of the rear axle.
    delay : float
        Between the axles [s].
    preview : Preview
    setting : Setting
        Of the laws.
    settings : ChainSettings
        Of the rear axle.
    seeds : sequence of int
    speed : float or None
        Of the car [m/s], for the spectrum that the estimate expects; None for that of the settings.
    """

    def __init__(self, car: QuarterCar, profiles: np.ndarray, delay: float, preview: Preview, setting: Setting,
                 settings: ChainSettings, seeds: Sequence[int], speed: float | None = None) -> None:
        n, cars = profiles.shape
        late = delay / setting.sample_time
        self.samples = int(np.floor(late + 1e-9))
        at = np.arange(n) + late
        self._road = np.column_stack([np.interp(at, np.arange(n), z) for z in profiles.T])
        setting = replace(setting, cars=cars, preview=0, road_error=1.0)
        sensors = preview.sensors or settings.sensors
        expected = settings.observer if speed is None else replace(settings.observer, speed=speed)
        self._estimate = RoadEstimator(setting, sensors, expected, int(np.ceil(late)) + 1)
        self.road_error = self._estimate.road_error
        noise = [np.random.default_rng([s, 2631, 1]) for s in seeds]
        self._sensing = Sensing(sensors, setting.sample_time, noise, n)
        settings = replace(settings, sensors=sensors)
        self._chain = ControllerChain([preview.law] * cars, setting, car.coil, settings, noise, 1)
        self._fleet = start_fleet(car, setting.sample_time, self._road[0], np.full(cars, setting.currents[0]))
        self._force = np.zeros(cars)
        lags = late - np.arange(self.samples + 1)
        self._lower = np.maximum(np.floor(lags + 1e-9).astype(int), 0)
        self._share = np.maximum(lags - self._lower, 0.0)

    def look(self, k: int) -> np.ndarray:
        readings = self._sensing(true_signals(self._fleet))
        command = self._chain.react(readings)
        force = self._chain.model_force.copy()
        register = self._estimate(readings, 0.5 * (self._force + force), force)
        self._force = force
        if k + 1 < len(self._road):
            self._fleet.advance(self._road[k + 1], command)
        levels = register[:, self._lower] * (1 - self._share) + register[:, self._lower + 1] * self._share
        return levels[:, 1:] - levels[:, :1]


class _Shared(Ahead):
    """Cars of the same seed see the same front axle."""

    def __init__(self, fronts: Ahead, places: np.ndarray) -> None:
        self._fronts, self._places = fronts, places
        self.samples, self.road_error = fronts.samples, fronts.road_error

    def look(self, k: int) -> np.ndarray:
        return self._fronts.look(k)[self._places]


def look_ahead(car: QuarterCar, road: RideRoad, preview: Preview | None, setting: Setting, settings: ChainSettings,
               seeds: Sequence[int], elevation: np.ndarray) -> Ahead:
    """What (cars,) rear axles with a seed each have of a road of (n, cars) elevations.

    Parameters
    ----------
    car : QuarterCar
    road : RideRoad
    preview : Preview or None
        None for cars without preview.
    setting : Setting
        Of the laws.
    settings : ChainSettings
        Of the rear axle.
    seeds : sequence of int
        One per car; cars of one seed share a front axle.
    elevation : (n, cars) array
        Of the road under the rear axles [m].

    Returns
    -------
    Ahead
    """
    if preview is None:
        return _Blind(len(seeds))
    delay = preview.delay(road)
    unique = list(dict.fromkeys(seeds))
    profiles = elevation[:, [list(seeds).index(s) for s in unique]]
    places = np.array([unique.index(s) for s in seeds])
    sensors = preview.sensors or settings.sensors
    if preview.front == "known" or sensors.ideal:
        return _Shared(Known(profiles, int(np.floor(delay / setting.sample_time + 1e-9))), places)
    speed = road.to_dict().get("speed")
    return _Shared(FrontAxle(car, profiles, delay, preview, setting, settings, unique, speed), places)


class EstimateError:
    """Root mean square of what an estimate of the road ahead is wrong by, car by car.

    Attributes
    ----------
    samples : int
        Counted so far.
    """

    def __init__(self, elevation: np.ndarray, ahead: int) -> None:
        self._true = Known(elevation, ahead)
        self._sum, self.samples = np.zeros(elevation.shape[1]), 0

    def note(self, k: int, found: np.ndarray) -> None:
        """Count the estimate at sample k; rides leave out samples from which the road ends within the preview.

        Parameters
        ----------
        k : int
        found : (cars, P) array
            Elevations ahead less that at k, as estimated [m].
        """
        gap = found - self._true.look(k)
        self._sum += np.mean(gap**2, axis=1)
        self.samples += 1

    @property
    def rms(self) -> np.ndarray:
        """(cars,) over samples and places ahead, of the elevation against the present one [m]."""
        return np.sqrt(self._sum / max(self.samples, 1))
