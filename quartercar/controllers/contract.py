"""Controller: the contract of every control law, from what is measured to a demand on the damper, once per sample.

Laws run for many cars side by side: every signal is an array with one entry per car, so that a law is written once, in
plain numpy, for one ride as for the hundreds of a tuning.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.dampers.parameter import Parametrised
from quartercar.parameters import CarParameters
from quartercar.vehicle.nonlinear import Coil

if TYPE_CHECKING:

    from lpvid.export.expression import Expr
    from lpvid.export.step_builder import StepBuilder
    from quartercar.dampers.contract import Damper

SIGNALS: Mapping[str, str] = MappingProxyType({
    "suspension_deflection": "m", "suspension_velocity": "m/s", "body_acceleration": "m/s^2", "body_velocity": "m/s",
    "wheel_acceleration": "m/s^2", "wheel_velocity": "m/s", "tyre_deflection": "m", "current": "A",
    "lowest_force": "N", "highest_force": "N", "demanded": "", "attained": "", "road_ahead": "m"})
"""What a law may read, with units; extension and tension positive, forces about the static equilibrium.

`current` is the one the coil is thought to carry; `lowest_force` and `highest_force` are what the damper can do at this
instant between its limits of current; `demanded` and `attained` are the law's last demand and what the damper's model
makes of it, in the law's own unit (N, or A where it demands a current). `road_ahead` is (cars, `Setting.preview`): the
elevation that the tyre meets at each of the coming samples, less the present one; it has no columns without preview.
"""
DEMANDS: Mapping[str, str] = MappingProxyType({"force": "N", "current": "A"})
"""What a law may ask for, with units: a damper force about the static equilibrium, or a current."""
Signals = Mapping[str, np.ndarray]
"""Name to (cars,) array, as in `SIGNALS`."""
Values = Mapping[str, np.ndarray]
"""Parameter to (cars,) array."""
DEADBAND = 5e-3
"""|v_d| below which a switching law keeps its last decision [m/s] (equation sheet 4.8)"""


@dataclass(frozen=True, eq=False)
class Setting:
    """What a law is given before it starts.

    Attributes
    ----------
    sample_time : float
        Of the law [s].
    cars : int
        How many cars it drives side by side.
    parameters : CarParameters
        The design model of the car.
    damper : Damper or None
        The damper model behind the inverse; None for a viscous car.
    currents : (float, float)
        Limits of the command [A].
    coil : Coil
        Its time constants in the design model.
    preview : int
        Coming samples whose road is known or estimated.
    road_error : float
        Share of the spectrum of the road's velocity that this leaves, 1 without preview.
    road_level : float
        Two-sided spectrum of the velocity of the road that the loop is made for [m²/s].
    estimate_error : (4, 4) array
        Covariance of what the observer leaves of z_d, ż_s, z_t, ż_us; zero where all is measured.
    """

    sample_time: float
    cars: int
    parameters: CarParameters
    damper: Damper | None = None
    currents: tuple[float, float] = (0.0, 2.5)
    coil: Coil = field(default_factory=Coil)
    preview: int = 0
    road_error: float = 1.0
    road_level: float = 0.0
    estimate_error: np.ndarray = field(default_factory=lambda: np.zeros((4, 4)))


class Law(ABC):
    """A running controller."""

    @abstractmethod
    def step(self, seen: Signals) -> np.ndarray:
        """(cars,) demand for the coming sample, from signals at this one.

        Parameters
        ----------
        seen : Signals
            Signals of every car at this sample, SI.

        Returns
        -------
        (cars,) array
            In the unit of what the law demands.
        """

    def counted(self) -> dict[str, np.ndarray]:
        """(cars,) counts worth reporting, by name; empty for most laws.

        Returns
        -------
        dict of (cars,) arrays
            Counts by name.
        """
        return {}


class Memoryless(Law):
    """A demand that is a function of the present signals.

    Parameters
    ----------
    demand : callable
        From `Signals` of one sample, SI, to the (cars,) demand, in the unit of what the law demands.
    """

    def __init__(self, demand: Callable[[Signals], np.ndarray]) -> None:
        self._demand = demand

    def step(self, seen: Signals) -> np.ndarray:
        return self._demand(seen)


class Switching(Law):
    """F = c v_d with c high while a condition holds, else low; no decision while |v_d| lies in the deadband.

    Parameters
    ----------
    low, high : (cars,) arrays
        Damping [N·s/m]; a c_max below c_min counts as c_min.
    condition : callable
        Signals to (cars,) bool.
    """

    def __init__(self, low: np.ndarray, high: np.ndarray, condition: Callable[[Signals], np.ndarray]) -> None:
        self._low, self._high, self._condition = low, np.maximum(low, high), condition
        self._on = np.zeros(low.shape, dtype=bool)

    def step(self, seen: Signals) -> np.ndarray:
        v = seen["suspension_velocity"]
        self._on = np.where(np.abs(v) > DEADBAND, self._condition(seen), self._on)
        return np.where(self._on, self._high, self._low) * v


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Controller(Parametrised):
    """A control law with named, bounded parameters.

    Attributes
    ----------
    values : mapping of str to float
        Parameters by name, SI; those left out take their defaults.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        for signal in self.reads:
            checks.one_of(signal, tuple(SIGNALS), f"every name in reads of {self.name}")
        checks.one_of(self.demands, tuple(DEMANDS), f"demands of {self.name}")

    # -- what a law describes -----------------------------------------------------------------------------------
    @property
    @abstractmethod
    def reads(self) -> tuple[str, ...]:
        """Signals that it needs, of `SIGNALS`."""

    @property
    @abstractmethod
    def demands(self) -> str:
        """Its demand: a name of `DEMANDS`."""

    @abstractmethod
    def begin(self, values: Values, setting: Setting) -> Law:
        """A running law for (cars,) values of every parameter.

        Parameters
        ----------
        values : mapping of (cars,) arrays
            Every parameter by name, SI.
        setting : Setting
            Cars, period and damper limits.

        Returns
        -------
        Law
            At rest.

        Raises
        ------
        InputError
            A setting that this law cannot work in.
        """

    def expression(self, b: StepBuilder, named: Mapping[str, Expr], seen: Mapping[str, Expr]) -> Expr | None:
        """One step of the law as an expression, for C, FMU and MATLAB.

        Parameters
        ----------
        b : StepBuilder
            Takes the states of a law with memory.
        named, seen : mapping of str to Expr
            Parameters, and the signals in `reads`.

        Returns
        -------
        Expr or None
            The demand; None for a law that has no exported step.
        """
        return None

    # -- running -----------------------------------------------------------------------------------------------------
    def start(self, setting: Setting) -> Law:
        """This law at rest, for every car of a setting.

        Parameters
        ----------
        setting : Setting
            Cars, period and damper limits.

        Returns
        -------
        Law
            At rest.
        """
        return self.begin({n: np.full(setting.cars, v) for n, v in self.values.items()}, setting)

    # -- storing -----------------------------------------------------------------------------------------------------
    @property
    def settings(self) -> dict[str, Any]:
        """Fields beside the parameters (models, schedules)."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "values"}

    @classmethod
    def from_dict(cls, data: Mapping) -> Self:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping
            What `to_dict` returned.

        Returns
        -------
        Controller
            With the same values.
        """
        return cls(**cls.settings_from(data["settings"]),
                   values={p["name"]: p["value"] for p in data["parameters"]})

    @classmethod
    def settings_from(cls, data: Mapping) -> dict[str, Any]:
        """Fields beside the parameters from plain data.

        Parameters
        ----------
        data : mapping
            The settings of `to_dict`.

        Returns
        -------
        dict
            Fields of the constructor.
        """
        return dict(data)


def by_car(values: Values, cars: int) -> list[dict[str, float]]:
    """Values of every parameter, car by car.

    Parameters
    ----------
    values : mapping of str to (cars,) array
    cars : int

    Returns
    -------
    list of dict of str to float
    """
    return [{n: float(a[k]) for n, a in values.items()} for k in range(cars)]


def start_together(controllers: Sequence[Controller], setting: Setting) -> Law:
    """One running law for cars that have a controller each: those that differ in their values alone share a law.

    Parameters
    ----------
    controllers : sequence of Controller
        One for each car.
    setting : Setting

    Returns
    -------
    Law
        Steps all cars at once.

    Raises
    ------
    InputError
        Not one controller for each car, or laws that demand different things.
    """
    if len(controllers) != setting.cars:
        raise InputError("every car needs one controller", got=f"{len(controllers)} for {setting.cars} cars")
    if len({c.demands for c in controllers}) > 1:
        raise InputError("laws that run side by side demand the same thing",
                         got=", ".join(sorted({c.demands for c in controllers})))
    groups: dict[tuple, list[int]] = {}
    for car, law in enumerate(controllers):
        groups.setdefault((type(law), *map(id, law.settings.values())), []).append(car)
    started = []
    for places in groups.values():
        first = controllers[places[0]]
        values = {n: np.array([controllers[c].values[n] for c in places]) for n in first.names}
        started.append((np.array(places), first.begin(values, replace(setting, cars=len(places)))))
    return started[0][1] if len(started) == 1 else _Several(started, setting.cars)


class _Several(Law):
    """Laws that have some of the cars each."""

    def __init__(self, parts: list[tuple[np.ndarray, Law]], cars: int) -> None:
        self._parts, self._cars = parts, cars

    def step(self, seen: Signals) -> np.ndarray:
        out = np.empty(self._cars)
        for places, law in self._parts:
            out[places] = law.step({n: a[places] for n, a in seen.items()})
        return out

    def counted(self) -> dict[str, np.ndarray]:
        out: dict[str, np.ndarray] = {}
        for places, law in self._parts:
            for name, counts in law.counted().items():
                out.setdefault(name, np.zeros(self._cars))[places] = counts
        return out
