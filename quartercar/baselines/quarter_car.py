"""QuarterCarBaseline: sprung and unsprung mass on a measured road, with an actuator between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline, Coefficient
from lpvid.baselines.signals import Core, Signals
from lpvid.codec import ADDED, Coded
from lpvid.errors import InputError
from lpvid.identification.covariance import clusters
from lpvid.least_squares import FunctionResiduals, StopRule, minimise_dense
from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.parameters import BENCH, CarParameters
from quartercar.vehicle.strut_friction import OUTPUTS, CarCore, discretised

ROLES = {"road": "m", "unsprung": "m", "sprung": "m", "actuator": "N"}
"""what a quarter car is simulated from and compared with, and the unit of each"""
UNITS = {"spring_stiffness": "N/m", "damping": "N*s/m", "sprung_mass": "kg", "unsprung_mass": "kg",
         "tyre_stiffness": "N/m", "tyre_damping": "N*s/m"}
FREE = ("spring_stiffness", "damping", "unsprung_mass", "tyre_stiffness", "tyre_damping")
"""what a fit moves; the sprung mass is the scale of all the others, which motions alone do not determine"""
MASS_REACH, STIFFNESS_REACH, DAMPING_REACH = 4.0, 10.0, 10.0
"""how far a fit may move from the given car: factors either way for masses and stiffnesses; for the dampings a multiple
of the critical one, 2√(km)"""
HOLD_FIRST = ("sprung_mass", "unsprung_mass", "tyre_damping", "tyre_stiffness", "spring_stiffness", "damping")
"""of several parameters that data cannot determine together, the one that is held at its given value"""
LOOSE = 0.5
"""standard error, as a share of a parameter, from which it counts as not determined"""
SAME = 0.02
"""share by which the squared error may grow when such a parameter is held"""
BLOCK = 2.0
"""length of the blocks over which errors are summed for standard errors [s]"""
DIFFERENCE = 1e-5


@dataclass(frozen=True, eq=False)
class QuarterCarBaseline(Coded, Baseline):
    """A quarter car simulated from the measured road and actuator force.

    Motions are the same for a car whose masses, stiffnesses and dampings are all twice as large; only an actuator's
    force, which may be wrong itself, sets the scale. The sprung mass is therefore held unless it is requested, the
    others stay within physical reach of the given car, and a fit holds what the records do not determine.

    Attributes
    ----------
    car : CarParameters
    free : tuple of str
        Parameters that a fit may move; none for a car whose parameters are given.
    output : {"sprung", "unsprung"}
        Which motion is compared.
    actuated : bool
        Whether there is an actuator whose force is recorded.
    given : CarParameters, optional
        The car around which the bounds lie; `car` when left out.
    """

    kind = "quarter-car"
    JSON = ("kind", ...)

    car: CarParameters = BENCH
    free: tuple[str, ...] = FREE
    output: str = "sprung"
    actuated: bool = field(default=True, metadata=ADDED)
    given: CarParameters | None = field(default=None, metadata=ADDED)
    name: str = field(default="quarter-car", init=False)
    output_unit: str = field(default="m", init=False)
    static: bool = field(default=False, init=False)
    start: ClassVar[int] = 1

    def __post_init__(self) -> None:
        checks.one_of(self.output, OUTPUTS, "output")
        for name in self.free:
            checks.one_of(name, tuple(UNITS), "a free parameter")
        if self.given is None:
            object.__setattr__(self, "given", self.car)

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(ROLES)[: 4 if self.actuated else 3]

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        assert self.given is not None
        found = []
        for name in self.free:
            value = float(getattr(self.given, name))
            low, high = _reach(self.given, name)
            found.append(Coefficient(name, UNITS[name], low, high, max(value, 0.01 * high if low == 0 else value)))
        return tuple(found)

    @property
    def vector(self) -> np.ndarray:
        return np.array([getattr(self.car, n) for n in self.free])

    def with_vector(self, vector: np.ndarray) -> QuarterCarBaseline:
        return replace(self, car=self.car.replace(**dict(zip(self.free, map(float, vector), strict=True))))

    def signals(self, record: Record) -> Signals:
        period = record.sample_time
        if period is None:
            raise InputError(f"record '{record.name}' has no uniform clock", mend="--sample-rate")
        for role in self.channels:
            if not record.has(role):
                raise InputError(f"record '{record.name}' has no {role}", got=", ".join(record.channels),
                                 why="a quarter car is simulated from its road and compared with its motion",
                                 mend=checks.role_mend(role))
        for role, wanted in ROLES.items():
            if record.has(role) and record.unit(role) not in (wanted, ""):
                mend = "positions of road, wheel and body; between accelerations, lpvid identify --input TABLE " \
                    "--output BODY" if wanted == "m" else "the actuator's force, or leave the role out"
                raise InputError(f"record '{record.name}': {role} has a wrong unit", got=record.unit(role),
                                 why=f"{wanted} expected", mend=mend)
        channels = {r: checks.finite(record[r], f"record '{record.name}': {r}") for r in ROLES if record.has(r)}
        return Signals(period, channels, channels[self.output], record.name)

    def core(self, vector: np.ndarray) -> Core:
        return CarCore(self.with_vector(vector).car, output=self.output)

    def fit(self, records: Sequence[Record]) -> QuarterCarBaseline:
        """Least squares of the free run; what the records do not determine is held as given.

        A parameter counts as such where its standard error is larger than half of it, or where it has run into its
        bounds, and the error hardly grows when it is held.
        """
        signals = [self.signals(r) for r in records]
        if not self.free:
            return self
        found, spread, cost = _searched(self, signals)
        while True:
            loose = [n for n, s, c, v in zip(found.free, spread, found.coefficients, found.vector, strict=True)
                     if s > LOOSE * max(c.scale, abs(v)) or v >= c.upper * (1 - 1e-6) or 0 < v <= c.lower * (1 + 1e-6)]
            for name in sorted(loose, key=HOLD_FIRST.index):
                smaller = _searched(found.holding(name), signals)
                if smaller[2] <= (1 + SAME) * cost:
                    found, spread, cost = smaller
                    break
            else:
                return found

    def holding(self, name: str) -> QuarterCarBaseline:
        """The same with one parameter at its given value, and no longer free.

        Parameters
        ----------
        name : str
            Of `free`.

        Returns
        -------
        QuarterCarBaseline
        """
        assert self.given is not None
        return replace(self, car=self.car.replace(**{name: getattr(self.given, name)}),
                       free=tuple(n for n in self.free if n != name))

    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        out = np.empty((signals.n_samples, vector.size))
        for j, coefficient in enumerate(self.coefficients):
            up, down = vector.copy(), vector.copy()
            up[j] = min(up[j] + DIFFERENCE * coefficient.scale, coefficient.upper)
            down[j] = max(down[j] - DIFFERENCE * coefficient.scale, coefficient.lower)
            out[:, j] = (self.core(up)(signals) - self.core(down)(signals)) / (up[j] - down[j])
        return out

    def starts(self, signals: Sequence[Signals]) -> list[np.ndarray]:
        return []


def _reach(given: CarParameters, name: str) -> tuple[float, float]:
    """Bounds of a parameter around a given car."""
    if name == "damping":
        return 0.0, DAMPING_REACH * 2 * float(np.sqrt(given.spring_stiffness * given.sprung_mass))
    if name == "tyre_damping":
        return 0.0, DAMPING_REACH / 5 * float(np.sqrt(given.tyre_stiffness * given.unsprung_mass))
    factor = MASS_REACH if name.endswith("mass") else STIFFNESS_REACH
    value = float(getattr(given, name))
    return value / factor, value * factor


def _searched(baseline: QuarterCarBaseline, signals: Sequence[Signals]
              ) -> tuple[QuarterCarBaseline, np.ndarray, float]:
    """The fit inside the bounds, standard errors (infinite where not identifiable), the squared error."""
    if not baseline.free:
        core = baseline.core(baseline.vector)
        return baseline, np.empty(0), float(sum(np.sum((core(s) - s.output) ** 2) for s in signals))
    scale = np.array([c.scale for c in baseline.coefficients])
    low, high = (np.array([getattr(c, side) for c in baseline.coefficients]) / scale for side in ("lower", "upper"))

    def errors(z: np.ndarray) -> np.ndarray:
        core = baseline.core(z * scale)
        return np.concatenate([core(s) - s.output for s in signals])

    def slopes(z: np.ndarray) -> np.ndarray:
        return np.vstack([baseline.sensitivities(s, z * scale) for s in signals]) * scale

    start = np.clip(baseline.vector / scale, low, high)
    found = minimise_dense(FunctionResiduals(errors, slopes), start, StopRule(evaluations=80), (low, high))
    assert found is not None
    end = found.trial
    return baseline.with_vector(end.point * scale), _spread(slopes(end.point), end.residual, signals) * scale, end.cost


def _spread(jacobian: np.ndarray, errors: np.ndarray, signals: Sequence[Signals]) -> np.ndarray:
    """(P,) standard errors in sandwich form over blocks of `BLOCK` seconds, infinite where not identifiable."""
    block = np.concatenate([k + np.arange(s.n_samples) * s.sample_time // BLOCK for k, s in
                            zip(np.cumsum([0, *(1 + s.n_samples * s.sample_time // BLOCK for s in signals)])[:-1],
                                signals, strict=True)]).astype(int)
    middle = clusters(jacobian * errors[:, None], block)
    values, axes = np.linalg.eigh(jacobian.T @ jacobian)
    seen = values > 1e-9 * max(float(values[-1]), 1e-300)
    inverse = (axes[:, seen] / values[seen]) @ axes[:, seen].T
    variance = np.diag(inverse @ middle @ inverse).copy()
    variance[np.any(np.abs(axes[:, ~seen]) > 0.05, axis=1)] = np.inf
    return np.sqrt(variance)


__all__ = ["FREE", "UNITS", "CarCore", "QuarterCarBaseline", "discretised"]
