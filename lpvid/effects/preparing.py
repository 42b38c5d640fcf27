"""Preparing: from records as read to records that a baseline and a catalogue can run along, on one clock, finite."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lpvid import _checks
from lpvid.baselines.signals import ROLES
from lpvid.condition import segments
from lpvid.condition.band_limited import quiet_pieces
from lpvid.condition.preparing import decimation, losses, one_clock, with_current, with_motion
from lpvid.condition.segmentation import refuse_text
from lpvid.effects.effect import Effect
from lpvid.errors import InputError, TooFewSamples
from lpvid.record import Record

SHORTEST = 50
"""samples of a piece at least"""


@dataclass(frozen=True, eq=False)
class PreparedRecords:
    """Training and held-out records, uniform, of one rate, finite in all roles that are used, and what was done.

    Attributes
    ----------
    training, held_out : tuple of Record
        Channels named by their roles, no others.
    notes : tuple of str
        What was done to the data.
    """

    training: tuple[Record, ...]
    held_out: tuple[Record, ...]
    notes: tuple[str, ...]


def prepare(training: Sequence[Record], held_out: Sequence[Record], catalogue: Sequence[Effect],
            needed: Sequence[str] = (), sample_rate: float | None = None) -> PreparedRecords:
    """Derive a velocity, let a voltage stand for a current, bring all to one rate, cut at gaps and NaN.

    A common rate above 1024 Hz is decimated (`condition.preparing.decimation`). A role that only some records have, or
    whose channel cannot be used, is left out unless the baseline needs it.

    Parameters
    ----------
    training, held_out : sequence of Record
    catalogue : sequence of Effect
        Their needs are roles to look for.
    needed : sequence of str
        Roles that the baseline reads; a bad channel among them is refused, one that is missing the baseline refuses.
    sample_rate : float, optional
        Resample to this rate [Hz].

    Returns
    -------
    PreparedRecords

    Raises
    ------
    InputError
        No training record, no channel that a baseline could read, or one that is needed and cannot be used.
    """
    records = [*training, *held_out]
    if not training:
        raise InputError("no records to diagnose")
    motion: tuple[str, ...] = ()
    if any(r.has(n) for r in records for n in ("velocity", "displacement")) and ("velocity" in needed or not needed):
        records, motion = with_motion(records)
    records, stand_in = with_current(records)
    roles, left = _roles(records, catalogue, needed)
    rate, why = (sample_rate, ()) if sample_rate is not None else decimation(records)
    try:
        parts = [segments(part, roles, sample_rate=rate, minimum=SHORTEST) if part else []
                 for part in (records[: len(training)], records[len(training):])]
    except TooFewSamples:
        refuse_text(records, ROLES)
        raise
    parts = one_clock(parts, roles)
    parts, motion = quiet_pieces(parts, motion)
    notes = (*motion, *stand_in, *why, *left, *losses([*parts[0], *parts[1]]))
    return PreparedRecords(tuple(_only(r, roles) for r in parts[0]), tuple(_only(r, roles) for r in parts[1]), notes)


def _roles(records: Sequence[Record], catalogue: Sequence[Effect],
           needed: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Roles that every record has in a usable channel, and notes on those left out."""
    known = dict.fromkeys((*needed, *ROLES, *(n for e in catalogue for n in e.needs)))
    found, left = [], []
    for role in known:
        having = [r for r in records if r.has(role)]
        if not having:
            continue
        lacking = next((r for r in records if not r.has(role)), None)
        if lacking is not None and role == "force" and (role in needed or not needed):
            raise InputError(f"record '{lacking.name}' has no force, which other records have",
                             got=", ".join(lacking.channels), mend=_checks.role_mend(role))
        bad = next((r for r in having if r.channel(role).fault or not r.channel(role).unit_known), None)
        if len(having) == len(records) and (bad is None or role in needed or role == "force"):
            found.append(role)
        elif bad is not None:
            left.append(f"{role} is left out: it cannot be used in record '{bad.name}'")
        else:
            left.append(f"{role} is left out: only {len(having)} of {len(records)} records have it")
    if not found:
        raise InputError(f"record '{records[0].name}' has no channel that a baseline could read",
                         got=", ".join(records[0].channels), why=f"a baseline reads some of {', '.join(ROLES)}",
                         mend=_checks.role_mend("ROLE"))
    return found, tuple(left)


def _only(record: Record, roles: Sequence[str]) -> Record:
    """The record with channels named by their roles, and no others."""
    return Record({n: record.channel(n) for n in roles}, record.sample_time, name=record.name, start=record.start,
                  notes=record.notes)
