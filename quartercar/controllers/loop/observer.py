"""What is not measured: a steady Kalman filter for the car's velocities, with the damper's model force as its input."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.controllers.contract import Setting
from quartercar.controllers.loop.sensing import MeasurementSet, Sensor
from quartercar.roads import iso_roughness
from quartercar.vehicle.linear import LinearCar

STATES = ("suspension_deflection", "body_velocity", "tyre_deflection", "wheel_velocity")
"""Of the car; a further one is what the damper's model is wrong by."""
READINGS = ("suspension_deflection", "body_acceleration", "wheel_acceleration")
"""What the filter can make use of."""


@dataclass(frozen=True)
class ObserverSettings:
    """Assumptions of the filter.

    Attributes
    ----------
    road_class : str
        ISO 8608, the road whose velocity drives the car.
    speed : float
        [m/s].
    force_error, force_memory : float
        What the damper's model is wrong by: standard deviation [N] and time constant [s] of a first-order process.
    """

    road_class: str = "C"
    speed: float = 20.0
    force_error: float = 200.0
    force_memory: float = 0.02

    def __post_init__(self) -> None:
        for name in ("speed", "force_error", "force_memory"):
            checks.positive(getattr(self, name), f"{name} of an observer")
        iso_roughness(self.road_class)

    @property
    def road_level(self) -> float:
        """Two-sided spectrum of the road's velocity [m²/s], half of the one-sided 4π² n_0² G_d(n_0) V."""
        return 2 * np.pi**2 * iso_roughness(self.road_class).coefficient * self.speed


class KalmanObserver:
    """A Kalman filter in steady state, for many cars.

    ::

        ẋ = A x + B_F (F + e) + B_w w      x as `STATES`, w = ż_r white, F the damper model's force
        ė = −e/τ + noise                   e what that model is wrong by
        ṡ = ω (C x + D (F + e) − s)        what each sensor of finite bandwidth shows, before its noise

    sampled exactly with F held; accelerations see F directly. The gain is that of the discrete Riccati equation for the
    noise of the sensors. Where the road ahead is known or estimated (`Setting.preview`) its rate is an input, and w is
    what that leaves, `Setting.road_error` of the road's spectrum.

    Parameters
    ----------
    setting : Setting
    readings : MeasurementSet
        The deflection and an acceleration at least.
    settings : ObserverSettings

    Attributes
    ----------
    gain : (n, r) array
        n: the states of the car, e, and one for each sensor of finite bandwidth.
    covariance : (n, n) array
        Of its error.
    poles : (n,) array
        Of its error, inside the unit circle.
    """

    def __init__(self, setting: Setting, readings: MeasurementSet, settings: ObserverSettings | None = None) -> None:
        self._names, model = observed_car(setting, readings, settings or ObserverSettings(), "an observer")
        left = model.level * (setting.road_error - 1)
        model = replace(model, intensity=model.intensity + left * np.outer(model.road, model.road))
        self._step, self._drive, x, spread = model.steady(setting.sample_time)
        self._road = replace(model, force=model.road).sampled(setting.sample_time)[1]
        self._c, self._d = model.output, model.through
        self.gain = np.linalg.solve(spread, self._c @ x).T
        kept = np.eye(len(x)) - self.gain @ self._c
        self.covariance = kept @ x
        self.poles = np.linalg.eigvals(kept @ self._step)
        self._x = np.zeros((setting.cars, len(x)))

    @property
    def matrices(self) -> ObserverMatrices:
        """What one step computes with."""
        return ObserverMatrices(self._names, self._step, self._drive, self._c, self._d, self.gain, self._road)

    def __call__(self, read: Mapping[str, np.ndarray], force_before: np.ndarray, force: np.ndarray,
                 road_rate: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Estimates at this sample.

        Parameters
        ----------
        read : mapping of str to (cars,) array
            Readings at this sample.
        force_before, force : (cars,) arrays
            The damper model's force over the last sample interval, and the one expected now [N].
        road_rate : (cars,) array, optional
            What is known of the road's rate over the last sample interval [m/s].
        """
        ahead = times(self._x, self._step) + force_before[:, None] * self._drive
        if road_rate is not None:
            ahead = ahead + road_rate[:, None] * self._road
        y = np.column_stack([read[n] for n in self._names])
        self._x = ahead + times(y - times(ahead, self._c) - force[:, None] * self._d, self.gain)
        z, vs, tyre, vu = self._x.T[:4]
        return {"suspension_deflection": z, "body_velocity": vs, "tyre_deflection": tyre, "wheel_velocity": vu,
                "suspension_velocity": vs - vu}


@dataclass(frozen=True, eq=False)
class ObserverMatrices:
    """x ← step x + drive F + road ż_r, then x ← x + gain (y − output x − through F).

    Attributes
    ----------
    names : tuple of str
        Readings, in the order of y.
    step, drive, output, through, gain : (n, n), (n,), (r, n), (r,), (n, r) arrays
    road : (n,) array
        What is known of the road's rate over the last sample interval to states.
    """

    names: tuple[str, ...]
    step: np.ndarray
    drive: np.ndarray
    output: np.ndarray
    through: np.ndarray
    gain: np.ndarray
    road: np.ndarray


def times(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """rows @ matrix.T, to the last bit the same for a car whatever stands beside it, which BLAS does not guarantee.

    Parameters
    ----------
    rows : (cars, n) array
        One vector for each car.
    matrix : (r, n) array
        The same for all.

    Returns
    -------
    (cars, r) array
        Products.
    """
    return np.einsum("cj,ij->ci", rows, matrix)


@dataclass(frozen=True, eq=False)
class ObservedCar:
    """Car, model error and sensors in continuous time: states, force and noises in, readings out.

    Attributes
    ----------
    a, output : (n, n), (r, n) arrays
    force, through : (n,), (r,) arrays
        Of the damper model's force.
    road : (n,) array
        Of the road's velocity.
    level : float
        Two-sided spectrum of the road's velocity [m²/s].
    intensity : (n, n) array
        Of all that is white, the road's velocity included.
    noise : (r,) array
        Standard deviation of each reading.
    """

    a: np.ndarray
    force: np.ndarray
    road: np.ndarray
    level: float
    intensity: np.ndarray
    output: np.ndarray
    through: np.ndarray
    noise: np.ndarray

    @classmethod
    def of(cls, setting: Setting, sensors: Sequence[Sensor], design: ObserverSettings) -> ObservedCar:
        """From the car of a setting, its sensors, and the errors that the observer is designed for.

        Parameters
        ----------
        setting : Setting
            Its car counts, without dampings.
        sensors : sequence of Sensor
            Of `READINGS`, in the order of the outputs.
        design : ObserverSettings
            Road class, speed, and the damper model's error.

        Returns
        -------
        ObservedCar
            With four states of the car, the error of the model force, and one state for each sensor of finite
            bandwidth. A sensor without noise and resolution counts with a standard deviation of 1e-5 of its unit.
        """
        car = LinearCar(setting.parameters.replace(damping=0.0, tyre_damping=0.0)).relative()
        slow = [s for s in sensors if np.isfinite(s.bandwidth)]
        n, rate = 5 + len(slow), 1 / design.force_memory
        a, force, intensity = np.zeros((n, n)), np.zeros(n), np.zeros((n, n))
        a[:4, :4], a[:4, 4], a[4, 4] = car.A, car.B[:, 1], -rate
        force[:4] = car.B[:, 1]
        road = design.road_level
        into = np.zeros(n)
        into[:4] = car.B[:, 0]
        intensity += road * np.outer(into, into)
        intensity[4, 4] = 2 * rate * design.force_error**2
        rows = {"suspension_deflection": np.array([1.0, 0, 0, 0, 0]), "body_acceleration": a[1, :5].copy(),
                "wheel_acceleration": a[3, :5].copy()}
        output, through = np.zeros((len(sensors), n)), np.zeros(len(sensors))
        for k, sensor in enumerate(sensors):
            row, direct = rows[sensor.signal], float(rows[sensor.signal][4])
            if sensor in slow:
                place, turn = 5 + slow.index(sensor), 2 * np.pi * sensor.bandwidth
                a[place, :5], a[place, place], force[place], output[k, place] = turn * row, -turn, turn * direct, 1.0
            else:
                output[k, :5], through[k] = row, direct
        noise = [float(np.hypot(s.noise, s.resolution / np.sqrt(12))) or 1e-5 for s in sensors]
        return cls(a, force, into, road, intensity, output, through, np.array(noise))

    def sampled(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Step, drive by a held force, covariance of the noise over a step (Van Loan 1978, IEEE TAC 23, 395-404).

        Parameters
        ----------
        time : float
            Sample time [s].

        Returns
        -------
        step : (n, n) array
            State at the next sample from the state.
        drive : (n,) array
            The same from the force held over the step.
        covariance : (n, n) array
            Symmetric.
        """
        from scipy.linalg import expm

        n = len(self.a)
        e = expm(np.block([[-self.a, self.intensity], [np.zeros((n, n)), self.a.T]]) * time)
        step = e[n:, n:].T
        held = expm(np.block([[self.a, self.force[:, None]], [np.zeros((1, n + 1))]]) * time)
        covariance = step @ e[:n, n:]
        return step, held[:n, n], 0.5 * (covariance + covariance.T)

    def steady(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Step and drive as in `sampled`, and the covariances of what the steady Kalman filter of this rate predicts.

        Parameters
        ----------
        time : float
            Sample time [s].

        Returns
        -------
        step : (n, n) array
        drive : (n,) array
        covariance : (n, n) array
            Of the predicted state's error.
        spread : (r, r) array
            Of the predicted readings' error.
        """
        from scipy.linalg import solve_discrete_are

        step, drive, disturbance = self.sampled(time)
        noise = np.diag(self.noise**2)
        covariance = solve_discrete_are(step.T, self.output.T, disturbance, noise)
        return step, drive, covariance, self.output @ covariance @ self.output.T + noise


def observed_car(setting: Setting, readings: MeasurementSet, settings: ObserverSettings,
                 noun: str) -> tuple[tuple[str, ...], ObservedCar]:
    """Names of the readings that a filter can make use of, and the car with their sensors.

    Parameters
    ----------
    setting : Setting
    readings : MeasurementSet
    settings : ObserverSettings
    noun : str
        What asks, as the error names it.

    Returns
    -------
    names : tuple of str
        Of `READINGS`, in that order.
    car : ObservedCar

    Raises
    ------
    InputError
        No deflection, or no acceleration.
    """
    names = tuple(n for n in READINGS if n in readings.signals)
    if "suspension_deflection" not in names or len(names) < 2:
        raise InputError(f"{noun} needs the suspension's deflection and an acceleration",
                         got=", ".join(readings.signals), mend="the measurement set 'stroke-body'")
    return names, ObservedCar.of(setting, [s for n in names for s in readings.sensors if s.signal == n], settings)
