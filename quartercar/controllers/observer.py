"""What is not measured: a steady Kalman filter for the car's velocities, with the damper's model force as its input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from quartercar.controllers.contract import Setting
from quartercar.controllers.sensing import MeasurementSet
from quartercar.linear_car import LinearCar
from quartercar.roads import iso_roughness

STATES = ("suspension_deflection", "body_velocity", "tyre_deflection", "wheel_velocity")
"""Of the car; a further one is what the damper's model is wrong by."""
READINGS = ("suspension_deflection", "body_acceleration", "wheel_acceleration")
"""What the filter can make use of."""


@dataclass(frozen=True)
class ObserverSettings:
    """What the filter takes for granted.

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
            _checks.positive(getattr(self, name), f"{name} of an observer")
        iso_roughness(self.road_class)


class Observer:
    """A Kalman filter in steady state, for many cars.

    ::

        ẋ = A x + B_F (F + e) + B_w w      x as `STATES`, w = ż_r white, F the damper model's force
        ė = −e/τ + noise                   e what that model is wrong by

    sampled exactly with F held; the readings are deflection and accelerations, in which F enters directly. Its gain is
    that of the discrete Riccati equation for the noise of the sensors.

    Parameters
    ----------
    setting : Setting
    readings : MeasurementSet
        The deflection or an acceleration at least; sensors without noise count with a tenth of their resolution.
    settings : ObserverSettings

    Attributes
    ----------
    gain : (5, r) array
    poles : (5,) array
        Of its error, inside the unit circle.
    """

    def __init__(self, setting: Setting, readings: MeasurementSet, settings: ObserverSettings | None = None) -> None:
        from scipy.linalg import solve_discrete_are

        design = settings or ObserverSettings()
        self._names = tuple(n for n in READINGS if n in readings.signals)
        if not {"suspension_deflection"} <= set(self._names) or len(self._names) < 2:
            raise InputError("an observer needs the suspension's deflection and an acceleration",
                             got=", ".join(readings.signals), mend="the measurement set 'stroke-body'")
        p = setting.parameters
        car = LinearCar(p.replace(damping=0.0, tyre_damping=0.0)).relative()
        a, b_road, b_force = car.A, car.B[:, 0], car.B[:, 1]
        self._step, self._drive, covariance = _sampled(a, b_road, b_force, design, setting.sample_time)
        rows = {"suspension_deflection": np.array([1.0, 0, 0, 0]), "body_acceleration": a[1],
                "wheel_acceleration": a[3]}
        through = {"suspension_deflection": 0.0, "body_acceleration": b_force[1], "wheel_acceleration": b_force[3]}
        self._c = np.array([[*rows[n], through[n]] for n in self._names])
        self._d = np.array([through[n] for n in self._names])
        noise = np.diag([_noise(readings, n) ** 2 for n in self._names])
        x = solve_discrete_are(self._step.T, self._c.T, covariance, noise)
        self.gain = np.linalg.solve(self._c @ x @ self._c.T + noise, self._c @ x).T
        self.covariance = x - self.gain @ self._c @ x
        self.poles = np.linalg.eigvals((np.eye(5) - self.gain @ self._c) @ self._step)
        self._x = np.zeros((setting.cars, 5))

    def __call__(self, read: Mapping[str, np.ndarray], force_before: np.ndarray,
                 force: np.ndarray) -> dict[str, np.ndarray]:
        """Estimates at this sample.

        Parameters
        ----------
        read : mapping of str to (cars,) array
            Readings at this sample.
        force_before, force : (cars,) arrays
            The damper model's force over the last sample interval, and the one expected now [N].
        """
        ahead = self._x @ self._step.T + force_before[:, None] * self._drive
        y = np.column_stack([read[n] for n in self._names])
        expected = ahead @ self._c.T + force[:, None] * self._d
        self._x = ahead + (y - expected) @ self.gain.T
        z, vs, tyre, vu, _ = self._x.T
        return {"suspension_deflection": z, "body_velocity": vs, "tyre_deflection": tyre, "wheel_velocity": vu,
                "suspension_velocity": vs - vu}


def _noise(readings: MeasurementSet, name: str) -> float:
    sensor = next(s for s in readings.sensors if s.signal == name)
    return float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12))) or 1e-5


def _sampled(a: np.ndarray, b_road: np.ndarray, b_force: np.ndarray, design: ObserverSettings,
             sample_time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Step, drive by a held force, covariance of the noise over a step (Van Loan 1978, IEEE TAC 23(3), 395-404)."""
    from scipy.linalg import expm

    rate = 1 / design.force_memory
    full = np.zeros((5, 5))
    full[:4, :4], full[:4, 4], full[4, 4] = a, b_force, -rate
    road = np.pi**2 * iso_roughness(design.road_class).coefficient * design.speed * 2  # two-sided: half of 4π²…
    spread = np.zeros((5, 5))
    spread[:4, :4] = road * np.outer(b_road, b_road)
    spread[4, 4] = 2 * rate * design.force_error**2
    block = np.block([[-full, spread], [np.zeros((5, 5)), full.T]])
    e = expm(block * sample_time)
    step = e[5:, 5:].T
    held = expm(np.block([[full, np.append(b_force, 0.0)[:, None]], [np.zeros((1, 6))]]) * sample_time)
    return step, held[:5, 5], step @ e[:5, 5:]
