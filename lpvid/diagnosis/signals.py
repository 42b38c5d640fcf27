"""Signals: the channels of one record as plain arrays, as effects and baselines see them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from lpvid import _checks

REMEMBERED, REPLACED = 24, 4
"""simulations that signals keep, and what a cause makes of their channels for the last values that it was given"""
LONG, FEWEST = 65_536, 2
"""samples of signals from which on they keep fewer of all that, so that ten minutes hold no more than two; what the
derivative at a point and the run beside it share stays
"""


@dataclass(frozen=True, eq=False)
class SignalStretch:
    """A part of a record among signals that are cut together.

    Attributes
    ----------
    first : int
        Its first sample among these.
    span : (float, float)
        Where it lies in the time of all records of the diagnosis, 0 their start and 1 their end.
    past : Signals or None
        What came before it in its record: of that a slow state, such as heat, is built up.
    """

    first: int
    span: tuple[float, float]
    past: Signals | None


@dataclass(frozen=True, eq=False)
class Signals:
    """Channels of one record by role, (n,) each, on a uniform clock, SI.

    Attributes
    ----------
    sample_time : float
        [s].
    channels : mapping of str to (n,) array
        Inputs and scheduling by role, e.g. ``velocity``, ``displacement``, ``current``, ``temperature``.
    output : (n,) array
        The measured output that the simulation is compared with.
    name : str
        Of the record.
    span : (float, float), optional
        Where the record lies in the time of all records of a diagnosis, 0 their start and 1 their end; None for a
        record of its own, about whose place nothing is known.
    record : Signals, optional
        Those whose range and history count where these hold other values, at which a law is only evaluated.
    at : (n,) array, optional
        Where each sample lies in that record, counted in its samples; None where they are its own, in order.
    finer : int
        How many times as fast the clock is as that by which they were recorded: beyond its band there is nothing.
    coarse : Signals, optional
        The same signals on the clock by which they were recorded, where this one is faster: what has a memory runs
        along those, and comes here by `refined`.
    peers : tuple of Signals
        All records of a diagnosis, as recorded: what one measurement did to all of them shows in all together.
    stretches : tuple of SignalStretch
        Where these are cut together from stretches of records, what they are; else empty.
    repeats : (Signals, int), optional
        Signals of which these repeat all but the velocity so many times, one repetition after the other.
    """

    sample_time: float
    channels: Mapping[str, np.ndarray]
    output: np.ndarray
    name: str = "record"
    span: tuple[float, float] | None = None
    cache: dict = field(default_factory=dict, repr=False)
    facts: dict = field(default_factory=dict, repr=False)
    record: Signals | None = field(default=None, repr=False)
    at: np.ndarray | None = field(default=None, repr=False)
    finer: int = 1
    coarse: Signals | None = field(default=None, repr=False)
    peers: tuple[Signals, ...] = field(default=(), repr=False)
    stretches: tuple[SignalStretch, ...] = field(default=(), repr=False)
    repeats: tuple[Signals, int] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        frozen = {role: _checks.read_only(values) for role, values in self.channels.items()}
        object.__setattr__(self, "channels", MappingProxyType(frozen))

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.output.size

    @property
    def times(self) -> np.ndarray:
        """(n,) time from the first sample [s]."""
        return self.sample_time * np.arange(self.n_samples)

    @property
    def pieces(self) -> list[tuple[int, int]]:
        """First sample and the one after the last of every stretch in which time goes on evenly."""
        firsts = [t.first for t in self.stretches] or [0]
        return list(zip(firsts, [*firsts[1:], self.n_samples], strict=True))

    @property
    def places(self) -> np.ndarray:
        """(n,) where the samples lie in their record, counted in its samples."""
        return np.arange(self.n_samples, dtype=float) if self.at is None else self.at

    def of_record(self, values: np.ndarray) -> np.ndarray:
        """(n,) values given along the whole record, taken at these samples.

        Parameters
        ----------
        values : (samples of the record,) array

        Returns
        -------
        (n,) array
            In the unit of the values, straight between samples.
        """
        return values if self.at is None else np.interp(self.at, np.arange(values.size), values)

    def refined(self, values: np.ndarray) -> np.ndarray:
        """(n,) values along `coarse`, straight in between.

        Parameters
        ----------
        values : (samples of `coarse`,) array

        Returns
        -------
        (n,) array
            In the unit of the values.
        """
        n = values.size
        return np.interp(np.arange(self.n_samples) * (n / self.n_samples), np.arange(n), values)

    def has(self, role: str) -> bool:
        """Whether a channel is there.

        Parameters
        ----------
        role : str

        Returns
        -------
        bool
        """
        return role in self.channels

    def __getitem__(self, role: str) -> np.ndarray:
        return self.channels[role]

    def replace(self, **channels: np.ndarray) -> Signals:
        """The same signals with some channels replaced or added; what was cached is forgotten, but for `fact`.

        `coarse` and `repeats` are dropped, for they hold other channels than these now: code that reads none of the
        replaced channels along them puts them back (`dataclasses.replace`).

        Parameters
        ----------
        **channels : (n,) arrays
            By role, in SI.

        Returns
        -------
        Signals
        """
        facts = {key: found for key, found in self.facts.copy().items() if key[0] not in channels}
        return Signals(self.sample_time, {**self.channels, **channels}, self.output, self.name, self.span, facts=facts,
                       record=self.record, at=self.at, finer=self.finer, peers=self.peers,
                       stretches=self.stretches)

    def evaluated(self, **channels: np.ndarray) -> Signals:
        """Signals with some channels replaced, at which a law is evaluated: these stay the record.

        Parameters
        ----------
        **channels : (n,) arrays
            By role, in the units of the record.

        Returns
        -------
        Signals
        """
        facts = {key: found for key, found in self.facts.copy().items() if key[0] not in channels}
        repeats = self.repeats if channels.keys() <= {"velocity"} else None
        return Signals(self.sample_time, {**self.channels, **channels}, self.output, self.name, self.span, facts=facts,
                       record=self.record or self, at=self.at, finer=self.finer, peers=self.peers, repeats=repeats)

    @property
    def distinct(self) -> tuple[Signals, int]:
        """Signals without repetitions of all but the velocity, and how often these repeat them."""
        return self.repeats or (self, 1)

    def cached(self, key: object, make: Callable[[], Any]) -> Any:
        """What `make` returns, computed once for these signals.

        Parameters
        ----------
        key : hashable
        make : callable
            Without arguments.

        Returns
        -------
        object
        """
        if key not in self.cache:
            self.cache[key] = make()
        return self.cache[key]

    def remembered(self, kind: str, key: Hashable, make: Callable[[], Any], most: int = REPLACED) -> Any:
        """What `make` returns for a key, of which the last few of one kind are kept; fewer where they are long.

        Parameters
        ----------
        kind : str
        key : hashable
        make : callable
            Without arguments; called where nothing is kept under the key.
        most : int
            Values kept along few samples (`most_kept`).

        Returns
        -------
        object
        """
        most = most_kept(most, self.n_samples)
        kept: OrderedDict = self.cached(kind, OrderedDict)
        found = kept.pop(key, None)  # each step by itself is safe where several threads share the signals
        if found is None:
            found = make()
        kept[key] = found
        with suppress(KeyError):
            if len(kept) > most:
                kept.popitem(last=False)
        return found

    def as_recorded(self, role: str) -> tuple[Signals, ...]:
        """All records of the diagnosis if this channel is that of one of them; else these signals alone.

        Parameters
        ----------
        role : str

        Returns
        -------
        tuple of Signals
        """
        mine = self.channels[role]
        return self.peers if any(p.channels.get(role) is mine for p in self.peers) else (self,)

    def fact(self, role: str, key: object, make: Callable[[np.ndarray], Any]) -> Any:
        """What `make` finds about one channel, computed once for all signals that share it by `replace`.

        Parameters
        ----------
        role : str
        key : hashable
        make : callable
            From the channel, an (n,) array.

        Returns
        -------
        object
        """
        if (role, key) not in self.facts:
            self.facts[role, key] = make(self.channels[role])
        return self.facts[role, key]

    def passed(self, core: Core) -> np.ndarray:
        """(n,) a simulation along these signals, which nothing is kept of: they were made for this one run.

        What a law caches along signals refers back to them, so that they would stay in memory until the next garbage
        collection.

        Parameters
        ----------
        core : Core

        Returns
        -------
        (n,) array
            Output, in its unit.
        """
        out = core(self)
        self.cache.clear()
        return out

    def along_record(self, role: str, key: str, make: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """(n,) what `make` returns for one channel of the record, at these samples; found once for all signals of it.

        Every sample has its place in the record, so that nothing is interpolated twice.

        Parameters
        ----------
        role : str
        key : str
        make : callable
            From the channel of the whole record to an array of its size.

        Returns
        -------
        (n,) array
        """
        record = self if self.record is None else self.record
        found = record.fact(role, key, make)
        if self.at is None:
            return found
        name = ("", role, key)  # of no channel: `replace` passes it on
        if name not in self.facts:
            self.facts[name] = self.of_record(found)
        return self.facts[name]


def most_kept(most: int, n_samples: int) -> int:
    """How many results along so many samples are kept, of `most` along few.

    Parameters
    ----------
    most, n_samples : int

    Returns
    -------
    int
        In proportion to 1/samples from `LONG` on, `FEWEST` at least.

    Examples
    --------
    >>> most_kept(24, 15_360), most_kept(24, 307_200), most_kept(4, 307_200)
    (24, 5, 2)
    """
    return max(min(most, most * LONG // n_samples), FEWEST)


def in_turn(signals: Sequence[Signals]) -> tuple[Signals, ...]:
    """The same signals, each with the others and its place among them, one after the other without pauses.

    Parameters
    ----------
    signals : sequence of Signals
        One for each record, in the order of time.

    Returns
    -------
    tuple of Signals
        With `span` and `peers`.
    """
    ends = [0.0]
    for s in signals:
        ends.append(ends[-1] + s.n_samples * s.sample_time)
    total = ends[-1] or 1.0
    return tuple(replace(s, span=(a / total, b / total), peers=tuple(signals))
                 for s, a, b in zip(signals, ends[:-1], ends[1:], strict=True))


Core = Callable[[Signals], np.ndarray]
"""A simulation of the output along signals: (n,) array, the same units as the output."""


class Linearised(ABC):
    """A simulation that gives, along its own run, what small changes of its parts do: cheaper than a run for each."""

    @abstractmethod
    def __call__(self, s: Signals) -> np.ndarray:
        """(n,) output along signals."""

    @abstractmethod
    def near(self, others: Sequence[Core]) -> list[Core]:
        """Simulations of its own kind that differ little from it, to first order in what differs.

        Parameters
        ----------
        others : sequence of Core

        Returns
        -------
        list of Core
            One for each, from signals to the (n,) output.
        """


@dataclass(frozen=True, eq=False)
class Remembered:
    """A simulation that is run once for each signals and key, of which the last `REMEMBERED` are kept; read-only.

    Attributes
    ----------
    core : Core
    key : hashable
        The same for simulations that are the same.

    Examples
    --------
    >>> runs = []
    >>> def core(s):
    ...     runs.append(s.name)
    ...     return 2 * s.output
    >>> s = Signals(0.1, {}, np.ones(3))
    >>> [float(Remembered(core, key)(s)[0]) for key in "aab"], len(runs)
    ([2.0, 2.0, 2.0], 2)
    """

    core: Core
    key: Hashable

    def __call__(self, s: Signals) -> np.ndarray:
        def run() -> np.ndarray:
            out = self.core(s).view()
            out.flags.writeable = False
            return out

        return s.remembered("simulations", self.key, run, REMEMBERED)
