"""QuarterCarBaseline: sprung and unsprung mass on a measured road, with an actuator between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from lpvid import _checks
from lpvid.diagnosis.baseline import Baseline, Coefficient
from lpvid.diagnosis.signals import Core, Signals
from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.parameters import BENCH, CarParameters

ROLES = ("road", "unsprung", "sprung", "actuator")
FREE = ("spring_stiffness", "damping", "sprung_mass", "unsprung_mass", "tyre_stiffness", "tyre_damping")
UNITS = {"spring_stiffness": "N/m", "damping": "N*s/m", "sprung_mass": "kg", "unsprung_mass": "kg",
         "tyre_stiffness": "N/m", "tyre_damping": "N*s/m"}
SMOOTH = 1e-3
"""speed over which the friction of the strut is smoothed [m/s]"""
DIFFERENCE = 1e-5


@dataclass(frozen=True)
class CarCore:
    """A linear quarter car with friction in the strut, as a simulation of one of its motions.

    ::

        m_s z̈_s   = −k_s (z_s − z_us) − c (ż_s − ż_us) − F_c sign(ż_s − ż_us) + F
        m_us z̈_us =  k_s (z_s − z_us) + c (ż_s − ż_us) + F_c sign(ż_s − ż_us) − F − k_t (z_us − z_r) − c_t (ż_us − ż_r)

    Attributes
    ----------
    car : CarParameters
    friction : float
        F_c [N].
    output : {"sprung", "unsprung"}
    """

    car: CarParameters
    friction: float = 0.0
    output: str = "sprung"

    def changed(self, friction: float = 0.0, **changes: float) -> CarCore:
        """The same with friction added, and some parameters multiplied (``tyre_stiffness=1.1``) or replaced."""
        return replace(self, car=self.car.replace(**changes), friction=self.friction + friction)

    def __call__(self, s: Signals) -> np.ndarray:
        from quartercar import _car_kernels as kernels

        road = s["road"]
        force = s["actuator"] if s.has("actuator") else np.zeros(s.n_samples)
        inputs = np.column_stack([road, force])
        ad, b0, b1, bf = discretised(self.car, s.sample_time)
        first = np.array([s["sprung"][0], 0.0, s["unsprung"][0], 0.0])
        states = np.empty((s.n_samples, 4))
        kernels.run_with_friction(ad, b0, b1, bf, np.array([0.0, 1.0, 0.0, -1.0]), np.ascontiguousarray(inputs),
                                  float(self.friction), SMOOTH, first, states)
        return np.ascontiguousarray(states[:, 0 if self.output == "sprung" else 2])


def discretised(car: CarParameters, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Exact step of the linear car for road and actuator force that are linear between samples.

    Returns
    -------
    ad : (4, 4) array
        States z_s, ż_s, z_us, ż_us.
    b0, b1 : (4, 2) arrays
        Weights of road and actuator force at the step's start and end.
    bf : (4,) array
        Weight of a friction force that opposes extension, held over the step.
    """
    from scipy.linalg import expm

    ms, mu, ks, c, kt, ct = (car.sprung_mass, car.unsprung_mass, car.spring_stiffness, car.damping,
                             car.tyre_stiffness, car.tyre_damping)
    a = np.array([[0, 1, 0, 0], [-ks / ms, -c / ms, ks / ms, c / ms], [0, 0, 0, 1],
                  [ks / mu, c / mu, -(ks + kt) / mu, -(c + ct) / mu]])
    level = np.array([[0, 0], [0, 1 / ms], [0, 0], [kt / mu, -1 / mu]])
    slope = np.array([[0, 0], [0, 0], [0, 0], [ct / mu, 0]])
    block = np.zeros((8, 8))
    block[:4, :4], block[:4, 4:6], block[:4, 6:], block[4:6, 6:] = a, level, slope, np.eye(2)
    e = expm(block * step)
    ramp = e[:4, 6:] / step
    held = np.zeros((5, 5))
    held[:4, :4], held[:4, 4] = a, [0.0, -1 / ms, 0.0, 1 / mu]
    return e[:4, :4].copy(), e[:4, 4:6] - ramp, ramp, np.ascontiguousarray(expm(held * step)[:4, 4])


@dataclass(frozen=True, eq=False)
class QuarterCarBaseline(Baseline):
    """A quarter car simulated from the measured road and actuator force.

    Attributes
    ----------
    car : CarParameters
    free : tuple of str
        Parameters that a fit may move; none for a car whose parameters are given.
    output : {"sprung", "unsprung"}
        Which motion is compared.
    """

    car: CarParameters = BENCH
    free: tuple[str, ...] = FREE
    output: str = "sprung"
    name: str = field(default="quarter-car", init=False)
    output_unit: str = field(default="m", init=False)
    static: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        _checks.one_of(self.output, ("sprung", "unsprung"), "output")
        for name in self.free:
            _checks.one_of(name, FREE, "a free parameter")

    @property
    def channels(self) -> tuple[str, ...]:
        return ("road", "unsprung", "sprung", "actuator")

    @property
    def start(self) -> int:
        return 1

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        low = {"damping": 0.0, "tyre_damping": 0.0, "spring_stiffness": 0.0}
        return tuple(Coefficient(n, UNITS[n], low.get(n, 1e-3 * float(getattr(self.car, n))), np.inf,
                                 max(float(getattr(self.car, n)), 1e-3)) for n in self.free)

    @property
    def vector(self) -> np.ndarray:
        return np.array([getattr(self.car, n) for n in self.free])

    def with_vector(self, vector: np.ndarray) -> QuarterCarBaseline:
        return replace(self, car=self.car.replace(**dict(zip(self.free, map(float, vector), strict=True))))

    def signals(self, record: Record) -> Signals:
        period = record.sample_time
        if period is None:
            raise InputError(f"record '{record.name}' has no uniform clock", mend="--sample-rate")
        for role in ("road", "unsprung", "sprung"):
            if not record.has(role):
                raise InputError(f"record '{record.name}' has no {role}", got=", ".join(record.channels),
                                 why="a quarter car is simulated from its road and compared with its motion",
                                 mend=f"--role {role}=CHANNEL")
        channels = {r: _checks.finite(record[r], f"record '{record.name}': {r}") for r in ROLES if record.has(r)}
        return Signals(period, channels, channels[self.output], record.name)

    def core(self, vector: np.ndarray) -> Core:
        return CarCore(self.with_vector(vector).car, output=self.output)

    def fit(self, records: Sequence[Record]) -> QuarterCarBaseline:
        from scipy.optimize import least_squares

        if not self.free:
            return self
        signals = [self.signals(r) for r in records]
        scale = np.array([c.scale for c in self.coefficients])

        def errors(z: np.ndarray) -> np.ndarray:
            core = self.core(np.exp(z) * scale)
            return np.concatenate([core(s) - s.output for s in signals])

        start = np.log(np.maximum(self.vector, 1e-3 * scale) / scale)
        found = least_squares(errors, start, x_scale=1.0, bounds=(-7, 7), max_nfev=60)
        return self.with_vector(np.exp(found.x) * scale)

    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        out = np.empty((signals.n_samples, vector.size))
        for j, coefficient in enumerate(self.coefficients):
            step = DIFFERENCE * coefficient.scale
            up, down = vector.copy(), vector.copy()
            up[j] += step
            down[j] = max(down[j] - step, coefficient.lower)
            out[:, j] = (self.core(up)(signals) - self.core(down)(signals)) / (up[j] - down[j])
        return out

    def to_dict(self) -> dict:
        return {"kind": "quarter-car", "car": asdict(self.car), "free": list(self.free), "output": self.output}
