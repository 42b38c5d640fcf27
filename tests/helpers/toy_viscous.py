"""A viscous baseline, forces beside it as effects, records that hide one, and packages that offer both."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import pytest

import lpvid as lpv
from lpvid.baselines import Baseline, Coefficient, Signals
from lpvid.effects import EffectParameter, GridEffect, LpvChange

RATE, SLOPE, FRICTION, NOISE = 200.0, 40.0, 3.0, 0.5


@dataclass(frozen=True, eq=False)
class Viscous(Baseline):
    """force = slope × velocity."""

    slope: float = 1.0
    polarity: int = 1
    name: str = field(default="viscous", init=False)
    output: str = field(default="force", init=False)
    output_unit: str = field(default="N", init=False)
    static: bool = field(default=True, init=False)

    @property
    def channels(self):
        return ("velocity", "force")

    @property
    def coefficients(self):
        return (Coefficient("slope", "N*s/m", -1e6, 1e6, 1.0),)

    @property
    def vector(self):
        return np.array([self.slope])

    @property
    def start(self):
        return 0

    def with_vector(self, vector):
        return Viscous(float(vector[0]), self.polarity)

    def signals(self, record):
        channels = {n: record[n] for n in ("velocity", "displacement") if record.has(n)}
        return Signals(record.sample_time, channels, self.polarity * record["force"], record.name)

    def core(self, vector):
        return lambda s: vector[0] * s["velocity"]

    def fit(self, records):
        v, f = (np.concatenate([part(self.signals(r)) for r in records])
                for part in (lambda s: s["velocity"], lambda s: s.output))
        return Viscous(float(v @ f / (v @ v)), self.polarity)

    def sensitivities(self, signals, vector):
        return signals["velocity"][:, None]

    def starts(self, signals):
        return []

    def to_dict(self):
        return {"kind": "viscous", "slope": self.slope, "polarity": self.polarity}


class Added(GridEffect):
    """A force of the velocity's sign or square, or of position."""

    family: ClassVar[str] = "toy"
    stage: ClassVar[str] = "force"
    equation = reference = experiment = "toy"

    def __init__(self, name, function, needs=("velocity",), change=None):
        self.name, self.title, self.function, self.needs, self.change = name, name, function, needs, change

    @property
    def parameters(self):
        return (EffectParameter("size", "N", "size", 0.0, (-100.0, 100.0), (-1e4, 1e4), (-1.0, 1.0)),)

    def applies(self, baseline, signals):
        return None

    def compose(self, core, values, baseline):
        return lambda s: core(s) + values[0] * self.function(s)

    def lpv_change(self):
        return self.change


def sign(s: Signals) -> np.ndarray:
    return np.tanh(s["velocity"] / 2e-3)


DRY = Added("dry", sign, change=LpvChange("sign", regressors=("sign(velocity)",)))
CATALOGUE = (DRY, Added("square", lambda s: 50 * s["velocity"] * np.abs(s["velocity"])),
             Added("spring", lambda s: 100 * s["displacement"], ("displacement",)),
             Added("heat", lambda s: s["temperature"], ("temperature",)))


class Point:
    """An entry point that gives an object, or fails."""

    def __init__(self, name, value):
        self.name, self.value, self._object = name, f"{name}:X", value

    def load(self):
        if isinstance(self._object, Exception):
            raise self._object
        return self._object


def pretend_installed(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Pretend that packages name these objects in the entry-point groups of a diagnosis."""
    def factory(records: Sequence, parameters=None):
        return Viscous() if parameters is None else Viscous(parameters["slope"], parameters["polarity"])

    points = {"lpvid.baselines": [Point("viscous", factory)], "lpvid.effects": [Point("toys", CATALOGUE)]}
    everyone = importlib.metadata.entry_points

    def pretended(**asked):
        ours = asked.get("group", "").startswith("lpvid.")
        return points.get(asked["group"], []) if ours else everyone(**asked)

    monkeypatch.setattr(importlib.metadata, "entry_points", pretended)
    return points


def measured(seed: int = 0, friction: float = FRICTION, seconds: float = 20.0, rate: float = RATE, sign_of: int = 1,
             **more) -> lpv.Record:
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    w, phase = 2 * np.pi * np.array([0.7, 1.9, 4.3]), rng.uniform(0, 6, 3)
    x = 0.02 * np.sin(np.outer(t, w) + phase).sum(axis=1)
    v = 0.02 * (w * np.cos(np.outer(t, w) + phase)).sum(axis=1)
    f = SLOPE * v + friction * np.tanh(v / 2e-3) + NOISE * rng.standard_normal(t.size)
    columns = {"displacement": x, "velocity": v, "force": sign_of * f} | more
    return lpv.Record(columns, 1 / rate, name=f"run-{seed}",
                      units={"displacement": "m", "velocity": "m/s", "force": "N"})


def by_hand(slope: float, friction: float, record: lpv.Record) -> float:
    f = record["force"]
    e = f - slope * record["velocity"] - friction * np.tanh(record["velocity"] / 2e-3)
    return float(e @ e / np.sum((f - f.mean()) ** 2))
