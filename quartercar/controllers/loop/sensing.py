"""Sensors of a car: bandwidth, noise and resolution, and the sets that are found on real ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks

TRUE = ("suspension_deflection", "suspension_velocity", "body_acceleration", "body_velocity", "wheel_acceleration",
        "wheel_velocity", "tyre_deflection")
"""What of a car can be measured, on paper."""


@dataclass(frozen=True)
class Sensor:
    """One signal, behind a first-order low-pass, with white noise, rounded to whole steps.

    Attributes
    ----------
    signal : str
        One of `TRUE`.
    noise : float
        Standard deviation, in the signal's SI unit.
    resolution : float
        Step of its numbers; 0 for none.
    bandwidth : float
        −3 dB [Hz]; infinite for none.

    Examples
    --------
    >>> Sensor("suspension_deflection", noise=2e-4, bandwidth=-1.0)
    Traceback (most recent call last):
    ...
    lpvid.errors.InputError: a sensor's bandwidth must be positive: got -1.
    """

    signal: str
    noise: float = 0.0
    resolution: float = 0.0
    bandwidth: float = np.inf

    def __post_init__(self) -> None:
        checks.known_name(self.signal, TRUE, "signal of a car that is measured")
        for name in ("noise", "resolution"):
            if checks.real(getattr(self, name), f"{name} of a sensor") < 0:
                raise InputError(f"a sensor's {name} must not be negative", got=f"{getattr(self, name):g}")
        if not self.bandwidth > 0:
            raise InputError("a sensor's bandwidth must be positive", got=f"{self.bandwidth:g}")


@dataclass(frozen=True)
class MeasurementSet:
    """The sensors of a car, under a name.

    Attributes
    ----------
    name : str
    sensors : tuple of Sensor
    """

    name: str
    sensors: tuple[Sensor, ...]

    def __post_init__(self) -> None:
        names = self.signals
        if len(set(names)) < len(names) or not names:
            raise InputError("a measurement set has one sensor per signal", got=", ".join(names) or "none")

    @property
    def signals(self) -> tuple[str, ...]:
        """What is measured."""
        return tuple(s.signal for s in self.sensors)

    @property
    def ideal(self) -> bool:
        """Whether every signal is measured as it is."""
        return set(TRUE) <= set(self.signals) and all(
            s.noise == 0 and s.resolution == 0 and np.isinf(s.bandwidth) for s in self.sensors)

    def quiet(self) -> MeasurementSet:
        """The same without noise.

        Returns
        -------
        MeasurementSet
            Resolution and bandwidth as before.
        """
        return MeasurementSet(self.name, tuple(Sensor(s.signal, 0.0, s.resolution, s.bandwidth) for s in self.sensors))


STROKE = Sensor("suspension_deflection", noise=1e-4, resolution=5e-5, bandwidth=150.0)
BODY = Sensor("body_acceleration", noise=0.05, resolution=0.01, bandwidth=100.0)
WHEEL = Sensor("wheel_acceleration", noise=0.5, resolution=0.1, bandwidth=150.0)
SETS: Mapping[str, MeasurementSet] = {
    s.name: s for s in (MeasurementSet("stroke-body", (STROKE, BODY)),
                        MeasurementSet("stroke-body-wheel", (STROKE, BODY, WHEEL)),
                        MeasurementSet("ideal", tuple(Sensor(n) for n in TRUE)))}
"""Sets by name: a potentiometer of 12 bits over 0.2 m with a micromechanical accelerometer on the body, the same with
one on the wheel, and what no car has."""


def _lag(bandwidth: float, sample_time: float) -> tuple[float, float, float]:
    """s(k) = m s(k−1) + e u(k−1) + l u(k) of a first-order lag, exact for a signal that is linear between samples."""
    if np.isinf(bandwidth):
        return 0.0, 0.0, 1.0
    turn = 2 * np.pi * bandwidth * sample_time
    memory = float(np.exp(-turn))
    mean = (1 - memory) / turn
    return memory, mean - memory, 1 - mean


class Sensing:
    """The sensors of many cars on their way.

    Parameters
    ----------
    chosen : MeasurementSet
    sample_time : float
        [s].
    generators : sequence of numpy.random.Generator
        One for each car, for its noise alone.
    samples : int
        How many there will be at most.
    """

    def __init__(self, chosen: MeasurementSet, sample_time: float, generators: Sequence[np.random.Generator],
                 samples: int) -> None:
        self._sensors = chosen.sensors
        count, cars = len(self._sensors), len(generators)
        scale = np.array([s.noise for s in self._sensors])
        self._noise = np.zeros((samples, count, cars))
        if scale.any():
            for car, rng in enumerate(generators):
                self._noise[:, :, car] = rng.standard_normal((samples, count)) * scale
        self._memory, self._early, self._late = np.array([_lag(s.bandwidth, sample_time) for s in self._sensors]
                                                         ).T[:, :, None]
        step = np.array([s.resolution for s in self._sensors])[:, None]
        self._rounds, self._step = step > 0, np.where(step > 0, step, 1.0)
        self._before, self._slow = np.zeros((count, cars)), np.zeros((count, cars))
        self._k = 0

    def __call__(self, true: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """(cars,) readings by signal, from what they are at this sample."""
        now = np.array([true[s.signal] for s in self._sensors])
        if self._k:
            self._slow = self._memory * self._slow + self._early * self._before + self._late * now
        else:
            self._slow = now  # settled
        self._before = now
        read = self._slow + self._noise[self._k]
        read = np.where(self._rounds, np.round(read / self._step) * self._step, read)
        self._k += 1
        return {s.signal: read[i] for i, s in enumerate(self._sensors)}
