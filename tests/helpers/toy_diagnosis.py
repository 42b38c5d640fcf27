"""A toy for the diagnosis that is no damper: y = p_0 u + p_1 tanh(p_2 u), and causes with closed forms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.signal import lfilter

from lpvid.baselines.baseline import Baseline, Coefficient
from lpvid.baselines.signals import Core, Signals
from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.screening import Direction, candidate_change, directions
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect, EffectParameter, GridEffect, LpvChange
from lpvid.record import Channel, Record

PERIOD = 0.01
TRUE = np.array([2.0, 3.0, 1.5])


@dataclass(frozen=True, eq=False)
class Bent(Baseline):
    """y = p_0 u + p_1 tanh(p_2 u)."""

    parameters: tuple[float, float, float] = (2.0, 3.0, 1.5)
    name: ClassVar[str] = "bent"
    output: str = "y"
    output_unit: str = "V"
    static: bool = True

    @property
    def channels(self) -> tuple[str, ...]:
        return ("u", "c", "y")

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(n, "", -50.0, 50.0, 1.0) for n in ("p0", "p1", "p2"))

    @property
    def vector(self) -> np.ndarray:
        return np.array(self.parameters)

    @property
    def start(self) -> int:
        return 0

    def with_vector(self, vector: np.ndarray) -> Bent:
        return replace(self, parameters=tuple(vector))

    def signals(self, record: Record) -> Signals:
        return Signals(PERIOD, {k: record[k] for k in ("u", "c")}, record["y"], record.name)

    def core(self, vector: np.ndarray) -> Core:
        return lambda s: vector[0] * s["u"] + vector[1] * np.tanh(vector[2] * s["u"])

    def fit(self, records: Sequence[Record]) -> Bent:
        from scipy.optimize import least_squares

        parts = [self.signals(r) for r in records]
        found = least_squares(lambda p: np.concatenate([s.output - self.core(p)(s) for s in parts]), self.vector)
        return self.with_vector(found.x)

    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        u, t = signals["u"], np.tanh(vector[2] * signals["u"])
        return np.column_stack([u, t, vector[1] * u * (1 - t**2)])

    def starts(self, signals) -> list[np.ndarray]:
        return []

    def to_dict(self) -> dict:
        return {"kind": "bent", "parameters": list(self.parameters)}


class Added(GridEffect):
    """y += g·shape(signals)."""

    family: ClassVar[str] = "toy"
    stage: ClassVar[str] = "force"
    equation: ClassVar[str] = "y += g shape"
    reference: ClassVar[str] = "none"
    experiment: ClassVar[str] = "measure it"
    shape: ClassVar[Callable[[Signals], np.ndarray]]

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("gain", "V", "g", 0.0, (-10.0, 10.0), (-100.0, 100.0), (-0.1, 0.1)),)

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return None

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        return lambda s: core(s) + values[0] * type(self).shape(s)

    def lpv_change(self) -> LpvChange | None:
        return None


class Dry(Added):
    name, title = "dry", "sign of the input"
    shape = staticmethod(lambda s: np.sign(s["u"]))


class DryTwin(Added):
    name, title = "dry-twin", "the same by another name"
    shape = staticmethod(lambda s: np.sign(s["u"]))


class Zero(Added):
    name, title = "zero", "a constant"
    shape = staticmethod(lambda s: np.ones(s.n_samples))


class Cubic(Added):
    name, title = "cubic", "cube of the input"
    shape = staticmethod(lambda s: s["u"] ** 3)


class Late(Added):
    name, title = "late", "the input half a second ago"
    shape = staticmethod(lambda s: np.concatenate([np.zeros(50), s["u"][:-50]]))


class Wave(Added):
    name, title = "wave", "sine of the input"
    shape = staticmethod(lambda s: np.sin(9 * s["u"]))


class LaggedConstant(Added):
    """Lag of a channel that never changes: no data of this kind can show it."""

    name, title = "lagged-c", "lag of c"
    stage = "current"

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:  # type: ignore[override]
        a = float(np.clip(values[0], -0.99, 0.99))
        return lambda s: core(s) + lfilter([1 - a], [1, -a], s["c"] - s["c"][0]) - (s["c"] - s["c"][0])


class Explosive(Added):
    """A sine of the input whose simulation runs away beyond a strength."""

    name, title = "explosive", "sine of the input, unstable"

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:  # type: ignore[override]
        size = float(values[0])
        growth = 1e300 ** max(size - 0.8, 0.0)
        return lambda s: core(s) + size * growth * np.sin(7 * s["u"])


CAUSES: tuple[Effect, ...] = (Dry(), Zero(), Cubic(), Late(), Wave())


def white(n: int, rng: np.random.Generator, force: np.ndarray) -> np.ndarray:
    """Unit white noise."""
    return rng.standard_normal(n)


def coloured(n: int, rng: np.random.Generator, force: np.ndarray) -> np.ndarray:
    """Stationary AR(1) of unit variance, pole .95."""
    drive = rng.standard_normal(n + 400) * np.sqrt(1 - 0.95**2)
    return np.asarray(lfilter([1.0], [1.0, -0.95], drive))[400:]


def proportional(n: int, rng: np.random.Generator, force: np.ndarray) -> np.ndarray:
    """As large as the output, of unit mean square."""
    return rng.standard_normal(n) * np.abs(force) / np.sqrt(np.mean(force**2))


NOISES = {"white": white, "ar1": coloured, "proportional": proportional}


def drive(n: int, rng: np.random.Generator) -> np.ndarray:
    """(n,) input of unit spread: noise through a 1 Hz low-pass."""
    u = np.asarray(lfilter([1.0], [1.0, -1.88, 0.8836], rng.standard_normal(n + 500)))[500:]
    return u / u.std()


def record(rng: np.random.Generator, noise: str = "white", level: float = 0.3, n: int = 3000,
           hidden: Callable[[np.ndarray], np.ndarray] | None = None, u: np.ndarray | None = None) -> Record:
    """A run of the toy with noise of a kind and, on request, something hidden that adds to y."""
    u = drive(n, rng) if u is None else u
    y = TRUE[0] * u + TRUE[1] * np.tanh(TRUE[2] * u)
    if hidden is not None:
        y = y + hidden(u)
    y = y + level * NOISES[noise](u.size, rng, y)
    return Record({"u": Channel(u, ""), "c": Channel(np.full(u.size, 1.7), ""), "y": Channel(y, "V")},
                  sample_time=PERIOD, name="toy")


def problem_of(*records: Record) -> tuple[DiagnosisProblem, Composition]:
    """The problem that the engine poses."""
    signals = tuple(Bent().signals(r) for r in records)
    return DiagnosisProblem(signals, Blocks.of(signals)), Composition(Bent())


def fitted(*records: Record) -> tuple[DiagnosisProblem, Refit]:
    """Problem and the baseline's own fit."""
    problem, composition = problem_of(*records)
    return problem, refit(problem, composition, composition.neutral)


def seen(problem: DiagnosisProblem, fit: Refit, effects: Sequence[Effect] = CAUSES) -> list[Direction]:
    """Directions of effects at their grid points, beside a fit."""
    found = [candidate_change(problem, fit, e, v) for e in effects for v in e.points(problem.signals)]
    return directions(problem, fit, [m for m in found if m is not None])
