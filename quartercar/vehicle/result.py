"""CarRun: what a quarter car did on a road, as named signals with units, and its balance of energy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lpvid.errors import NumericalError
from lpvid.record import Record
from lpvid.toolkit import Shown, checks

if TYPE_CHECKING:
    from quartercar.vehicle.assembly import CarAssembly
    from quartercar.vehicle.stepper import States

UNITS = {"road": "m", "body_displacement": "m", "body_velocity": "m/s", "body_acceleration": "m/s^2",
         "wheel_displacement": "m", "wheel_velocity": "m/s", "wheel_acceleration": "m/s^2",
         "suspension_deflection": "m", "suspension_velocity": "m/s", "damper_force": "N", "stop_force": "N",
         "tyre_deflection": "m", "tyre_force": "N", "tyre_load": "N", "command": "A", "current": "A"}
"""Every signal of a run and its unit; the current's is the damper's own."""


@dataclass(frozen=True)
class EnergyBalance:
    """Where the energy of a run went [J], by the trapezoidal rule over its samples.

    Attributes
    ----------
    road : float
        Work of the road on the tyre.
    damper, tyre : float
        Taken by the damper and by the tyre's damping.
    stored : float
        What masses, spring, stops and tyre hold more at the end than at the start.
    """

    road: float
    damper: float
    tyre: float
    stored: float

    @property
    def gap(self) -> float:
        """Road less all the rest: zero but for the quadrature and the integration."""
        return self.road - self.damper - self.tyre - self.stored


@dataclass(frozen=True, eq=False)
class CarRun(Shown):
    """Signals of a quarter car at the samples of its road, about the static equilibrium.

    `damper_force` is positive in extension; `tyre_force` is F_t, positive where the tyre is lighter than at rest;
    `tyre_load` is what presses on the road, never below zero where the tyre may lift off.

    Attributes
    ----------
    sample_time : float
        [s].
    signals : mapping of str to (n,) array
        As in `UNITS`.
    units : mapping of str to str
    static_load : float
        [N].
    car : CarAssembly
        What was driven.
    """

    DRAWN_BY: ClassVar[str] = "quartercar.plot.drawings"
    sample_time: float
    signals: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    static_load: float
    car: CarAssembly

    @classmethod
    def of(cls, car: CarAssembly, sample_time: float, road: np.ndarray, command: np.ndarray, states: States) -> CarRun:
        """Every signal from the states of a run.

        Parameters
        ----------
        car : CarAssembly
            What was driven.
        sample_time : float
            [s].
        road : (n,) array
            Elevation at the samples [m].
        command : (n,) array
            Held from each sample to the next, in the damper's unit.
        states : States
            At the samples.

        Returns
        -------
        CarRun
            Its arrays are read-only.

        Raises
        ------
        NumericalError
            A run that left all bounds.
        """
        bad = np.flatnonzero(~np.isfinite(states.motion).all(axis=1))
        if bad.size:
            raise NumericalError(f"the car left all bounds {bad[0] * sample_time:.4g} s into the run; "
                                 "a damper that gives energy, or a step that is too long")
        p, part = car.parameters, car.linear_part
        zs, vs, zu, vu = states.motion.T
        rate = np.zeros(road.size)
        rate[1:] = np.diff(road) / sample_time
        deflection, speed = zs - zu, vs - vu
        tyre = p.tyre_stiffness * (zu - road) + p.tyre_damping * (vu - rate) + states.tyre
        strut = part.stiffness * deflection + part.damping * speed + states.strut
        body, wheel = part.inverse_mass @ np.vstack([-strut, strut - tyre])
        stop = np.zeros(road.size) if car.stops is None else car.stops.force(deflection)
        damper = (strut - stop - p.spring_stiffness * deflection + part.inertance * (body - wheel) + car.preload)
        signals = {"road": road, "body_displacement": zs, "body_velocity": vs, "body_acceleration": body,
                   "wheel_displacement": zu, "wheel_velocity": vu, "wheel_acceleration": wheel,
                   "suspension_deflection": deflection, "suspension_velocity": speed, "damper_force": damper,
                   "stop_force": stop, "tyre_deflection": zu - road, "tyre_force": tyre,
                   "tyre_load": np.maximum(car.static_load - tyre, 0.0) if car.lift_off else car.static_load - tyre,
                   "command": command, "current": states.current}
        unit = "A" if car.damper is None else car.damper.current_unit
        return cls(sample_time, {n: checks.frozen_array(a, n) for n, a in signals.items()},
                   {**UNITS, "command": unit, "current": unit}, car.static_load, car)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.signals[checks.known_name(name, tuple(self.signals), "signal of a car")]

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.signals["road"].size

    @property
    def time(self) -> np.ndarray:
        """(n,) from the first sample [s]."""
        return self.sample_time * np.arange(self.n_samples)

    def after(self, time: float) -> CarRun:
        """The run from a time on [s], its start left out of every figure.

        Parameters
        ----------
        time : float
            From the first sample [s]; the first sample kept is the one at it or after.

        Returns
        -------
        CarRun
            Of at least two samples.
        """
        first = int(np.ceil(checks.real(time, "time") / self.sample_time - 1e-9))
        checks.count(self.n_samples - first, "the number of samples after the start of a run", at_least=2)
        return CarRun(self.sample_time, {n: checks.frozen_array(a[first:], n) for n, a in self.signals.items()},
                      self.units, self.static_load, self.car)

    def energy(self) -> EnergyBalance:
        """Where the energy went: the static forces, which do no net work about the equilibrium, are left out.

        Returns
        -------
        EnergyBalance
            Over the whole run.
        """
        s, p, car = self.signals, self.car.parameters, self.car
        road_rate = np.diff(s["road"]) / self.sample_time
        tyre_damping = 0.0
        if p.tyre_damping:
            lost = s["tyre_force"] - self._elastic
            slip = 0.5 * (s["wheel_velocity"][1:] + s["wheel_velocity"][:-1]) - road_rate
            tyre_damping = float(np.sum(0.5 * (lost[1:] + lost[:-1]) * slip) * self.sample_time)
        given = -float(np.sum(0.5 * (s["tyre_force"][1:] + s["tyre_force"][:-1]) * np.diff(s["road"])))
        free = s["damper_force"] - car.preload
        power = free * s["suspension_velocity"]
        damper = float(np.sum(0.5 * (power[1:] + power[:-1])) * self.sample_time)
        return EnergyBalance(given, damper, tyre_damping, float(self._stored[-1] - self._stored[0]))

    @property
    def _elastic(self) -> np.ndarray:
        limit = self.static_load if self.car.lift_off else np.inf
        return np.minimum(self.car.parameters.tyre_stiffness * self.signals["tyre_deflection"], limit)

    @property
    def _stored(self) -> np.ndarray:
        """(n,) energy of masses, spring, stops and tyre, against the static forces [J]."""
        s, p, car = self.signals, self.car.parameters, self.car
        tyre = self._elastic
        energy = 0.5 * p.sprung_mass * s["body_velocity"] ** 2 + 0.5 * p.unsprung_mass * s["wheel_velocity"] ** 2
        energy = energy + 0.5 * p.spring_stiffness * s["suspension_deflection"] ** 2
        energy = energy + tyre * s["tyre_deflection"] - 0.5 * tyre**2 / p.tyre_stiffness
        return energy if car.stops is None else energy + car.stops.energy(s["suspension_deflection"])

    def to_record(self, name: str = "car") -> Record:
        """As a record of lpvid, with the damper's motion under the names that dampers read.

        Parameters
        ----------
        name : str
            Of the record.

        Returns
        -------
        Record
            `displacement` [m], `velocity` [m/s] and `force` [N] of the damper, then every signal of the run.
        """
        s = self.signals
        channels: Any = {"displacement": s["suspension_deflection"], "velocity": s["suspension_velocity"],
                    "force": s["damper_force"], **s}
        units = {"displacement": "m", "velocity": "m/s", "force": "N", **self.units}
        for channel in ("command", "current"):
            units[channel] = "" if units[channel] == "1" else units[channel]
        return Record(channels, self.sample_time, units=units, name=name)

    def __repr__(self) -> str:
        s = self.signals
        rms = {n: float(np.sqrt(np.mean(s[n] ** 2))) for n in ("body_acceleration", "tyre_force")}
        reach = 1e3 * np.array([s["suspension_deflection"].min(), s["suspension_deflection"].max()])
        off = float(np.mean(s["tyre_load"] <= 0))
        return (f"CarRun of {self.n_samples * self.sample_time:.4g} s at {1 / self.sample_time:.6g} Hz\n"
                f"  body acceleration  {rms['body_acceleration']:.4g} m/s^2 rms\n"
                f"  tyre force         {rms['tyre_force']:.4g} N rms about {self.static_load:.4g} N, "
                f"off the road {off:.1%} of the time\n"
                f"  suspension         {reach[0]:.3g} to {reach[1]:.3g} mm")
