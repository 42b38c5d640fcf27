"""From records as read to records that damper models can be fitted to: roles, velocity, one rate, one polarity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lpvid.caveat import Caveat
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.dampers.drive import UNITS, wrong_unit
from quartercar.dampers.polarity import common_polarity

SHORTEST = 50
"""samples of a piece worth keeping."""


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
        What was derived, resampled, left out; a `Caveat` where it qualifies every figure.
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

    A velocity that was not measured is derived from displacement, in the band in which it moves. Where no record has a
    current, a voltage stands for it. A common rate above 1024 Hz is decimated (`lpvid.condition.preparing.decimation`).

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
        No records, no force or motion, one that never changes or has a wrong unit, unequal rates without `sample_rate`,
        force of different polarity in different records.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(4000) / 2000
    >>> run = Record({"displacement": 0.01 * np.sin(6 * t), "force": 60 * np.cos(6 * t)}, sample_time=1 / 2000,
    ...              units={"displacement": "m", "force": "N"}, name="run")
    >>> for note in prepare([run]).notes:
    ...     print(note)
    velocity derived from displacement without the sensor's noise beyond the band that moves
    all records decimated by 4 from 2000 Hz to 500 Hz (anti-aliased); --sample-rate HZ chooses another rate
    """
    from lpvid.condition import segments
    from lpvid.condition.band_limited import quiet_pieces
    from lpvid.condition.preparing import decimation, losses, one_clock

    records = [*training, *held_out]
    if not training:
        raise InputError("no records to fit to")
    records, notes = _with_roles(records)
    rate, why = (sample_rate, ()) if sample_rate is not None else decimation(records)
    channels = [r for r in ("velocity", "force", "displacement", "current") if records[0].has(r)]
    cut = [segments(part, channels, sample_rate=rate, minimum=SHORTEST) if part else []
           for part in (records[: len(training)], records[len(training):])]
    cut, notes = quiet_pieces(one_clock(cut, channels), notes)
    _need_signals(cut[0])
    polarity, stated = sense_of([*cut[0], *cut[1]])
    return Prepared(tuple(cut[0]), tuple(cut[1]), polarity, (*stated, *notes, *why, *losses([*cut[0], *cut[1]])))


def _with_roles(records: Sequence[Record]) -> tuple[list[Record], tuple[str, ...]]:
    """Records with the roles that all of them have; what was derived or stands in."""
    from lpvid.condition.preparing import with_current, with_motion

    for r in records:
        for role, wanted in UNITS.items():
            if r.has(role) and r.unit(role) not in (wanted, ""):
                raise wrong_unit(r, role, wanted)
    found, notes = with_motion(records)
    for r in found:
        if not r.has("force"):
            raise InputError(f"record '{r.name}' has no force", got=", ".join(r.channels),
                             mend=checks.role_mend("force"))
    found, stand_in = with_current(found)
    for role in ("displacement", "current"):
        without = [r.name for r in found if not r.has(role)]
        if without and len(without) < len(found):
            raise InputError(f"some records have no {role}", got=", ".join(without[:4]),
                             why="a model reads it from all records or from none",
                             mend=f"leave these files out, or {checks.role_mend(role)}")
    return found, (*notes, *stand_in)


def _need_signals(training: Sequence[Record]) -> None:
    """Refuse training data in which nothing moves: no law can be separated from them."""
    for role in ("velocity", "force"):
        ends = [(float(r[role].min()), float(r[role].max())) for r in training]
        low, high = min(a for a, _ in ends), max(b for _, b in ends)
        if low == high:
            raise InputError(f"the {role} never changes in the training records",
                             got=f"{low:g} {UNITS[role]} throughout", mend="check the sensor, or leave these files out")


def sense_of(records: Sequence[Record]) -> tuple[int, tuple[str, ...]]:
    """The sense in which the force is measured, the same in all records, and notes on it.

    Parameters
    ----------
    records : sequence of Record
        With force, and displacement or velocity.

    Returns
    -------
    polarity : {1, −1}
        −1 where the force is measured against the velocity; 1 where no record decides.
    notes : tuple of str
        On a reversed or an undecided polarity; empty for a passive one.
    """
    sense = common_polarity(records)
    if sense < 0:
        return -1, (Caveat("reversed polarity: the force opposes the velocity in these records (mean F·v < 0). "
                           "Parameters are those of the damper, tension positive; simulated forces have the sign of "
                           "the records. --flip force turns the records"),)
    if sense == 0:
        return 1, (Caveat("the polarity cannot be determined: mean F·v is too close to zero; taken as tension "
                          "positive"),)
    return 1, ()
