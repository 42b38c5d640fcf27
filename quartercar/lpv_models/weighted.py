"""The generalised plant of suspension design: comfort, road holding, stroke and effort weighted, sensors with noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType

import numpy as np

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import connect
from lpvid.synthesis.joining import gain
from lpvid.synthesis.weights import bandpass, scheduled_gain
from lpvid.toolkit import checks
from quartercar.vehicle.linear import OUTPUTS

MEASUREMENTS: Mapping[str, tuple[str, ...]] = MappingProxyType({
    "stroke-body": ("suspension_deflection", "body_acceleration"),
    "stroke": ("suspension_deflection",),
    "body": ("body_acceleration",),
    "observed": ("suspension_deflection", "body_velocity", "tyre_deflection", "wheel_velocity")})
"""Measurement sets by name: "stroke-body" is what production cars have, "observed" what an observer makes of it."""
COMFORT_BAND = (1.0, 12.0)
WHEEL_BAND = (8.0, 15.0)
"""Bands of the weights [Hz] (equation sheet 4.4)."""


@dataclass(frozen=True)
class SuspensionWeights:
    """How large each signal may be: every weight is one over a level, over a band of frequencies.

    A design makes the worst gain from road and noise to all weighted signals small: a signal with half the level counts
    twice. Levels matter by their ratios; `docs/design_weights.md` states what each one does and how to choose it.

    Attributes
    ----------
    acceleration : float
        Body acceleration in the comfort band [m/s²].
    tyre_force : float
        Dynamic tyre force in the wheel band [N].
    stroke : float
        Suspension deflection, at all frequencies [m].
    demand : float
        Force beside the nominal damping, at all frequencies [N].
    relief : float
        Share of comfort, road holding and room that is still demanded where the damper can give nothing of the demand.
    comfort_low, comfort_high, wheel_low, wheel_high : float
        Bands [Hz].
    road : float
        Road velocity that counts as one [m/s].
    noise : float
        Factor on the sensors' noise.

    Examples
    --------
    >>> SuspensionWeights(acceleration=0.5).comfort_gain(np.array([3.5]), ).round(2)
    array([2.])
    """

    acceleration: float = 1.0
    tyre_force: float = 1000.0
    stroke: float = 0.05
    demand: float = 3000.0
    relief: float = 0.3
    comfort_low: float = COMFORT_BAND[0]
    comfort_high: float = COMFORT_BAND[1]
    wheel_low: float = WHEEL_BAND[0]
    wheel_high: float = WHEEL_BAND[1]
    road: float = 0.1
    noise: float = 1.0

    def __post_init__(self) -> None:
        for f in fields(self):
            object.__setattr__(self, f.name, checks.positive(getattr(self, f.name), f"weight '{f.name}'"))
        if self.relief > 1:
            raise InputError("relief is a share", got=self.relief, mend="1 asks for as much as where the damper gives")
        for low, high in (("comfort_low", "comfort_high"), ("wheel_low", "wheel_high")):
            if getattr(self, low) >= getattr(self, high):
                raise InputError("a band runs from low to high",
                                 got=f"{getattr(self, low):g} to {getattr(self, high):g} Hz")

    @property
    def bands(self) -> dict[str, tuple[float, float, float]]:
        """Signal to (gain in the middle of the band, its two corner frequencies [Hz])."""
        return {"body_acceleration": (1 / self.acceleration, self.comfort_low, self.comfort_high),
                "tyre_force": (1 / self.tyre_force, self.wheel_low, self.wheel_high)}

    def comfort_gain(self, frequency: np.ndarray) -> np.ndarray:
        """|W| on the body's acceleration at frequencies [Hz].

        Parameters
        ----------
        frequency : (n,) array
            [Hz].

        Returns
        -------
        (n,) array
            Per m/s²; largest, 1/`acceleration`, in the middle of the band.
        """
        return _band_gain(self.bands["body_acceleration"], frequency)

    def wheel_gain(self, frequency: np.ndarray) -> np.ndarray:
        """|W| on the tyre force at frequencies [Hz].

        Parameters
        ----------
        frequency : (n,) array
            [Hz].

        Returns
        -------
        (n,) array
            Per newton; largest, 1/`tyre_force`, in the middle of the band.
        """
        return _band_gain(self.bands["tyre_force"], frequency)


@dataclass(frozen=True)
class SensorNoise:
    """White noise of the sensors, as the amplitude that counts as one, and their anti-aliasing lag.

    Attributes
    ----------
    suspension_deflection, body_velocity, tyre_deflection, wheel_velocity, body_acceleration : float
        [m], [m/s], [m], [m/s], [m/s²].
    bandwidth : float
        Of a first-order lag on the accelerometer [Hz]; it keeps C_2 constant, since the acceleration holds the damper's
        force.
    """

    suspension_deflection: float = 2e-4
    body_velocity: float = 1e-2
    tyre_deflection: float = 2e-4
    wheel_velocity: float = 2e-2
    body_acceleration: float = 0.05
    bandwidth: float = 60.0

    def __post_init__(self) -> None:
        for f in fields(self):
            object.__setattr__(self, f.name, checks.positive(getattr(self, f.name), f"sensor '{f.name}'"))


@dataclass(frozen=True, eq=False)
class WeightedCar:
    """A car to design a controller for.

    ::

        road ──> W_r ─> ┌─────────┐ ─> body_acceleration ──> W_a (1-12 Hz) ──> comfort       }
                        │  car    │ ─> tyre_force ─────────> W_t (8-15 Hz) ──> road_holding  }  z
                        │ (given  │ ─> suspension_deflection ─> 1/level ────> room           }
        u ──> lag ────> │  share) │ ─> … ─────────────────────> 1/level ────> effort         }
                        └─────────┘ ─> sensors (+ noise) ────> y

    Where the system is scheduled on ``given_share`` (`LimitedForce`), comfort, road holding and room are weighted with
    the factor relief + (1 − relief) ρ.

    Attributes
    ----------
    system : LPVStateSpace
        Continuous, with inputs ``road_velocity`` and `control` and the outputs of an embedding; a control that is
        scheduled stands behind a lag (`prefiltered`).
    control : str
    weights : SuspensionWeights
    measured : tuple of str
    noise : SensorNoise
    """

    system: LPVStateSpace
    control: str
    weights: SuspensionWeights = field(default_factory=SuspensionWeights)
    measured: tuple[str, ...] = MEASUREMENTS["stroke-body"]
    noise: SensorNoise = field(default_factory=SensorNoise)

    def __post_init__(self) -> None:
        if self.system.sample_time is not None:
            raise InputError("a suspension is weighted in continuous time", got="a discrete system")
        checks.known_name(self.control, [s.name for s in self.system.inputs], "input")
        for name in self.measured:
            checks.known_name(name, [s.name for s in self.system.outputs], "output")
            if not hasattr(self.noise, name):
                raise InputError(f"no sensor for '{name}'", mend=", ".join(f.name for f in fields(self.noise)[:5]))

    def plant(self) -> GeneralizedPlant:
        """The generalised plant; measurements are named ``measured_…``.

        Returns
        -------
        GeneralizedPlant
            Disturbances are ``road`` and one ``noise_…`` for each sensor; performance outputs are ``comfort``,
            ``road_holding``, ``room`` and ``effort``; all dimensionless. Control and measurements are in SI units.
        """
        w, blocks = self.weights, [self.system]
        wires: dict[str, Mapping[str, float]] = {"road_velocity": {"road": w.road}}
        shapes = [banded(*w.bands["body_acceleration"], "body_acceleration", "comfort"),
                  banded(*w.bands["tyre_force"], "tyre_force", "road_holding"),
                  gain([[1 / w.stroke]], [Signal("weighted_suspension_deflection", "m")], ["room"])]
        box = self.system.box
        relieved = "given_share" in box.names
        place = box.names.index("given_share") if relieved else 0
        own = Scheduling(("given_share",), (box.lower[place],), (box.upper[place],)) if relieved else box
        for shape in shapes:
            source, output = shape.inputs[0].name, shape.outputs[0].name
            wires[source] = {source.removeprefix("weighted_"): 1.0}
            blocks.append(shape.replace(outputs=(Signal(f"full_{output}"),)) if relieved else shape)
            if relieved:
                share = scheduled_gain("given_share", own, (w.relief, 1 - w.relief))
                blocks.append(share.replace(inputs=(Signal(f"full_{output}"),), outputs=(Signal(output),)))
        blocks.append(gain([[1 / w.demand]], [Signal("weighted_demand", "N")], ["effort"]))
        wires["weighted_demand"] = {self.control: 1.0}
        disturbances = ["road"]
        for name in self.measured:
            block, wired = self._sensor(name)
            blocks += block
            wires |= wired
            disturbances.append(f"noise_{name}")
        outputs = ["comfort", "road_holding", "room", "effort", *(f"measured_{n}" for n in self.measured)]
        whole = connect(blocks, [*disturbances, self.control], outputs, wires)
        return GeneralizedPlant(whole, (self.control,), tuple(outputs[4:]))

    def state_plant(self) -> GeneralizedPlant:
        """The same for state feedback: what is measured are all states, the car's first; they are ``state_0`` …

        The sensors and their noise are left out: the observer that estimates the car's states stands outside.

        Returns
        -------
        GeneralizedPlant
            With ``road`` as its only disturbance; the states after the car's are those of lag and weights.
        """
        bare = WeightedCar(self.system, self.control, self.weights, (), self.noise).plant().system
        m, n, nz = len(bare.A), bare.order, bare.n_outputs
        c, d = np.zeros((m, nz + n, n)), np.zeros((m, nz + n, bare.n_filter_inputs))
        c[:, :nz], d[:, :nz] = bare.C, bare.D
        c[bare.basis.labels.index("1"), nz:] = np.eye(n)
        names = tuple(f"state_{k}" for k in range(n))
        system = LPVStateSpace(bare.A, bare.B, c, d, bare.basis, None, bare.box, inputs=bare.inputs,
                               outputs=(*bare.outputs, *map(Signal, names)))
        return GeneralizedPlant(system, (self.control,), names)

    def _sensor(self, name: str) -> tuple[list[LPVStateSpace], dict[str, Mapping[str, float]]]:
        level = self.weights.noise * getattr(self.noise, name)
        unit = OUTPUTS[name]
        adder = gain([[1.0, 1.0]], [Signal(f"clean_{name}", unit), Signal(f"disturbed_{name}", unit)],
                     [Signal(f"measured_{name}", unit)])
        wires: dict[str, Mapping[str, float]] = {f"disturbed_{name}": {f"noise_{name}": level},
                                                 f"clean_{name}": {name: 1.0}}
        if name != "body_acceleration":
            return [adder], wires
        wires[f"clean_{name}"] = {"lagged_acceleration": 1.0}
        wires["sensed_acceleration"] = {name: 1.0}
        return [self._sensor_lag("sensed_acceleration", "lagged_acceleration"), adder], wires

    def _sensor_lag(self, source: str, output: str) -> LPVStateSpace:
        """The accelerometer's lag as a block, for the plant and for what runs in front of the controller."""
        omega = 2 * np.pi * self.noise.bandwidth
        return lti([[-omega]], [[omega]], [[1.0]], [[0.0]], (Signal(source, "m/s^2"),), (Signal(output, "m/s^2"),))

    def physical(self, controller: LPVStateSpace) -> LPVStateSpace:
        """A controller of `plant` as one of the car's own signals: its inputs renamed, the sensor's lag in front.

        Parameters
        ----------
        controller : LPVStateSpace
            Continuous, designed for `plant`.

        Returns
        -------
        LPVStateSpace
            From the signals in `measured` to `control`, SI; one state more where the body's acceleration is measured.
        """
        blocks, wires = [controller], {f"measured_{n}": {n: 1.0} for n in self.measured}
        if "body_acceleration" in self.measured:
            blocks.append(self._sensor_lag("sensed_acceleration", "lagged_acceleration"))
            wires["measured_body_acceleration"] = {"lagged_acceleration": 1.0}
            wires["sensed_acceleration"] = {"body_acceleration": 1.0}
        return connect(blocks, list(self.measured), [self.control], wires)


def lti(a: object, b: object, c: object, d: object, inputs: tuple[Signal, ...],
        outputs: tuple[Signal, ...]) -> LPVStateSpace:
    """A continuous time-invariant block.

    Parameters
    ----------
    a, b, c, d : array_like
        (n, n), (n, n_u), (n_y, n), (n_y, n_u) matrices.
    inputs, outputs : tuple of Signal
        As many as B and D have columns, C and D rows.

    Returns
    -------
    LPVStateSpace
        Without scheduling.
    """
    a, b, c, d = (np.asarray(m, dtype=float)[None] for m in (a, b, c, d))
    return LPVStateSpace(a, b, c, d, Polynomial(), None, inputs=inputs, outputs=outputs)


def banded(peak: float, low: float, high: float, signal: str, output: str) -> LPVStateSpace:
    """g (ω_l + ω_h) s/((s + ω_l)(s + ω_h)): g at √(ω_l ω_h), falling off on both sides, strictly proper.

    Parameters
    ----------
    peak : float
        g, the gain in the middle.
    low, high : float
        Corner frequencies [Hz].
    signal : str
        What is weighted, a name of `quartercar.vehicle.linear.OUTPUTS`; the input is named ``weighted_…``.
    output : str
        Name of the output, dimensionless.

    Returns
    -------
    LPVStateSpace
        Continuous, of two states.

    Examples
    --------
    >>> shape = banded(2.0, 1.0, 12.0, "body_acceleration", "comfort")
    >>> abs(shape.to_control([])(2j * np.pi * 12**0.5)).round(6)
    np.float64(2.0)
    """
    middle = float(np.sqrt(low * high))
    block = bandpass(peak, 2 * np.pi * middle, (low + high) / (2 * middle))
    return block.replace(inputs=(Signal(f"weighted_{signal}", OUTPUTS[signal]),), outputs=(Signal(output),))


def _band_gain(band: tuple[float, float, float], frequency: np.ndarray) -> np.ndarray:
    peak, low, high = band
    s = 1j * np.asarray(frequency, dtype=float)
    return np.abs(peak * (low + high) * s / ((s + low) * (s + high)))
