"""Runs: from records as read to uniform, finite pieces of one current kind each, in the damper's own sense."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lpvid.auditing.values import plateau
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.characterisation.settings import CharacteriseSettings
from quartercar.dampers.bench.static_characteristic import SAME_SPEED
from quartercar.dampers.drive import UNITS, wrong_unit
from quartercar.dampers.facts import DISTINCT
from quartercar.dampers.polarity import common_polarity
from quartercar.dampers.preparing import SHORTEST

NOISE = 8.0
"""standard deviations that noise spans from end to end: 4 to either side, exceeded once in 16,000 samples"""
LONGEST = 1.0
"""stroke [m] above which a displacement is probably in another unit than its header states"""


@dataclass(frozen=True, eq=False)
class RecordPiece:
    """One uniform, finite piece of a record.

    Attributes
    ----------
    record : Record
        At the working rate, with displacement and velocity, force and current where they were measured.
    raw : Record
        The same piece at the rate of the measurement.
    specimen : str
    level : float or None
        Current that is held throughout; None where it varies or is not recorded.
    current : {"constant", "varies", "none"}
    integrated : bool
        Whether the displacement is the integral of the velocity.
    polarity : {1, −1}
    source : str
        Name of the record as read, of which this may be one of several pieces.
    held : float or None
        Time of the cycles at this level [s], where the record holds several levels; None otherwise.
    """

    record: Record
    raw: Record
    specimen: str
    level: float | None
    current: str
    integrated: bool
    polarity: int
    source: str
    held: float | None = None

    @property
    def duration(self) -> float:
        """Time of the samples that count [s]: of the record, or of the cycles at one of its levels."""
        return self.record.n_samples * self.period if self.held is None else self.held

    @property
    def name(self) -> str:
        """Of the record."""
        return self.record.name

    @property
    def period(self) -> float:
        """Sampling period [s]."""
        assert self.record.sample_time is not None
        return self.record.sample_time

    @property
    def has_force(self) -> bool:
        """Whether a force was measured."""
        return self.record.has("force")

    @property
    def displacement(self) -> np.ndarray:
        """(n,) [m], positive in extension."""
        return self.record["displacement"]

    @property
    def velocity(self) -> np.ndarray:
        """(n,) [m/s], positive in extension."""
        return self.record["velocity"]

    @property
    def force(self) -> np.ndarray:
        """(n,) [N], positive in tension, whatever the sense of the measurement."""
        return self.polarity * self.record["force"]

    @cached_property
    def cut_off(self) -> np.ndarray:
        """(n,) bool: at a force, as measured, that rests on an end of its range; within a sample where resampled."""
        if not self.raw.has("force"):
            return np.zeros(self.displacement.size, dtype=bool)
        measured = self.raw["force"]
        resting = np.zeros(measured.size, dtype=bool)
        for sign in (1.0, -1.0):
            if found := plateau(sign * measured):
                resting |= sign * measured >= found[1] - 1e-9 * float(np.ptp(measured))
        reach = self.period * (0.5 if measured.size == self.displacement.size else 1.0)
        first = np.searchsorted(self.raw.times, self.record.times - reach)
        last = np.searchsorted(self.raw.times, self.record.times + reach, side="right")
        before = np.concatenate([[0], np.cumsum(resting)])
        found = before[last] > before[first]
        low, high = np.quantile(np.abs(self.velocity[found]), (0.1, 0.9)) if found.any() else (0.0, 0.0)
        return found & bool(high - low > SAME_SPEED * high)  # a force without noise rests where the speed does

    @property
    def temperature(self) -> np.ndarray | None:
        """(n,) [K], NaN where missing; None where it was not measured."""
        if not self.record.has("temperature"):
            return None
        values = self.record["temperature"]
        return values if np.isfinite(values).any() else None


@dataclass(frozen=True, eq=False)
class RecordPieces:
    """All runs of a data set.

    Attributes
    ----------
    runs : tuple of RecordPiece
    levels : tuple of float
        Distinct held currents, rising.
    current_unit : str
    polarity : {1, −1}
        −1 where the force is measured against the velocity in all records.
    notes, caveats : tuple of str
        What was derived, resampled or left out; what must not be missed.
    """

    runs: tuple[RecordPiece, ...]
    levels: tuple[float, ...]
    current_unit: str
    polarity: int
    notes: tuple[str, ...]
    caveats: tuple[str, ...]

    @property
    def specimens(self) -> tuple[str, ...]:
        """Names in the order of the files."""
        return tuple(dict.fromkeys(r.specimen for r in self.runs))


def runs_of(records: Sequence[Record], settings: CharacteriseSettings) -> RecordPieces:
    """Cut, resample and sort records.

    Parameters
    ----------
    records : sequence of Record
        As read, each at its own rate.
    settings : CharacteriseSettings

    Returns
    -------
    RecordPieces
        Those that move, in the order of the records.

    Raises
    ------
    InputError
        No records, no motion, no force in any record, wrong units, nothing that moves, pieces too short, polarities
        that differ.
    """
    if not records:
        raise InputError("no records to characterise")
    _need_channels(records)
    for name, delay in settings.delays.items():
        short = min((r for r in records if r.has(name)), key=lambda r: float(r.times[-1] - r.times[0]), default=None)
        if short is not None and delay >= float(short.times[-1] - short.times[0]):
            raise InputError(f"the delay of '{name}' is longer than the record '{short.name}'", got=f"{delay:.4g} s",
                             mend=f"state the unit: --delay {name}={delay:.4g}ms")
        if not any(r.has(name) for r in records):
            raise InputError(f"no record has the channel '{name}' whose delay is given", got=", ".join(
                records[0].channels), mend="name a role or a channel: --delay force=1.2ms")
    from lpvid.condition.preparing import losses, with_current

    standing, notes = with_current(list(records))
    pieces: list[tuple[Record, Record, str, bool]] = []
    sources: dict[int, str] = {}
    done: list[str] = []
    for record in standing:
        found, stated = _pieces(record, settings)
        pieces += found
        sources |= {id(piece): record.name for piece, *_ in found}
        done += list(dict.fromkeys(stated))
    if not pieces:
        raise InputError("no record is long enough to characterise", got=", ".join(
            f"'{r.name}': {r.n_samples} samples" for r in records[:4]), why=f"a piece without missing samples needs "
            f"{SHORTEST}", mend="record at least one whole cycle")
    moving = [p for p in pieces if np.ptp(p[0]["displacement"]) > 0]
    if not moving:
        raise InputError("nothing moves in these records", got="a constant displacement throughout",
                         mend="check the sensor, or leave these files out")
    with_force = [p[0] for p in moving if p[0].has("force")]
    still = next((r for r in with_force if not np.ptp(r["force"]) > 0), None)
    if still is not None:
        raise InputError(f"record '{still.name}': the force never moves while the damper does",
                         got=f"the constant {still['force'][0]:.4g} N",
                         mend="check the load cell, or leave that file out")
    sense = common_polarity(with_force) if with_force else 1
    current = _kinds([p[0] for p in moving])
    runs = tuple(RecordPiece(a, b, name, level, kind, integrated, sense or 1, sources[id(a)])
                 for (a, b, name, integrated), (kind, level) in zip(moving, current, strict=True))
    unit = next((r.record.unit("current") or "1" for r in runs if r.record.has("current")), "A")
    levels = tuple(sorted({r.level for r in runs if r.level is not None}))
    lost = losses([p[0] for p in moving])
    counted = tuple(n if done.count(n) == len(records) else f"{n} in {done.count(n)} of {len(records)} records"
                    for n in dict.fromkeys(done))
    return RecordPieces(runs, levels, unit, sense or 1, (*dict.fromkeys(notes), *counted, *lost), _caveats(runs, sense))


def _need_channels(records: Sequence[Record]) -> None:
    for r in records:
        for role, wanted in (*UNITS.items(), ("temperature", "K")):
            if r.has(role) and role != "current" and r.unit(role) not in (wanted, "") and r.channel(role).unit_known:
                raise wrong_unit(r, role, wanted)
        if not (r.has("displacement") or r.has("velocity")):
            raise InputError(f"record '{r.name}' has neither displacement nor velocity", got=", ".join(r.channels),
                             mend=checks.role_mend("displacement", "velocity"))
    if not any(r.has("force") for r in records):
        raise InputError("no record has a force", got=", ".join(records[0].channels),
                         mend=checks.role_mend("force"))


def _pieces(record: Record, settings: CharacteriseSettings) -> tuple[list[tuple[Record, Record, str, bool]],
                                                                     tuple[str, ...]]:
    """(working piece, raw piece, specimen, integrated) of one record, and what was done."""
    from lpvid.condition import segments
    from lpvid.condition.band_limited import quiet_pieces
    from lpvid.condition.preparing import decimation, with_motion
    from lpvid.condition.resampling import resample

    notes: tuple[str, ...] = ()
    record, notes = _without_delays(record, settings, notes)
    channels = [c for c in ("displacement", "velocity", "force", "current") if record.has(c)]
    rate, why = (settings.sample_rate, ()) if settings.sample_rate else decimation([record])
    if settings.raw:
        rate, why = None, ()
    specimen = settings.specimen_of(record.name)
    found = []
    for raw in segments([record], channels, minimum=SHORTEST):
        piece = resample(raw, rate) if rate else raw
        integrated = not piece.has("displacement")
        if integrated:
            piece = piece.with_channel("displacement", integral(piece["velocity"], float(piece.sample_time or 1)), "m")
        (piece,), stated = with_motion([piece])
        ((piece,),), stated = quiet_pieces([[piece]], stated)
        notes = (*notes, *stated)
        found.append((piece, raw, specimen, integrated))
    return found, (*notes, *(w.replace("all records ", "") for w in why))


def integral(velocity: np.ndarray, period: float) -> np.ndarray:
    """Trapezoidal integral from 0.

    A zero error of the sensor becomes a drift, which cycles are fitted with; the mean is no measure of it where the
    record does not hold whole cycles.

    Parameters
    ----------
    velocity : (n,) array
        [m/s]
    period : float
        [s]

    Returns
    -------
    (n,) array
        [m]
    """
    return np.concatenate([[0.0], np.cumsum(0.5 * period * (velocity[1:] + velocity[:-1]))])


def _without_delays(record: Record, settings: CharacteriseSettings,
                    notes: tuple[str, ...]) -> tuple[Record, tuple[str, ...]]:
    """Channels earlier by the known delay of their sensors, interpolated linearly; the ends become missing."""
    for name, delay in settings.delays.items():
        if delay == 0 or not record.has(name):
            continue
        t, values = record.times, record[name]
        moved = np.interp(t + delay, t, values, left=np.nan, right=np.nan)
        channel = record.resolve(name)
        channels = {**record.channels, channel: replace(record.channels[channel], values=moved)}
        clock = {"sample_time": None} if record.time is not None else {}
        record = replace(record, channels=channels, **clock)
        notes = (*notes, f"{name} taken {1e3 * delay:g} ms earlier: the known delay of its sensor")
    return record, notes


def _kinds(pieces: Sequence[Record]) -> list[tuple[str, float | None]]:
    """("constant", level), ("varies", None) or ("none", None) of each piece; near currents share a level."""
    having = [(k, r["current"]) for k, r in enumerate(pieces) if r.has("current")]
    found: list[tuple[str, float | None]] = [("none", None)] * len(pieces)
    if not having:
        return found
    resolution = resolution_of([i for _, i in having])
    medians: list[tuple[float, int]] = []
    for k, i in having:
        if resolution.held(i):
            medians.append((float(np.median(i)), k))
        else:
            found[k] = ("varies", None)
    for group in resolution.groups(medians):
        level = resolution.level([v for v, _ in group])
        for _, k in group:
            found[k] = ("constant", level)
    return found


@dataclass(frozen=True)
class CurrentResolution:
    """Which currents of a data set are one level, and which stretches hold one.

    Attributes
    ----------
    share : float
        Two per cent of the largest current, in its unit.
    apart : float
        Currents that differ by more are two levels: `share`, or the noise where it is larger.
    """

    share: float
    apart: float

    def held(self, current: np.ndarray) -> bool:
        """Whether a stretch stays at one current, but for its noise and for 1 % of its samples.

        Parameters
        ----------
        current : (n,) array

        Returns
        -------
        bool
        """
        low, high = np.quantile(current, (0.005, 0.995))
        return bool(high - low <= max(self.share, NOISE * _noise(current)))

    def groups(self, values: Sequence[tuple[float, int]]) -> list[list[tuple[float, int]]]:
        """(current, number) sorted into groups between which the current is further apart than `apart`.

        Parameters
        ----------
        values : sequence of (float, int)

        Returns
        -------
        list of list of (float, int)
            Of rising current.
        """
        found: list[list[tuple[float, int]]] = []
        for value, k in sorted(values):
            if found and value - found[-1][-1][0] <= self.apart:
                found[-1].append((value, k))
            else:
                found.append([(value, k)])
        return found

    def level(self, values: Sequence[float]) -> float:
        """The level of a group: its median, and 0 where that is no further from 0 than `apart`.

        Parameters
        ----------
        values : sequence of float

        Returns
        -------
        float
        """
        level = float(np.median(values))
        return 0.0 if abs(level) <= self.apart else level


def resolution_of(currents: Sequence[np.ndarray]) -> CurrentResolution:
    """From the largest current of a data set, and from its noise.

    Parameters
    ----------
    currents : sequence of (n,) array
        Of its pieces.

    Returns
    -------
    CurrentResolution
    """
    largest = max(float(np.abs(np.median(i)) if np.ptp(i) == 0 else np.abs(i).max()) for i in currents)
    return CurrentResolution(DISTINCT * largest, max([DISTINCT * largest, *map(_noise, currents)]))


def _noise(current: np.ndarray) -> float:
    """Standard deviation of white noise on a current, from its median step."""
    return float(np.median(np.abs(np.diff(current)))) / (0.6745 * np.sqrt(2)) if current.size > 1 else 0.0


def _caveats(runs: Sequence[RecordPiece], sense: int) -> tuple[str, ...]:
    stated = []
    if sense < 0:
        stated.append("The force opposes the velocity in these records (mean F·v < 0): it is read as tension positive. "
                    "--flip force turns the records.")
    elif sense == 0:
        stated.append("The polarity of the force is not decided by these records: mean F·v is too close to zero. It is "
                    "taken as positive in tension.")
    if cut := {r.name: float(r.cut_off.mean()) for r in runs if r.cut_off.any()}:
        share, name = max((share, name) for name, share in cut.items())
        records = f"{len(cut)} record" + ("s" if len(cut) > 1 else "")
        stated.append(f"The force of {records} rests on an end of its range (up to "
                      f"{100 * share:.2g} % of the time, '{name}'): forces there are not given, loops, energies and "
                      "peak-velocity points hold them cut off. Widen the range of the load cell.")
    longest = max(((float(np.ptp(r.displacement)), r.name) for r in runs if not r.integrated), default=(0.0, ""))
    if longest[0] > LONGEST:
        stated.append(f"Record '{longest[1]}' has a stroke of {longest[0]:.3g} m: is its displacement in mm, with "
                    "another unit in the header?")
    if any(r.integrated for r in runs):
        stated.append("Displacement is the integral of the velocity where it was not measured: its zero is not known, "
                      "so the gas force belongs to the middle of the motion.")
    without = [r.name for r in runs if not r.has_force]
    if without:
        stated.append(f"No force in {', '.join(without[:4])}{' and more' if len(without) > 4 else ''}: only the "
                      "velocity histogram uses it.")
    return tuple(stated)
