"""RoadEstimator: the profile that an axle has met, from its own sensors, by a Kalman filter with a register.

The register is the steady fixed-lag smoother (Anderson, Moore 1979, *Optimal Filtering*, section 7.3): what was
estimated of the road j samples ago is corrected by every later reading, so that a rear axle meets a better estimate
than the front axle had when it met the same place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from quartercar.controllers.contract import Setting
from quartercar.controllers.loop.observer import ObservedCar, ObserverSettings, observed_car, times
from quartercar.controllers.loop.sensing import MeasurementSet

CUTOFF = 0.01
"""of the road's spectrum, n_00, below which it is flat [cycles/m], as in `quartercar.roads.iso8608`: no sensor of the
axle measures the elevation itself"""
BAND = np.geomspace(0.5, 20.0, 40)
"""of body and wheel modes, in which the error of the road counts [Hz]"""


class RoadEstimator:
    """The road of many axles up to some samples ago.

    ::

        ẋ = A x + B_F (F + e) + B_r ż_r,    ż_r = −2π n_00 V z_r + w       e, sensors as in `KalmanObserver`
        ẑ_r(k−j | k) = ẑ_r(k−j | k−1) + g_j ν(k),    g_j = E[z_r(k−j) x̃(k)ᵀ] Cᵀ S⁻¹,  ν the innovation, S its covariance

    Parameters
    ----------
    setting : Setting
    readings : MeasurementSet
        The deflection and an acceleration at least.
    settings : ObserverSettings
        With the speed of the car.
    samples : int
        Length of the register less one.

    Attributes
    ----------
    gain : (samples + 1, r) array
        g_j.
    error : (samples + 1,) array
        Standard deviation of the error of ẑ_r(k−j | k) on the road of the settings [m]; most of it is elevation that
        no sensor measures and that cancels in differences.
    road_error : float
        Share of the road's spectrum that no amount of later readings determines, mean over `BAND`.
    """

    def __init__(self, setting: Setting, readings: MeasurementSet, settings: ObserverSettings, samples: int) -> None:
        self._names, car = observed_car(setting, readings, settings, "the road's estimate")
        self.road_error = _unseen(car, setting.sample_time)
        model = _with_road(car, 2 * np.pi * CUTOFF * settings.speed)
        self._step, self._drive, p, spread = model.steady(setting.sample_time)
        self._c, self._d = model.output, model.through
        self._gain = np.linalg.solve(spread, self._c @ p).T
        loop = self._step @ (np.eye(len(p)) - self._gain @ self._c)
        row, gains = p[-1], []
        for _ in range(samples + 1):
            gains.append(np.linalg.solve(spread, self._c @ row))
            row = loop @ row
        self.gain = np.array(gains)
        won = np.cumsum(np.einsum("ji,ik,jk->j", self.gain, spread, self.gain))
        self.error = np.sqrt(np.maximum(p[-1, -1] - won, 0.0))
        self._x = np.zeros((setting.cars, len(p)))
        self._register = np.zeros((setting.cars, samples + 1))

    def __call__(self, read: Mapping[str, np.ndarray], force_before: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(cars, samples + 1) elevations now and 1, 2 … samples ago [m]; arguments as of `KalmanObserver`."""
        ahead = times(self._x, self._step) + force_before[:, None] * self._drive
        y = np.column_stack([read[n] for n in self._names])
        new = y - times(ahead, self._c) - force[:, None] * self._d
        self._x = ahead + times(new, self._gain)
        self._register = np.column_stack([ahead[:, -1], self._register[:, :-1]]) + times(new, self.gain)
        return self._register


def _with_road(car: ObservedCar, rate: float) -> ObservedCar:
    """The same with the elevation as its last state, behind the road's cut-off [rad/s]."""
    n = len(car.a)
    a, intensity = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    a[:n, :n], a[:n, n], a[n, n] = car.a, -rate * car.road, -rate
    intensity[:n, :n] = car.intensity
    into = np.append(car.road, 1.0)
    intensity += car.level * (np.outer(into, into) - np.pad(np.outer(car.road, car.road), (0, 1)))
    return replace(car, a=a, intensity=intensity, force=np.append(car.force, 0.0), road=into,
                   output=np.pad(car.output, ((0, 0), (0, 1))))


def _unseen(car: ObservedCar, time: float) -> float:
    """Mean over `BAND` of S_e/S_w = 1/(1 + S_w hᴴ S_n⁻¹ h), the error of the smoother of infinite lag.

    h from the road's velocity to the readings, S_n of the sensors' noise (its variance over one sample) and of what
    the damper's model is wrong by.
    """
    n, rest = len(car.a), car.intensity - car.level * np.outer(car.road, car.road)
    shares = []
    for frequency in BAND:
        through = car.output @ np.linalg.inv(2j * np.pi * frequency * np.eye(n) - car.a)
        h = through @ car.road
        noise = np.diag(car.noise**2) * time + through @ rest @ through.conj().T
        shares.append(1 / (1 + car.level * np.real(h.conj() @ np.linalg.solve(noise, h))))
    return float(np.mean(shares))
