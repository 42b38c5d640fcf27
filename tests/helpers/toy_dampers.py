"""Small damper laws whose answers are known in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.dampers import Drive, Facts, Parameter, StaticDamper


class Toy(StaticDamper):
    """What all toys share."""

    @property
    def reads(self) -> tuple[str, ...]:
        return ("velocity",)

    @classmethod
    def suited(cls, facts: Facts) -> Toy:
        return cls(**facts.common)

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        first = self.vector
        return [first, *(first * np.exp(rng.uniform(-2.0, 2.0, first.size)) for _ in range(count - 1))]

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        return np.zeros_like(np.asarray(displacement, dtype=float))

    def to_lpv(self, sample_time: float) -> Any:
        raise InputError("no LPV form of a toy")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Misra(Toy):
    """F = b1 (1 − exp(−b2 v)): NIST StRD, Misra1a."""

    name: ClassVar[str] = "misra"
    title: ClassVar[str] = "Misra1a"
    source: ClassVar[str] = "NIST StRD"
    projected: bool = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("b1", "N", "b1", 500.0), Parameter("b2", "s/m", "b2", 1e-4, 1e-9, 1.0, log=True))

    @property
    def linear(self) -> tuple[str, ...]:
        return ("b1",) if self.projected else ()

    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        return vector[0] * (1 - np.exp(-vector[1] * velocity))

    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        decay = np.exp(-vector[1] * velocity)
        return np.column_stack([1 - decay, vector[0] * velocity * decay])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Tanh(Toy):
    """F = A tanh(s v) + c v (1 − r i), A and c of either sign; runs away where s > `limit`."""

    name: ClassVar[str] = "tanh"
    title: ClassVar[str] = "tanh"
    source: ClassVar[str] = "a toy"
    limit: float = 1e9
    per_current: float = 0.0
    in_place: bool = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("height", "N", "A", 400.0), Parameter("sharpness", "s/m", "s", 5.0, 1e-3, 1e4, log=True),
                Parameter("damping", "N*s/m", "c", 1000.0))

    @property
    def reads(self) -> tuple[str, ...]:
        place = ("displacement",) if self.in_place else ()
        return ("velocity", *place, "current") if self.per_current else ("velocity", *place)

    @property
    def linear(self) -> tuple[str, ...]:
        return ("height", "damping")

    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        away = np.inf if vector[1] > self.limit else 0.0
        return vector[0] * np.tanh(vector[1] * velocity) + (
            vector[2] * velocity * (1 - self.per_current * current)) + away

    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        wave = np.tanh(vector[1] * velocity)
        return np.column_stack([wave, vector[0] * velocity * (1 - wave**2),
                                velocity * (1 - self.per_current * current)])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Redundant(Toy):
    """F = a b v + 0 d: only the product a b can be known, and d not at all."""

    name: ClassVar[str] = "redundant"
    title: ClassVar[str] = "redundant"
    source: ClassVar[str] = "a toy"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("first", "N", "a", 10.0, 1e-3, 1e6, log=True),
                Parameter("second", "s/m", "b", 10.0, 1e-3, 1e6, log=True), Parameter("idle", "", "d", 1.0))

    @property
    def linear(self) -> tuple[str, ...]:
        return ()

    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        return vector[0] * vector[1] * velocity

    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        return np.column_stack([vector[1] * velocity, vector[0] * velocity, np.zeros_like(velocity)])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Wave(Toy):
    """F = A sin(k v): as many minima as waves fit into the velocities."""

    name: ClassVar[str] = "wave"
    title: ClassVar[str] = "wave"
    source: ClassVar[str] = "a toy"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("height", "N", "A", 100.0, 0.0), Parameter("number", "s/m", "k", 2.0, 0.1, 50.0, log=True))

    @property
    def linear(self) -> tuple[str, ...]:
        return ("height",)

    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        return vector[0] * np.sin(vector[1] * velocity)

    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        angle = vector[1] * velocity
        return np.column_stack([np.sin(angle), vector[0] * velocity * np.cos(angle)])


def record(velocity: np.ndarray, force: np.ndarray, current: np.ndarray | None = None, name: str = "toy") -> Record:
    """A record at 500 Hz."""
    channels = {"velocity": velocity, "force": force, **({} if current is None else {"current": current})}
    return Record(channels, sample_time=0.002, units={"velocity": "m/s", "force": "N", "current": "A"}, name=name)


def sweep(n: int = 3000) -> np.ndarray:
    """A velocity that visits every speed up to 1 m/s often."""
    t = 0.002 * np.arange(n)
    return 0.6 * np.sin(9.1 * t) + 0.4 * np.sin(23.7 * t + 1.0)
