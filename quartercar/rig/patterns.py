"""Motions and currents that the rig can impose: each is a small frozen table of numbers with one method."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, Protocol

import numpy as np

from lpvid import excitation
from lpvid.errors import InputError
from lpvid.tables import option, quantity
from lpvid.toolkit import checks
from quartercar import roads


class MotionPattern(Protocol):
    """A displacement over time; drawn once, then evaluated on whatever clock."""

    kind: ClassVar[str]

    def displacement(self, samples: int, rate: float, rng: np.random.Generator | int) -> np.ndarray:
        """(samples,) displacement [m] on a clock of `rate` [Hz].

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            [Hz].
        rng : numpy.random.Generator or int
            Draws what is random in it.

        Returns
        -------
        (samples,) array
            [m].
        """
        ...


class CurrentPattern(Protocol):
    """A driver current over time, held between output samples."""

    kind: ClassVar[str]

    def current(self, samples: int, rate: float, rng: np.random.Generator | int, replicate: int) -> np.ndarray:
        """(samples,) current [A] at the output rate [Hz].

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            Of the records [Hz].
        rng : numpy.random.Generator or int
            Draws what is random in it.
        replicate : int
            Which run of the experiment, counted from 0.

        Returns
        -------
        (samples,) array
            [A].
        """
        ...


class _Finite:
    """Refuses numbers that are not finite when a pattern is made."""

    def __post_init__(self) -> None:
        for entry in fields(self):  # type: ignore[arg-type]
            if "unit" in entry.metadata:
                values = np.atleast_1d(np.asarray(getattr(self, entry.name), dtype=float))
                checks.finite(values, f"{entry.name} of '{self.kind}'")  # type: ignore[attr-defined]


# -- motions ------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Road(_Finite):
    """Road profile as a sum of cosines in a band (equations 4.2-4.4 of the thesis; Wong's or an ISO 8608 surface).

    Attributes
    ----------
    surface : str
        One of `roads.SURFACES`.
    speed : float
        Of the vehicle, 25 mph by default [m/s].
    f_min, f_max : float
        Lowest and highest frequency [Hz].
    lines : int
        Number of cosines.
    incommensurate : bool
        Whether each line is drawn inside its bin; without, the road repeats every 10 s as in the thesis.
    """

    kind: ClassVar[str] = "road"
    surface: str = option("smooth-highway", "road surface", roads.SURFACES)
    speed: float = quantity(25 * roads.MILES_PER_HOUR, "m/s", "vehicle speed")
    f_min: float = quantity(0.5, "Hz", "lowest frequency")
    f_max: float = quantity(20.5, "Hz", "highest frequency")
    lines: int = option(100, "number of cosines")
    incommensurate: bool = option(True, "draw each line inside its bin; false repeats every 10 s as in the thesis")

    def displacement(self, samples: int, rate: float, rng: np.random.Generator | int) -> np.ndarray:
        """Elevation of the road [m].

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            [Hz].
        rng : numpy.random.Generator or int
            Draws the phases, and the lines where they are incommensurate.

        Returns
        -------
        (samples,) array
            [m].
        """
        return roads.profile(samples, rate, roads.surface(self.surface), speed=self.speed, rng=rng, f_min=self.f_min,
                             f_max=self.f_max, lines=self.lines, incommensurate=self.incommensurate)


@dataclass(frozen=True)
class Multisine(_Finite):
    """Sum of sines of equal amplitude, Schroeder or random phases, lines spread so that nothing repeats.

    Attributes
    ----------
    rms : float
        Root mean square displacement [m].
    f_min, f_max : float
        Lowest and highest frequency [Hz].
    lines : int
        Number of sines.
    random_phases : bool
        Whether phases are drawn; without, they are Schroeder's.
    incommensurate : bool
        Whether each line is drawn inside its bin; without, lines stand at the lower edges of the bins.
    """

    kind: ClassVar[str] = "multisine"
    rms: float = quantity(0.0025, "m", "root mean square displacement")
    f_min: float = quantity(0.5, "Hz", "lowest frequency")
    f_max: float = quantity(8.0, "Hz", "highest frequency")
    lines: int = option(40, "number of sines")
    random_phases: bool = option(True, "random phases instead of Schroeder's")
    incommensurate: bool = option(True, "draw each line inside its bin")

    def displacement(self, samples: int, rate: float, rng: np.random.Generator | int) -> np.ndarray:
        """Sum of sines [m].

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            [Hz].
        rng : numpy.random.Generator or int
            Draws phases and lines, where these are random.

        Returns
        -------
        (samples,) array
            [m].
        """
        rng = checks.generator(rng)
        lines = excitation.spread_lines(self.f_min, self.f_max, self.lines, rng if self.incommensurate else None)
        return excitation.multisine(samples, rate, frequencies=lines, rms=self.rms,
                                    rng=rng if self.random_phases else None)


@dataclass(frozen=True)
class Chirp(_Finite):
    """Logarithmic sweep over the record, of equal peak velocity as far as the stroke allows.

    Attributes
    ----------
    f_start, f_end : float
        First and last frequency [Hz].
    amplitude : float
        Largest amplitude, which low frequencies have [m].
    peak_velocity : float
        Of every frequency above [m/s].
    """

    kind: ClassVar[str] = "chirp"
    f_start: float = quantity(0.5, "Hz", "first frequency")
    f_end: float = quantity(15.0, "Hz", "last frequency")
    amplitude: float = quantity(0.018, "m", "largest amplitude")
    peak_velocity: float = quantity(0.2, "m/s", "peak velocity")

    def displacement(self, samples: int, rate: float, rng: np.random.Generator | int) -> np.ndarray:
        """Sweep [m]; nothing is random.

        Parameters
        ----------
        samples : int
            Length; the sweep ends with it.
        rate : float
            [Hz].
        rng : numpy.random.Generator or int
            Not read.

        Returns
        -------
        (samples,) array
            [m].
        """
        return excitation.chirp(samples, rate, f_start=self.f_start, f_end=self.f_end, amplitude=self.amplitude,
                                peak_velocity=self.peak_velocity)


@dataclass(frozen=True)
class Triangle(_Finite):
    """Strokes of constant speed with corners rounded by an acceleration limit.

    Attributes
    ----------
    amplitude : float
        Half the stroke [m].
    frequency : float
        Strokes there and back per second [Hz].
    acceleration : float
        Limit at the corners [m/s²].
    """

    kind: ClassVar[str] = "triangle"
    amplitude: float = quantity(0.012, "m", "amplitude")
    frequency: float = quantity(3.7, "Hz", "frequency")
    acceleration: float = quantity(40.0, "m/s^2", "acceleration limit at the corners")

    def displacement(self, samples: int, rate: float, rng: np.random.Generator | int) -> np.ndarray:
        """Triangle [m]; nothing is random.

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            [Hz].
        rng : numpy.random.Generator or int
            Not read.

        Returns
        -------
        (samples,) array
            Starts at 0, rising [m].
        """
        return excitation.triangle(samples, rate, amplitude=self.amplitude, frequency=self.frequency,
                                   acceleration=self.acceleration)


@dataclass(frozen=True)
class Sine(_Finite):
    """One sine.

    Attributes
    ----------
    amplitude : float
        [m].
    frequency : float
        [Hz].
    """

    kind: ClassVar[str] = "sine"
    amplitude: float = quantity(0.01, "m", "amplitude")
    frequency: float = quantity(3.0, "Hz", "frequency")

    def displacement(self, samples: int, rate: float, rng: np.random.Generator | int) -> np.ndarray:
        """Sine [m]; nothing is random.

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            [Hz].
        rng : numpy.random.Generator or int
            Not read.

        Returns
        -------
        (samples,) array
            Starts at 0, rising [m].
        """
        return excitation.sine(samples, rate, amplitude=self.amplitude, frequency=self.frequency)


@dataclass(frozen=True)
class Creep(_Finite):
    """Slow triangle at a given speed: friction and gas alone remain.

    Attributes
    ----------
    amplitude : float
        Half the stroke [m].
    speed : float
        On the flanks [m/s].
    """

    kind: ClassVar[str] = "creep"
    amplitude: float = quantity(0.01, "m", "amplitude")
    speed: float = quantity(0.002, "m/s", "speed on the flanks")

    def displacement(self, samples: int, rate: float, rng: np.random.Generator | int) -> np.ndarray:
        """Slow triangle [m]; nothing is random.

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            [Hz].
        rng : numpy.random.Generator or int
            Not read.

        Returns
        -------
        (samples,) array
            Sharp corners; starts at 0, rising [m].
        """
        return excitation.triangle(samples, rate, amplitude=self.amplitude,
                                   frequency=self.speed / (4 * self.amplitude))


# -- currents -----------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Icps(_Finite):
    """Increased clock period signal (equation 4.1 of the thesis).

    Attributes
    ----------
    hold : float
        Time for which a level is held, rounded to whole samples [s].
    low, high : float
        Range of the levels [A].
    """

    kind: ClassVar[str] = "icps"
    hold: float = quantity(0.02, "s", "time a level is held")
    low: float = quantity(0.0, "A", "lowest current")
    high: float = quantity(2.5, "A", "highest current")

    def current(self, samples: int, rate: float, rng: np.random.Generator | int, replicate: int) -> np.ndarray:
        """Fresh uniform level every `hold` seconds [A].

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            Of the records [Hz].
        rng : numpy.random.Generator or int
            Draws the levels.
        replicate : int
            Not read.

        Returns
        -------
        (samples,) array
            [A].
        """
        return excitation.icps(samples, rate, hold=self.hold, low=self.low, high=self.high, rng=rng)


@dataclass(frozen=True)
class Prbs(_Finite):
    """Pseudo-random binary signal; a register of 11 cells clocked every sample outlasts 20 ms of settling.

    Attributes
    ----------
    clock : float
        Time between register clocks, rounded to whole samples [s].
    low, high : float
        The two levels [A].
    cells : int
        Cells of the shift register; the longest run lasts as many clocks.
    """

    kind: ClassVar[str] = "prbs"
    clock: float = quantity(1 / 512, "s", "time between register clocks")
    low: float = quantity(0.0, "A", "lower current")
    high: float = quantity(2.5, "A", "upper current")
    cells: int = option(11, "cells of the shift register")

    def current(self, samples: int, rate: float, rng: np.random.Generator | int, replicate: int) -> np.ndarray:
        """Two levels [A].

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            Of the records [Hz].
        rng : numpy.random.Generator or int
            Draws the register's first content.
        replicate : int
            Not read.

        Returns
        -------
        (samples,) array
            [A].
        """
        return excitation.prbs(samples, rate, clock=self.clock, low=self.low, high=self.high, cells=self.cells, rng=rng)


@dataclass(frozen=True)
class Aprbs(_Finite):
    """PRBS switching instants, a uniform level at each.

    Attributes
    ----------
    clock : float
        Time between register clocks, rounded to whole samples [s].
    low, high : float
        Range of the levels [A].
    cells : int
        Cells of the shift register.
    """

    kind: ClassVar[str] = "aprbs"
    clock: float = quantity(1 / 512, "s", "time between register clocks")
    low: float = quantity(0.0, "A", "lowest current")
    high: float = quantity(2.5, "A", "highest current")
    cells: int = option(11, "cells of the shift register")

    def current(self, samples: int, rate: float, rng: np.random.Generator | int, replicate: int) -> np.ndarray:
        """Random levels at random instants [A].

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            Of the records [Hz].
        rng : numpy.random.Generator or int
            Draws the register's first content and the levels.
        replicate : int
            Not read.

        Returns
        -------
        (samples,) array
            [A].
        """
        return excitation.aprbs(samples, rate, clock=self.clock, low=self.low, high=self.high, cells=self.cells,
                                rng=rng)


@dataclass(frozen=True)
class Constant(_Finite):
    """One level for a whole run; replicate k runs at level k (the thesis's SC tests have one run for each).

    Attributes
    ----------
    levels : tuple of float
        Current of each replicate, in order [A].
    """

    kind: ClassVar[str] = "constant"
    levels: tuple[float, ...] = quantity((0.0, 0.44, 0.8, 1.2, 1.6, 2.1, 2.5), "A", "level of each replicate")  # type: ignore[arg-type]

    def current(self, samples: int, rate: float, rng: np.random.Generator | int, replicate: int) -> np.ndarray:
        """Level of this replicate [A]; after the last level it starts over.

        Parameters
        ----------
        samples : int
            Length.
        rate : float
            Not read.
        rng : numpy.random.Generator or int
            Not read.
        replicate : int
            Which run of the experiment, counted from 0.

        Returns
        -------
        (samples,) array
            [A].
        """
        return np.full(samples, float(self.levels[replicate % len(self.levels)]))


@dataclass(frozen=True)
class Stepped(_Finite):
    """Levels one after another inside one run.

    Attributes
    ----------
    levels : tuple of float
        Currents in order [A].
    """

    kind: ClassVar[str] = "stepped"
    levels: tuple[float, ...] = quantity((0.0, 0.44, 0.8, 1.2, 1.6, 2.1, 2.5), "A", "levels in order")  # type: ignore[arg-type]

    def current(self, samples: int, rate: float, rng: np.random.Generator | int, replicate: int) -> np.ndarray:
        """Equal times at each level [A].

        Parameters
        ----------
        samples : int
            Length, at least one for each level.
        rate : float
            Not read.
        rng : numpy.random.Generator or int
            Not read.
        replicate : int
            Not read.

        Returns
        -------
        (samples,) array
            [A].
        """
        return excitation.stepped(samples, self.levels)


MOTIONS: tuple[type, ...] = (Road, Multisine, Chirp, Triangle, Sine, Creep)
CURRENTS: tuple[type, ...] = (Icps, Prbs, Aprbs, Constant, Stepped)


# -- experiments --------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Experiment:
    """One test: a motion, a current, how long and how often.

    Attributes
    ----------
    name : str
        Name of the test; records are called ``name-r0``, ``name-r1``, …
    displacement : MotionPattern
    current : CurrentPattern
    duration : float
        Length of a record [s].
    replicates : int
        How often the test is run.
    redraw : bool
        True: every replicate draws its own random motion and current. False: all replicates repeat one drawing and
        differ by noise only, as on the thesis's rig; such replicates are no independent test of a model.
    """

    name: str
    displacement: MotionPattern
    current: CurrentPattern
    duration: float = 30.0
    replicates: int = 1
    redraw: bool = True

    def __post_init__(self) -> None:
        checks.positive(self.duration, f"duration of '{self.name}'", "s")
        checks.count(self.replicates, f"replicates of '{self.name}'", at_least=1)
        if not self.name:
            raise InputError("an experiment needs a name", got="an empty one")


_ROAD = Road()
EXPERIMENTS: dict[str, Experiment] = {e.name: e for e in (
    Experiment("test-1", _ROAD, Icps(), replicates=11),
    Experiment("test-2", _ROAD, Prbs(), replicates=11),
    Experiment("test-3", _ROAD, Aprbs(), replicates=11),
    Experiment("test-4", _ROAD, Icps(), duration=60.0, replicates=3),
    Experiment("test-5", _ROAD, Aprbs(), duration=60.0, replicates=4),
    Experiment("test-6", _ROAD, Constant(), replicates=7),
    Experiment("test-7", Multisine(), Constant(), replicates=7),
    Experiment("test-8", Triangle(), Constant(), replicates=7),
)}
"""The eight experiments of Díaz Salas (2011), section 4.4: numbers of replicates and the currents as printed.

Tests 4 and 5 lasted 600 s there; 60 s here (`dataclasses.replace(EXPERIMENTS["test-4"], duration=600.0)`). The table
that paired displacements with currents (4.2) is lost: the road of the text stands in tests 1-6, and a multisine and a
triangle of this project's choice in tests 7 and 8.
"""
