"""What every damper model is asked on: true parameters and motions rich enough to recover them.

A model's author edits `CASES`; where a model is not named the defaults below serve.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from lpvid.record import Record
from quartercar.dampers import MODELS, Damper, Drive, LawDamper, model_class
from quartercar.dampers.families import DynamicDamper, StaticDamper
from quartercar.dampers.fitting import fit


@dataclass(frozen=True)
class Case:
    """A true damper and how it is moved.

    Attributes
    ----------
    settings : dict
        Fields of the model beyond the common ones (orders, tables).
    values : dict
        True parameters where they are not the default moved by up to 15 %; those whose default rests on a bound need
        one inside.
    stroke, speed : float
        Largest displacement [m] and velocity [m/s] of the multisine.
    lowest, highest : float
        Its band [Hz].
    currents : (float, float)
        Between which the current steps at random; ignored by models that do not read it.
    hold : float
        Time between two steps of the current [s].
    duration, sample_time : float
        [s]
    noise : float
        White, as a share of the force's standard deviation.
    fit : dict
        Changed `FitSettings`.
    teacher : str
        The model whose force a sampled model is fitted to, to have true parameters; ignored by laws.
    smooth_tolerance : float
        Of `response` against a tight integration of `rates`, as a share of the force's range.
    """

    settings: dict[str, Any] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    stroke: float = 0.03
    speed: float = 0.8
    lowest: float = 0.3
    highest: float = 9.0
    currents: tuple[float, float] = (0.0, 2.0)
    hold: float = 0.3
    duration: float = 8.0
    sample_time: float = 1.0 / 512
    noise: float = 0.01
    fit: dict[str, Any] = field(default_factory=dict)
    teacher: str = "guo"
    smooth_tolerance: float = 2e-3


CASES: dict[str, Case] = {
    "linear": Case(values={"mass": 1.5, "stiffness": 4000.0}),
    "bouc-wen": Case(values={"series_damping_per_current": 4000.0, "hysteresis_shape": 0.3, "gas_force": -70.0}),
    "wang-kamath": Case(settings={"growing": True}),
    "force-map": Case(settings={"nodes": (0.0, 1.0, 2.0), "knots": (-0.5, -0.15, 0.0, 0.15, 0.5)}, hold=0.1),
    "extended-bouc-wen": Case(settings={"nodes": (0.0, 2.0)}, hold=0.1, noise=0.005, fit={"polished": 1}),
    "relief-valve": Case(duration=3.0, fit={"starts": 3, "polished": 1}),
    "relief-valve-orifice": Case(duration=3.0, fit={"starts": 3, "polished": 1}),
    "narx-2": Case(highest=60.0),
    "narx-3": Case(highest=60.0),
    "lpv-arx": Case(settings={"order": 1}, teacher="bouc-wen", highest=30.0, hold=0.1),
    "quasi-lpv": Case(settings={"lags": 4, "trial": 1, "oddness": 900.0}, teacher="bouc-wen", highest=30.0, noise=0.05),
    "compliance": Case(settings={"lags": 1}, teacher="bouc-wen", highest=30.0),
}
"""By the model's name on the command line."""

PENALISED = ("quasi-lpv", "compliance")
"""Models whose parameters a prior holds where the data say nothing, on knots that follow the data: of these the force
is recovered, and the parameters mean nothing by themselves."""
NAMES = [name for name, _, _ in MODELS]
FREE = [n for n in NAMES if n not in PENALISED]
LAWS = [n for n in NAMES if issubclass(model_class(n), LawDamper)]
STATIC = [n for n in NAMES if issubclass(model_class(n), StaticDamper)]
DYNAMIC = [n for n in NAMES if issubclass(model_class(n), DynamicDamper)]


def case_of(name: str) -> Case:
    """The case of a model."""
    return CASES.get(name, Case())


def blank(name: str) -> Damper:
    """The model with default parameters, as a user would hand it to `fit`."""
    case = case_of(name)
    return model_class(name)(**case.settings, current_range=case.currents)


@cache
def truth(name: str) -> Damper:
    """The model with the case's true parameters: the defaults moved by up to 15 %, or as the case says.

    A sampled model has no default parameters; its true ones are what it makes of another model's force.
    """
    damper, rng = blank(name), np.random.default_rng(7)
    if name not in LAWS:
        case, teacher = case_of(name), truth(case_of(name).teacher)
        drive = _driven(case, 2)
        force = teacher.response(drive, teacher.vector)
        return fit(damper, [record_of(drive, force + 0.02 * force.std() * rng.normal(size=force.size))]).damper
    moved = {p.name: float(np.clip(p.default * rng.uniform(0.85, 1.15), p.lower, p.upper)) for p in damper.parameters}
    return damper.with_values(**{**moved, **case_of(name).values})


@dataclass(frozen=True)
class Multisine:
    """A motion that is smooth and known at any time."""

    amplitude: np.ndarray
    omega: np.ndarray
    phase: np.ndarray

    @classmethod
    def of(cls, case: Case, rng: np.random.Generator) -> Multisine:
        """As fast as the case says, with the spectrum that gives its stroke."""
        f = np.geomspace(case.lowest, case.highest, 14) * rng.uniform(0.95, 1.05, 14)
        found = cls(np.ones(14), 2 * np.pi * f, rng.uniform(0, 2 * np.pi, 14))
        dense = np.arange(0.0, case.duration, 4e-3)
        for power in np.arange(0.0, 3.01, 0.1):  # the flatter the line spectrum the faster for its stroke
            found = cls(f**-power, found.omega, found.phase)
            x, v = found.at(dense)
            if np.abs(v).max() / np.abs(x).max() <= case.speed / case.stroke:
                break
        return cls(found.amplitude * case.speed / np.abs(v).max(), found.omega, found.phase)

    def at(self, times: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """(displacement, velocity)."""
        angle = np.multiply.outer(times, self.omega) + self.phase
        return np.sin(angle) @ self.amplitude, np.cos(angle) @ (self.amplitude * self.omega)


def current_of(case: Case, rng: np.random.Generator, times: np.ndarray) -> np.ndarray:
    """Random levels, each held for `hold`."""
    low, high = case.currents
    levels = rng.uniform(low, high, int(times[-1] / case.hold) + 2)
    levels[:4] = low, high, 0.5 * (low + high), low
    return levels[(times / case.hold).astype(int)]


def recovery_drive(name: str, seed: int = 1) -> Drive:
    """The motion and current of a model's case, without force."""
    return _driven(case_of(name), seed)


def _driven(case: Case, seed: int) -> Drive:
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, case.duration, case.sample_time)
    x, v = Multisine.of(case, rng).at(times)
    return Drive(case.sample_time, v, x, current_of(case, rng, times))


def record_of(drive: Drive, force: np.ndarray | None = None, unit: str = "A") -> Record:
    """A drive as a record."""
    channels = {"displacement": drive.displacement, "velocity": drive.velocity, "current": drive.current}
    units = {"displacement": "m", "velocity": "m/s", "current": unit, "force": "N"}
    if force is not None:
        channels["force"] = force
    return Record(channels, sample_time=drive.sample_time, units=units, name="case")


def noisy_record(name: str, rng: np.random.Generator, seed: int = 1) -> Record:
    """The true damper's force along its case, with white noise."""
    damper, drive = truth(name), recovery_drive(name, seed)
    force = damper.response(drive, damper.vector)
    assert np.isfinite(force).all()
    return record_of(drive, force + case_of(name).noise * force.std() * rng.normal(size=force.size),
                     damper.current_unit)
