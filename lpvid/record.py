"""Record: sampled channels with units on one time base. A data set is a list of records."""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from lpvid import _checks, units
from lpvid._pickling import ReadOnlyState
from lpvid._shown import Shown
from lpvid.errors import InputError
from lpvid.remark import Turned
from lpvid.timebase import TimeBase, analyse_time, calendar_seconds

MISSPELT = 0.85
"""Share of letters in common, of both names, from which one is a slip of the other: one letter left out of four has
6/7, one mistaken of seven 6/7 as well; `force` and `force_2` have 5/6."""
_PLACE = re.compile(r"\d+|(?<![^\W_])(?:left|right|front|rear|[fr][lr])(?![^\W_])|(?<=[\W_])[^\W\d_]$")
"""What sets like channels apart: numbers, sides, a last word of one letter."""


@dataclass(frozen=True, eq=False)
class Channel(ReadOnlyState):
    """One sampled signal, SI inside.

    Attributes
    ----------
    values : (n,) array
        Samples in SI units, read-only; NaN marks a missing sample.
    unit : str
        SI unit as text, e.g. ``"m/s"``; empty for a pure number.
    source_unit : str or None
        Unit as the header gave it; None when the header gave none (SI was assumed).
    unit_known : bool
        False when the header's unit could not be understood: the values are then a pure number as read.
    fault : str or None
        Why this channel cannot be used, e.g. ``"text 'abc' in row 17 (line 18 of the file)"``; the rows at fault
        are NaN, and a user of the channel must refuse it.
    """

    values: np.ndarray
    unit: str = ""
    source_unit: str | None = None
    unit_known: bool = True
    fault: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", _checks.frozen_array(self.values, "a channel", ndim=1))


def _channel(name: str, values: object, unit: str) -> Channel:
    try:
        given = Channel(values, unit)  # type: ignore[arg-type]
        found = units.to_si(given.values, unit)
        return Channel(found.values, found.unit, unit or None, found.known)
    except InputError as error:
        raise InputError(error.what.replace("a channel", f"channel '{name}'"), got=error.got, why=error.why) from None


def _siblings(name: str, other: str) -> bool:
    """Whether two names are those of like channels, such as `accel_x` and `accel_y`, rather than one and a slip."""
    stems = [re.sub(r"[\W_]", "", _PLACE.sub("", text)) for text in (name, other)]
    return stems[0] == stems[1] and _PLACE.findall(name) != _PLACE.findall(other)


def _refuse_misspelt(stated: Mapping[str, str], arrays: Sequence[str], channels: Mapping[str, Channel], where: str
                     ) -> None:
    """A unit whose array is misspelt would leave that array without one, off by a thousand where it is in mm/s.

    Units of channels that are not there are allowed: one table may serve many records.
    """
    bare = {name.casefold(): name for name in arrays if name not in stated}
    for title in stated:
        folded = str(title).casefold()
        others = [name for name in bare if not _siblings(folded, name)]
        near = difflib.get_close_matches(folded, others, n=1, cutoff=MISSPELT)
        if title not in channels and near:
            raise InputError(f"{where}: units= names '{title}', which is no channel",
                             got=f"'{bare[near[0]]}' without a unit", mend=f"did you mean '{bare[near[0]]}'?")


@dataclass(frozen=True, eq=False)
class Record(ReadOnlyState, Shown):
    """Channels sampled together, immutable, SI inside.

    Parameters
    ----------
    channels : mapping of str to Channel or (n,) array
        Signals by name; plain arrays are converted to SI from the unit that `units` names.
    sample_time : float, optional
        Sampling period [s] of a uniform record; leave out when `time` is given.
    time : (n,) array, optional
        Time stamps [s], or dates, which count from the first. A uniform clock (within 1 % jitter or the print's
        rounding, no gaps) sets `sample_time`.
    units : mapping of str to str, optional
        Unit of each plain array, any that a header may have; SI where left out.
    roles : mapping of str to str, optional
        Role name to channel name, e.g. ``{"force": "F_load_cell"}``; a role serves wherever a name does.
    name : str
        What to call the record in reports (the file's stem).
    start : float
        Time of the first sample [s] when `sample_time` is given.
    notes : tuple of str
        What the reader or a conversion notes on these data.
    reading : mapping of str to str, optional
        What roles stated that the file's header leaves open: ``{"time": "Zeit", "displacement": "s [mm]"}``, a clock
        under another name, a unit. A model keeps it, so that further files are read alike.

    Raises
    ------
    InputError
        Unequal lengths, no time base, a role that names no channel, a unit whose channel is misspelt.

    Examples
    --------
    >>> record = Record({"velocity": [0.0, 0.1, 0.2], "force": [0.0, 9.0, 21.0]}, sample_time=0.01,
    ...                 units={"velocity": "m/s", "force": "N"}, roles={"output": "force"})
    >>> record["output"], record.unit("force"), round(record.duration, 3)
    (array([ 0.,  9., 21.]), 'N', 0.02)
    """

    channels: Mapping[str, Channel]
    sample_time: float | None = None
    time: np.ndarray | None = None
    units: Mapping[str, str] | None = None
    roles: Mapping[str, str] = field(default_factory=dict)
    name: str = "record"
    start: float = 0.0
    notes: tuple[str, ...] = ()
    reading: Mapping[str, str] = field(default_factory=dict)
    time_base: TimeBase = field(init=False)

    def __post_init__(self) -> None:
        given = self.units or {}
        channels = {str(k): v if isinstance(v, Channel) else _channel(str(k), v, given.get(k, ""))
                    for k, v in self.channels.items()}
        if not channels:
            raise InputError(f"record '{self.name}' has no channels")
        arrays = [str(k) for k, v in self.channels.items() if not isinstance(v, Channel)]
        _refuse_misspelt(given, arrays, channels, f"record '{self.name}'")
        lengths = {k: v.values.size for k, v in channels.items()}
        n = next(iter(lengths.values()))
        if len(set(lengths.values())) > 1:
            raise InputError(f"record '{self.name}': channels differ in length", got=lengths)
        set_ = object.__setattr__
        set_(self, "channels", MappingProxyType(channels))
        set_(self, "units", None)
        if (self.time is None) == (self.sample_time is None):
            given = "neither" if self.time is None else "both"
            raise InputError(f"record '{self.name}' needs either sample_time or time", got=given)
        if self.time is not None:
            dated = calendar_seconds(self.time)
            time = _checks.frozen_array(self.time if dated is None else dated, "time", ndim=1)
            if time.size != n:
                raise InputError(f"record '{self.name}': time differs in length", got=f"{time.size} against {n}")
            base = analyse_time(time)
            set_(self, "time_base", base)
            set_(self, "start", base.start)
            set_(self, "sample_time", base.period if base.uniform else None)
            set_(self, "time", time)
        else:
            period = _checks.positive(self.sample_time, "sample_time", "s")  # type: ignore[arg-type]
            set_(self, "sample_time", period)
            set_(self, "time", None)
            set_(self, "time_base", TimeBase(n, self.start, period, 0.0, 0.0, 0.0, False, (), (), (), ()))
        for role, channel in self.roles.items():
            _checks.known_name(channel, list(channels), "channel", f"--role {shlex.quote(role + '=CHANNEL')}",
                               f"record '{self.name}'")
        set_(self, "roles", MappingProxyType(dict(self.roles)))
        set_(self, "reading", MappingProxyType(dict(self.reading)))

    # -- looking ------------------------------------------------------------------------------------------------
    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return next(iter(self.channels.values())).values.size

    @property
    def is_uniform(self) -> bool:
        """True when one sampling period describes every sample."""
        return self.sample_time is not None

    @property
    def times(self) -> np.ndarray:
        """(n,) time of every sample [s]: the stamps as read, or the uniform clock."""
        if self.sample_time is not None:
            return self.start + self.sample_time * np.arange(self.n_samples)
        assert self.time is not None
        return self.time

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        times = self.times
        return float(times[-1] - times[0]) if times.size else 0.0

    def resolve(self, name: str) -> str:
        """Channel name behind a role or a name; raises InputError that lists what there is.

        Parameters
        ----------
        name : str
            Role or channel, in any case of letters.

        Returns
        -------
        str
            The channel.
        """
        if name in self.roles:
            return self.roles[name]
        if name in self.channels:
            return name
        folded = {k.casefold(): k for k in self.channels}
        if name.casefold() in folded:
            return folded[name.casefold()]
        return _checks.known_name(name, list(self.channels), "channel",
                                  f"map it with {_checks.role_mend(name)}", f"record '{self.name}'")

    def has(self, name: str) -> bool:
        """True when a channel, or a role, of this name exists.

        Parameters
        ----------
        name : str
            Role or channel.

        Returns
        -------
        bool
            Whether `resolve` would find it.
        """
        return name in self.roles or name.casefold() in {k.casefold() for k in self.channels}

    def channel(self, name: str) -> Channel:
        """The channel behind a name or role, with its unit.

        Parameters
        ----------
        name : str
            Role or channel.

        Returns
        -------
        Channel
            Values and unit.
        """
        return self.channels[self.resolve(name)]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.channel(name).values

    def unit(self, name: str) -> str:
        """SI unit of a channel as text.

        Parameters
        ----------
        name : str
            Role or channel.

        Returns
        -------
        str
            Empty where it has none.
        """
        return self.channel(name).unit

    def matrix(self, names: Sequence[str]) -> np.ndarray:
        """(n, len(names)) array of the named channels.

        Parameters
        ----------
        names : sequence of str
            Roles or channels.

        Returns
        -------
        (n, len(names)) array
            One column for each, in its unit.
        """
        if len(names) == 1:
            return self[names[0]][:, None]
        return np.column_stack([self[n] for n in names]) if names else np.empty((self.n_samples, 0))

    # -- deriving -----------------------------------------------------------------------------------------------
    def slice(self, first: int, last: int) -> Record:
        """Samples first … last−1 as a record of their own; negative places count from the end, as in Python.

        Parameters
        ----------
        first, last : int
            Places of samples.

        Returns
        -------
        Record
            With its own start [s].
        """
        first, last, _ = slice(first, last).indices(self.n_samples)
        cut = {k: replace(c, values=c.values[first:last]) for k, c in self.channels.items()}
        if self.sample_time is not None:
            return replace(self, channels=cut, time=None, start=self.start + first * self.sample_time)
        assert self.time is not None
        return replace(self, channels=cut, time=self.time[first:last], sample_time=None)

    def with_channel(self, name: str, values: np.ndarray, unit: str = "", note: str = "") -> Record:
        """The same record with one channel added or replaced.

        Parameters
        ----------
        name : str
            Channel.
        values : (n,) array
            One for each sample.
        unit : str
            SI unit as text.
        note : str
            Further note of the record; empty for none.

        Returns
        -------
        Record
            A copy.
        """
        channels = {**self.channels, name: Channel(values, unit)}
        return self._with(channels, (*self.notes, note) if note else self.notes)

    def with_roles(self, roles: Mapping[str, str]) -> Record:
        """The same record with further roles (role name to channel name).

        Parameters
        ----------
        roles : mapping of str to str
            Role to channel.

        Returns
        -------
        Record
            A copy.
        """
        return replace(self, roles={**self.roles, **roles}, **self._clock())

    def flip(self, name: str) -> Record:
        """The same record with one channel's sign turned, and a note that states so.

        Parameters
        ----------
        name : str
            Role or channel.

        Returns
        -------
        Record
            A copy.
        """
        real_name = self.resolve(name)
        channel = self.channels[real_name]
        channels = {**self.channels, real_name: replace(channel, values=-channel.values)}
        return self._with(channels, (*self.notes, Turned(f"sign of '{real_name}' turned on request")))

    def with_note(self, note: str) -> Record:
        """The same record with a further note.

        Parameters
        ----------
        note : str
            One line.

        Returns
        -------
        Record
            A copy.
        """
        return self._with(self.channels, (*self.notes, note))

    def _clock(self) -> dict:
        return {"sample_time": None} if self.time is not None else {}

    def _with(self, channels: Mapping[str, Channel], notes: tuple[str, ...]) -> Record:
        return replace(self, channels=channels, notes=notes, **self._clock())

    def __repr__(self) -> str:
        clock = f"{1 / self.sample_time:.6g} Hz" if self.sample_time else "time stamps"
        signals = ", ".join(f"{k} [{c.unit or '1'}]" for k, c in self.channels.items())
        count = f"{self.n_samples} sample{'s' * (self.n_samples != 1)}"
        return f"Record '{self.name}': {count}, {clock}, {signals}"
