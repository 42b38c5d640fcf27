"""What every check reads of a record: its clock, its unbroken runs, which channel plays which part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from lpvid.condition import differentiate
from lpvid.condition.bandwidth import LONGEST
from lpvid.condition.derivation import DERIVED
from lpvid.condition.differentiation import DERIVATIONS
from lpvid.condition.interference import interference
from lpvid.condition.resampling import true_runs
from lpvid.record import Channel, Record

_LEVELS = 32
_SCHEDULING_UNITS = ("A", "V", "K")


@dataclass(frozen=True, eq=False)
class View:
    """A record as the checks see it.

    Attributes
    ----------
    record : Record
    scheduling : tuple of str
        Channels that could schedule a model.
    known : dict
        What several checks ask for, found once.
    """

    record: Record
    scheduling: tuple[str, ...]
    known: dict[str, Any] = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        """Name of the record."""
        return self.record.name

    @cached_property
    def usable(self) -> dict[str, Channel]:
        """Channels whose values are numbers in a known unit."""
        return {k: c for k, c in self.record.channels.items() if c.unit_known and not c.fault}

    @cached_property
    def period(self) -> float | None:
        """Sampling period [s], or None where there is no steady clock."""
        base = self.record.time_base
        return base.period if base.n_samples > 1 and not base.invalid and base.steady else None

    @cached_property
    def _broken(self) -> np.ndarray:
        """(n,) True for rows in front of which the clock stands still, jumps or runs backward."""
        base = self.record.time_base
        broken = np.zeros(base.n_samples, dtype=bool)
        for rows in (base.gaps, base.duplicates, base.backward):
            broken[list(rows)] = True
        return broken

    def run(self, *names: str, longest: int = LONGEST) -> tuple[np.ndarray, ...] | None:
        """The named channels over the longest unbroken run in which all are finite, or None below 64 samples.

        Parameters
        ----------
        *names : str
            Channels.
        longest : int
            Samples at most, from the start of the run.

        Returns
        -------
        tuple of (n,) arrays, or None
            None also without a steady clock.
        """
        if self.period is None:
            return None
        signals = [self.record.channels[n].values for n in names]
        good = np.all([np.isfinite(s) for s in signals], axis=0)
        joined = good[1:] & good[:-1] & ~self._broken[1:]  # a run of m joints is one of m + 1 samples
        runs = true_runs(joined) or [(0, 0)]
        best, end = max(runs, key=lambda ends: ends[1] - ends[0])
        first, last = best, min(end + 1, best + longest)
        return tuple(s[first:last] for s in signals) if last - first >= 64 else None

    def finite(self, name: str) -> np.ndarray:
        """Finite values of a channel.

        Parameters
        ----------
        name : str
            Channel.

        Returns
        -------
        (n,) array
            In the unit of the channel, without the samples that are NaN or infinite.
        """
        values = self.record.channels[name].values
        return values[np.isfinite(values)]

    def moves(self, name: str) -> bool:
        """True when a channel is not constant.

        Parameters
        ----------
        name : str
            Channel.

        Returns
        -------
        bool
            False below two finite samples.
        """
        values = self.finite(name)
        return bool(values.size > 1 and np.ptp(values) > 0)

    def few_levels(self, name: str) -> bool:
        """True for a command that rests on few values and jumps between them.

        Parameters
        ----------
        name : str
            Channel.

        Returns
        -------
        bool
            Up to 32 distinct values, and more than half of all samples equal to the one before.
        """
        values = self.finite(name)
        if values.size < 2:
            return False
        return _distinct(values, _LEVELS) <= _LEVELS and bool(np.mean(np.diff(values) == 0) > 0.5)

    def rests(self, name: str) -> bool:
        """True for a constant, and for a command that rests on few levels, noise or not.

        Parameters
        ----------
        name : str
            Channel.

        Returns
        -------
        bool
        """
        values = self.finite(name)
        if values.size < 2 or not np.ptp(values) > 0:
            return True
        return self.few_levels(name) or resting_levels(values, float(values.min()), float(values.max())) > 0

    def _part(self, word: str, unit: str) -> str | None:
        if self.record.has(word):
            name = self.record.resolve(word)
            return name if name in self.usable else None
        of_unit = [k for k, c in self.usable.items() if c.unit == unit]
        return of_unit[0] if len(of_unit) == 1 else None

    @cached_property
    def force(self) -> str | None:
        """The one channel that is the force."""
        return self._part("force", "N")

    @cached_property
    def displacement(self) -> str | None:
        """The one channel that is the displacement."""
        return self._part("displacement", "m")

    @cached_property
    def velocity(self) -> str | None:
        """The one channel that is the measured velocity."""
        return self._part("velocity", "m/s")

    @cached_property
    def stroke(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """(displacement, velocity, force) over one unbroken run, velocity and displacement each derived if need be.

        A velocity that is derived is without interference: in a slow record hum turns the motion over at every cycle.
        """
        if not self.force or not (self.velocity or self.displacement) or self.period is None:
            return None
        names = [n for n in (self.displacement, self.velocity, self.force) if n]
        found = self.run(*names)
        if found is None:
            return None
        signals = dict(zip(names, found, strict=True))
        force = signals[self.force]
        if self.velocity:
            velocity = signals[self.velocity]
        else:
            velocity = self._moved(signals[self.displacement], force)  # type: ignore[index]
        if self.displacement:
            displacement = signals[self.displacement]
        else:
            displacement = np.cumsum(velocity - velocity.mean()) * self.period
        if not (np.ptp(force) > 0 and np.ptp(velocity) > 0):
            return None
        return displacement, velocity, force

    def _moved(self, displacement: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Slope of the displacement, without the bands in which the force does not follow."""
        assert self.period is not None
        velocity = differentiate(displacement, self.period)
        frequency, interfering = interference(displacement, force, self.period)
        if not interfering.any():
            return velocity
        spectrum = np.fft.rfft(velocity)
        fine = np.fft.rfftfreq(velocity.size, self.period)
        spectrum[np.interp(fine, frequency, interfering.astype(float)) >= 0.5] = 0.0
        return np.fft.irfft(spectrum, velocity.size)


def view(record: Record, scheduling: Sequence[str] | None) -> View:
    """A record with its scheduling candidates: those named, else every channel in A, V or K or a pure number.

    Parameters
    ----------
    record : Record
        As it was read.
    scheduling : sequence of str or None
        Channels or roles; None to choose by unit.

    Returns
    -------
    View
    """
    if scheduling is not None:
        return View(record, tuple(record.resolve(s) for s in scheduling))
    found = tuple(k for k, c in record.channels.items()
                  if c.unit_known and not c.fault and (c.unit in _SCHEDULING_UNITS or not c.unit))
    return View(record, found)


def check_names(records: Sequence[Record], names: Sequence[str]) -> None:
    """An error of one line for a name that no record has, unless it is that of a channel which follows from others.

    Parameters
    ----------
    records : sequence of Record
    names : sequence of str
        Channels or roles.

    Raises
    ------
    InputError
        With what there is.
    """
    follow = {*DERIVATIONS, *(d.name for d in DERIVED.values())}
    for name in names:
        if name not in follow and not any(r.has(name) for r in records):
            records[0].resolve(name)


def _distinct(values: np.ndarray, stop: int) -> int:
    """Number of distinct values, counted no further than it takes to exceed `stop`."""
    if np.unique(values[: 40 * stop]).size > stop:
        return stop + 1
    return int(np.unique(values).size)


def resting_levels(values: np.ndarray, low: float, high: float) -> int:
    """Number of levels on which a signal rests for 95 % of the time, 0 when it has none (it is continuous).

    Parameters
    ----------
    values : (n,) array
        Finite samples.
    low, high : float
        Range over which the samples are counted, in 64 classes.

    Returns
    -------
    int
    """
    counts = np.histogram(values, bins=64, range=(low, high))[0]
    busy = counts > 0.02 * values.size
    groups = int(np.sum(np.diff(np.concatenate(([0], busy.astype(int)))) == 1))
    narrow = busy.mean() < 0.25 and counts[busy].sum() > 0.85 * values.size
    return groups if groups >= 2 and narrow and busy.sum() <= 4 * groups else 0
