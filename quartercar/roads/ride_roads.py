"""Roads of a ride: what a car meets, sampled at its controller's rate, anew for every seed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.tables import quantity
from lpvid.toolkit import checks
from quartercar import roads

SHORTEST = 5.0
"""for which a measured track is driven by default [s]"""
LEAD = 1.0
"""time before a bump that is left out of the figures [s]"""


class RideRoad(Encoded, ABC):
    """A road at a speed."""

    JSON = ("kind", ...)
    longer: ClassVar[str] = "give a longer duration"
    """What makes a ride over it longer, in words."""

    @property
    @abstractmethod
    def name(self) -> str:
        """As in a table."""

    @property
    @abstractmethod
    def settle(self) -> float:
        """Time at the start that is left out of every figure [s]."""

    @abstractmethod
    def profile(self, sample_time: float, seed: int) -> np.ndarray:
        """(n,) elevation over time, from zero [m].

        Parameters
        ----------
        sample_time : float
            Of the loop [s].
        seed : int
            Chooses the road where it is random; the same seed gives the same road.

        Returns
        -------
        (n,) array
            At the samples, the time that does not count included [m].
        """


@dataclass(frozen=True)
class IsoRoad(RideRoad):
    """A random road of a class of ISO 8608; every seed is another one.

    Attributes
    ----------
    road_class : str
    speed : float
        [m/s].
    duration : float
        That counts [s].

    Examples
    --------
    >>> IsoRoad("C", 20.0, 2.0).profile(0.002, seed=0).size
    1500
    """

    kind = "iso"
    JSON = ("kind", ("class", "road_class"), "speed", "duration")

    road_class: str = "C"
    speed: float = quantity(20.0, "m/s", "of the car")
    duration: float = quantity(20.0, "s", "that counts")
    settle: ClassVar[float] = LEAD

    def __post_init__(self) -> None:
        roads.iso_roughness(self.road_class)
        object.__setattr__(self, "road_class", self.road_class.upper())
        checks.positive(self.speed, "speed", "m/s")
        checks.positive(self.duration, "duration", "s")

    @property
    def name(self) -> str:
        return f"ISO {self.road_class}, {self.speed:g} m/s"

    def profile(self, sample_time: float, seed: int) -> np.ndarray:
        samples = round((self.duration + self.settle) / sample_time)
        rng = np.random.default_rng([checks.count(seed, "seed"), 8608])
        z = roads.iso8608(samples, 1 / sample_time, self.road_class, speed=self.speed, rng=rng)
        return z - z[0]


@dataclass(frozen=True)
class Bump(RideRoad):
    """z = ½h(1 − cos 2πs/L) over a length, on a road that is otherwise of an ISO 8608 class.

    Attributes
    ----------
    height, length : float
        h, L [m].
    speed : float
        [m/s].
    duration : float
        From just before the bump on [s].
    road_class : str
        Of the road beneath; every seed is another one.
    """

    kind = "bump"
    JSON = ("kind", "height", "length", "speed", "duration", ("class", "road_class"))

    height: float = quantity(0.05, "m", "of the bump")
    length: float = quantity(2.0, "m", "of the bump")
    speed: float = quantity(8.0, "m/s", "of the car")
    duration: float = quantity(4.0, "s", "from just before the bump on")
    road_class: str = "A"
    settle: ClassVar[float] = LEAD

    def __post_init__(self) -> None:
        roads.iso_roughness(self.road_class)
        object.__setattr__(self, "road_class", self.road_class.upper())
        for name, unit in (("length", "m"), ("speed", "m/s"), ("duration", "s")):
            checks.positive(getattr(self, name), name, unit)
        checks.real(self.height, "height")

    @property
    def name(self) -> str:
        return f"bump {1e3 * self.height:g} mm x {self.length:g} m, {self.speed:g} m/s"

    def profile(self, sample_time: float, seed: int) -> np.ndarray:
        base = IsoRoad(self.road_class, self.speed, self.duration).profile(sample_time, seed)
        along = self.speed * (sample_time * np.arange(base.size) - self.settle - 0.1)
        inside = (along > 0) & (along < self.length)
        return base + np.where(inside, 0.5 * self.height * (1 - np.cos(2 * np.pi * along / self.length)), 0.0)


@dataclass(frozen=True)
class SineSweep(RideRoad):
    """z = a(f) sin φ(t), φ̇ = 2πf, f growing exponentially; a = amplitude·f_start/f keeps the road's velocity.

    Attributes
    ----------
    amplitude : float
        At the lowest frequency [m].
    lowest, highest : float
        [Hz].
    duration : float
        [s].
    """

    kind = "sweep"

    amplitude: float = quantity(0.02, "m", "of the sine")
    lowest: float = quantity(0.5, "Hz", "frequency")
    highest: float = quantity(20.0, "Hz", "frequency")
    duration: float = quantity(30.0, "s", "of the sweep")
    settle: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        for name, unit in (("amplitude", "m"), ("lowest", "Hz"), ("highest", "Hz"), ("duration", "s")):
            checks.positive(getattr(self, name), name, unit)
        if not self.lowest < self.highest:
            raise InputError("a sweep runs from low to high", got=f"{self.lowest:g} to {self.highest:g} Hz")

    @property
    def name(self) -> str:
        return f"sweep {self.lowest:g}-{self.highest:g} Hz"

    def profile(self, sample_time: float, seed: int) -> np.ndarray:
        t = sample_time * np.arange(round(self.duration / sample_time))
        growth = np.log(self.highest / self.lowest) / self.duration
        phase = 2 * np.pi * self.lowest * np.expm1(growth * t) / growth
        return self.amplitude * np.exp(-growth * t) * np.sin(phase)


@dataclass(frozen=True, eq=False)
class MeasuredRoad(RideRoad):
    """A measured track at a constant speed; the seed only draws the sensors' noise.

    Attributes
    ----------
    track : roads.Track
    speed : float
        [m/s].
    laps : int
        How often it is driven, forwards and backwards in turn.
    """

    track: roads.Track
    speed: float = 10.0
    laps: int = 1
    settle: ClassVar[float] = 0.0
    longer: ClassVar[str] = "give a longer track, more laps, or a lower speed"

    def __post_init__(self) -> None:
        checks.positive(self.speed, "speed", "m/s")
        checks.count(self.laps, "laps", at_least=1)

    @classmethod
    def read(cls, path: str | Path, speed: float, track: int | str | None = None,
             laps: int | None = None) -> MeasuredRoad:
        """A profile from a file with distance and height columns (`roads.measured`), by default driven for 5 s.

        Parameters
        ----------
        path : str or Path
            Any format that `lpvid.read` reads.
        speed : float
            [m/s].
        track : int or str, optional
            Which height column, by its place or name; needed where there are several.
        laps : int, optional
            How often the track is driven; as often as 5 s take where left out.

        Returns
        -------
        MeasuredRoad
            Named after the track.
        """
        found = roads.measured(path, track)
        needed = int(np.ceil(SHORTEST * checks.positive(speed, "speed", "m/s") / found.length))
        return cls(found, speed, needed if laps is None else laps)

    @property
    def name(self) -> str:
        often = f", {self.laps} times" if self.laps > 1 else ""
        return f"{self.track.name or 'measured road'}, {self.speed:g} m/s{often}"

    def profile(self, sample_time: float, seed: int) -> np.ndarray:
        return self.track.over_time(self.speed, sample_time, self.laps)

    def to_dict(self) -> dict:
        return {"kind": "measured", "track": self.track.name, "length": self.track.length, "speed": self.speed,
                "laps": self.laps}
