"""From records as read to records that damper models can be fitted to: roles, velocity, one rate, one polarity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.dampers.polarity import common_polarity

FASTEST = 1024.0
"""common rate [Hz] above which records are decimated: dampers have little above 100 Hz, and fits take longer."""
WANTED = 500.0
"""rate [Hz] that the decimation aims at."""
SHORTEST = 50
"""samples of a piece worth keeping."""
STAND_IN = "voltage"
"""channel that stands for the current where there is none."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """Records on one clock, finite, with roles ``velocity``, ``force`` and those of ``displacement``, ``current``
    that every record has.

    Attributes
    ----------
    training, held_out : tuple of Record
    polarity : {1, −1}
        −1 where the force is measured against the velocity, in all records.
    notes : tuple of str
        What was derived, resampled, left out; the gravest first.
    """

    training: tuple[Record, ...]
    held_out: tuple[Record, ...]
    polarity: int
    notes: tuple[str, ...]

    @property
    def sample_rate(self) -> float:
        """[Hz]"""
        period = self.training[0].sample_time
        assert period is not None
        return 1.0 / period


def prepare(training: Sequence[Record], held_out: Sequence[Record] = (),
            sample_rate: float | None = None) -> Prepared:
    """Find the roles, derive what is missing, bring all records to one rate and look at their polarity.

    A velocity that was not measured is derived from displacement. Where no record has a current, a voltage stands for
    it. A common rate above 1024 Hz is decimated by the whole number that comes nearest to 500 Hz.

    Parameters
    ----------
    training, held_out : sequence of Record
        As read.
    sample_rate : float, optional
        Resample to this rate [Hz], anti-aliased.

    Returns
    -------
    Prepared

    Raises
    ------
    InputError
        No records, no force or motion, unequal rates without `sample_rate`, force of different polarity in different
        records.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(4000) / 2000
    >>> run = Record({"displacement": 0.01 * np.sin(6 * t), "force": 60 * np.cos(6 * t)}, sample_time=1 / 2000,
    ...              units={"displacement": "m", "force": "N"}, name="run")
    >>> prepare([run]).notes
    ('velocity derived from displacement (savitzky-golay)', 'all records decimated by 4 from 2000 Hz to 500 Hz
    (anti-aliased); --sample-rate HZ chooses another rate')
    """
    from lpvid.condition import segments

    records = [*training, *held_out]
    if not training:
        raise InputError("no records to fit to")
    records, notes = _with_roles(records)
    rate, why = (sample_rate, ()) if sample_rate is not None else _decimation(records)
    channels = [r for r in ("velocity", "force", "displacement", "current") if records[0].has(r)]
    cut = [segments(part, channels, sample_rate=rate, minimum=SHORTEST) if part else []
           for part in (records[: len(training)], records[len(training):])]
    cut = _one_clock(cut, channels)
    polarity, said = _polarity([*cut[0], *cut[1]])
    losses = [f"record '{r.name}': {n}" for part in cut for r in part for n in r.notes if n.startswith(_LOSSES)]
    return Prepared(tuple(cut[0]), tuple(cut[1]), polarity, (*said, *notes, *why, *dict.fromkeys(losses)))


_LOSSES = ("cut into", "dropped", "record '", "sign of")


def _with_roles(records: Sequence[Record]) -> tuple[list[Record], tuple[str, ...]]:
    """Records with the roles that all of them have; what was derived or stands in."""
    from lpvid.condition import with_velocity

    notes, found = [], list(records)
    lacking = [r for r in found if not r.has("velocity")]
    if lacking:
        derived = [with_velocity(r) for r in found]
        still = [r for r in derived if not r.has("velocity")]
        if still:
            raise InputError(f"record '{still[0].name}' has neither velocity nor displacement",
                             got=", ".join(still[0].channels),
                             mend="--role velocity=CHANNEL or --role displacement=CHANNEL")
        new = [n for r, old in zip(derived, found, strict=True) for n in r.notes if n not in old.notes]
        notes += [n if len(lacking) == len(found) else f"{n} in {len(lacking)} of {len(found)} records"
                  for n in dict.fromkeys(new)]
        found = derived
    for r in found:
        if not r.has("force"):
            raise InputError(f"record '{r.name}' has no force", got=", ".join(r.channels), mend="--role force=CHANNEL")
    if not any(r.has("current") for r in found) and all(r.has(STAND_IN) for r in found):
        found = [r.with_roles({"current": r.resolve(STAND_IN)}) for r in found]
        notes.append(f"no channel 'current': '{STAND_IN}' stands for it, a command to the driver and not the current "
                     "in the coil, so that a lag of the driver is part of what is fitted")
    for role in ("displacement", "current"):
        without = [r.name for r in found if not r.has(role)]
        if without and len(without) < len(found):
            raise InputError(f"some records have no {role}", got=", ".join(without[:4]),
                             why="a model reads it from all records or from none",
                             mend=f"leave these files out, or --role {role}=CHANNEL")
    return found, tuple(notes)


def _decimation(records: Sequence[Record]) -> tuple[float | None, tuple[str, ...]]:
    """Rate to resample to where all records share one that is too fast, and what to say of it."""
    from lpvid.condition.segmentation import RATE_TOLERANCE

    periods = [r.time_base.period for r in records if r.time_base.period > 0]
    if not periods or max(periods) - min(periods) > RATE_TOLERANCE * min(periods):
        return None, ()
    rate = 1.0 / periods[0]
    factor = round(rate / WANTED)
    if rate <= FASTEST or factor < 2:
        return None, ()
    return rate / factor, (f"all records decimated by {factor} from {rate:.6g} Hz to {rate / factor:.6g} Hz "
                           "(anti-aliased); --sample-rate HZ chooses another rate",)


def _one_clock(cut: Sequence[list[Record]], channels: Sequence[str]) -> list[list[Record]]:
    """Training and held-out records with one sampling period; `segments` has seen to each part by itself."""
    from lpvid.condition import segments

    if not cut[1]:
        return list(cut)
    both = segments([*cut[0], *cut[1]], channels, minimum=1)
    return [both[: len(cut[0])], both[len(cut[0]):]]


def _polarity(records: Sequence[Record]) -> tuple[int, tuple[str, ...]]:
    """The sense in which the force is measured, the same in all records, and what to say of it."""
    sense = common_polarity(records)
    if sense < 0:
        return -1, ("reversed polarity: the force opposes the velocity in these records (mean F·v < 0). Parameters are "
                    "those of the damper, tension positive; simulated forces have the sign of the records. "
                    "--flip force turns the records",)
    if sense == 0:
        return 1, ("the polarity cannot be told: mean F·v is too close to zero; taken as tension positive",)
    return 1, ()
