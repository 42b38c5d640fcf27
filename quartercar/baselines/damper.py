"""DamperBaseline: any law of `quartercar.dampers` as what a diagnosis starts from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from lpvid.baselines.baseline import Baseline, Coefficient
from lpvid.baselines.signals import Core, Signals
from lpvid.baselines.spectra import derivative
from lpvid.record import Record
from quartercar.dampers.drive import Drive
from quartercar.dampers.families import LawDamper, StaticDamper
from quartercar.dampers.fitting.front import fit
from quartercar.dampers.fitting.problem import sized_parameters
from quartercar.dampers.fitting.settings import FitSettings
from quartercar.dampers.laws.relief_valve import LagDamper
from quartercar.dampers.parameter import Parameter
from quartercar.dampers.sizes import TYPICAL, Sizes

STARTS = 6
"""points from which a search over a law's parameters may begin"""
ROLES = ("displacement", "velocity", "current", "temperature")
ROUGH = FitSettings(starts=4, polished=1, evaluations=15, short_evaluations=6, tolerance=1e-4)
"""search for a damper whose stiff run takes long: the diagnosis moves its parameters on from there"""
AFFORDABLE = {"valve_frequency": (5.0, 1000.0), "valve_damping": (0.1, 100.0)}
"""a poppet that rings faster (at a sample rate of 1 kHz), or without damping, takes a stiff run minutes and no record
shows it"""
REACH = 30.0
"""factor by which a diagnosis moves a parameter of such a law: a valve without loss chatters for minutes"""


@dataclass(frozen=True, eq=False)
class DamperBaseline(Baseline):
    """A damper law, free in its own parameters.

    Attributes
    ----------
    damper : LawDamper
    sizes : Sizes or None
        Of the records that it was fitted to; None: `TYPICAL`.
    """

    damper: LawDamper
    name: str = field(init=False)
    output: str = field(default="force", init=False)
    output_unit: str = field(default="N", init=False)
    static: bool = field(init=False)
    adaptive: bool = field(init=False)
    forward: bool = field(init=False)
    polarity: int = field(init=False)
    schedule: tuple[str, ...] = field(init=False)
    apart: tuple[str, ...] = field(init=False)
    sizes: Sizes | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.damper.name)
        linear = self.damper.linear_elements is not None
        object.__setattr__(self, "static", linear or isinstance(self.damper, StaticDamper))
        object.__setattr__(self, "adaptive", isinstance(self.damper, LagDamper))
        object.__setattr__(self, "apart", ("mass",) if linear else ())
        object.__setattr__(self, "forward", self.damper.forward)
        object.__setattr__(self, "polarity", self.damper.polarity)
        object.__setattr__(self, "schedule", tuple(r for r in ("current",) if r in self.damper.reads))

    @property
    def channels(self) -> tuple[str, ...]:
        return (*self.damper.reads, "force")

    @cached_property
    def coefficients(self) -> tuple[Coefficient, ...]:
        bounds = _within_reach if self.adaptive else _own_bounds
        sizes = self.sizes or TYPICAL
        return tuple(Coefficient(p.name, p.unit, *bounds(p, v, sizes), max(abs(v), abs(p.default), _least(p, sizes)))
                     for p, v in zip(sized_parameters(self.damper, sizes), self.damper.vector, strict=True))

    @property
    def vector(self) -> np.ndarray:
        return self.damper.vector

    @property
    def start(self) -> int:
        return self.damper.start

    def with_vector(self, vector: np.ndarray) -> DamperBaseline:
        return replace(self, damper=self.damper.with_vector(vector))

    def signals(self, record: Record) -> Signals:
        drive = self.damper.drive(record, force=True)
        assert drive.force is not None
        channels = {r: record[r] for r in ROLES if record.has(r)}
        if "displacement" in channels:
            channels["displacement"] = channels["displacement"] - self.damper.centre
        return Signals(drive.sample_time, channels, drive.force, record.name)

    def core(self, vector: np.ndarray) -> Core:
        return DamperCore(self, vector)

    def starts(self, signals: Sequence[Signals]) -> list[np.ndarray]:
        if not self.static:  # each costs a search of its own
            return []
        return list(self.damper.starts([self.drive(s) for s in signals], STARTS, np.random.default_rng(0)))

    def fit(self, records: Sequence[Record]) -> DamperBaseline:
        settings = ROUGH if isinstance(self.damper, LagDamper) else None
        found = fit(self.damper, records, settings=settings).damper
        sizes = Sizes.of([found.drive(r, force=True) for r in records])
        return DamperBaseline(found, sizes=sizes)  # type: ignore[arg-type]

    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        return self.damper.jacobian(self.drive(signals), vector)

    def drive(self, s: Signals) -> Drive:
        """Signals as a damper reads them, made once.

        Parameters
        ----------
        s : Signals

        Returns
        -------
        Drive
        """
        return s.cached("drive", lambda: _made(s, _rate(s) if self.apart else None))

    def to_dict(self) -> dict:
        return {"kind": "damper", "damper": self.damper.to_dict()}


@dataclass(frozen=True, eq=False)
class DamperCore:
    """The simulation of a damper law alone, at a parameter vector.

    Attributes
    ----------
    baseline : DamperBaseline
    vector : (P,) array
    """

    baseline: DamperBaseline
    vector: np.ndarray

    def __call__(self, s: Signals) -> np.ndarray:
        return self.baseline.damper.response(self.baseline.drive(s), self.vector)


def _made(s: Signals, rate: np.ndarray | None) -> Drive:
    zeros = np.zeros(s.n_samples)
    return Drive(s.sample_time, s["velocity"], s.channels.get("displacement", zeros), s.channels.get("current", zeros),
                 s.output, rate)


def _rate(s: Signals) -> np.ndarray:
    """Rate of change of the record's velocity, without the noise beyond its band.

    Central differences are a quarter too small at a fifth of the sample rate. At speeds that are only evaluated it is
    the record's, so that with its mass, too, the law is one of the speed; between the samples it is straight.
    """
    if s.coarse is not None:
        return s.refined(_rate(s.coarse))
    record = s if s.record is None else s.record
    return s.along_record("velocity", "rate of change", lambda _: derivative(record, "velocity"))


def _own_bounds(parameter: Parameter, value: float, sizes: Sizes) -> tuple[float, float]:
    return parameter.lower, parameter.upper


def _within_reach(parameter: Parameter, value: float, sizes: Sizes) -> tuple[float, float]:
    """Bounds of a parameter of a stiff law: about its value, and where a run does not take minutes."""
    low, high = (value / REACH, value * REACH) if parameter.log else (parameter.lower, parameter.upper)
    faster = TYPICAL.sample_time / sizes.sample_time if parameter.unit == "Hz" else 1.0
    least, most = (faster * f for f in AFFORDABLE[parameter.name]) if parameter.name in AFFORDABLE else (low, high)
    return max(parameter.lower, low, least), max(min(parameter.upper, high, most), least)


def _least(parameter: Parameter, sizes: Sizes) -> float:
    """Change of a parameter that matters where neither its value nor its typical one gives a scale, in its unit."""
    return 1e-6 * sizes.factor(parameter.unit)
