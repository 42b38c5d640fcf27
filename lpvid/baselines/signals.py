"""Signals: the channels of one record as plain arrays, the input of effects and baselines."""

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
from lpvid.baselines.budgets import LONG, REMEMBERED, REPLACED

ROLES = ("displacement", "velocity", "acceleration", "current", "temperature", "force", "road", "unsprung", "sprung",
         "actuator")
"""roles that baselines and effects look for, where a baseline does not name its own"""
FEWEST = 2
"""results of a kind kept at least, so that a derivative and the run at the same point share theirs"""
MISSING = object()


@dataclass(frozen=True, eq=False)
class SignalStretch:
    """A part of a record among signals that are cut together.

    Attributes
    ----------
    first : int
        Its first sample among these.
    span : (float, float)
        Its place in the time of all records of the diagnosis, 0 their start and 1 their end.
    past : Signals or None
        The part of its record before it, from which the initial value of a slow state, such as heat, follows.
    record : Signals
        Its record, whole.
    """

    first: int
    span: tuple[float, float]
    past: Signals | None
    record: Signals


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
        Place of the record in the time of all records of a diagnosis, 0 their start and 1 their end; None where it is
        unknown.
    record : Signals, optional
        The record, where these hold other values at which a law is evaluated; range and history are the record's.
    at : (n,) array, optional
        Place of each sample in that record, counted in its samples; None where they are its own, in order.
    finer : int
        Ratio of the sample rate to that of the recording, which limits the band.
    coarse : Signals, optional
        The same signals at the sample rate of the recording, where this one is higher: a simulation with memory runs
        along those and is interpolated by `refined`.
    peers : tuple of Signals
        All records of a diagnosis, as recorded, for properties of a measurement that they share.
    stretches : tuple of SignalStretch
        The stretches of records that these consist of; empty for a whole record.
    repeats : (Signals, int), optional
        Signals that these repeat, except for the velocity, and the number of repetitions.
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
        """First sample and the one after the last of every stretch of uniform time."""
        firsts = [t.first for t in self.stretches] or [0]
        return list(zip(firsts, [*firsts[1:], self.n_samples], strict=True))

    @property
    def places(self) -> np.ndarray:
        """(n,) places of the samples in their record, counted in its samples."""
        return np.arange(self.n_samples, dtype=float) if self.at is None else self.at

    def of_record(self, values: np.ndarray) -> np.ndarray:
        """(n,) values along the whole record, interpolated linearly at these samples.

        Parameters
        ----------
        values : (samples of the record,) array

        Returns
        -------
        (n,) array
            In the unit of the values.
        """
        return values if self.at is None else np.interp(self.at, np.arange(values.size), values)

    def refined(self, values: np.ndarray) -> np.ndarray:
        """(n,) values along `coarse`, interpolated linearly.

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
        """The same signals with some channels replaced or added, without cached results except `fact`.

        `coarse` and `repeats` are dropped, since they hold the former channels; code that reads none of the replaced
        channels along them sets them again (`dataclasses.replace`).

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
        """Signals with some channels replaced, at which a law is evaluated; their record remains these.

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
        """The signals that these repeat, except for the velocity, and the number of repetitions."""
        return self.repeats or (self, 1)

    def cached(self, key: object, make: Callable[[], Any]) -> Any:
        """The result of `make`, computed once for these signals.

        Parameters
        ----------
        key : hashable
        make : callable
            Without arguments.

        Returns
        -------
        object
        """
        found = self.cache.get(key, MISSING)
        if found is MISSING:
            found = self.cache[key] = make()
        return found

    def remembered(self, kind: str, key: Hashable, make: Callable[[], Any], most: int = REPLACED) -> Any:
        """The result of `make` for a key; the last few of a kind are kept, fewer along many samples.

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
                _, left = kept.popitem(last=False)
                if isinstance(left, Signals):  # they refer to what was cached along them, and the other way round
                    left.cache.clear()
        return found

    def as_recorded(self, role: str) -> tuple[Signals, ...]:
        """All records of the diagnosis, whole, if this channel is that of one of them; else these signals alone.

        Between the stretches that a search consists of, jumps are no whole number of steps apart.

        Parameters
        ----------
        role : str

        Returns
        -------
        tuple of Signals
        """
        own = self.channels[role]
        if not any(p.channels.get(role) is own for p in self.peers):
            return (self,)
        whole = {id(t.record): t.record for p in self.peers for t in p.stretches}
        return tuple(whole.values()) or self.peers

    def fact(self, role: str, key: object, make: Callable[[np.ndarray], Any]) -> Any:
        """The result of `make` for one channel, computed once for all signals that share it by `replace`.

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

    def along_others(self, kind: str, key: Hashable, make: Callable[[], Signals], core: Core) -> np.ndarray:
        """A simulation along signals that were made of these; the last of a kind are kept, with what is cached there.

        Where the others and those made of them would have more than `LONG` samples together, nothing is kept: what is
        cached along signals refers to these, and stays in memory until the next garbage collection.

        Parameters
        ----------
        kind : str
        key : hashable
            Equal for equal signals.
        make : callable
            The other signals; without arguments.
        core : Core

        Returns
        -------
        (n,) array
            Output, in its unit.
        """
        if REPLACED**2 * self.n_samples <= LONG:
            return core(self.remembered(kind, key, make))
        others = make()
        out = core(others)
        others.cache.clear()
        return out

    def along_record(self, role: str, key: str, make: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """(n,) result of `make` for one channel of the record, at these samples; computed once for the record.

        The place of every sample in the record is known, so that nothing is interpolated twice.

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
        name = ("", role, key)  # belongs to no channel, so that `replace` keeps it
        if name not in self.facts:
            self.facts[name] = self.of_record(found)
        return self.facts[name]


def most_kept(most: int, n_samples: int) -> int:
    """Number of results kept along signals of a length; `most` along short ones.

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
    """The same signals with `peers` and `span`: records that follow one another without pauses.

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
    """A simulation with the first-order effect of small changes of its parts, at less cost than a run for each."""

    @abstractmethod
    def __call__(self, s: Signals) -> np.ndarray:
        """(n,) output along signals."""

    @abstractmethod
    def near(self, others: Sequence[Core]) -> list[Core]:
        """Simulations of its own kind that differ little from it, to first order in the difference.

        Parameters
        ----------
        others : sequence of Core

        Returns
        -------
        list of Core
            One for each, from signals to the (n,) output.
        """


@dataclass(frozen=True, eq=False)
class AlongTangent:
    """A simulation with a parameter moved to first order, and the same run anew.

    Attributes
    ----------
    tangent, exact : Core
    """

    tangent: Core
    exact: Core

    def __call__(self, s: Signals) -> np.ndarray:
        return self.tangent(s)


@dataclass(frozen=True, eq=False)
class Around:
    """A simulation with effects around a baseline, and that baseline alone.

    Attributes
    ----------
    core, bare : Core
    """

    core: Core
    bare: Core

    def __call__(self, s: Signals) -> np.ndarray:
        return self.core(s)


@dataclass(frozen=True, eq=False)
class Remembered:
    """A simulation that runs once for each pair of signals and key; the last `REMEMBERED` are kept, read-only.

    Attributes
    ----------
    core : Core
    key : hashable
        Equal for equal simulations.

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

    def kept(self, s: Signals) -> bool:
        """Whether the simulation along signals is kept at present.

        Parameters
        ----------
        s : Signals

        Returns
        -------
        bool
        """
        return self.key in s.cache.get("simulations", ())
