"""Fleet: many quarter cars of one kind side by side, one sample of a control loop at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.toolkit import checks
from quartercar.vehicle.filter_bank import bank, filter_of
from quartercar.vehicle.integrator import IntegratorStages
from quartercar.vehicle.nonlinear import Coil, QuarterCar
from quartercar.vehicle.result import CarRun
from quartercar.vehicle.stepper import States
from quartercar.vehicle.tanh_coefficients import tanh_form

DIVERGED = 1e4
"""motion [m] or [m/s] at which a car counts as out of all bounds"""


class Fleet(ABC):
    """Cars on their way; each has its own road and its own command.

    Attributes
    ----------
    car : QuarterCar
    sample_time : float
        [s].
    motion : (cars, 4) array
        z_s, ż_s, z_us, ż_us.
    strut, tyre : (cars,) arrays
        As in `stepper.States` [N].
    current : (cars,) array
        In the coil.
    road, road_rate : (cars,) arrays
        Elevation [m], and its rate up to here [m/s].
    """

    def __init__(self, car: QuarterCar, sample_time: float, road: np.ndarray, current: np.ndarray) -> None:
        self.car, self.sample_time = car, sample_time
        zero = np.zeros(road.size)
        self.motion = np.column_stack([road, zero, road, zero])
        self.strut, self.tyre = zero.copy(), zero.copy()
        self.current = car.coil.limited(np.asarray(current, dtype=float))
        self.road, self.road_rate = np.array(road, dtype=float), zero.copy()
        self._part = car.linear_part
        self._inverse_mass = self._part.inverse_mass

    @abstractmethod
    def _advance(self, road: np.ndarray, command: np.ndarray) -> None:
        """Move motion, strut, tyre and current to the coming sample."""

    def advance(self, road: np.ndarray, command: np.ndarray) -> None:
        """Go on to (cars,) elevations at the coming sample under (cars,) commands held until then.

        Parameters
        ----------
        road : (cars,) array
            At the coming sample, linear from here [m].
        command : (cars,) array
            In the damper's unit; the coil limits it.

        Raises
        ------
        NumericalError
            A car that leaves all bounds.
        """
        self._advance(road, command)
        self.road_rate = (road - self.road) / self.sample_time
        self.road = road
        if not np.all(np.abs(self.motion) < DIVERGED):
            raise NumericalError("a car left all bounds; a damper that gives energy, or a step that is too long")

    @property
    def accelerations(self) -> tuple[np.ndarray, np.ndarray]:
        """(cars,) of the body and of the wheel [m/s²]."""
        p, part = self.car.parameters, self._part
        zs, vs, zu, vu = self.motion.T
        tyre = p.tyre_stiffness * (zu - self.road) + p.tyre_damping * (vu - self.road_rate) + self.tyre
        strut = part.stiffness * (zs - zu) + part.damping * (vs - vu) + self.strut
        (a, b), (c, d) = self._inverse_mass
        return b * (strut - tyre) - a * strut, d * (strut - tyre) - c * strut


def start_fleet(car: QuarterCar, sample_time: float, road: np.ndarray, current: np.ndarray) -> Fleet:
    """Cars at rest on (cars,) elevations with (cars,) commands on which everything has settled.

    Laws of the form of `tanh_form`, identified transfer functions and state spaces are stepped together; any other
    damper car by car, which takes a few milliseconds per simulated second and car longer.

    Parameters
    ----------
    car : QuarterCar
        The same for all.
    sample_time : float
        Of the control loop [s].
    road : (cars,) array
        Elevation at the start [m].
    current : (cars,) array
        Command before the start, in the damper's unit.

    Returns
    -------
    Fleet
        Cars at rest.

    Raises
    ------
    InputError
        A damper that runs at another rate only.
    """
    sample_time = checks.positive(sample_time, "sample_time", "s")
    damper = car.damper
    if car.damper_is_linear or tanh_form(damper) is not None:
        return _LawFleet(car, sample_time, road, current)
    if filter_of(damper) is not None:
        return _FilterFleet(car, sample_time, road, current)
    return _SteppedFleet(car, sample_time, road, current)


class _LawFleet(Fleet):
    """Laws without memory whose coefficients depend on the current."""

    def __init__(self, car: QuarterCar, sample_time: float, road: np.ndarray, current: np.ndarray) -> None:
        super().__init__(car, sample_time, road, current)
        self._form = None if car.damper_is_linear else tanh_form(car.damper)
        self._parts = max(1, int(np.ceil(sample_time / car.longest_step - 1e-9)))
        self._step = sample_time / self._parts
        self._stages = IntegratorStages.held(self._part, self._step)
        self._held = np.zeros((road.size, 3))
        self._stop, self._tyre = car.limits

    def _advance(self, road: np.ndarray, command: np.ndarray) -> None:
        from quartercar.vehicle._nonlinear_kernels import advance_all

        cars, stages = road.size, self._stages
        shares = (np.arange(self._parts)[:, None] + stages.ends[None]).ravel()
        coil = self.car.coil
        currents = coil.follow_all(self.current[:, None], coil.limited(command)[:, None], shares * self._step)
        coefficients = np.zeros((currents.size, 8)) if self._form is None else self._form(currents.ravel())
        if self._form is not None:
            coefficients[:, 0] -= self.car.preload
        advance_all(stages.ends, stages.state, stages.road, stages.force, self.road, road, self._step,
                    np.ascontiguousarray(coefficients).reshape(cars, self._parts, stages.ends.size, 8), self._stop,
                    self._tyre, self.motion, self._held)
        self.strut, self.tyre = self._held[:, 0].copy(), self._held[:, 1].copy()
        self.current = currents[:, -1]


class _FilterFleet(Fleet):
    """Identified transfer functions and state spaces, at their own rate."""

    def __init__(self, car: QuarterCar, sample_time: float, road: np.ndarray, current: np.ndarray) -> None:
        super().__init__(car, sample_time, road, current)
        assert car.damper is not None
        model = filter_of(car.damper)
        assert model is not None and model.sample_time is not None
        self._step = car.start(sample_time, 0.0, float(car.coil.limited(np.zeros(1))[0])).step  # which checks the rate
        self._parts = round(sample_time / self._step)
        self._stages = IntegratorStages.ramp(self._part, self._step)
        self._lag = lag_coil(model)
        self._bank = bank(model, road.size)
        self._bank.begin(self.current)
        self._rest = car.preload
        self._held = np.zeros((road.size, 3))
        self._held[:, 0] = self._bank.force - self._rest
        self.strut = self._held[:, 0].copy()
        self._filtered = self.current.copy()
        self._stop, self._tyre = car.limits

    def _advance(self, road: np.ndarray, command: np.ndarray) -> None:
        from quartercar.vehicle._nonlinear_kernels import advance_all

        stages, cars = self._stages, road.size
        command = self.car.coil.limited(command)
        rise = (road - self.road) / self._parts
        for part in range(self._parts):
            self.current = self.car.coil.follow_all(self.current, command, self._step)
            self._filtered = self._lag.follow_all(self._filtered, self.current, self._step)
            law = self._bank.approach(self._filtered)
            law[:, 0] -= self._rest
            here = self.road + part * rise
            advance_all(stages.ends, stages.state, stages.road, stages.force, here, here + rise, self._step,
                        law.reshape(cars, 1, 1, 8), self._stop, self._tyre, self.motion, self._held)
            zs, vs, zu, vu = self.motion.T
            self._bank.commit(zs - zu, vs - vu)
        self.strut, self.tyre = self._held[:, 0].copy(), self._held[:, 1].copy()


class _SteppedFleet(Fleet):
    """Any damper, car by car."""

    def __init__(self, car: QuarterCar, sample_time: float, road: np.ndarray, current: np.ndarray) -> None:
        super().__init__(car, sample_time, road, current)
        self._steppers = [car.start(sample_time, float(r), float(i)) for r, i in zip(road, current, strict=True)]
        self.strut = np.array([s.strut for s in self._steppers])

    def _advance(self, road: np.ndarray, command: np.ndarray) -> None:
        for k, stepper in enumerate(self._steppers):
            states = stepper.advance(road[k:k + 1], command[k:k + 1])
            self.motion[k], self.strut[k] = states.motion[-1], states.strut[-1]
            self.tyre[k], self.current[k] = states.tyre[-1], states.current[-1]


def lag_coil(model) -> Coil:
    """The lag that an identified model puts on its current, as a coil.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        As `filter_of` gives it.

    Returns
    -------
    Coil
        With the time constants of the model's lag [s] and without limits; one that follows at once where there is no
        lag.
    """
    lag = model.scheduling_stage
    return Coil() if lag is None else Coil(lag.tau_rise, lag.tau_fall)


def true_signals(fleet: Fleet) -> dict[str, np.ndarray]:
    """(cars,) of every signal that a sensor may measure (`controllers.loop.sensing.TRUE`).

    Parameters
    ----------
    fleet : Fleet
        At its present sample.

    Returns
    -------
    dict of str to (cars,) array
        SI, without noise.
    """
    zs, vs, zu, vu = fleet.motion.T
    body, wheel = fleet.accelerations
    return {"suspension_deflection": zs - zu, "suspension_velocity": vs - vu, "body_acceleration": body,
            "body_velocity": vs, "wheel_acceleration": wheel, "wheel_velocity": vu, "tyre_deflection": zu - fleet.road}


class Log:
    """Every sample of a fleet, for the runs that are made of it at the end.

    Parameters
    ----------
    fleet : Fleet
        Observed at every `note`.
    roads : (n, cars) array
        Elevation at every sample [m].
    """

    def __init__(self, fleet: Fleet, roads: np.ndarray) -> None:
        n, cars = roads.shape
        self._fleet, self._roads = fleet, roads
        self._motion = np.empty((n, cars, 4))
        self._others = np.empty((4, n, cars))
        self._k = 0

    def note(self, command: np.ndarray) -> None:
        """The fleet at this sample, and the command from here on.

        Parameters
        ----------
        command : (cars,) array
            In the damper's unit, before the coil's limits.
        """
        f, k = self._fleet, self._k
        self._motion[k] = f.motion
        self._others[:, k] = f.strut, f.tyre, f.current, command
        self._k += 1

    def run(self, car: int) -> CarRun:
        """What one car did.

        Parameters
        ----------
        car : int
            Its place in the fleet, from 0.

        Returns
        -------
        CarRun
            Complete once every sample of the roads is noted.

        Raises
        ------
        InputError
            No car at that place.
        NumericalError
            A car that left all bounds.
        """
        if not 0 <= car < self._roads.shape[1]:
            raise InputError("no such car in the fleet", got=car)
        strut, tyre, current, command = self._others[:, :, car]
        return CarRun.of(self._fleet.car, self._fleet.sample_time, self._roads[:, car], command,
                         States(self._motion[:, car], strut, tyre, current))
