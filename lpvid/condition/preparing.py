"""Preparing: what several records need before one model can run along all of them: motion, one rate, one clock."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid import _checks
from lpvid.caveat import Caveat
from lpvid.condition.bandwidth import SPARE, widest_band
from lpvid.condition.differentiation import with_velocity
from lpvid.condition.segmentation import RATE_TOLERANCE, segments
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.remark import Cut, ReadAs, Turned, of_records

FASTEST = 1024.0
"""common rate [Hz] above which records are decimated: dampers have little above 100 Hz, and fits take longer."""
WANTED = 500.0
"""rate [Hz] that the decimation aims at, where `SPARE` times the bandwidth is less."""
STAND_IN = "voltage"
"""channel that stands for the current where there is none."""


def with_motion(records: Sequence[Record]) -> tuple[list[Record], tuple[str, ...]]:
    """Records with a velocity, derived from displacement where it was not measured, and notes on it.

    Parameters
    ----------
    records : sequence of Record

    Returns
    -------
    list of Record, tuple of str

    Raises
    ------
    InputError
        A record with neither.
    """
    found = list(records)
    lacking = [r for r in found if not r.has("velocity")]
    if not lacking:
        return found, ()
    derived = [with_velocity(r) for r in found]
    still = [r for r in derived if not r.has("velocity")]
    if still:
        raise InputError(f"record '{still[0].name}' has neither velocity nor displacement",
                         got=", ".join(still[0].channels),
                         mend=_checks.role_mend("velocity", "displacement"))
    new = [n for r, old in zip(derived, found, strict=True) for n in r.notes if n not in old.notes]
    notes = tuple(n if len(lacking) == len(found) else type(n)(f"{n} in {len(lacking)} of {len(found)} records")
                  for n in dict.fromkeys(new))
    return derived, notes


def with_current(records: Sequence[Record]) -> tuple[list[Record], tuple[str, ...]]:
    """Records in which a voltage stands for the current where no record has one, and notes on it.

    Parameters
    ----------
    records : sequence of Record

    Returns
    -------
    list of Record, tuple of str
        The records as they are, and no notes, where one has a current or one lacks a voltage.
    """
    if any(r.has("current") for r in records) or not all(r.has(STAND_IN) for r in records):
        return list(records), ()
    return [r.with_roles({"current": r.resolve(STAND_IN)}) for r in records], (
        Caveat(f"no channel 'current': '{STAND_IN}' stands for it, a command to the driver and not the current in the "
               "coil, so that a lag of the driver is part of what is fitted"),)


def common_rate(records: Sequence[Record]) -> float | None:
    """The rate that all records share [Hz]; None where they have no common one.

    Parameters
    ----------
    records : sequence of Record
        Those of a single sample are left out.

    Returns
    -------
    float or None
    """
    periods = [r.time_base.period for r in records if r.time_base.period > 0]
    if not periods or max(periods) - min(periods) > RATE_TOLERANCE * min(periods):
        return None
    return 1.0 / periods[0]


def decimation(records: Sequence[Record]) -> tuple[float | None, tuple[str, ...]]:
    """Rate to resample to [Hz] where all records share one that is too fast, and notes on it.

    By a whole number, to about `WANTED`, but never to less than `SPARE` times the bandwidth of what moves: an
    anti-alias filter would take away what the records were made to show.

    Parameters
    ----------
    records : sequence of Record

    Returns
    -------
    float or None, tuple of str
        None, and no notes, up to `FASTEST` or where no whole number serves.

    Examples
    --------
    >>> decimation([Record({"x": [0.0] * 10}, sample_time=1 / 2000)])[0]
    500.0
    """
    rate = common_rate(records)
    if rate is None:
        return None, ()
    if rate <= FASTEST:
        return None, ()
    widest = widest_band(records)
    factor = min(round(rate / WANTED), int(rate / (SPARE * widest)) if widest > 0 else round(rate / WANTED))
    if factor < 2:
        return None, ()
    why = f"; 99 % of what moves lies below {widest:.3g} Hz" if factor < round(rate / WANTED) else ""
    return rate / factor, (f"all records decimated by {factor} from {rate:.6g} Hz to {rate / factor:.6g} Hz "
                           f"(anti-aliased{why}); --sample-rate HZ chooses another rate",)


def one_clock(cut: Sequence[list[Record]], channels: Sequence[str]) -> list[list[Record]]:
    """Training and held-out records with one sampling period; `segments` has seen to each part by itself.

    Parameters
    ----------
    cut : (training, held-out) lists of Record
        From `segments`; the second may be empty.
    channels : sequence of str
        In use.

    Returns
    -------
    list of list of Record
    """
    if not cut[1]:
        return list(cut)
    both = segments([*cut[0], *cut[1]], channels, minimum=1)
    return [both[: len(cut[0])], both[len(cut[0]):]]


def losses(records: Sequence[Record]) -> tuple[str, ...]:
    """What was cut away from records or turned in them, and how their files were read, each thing once.

    Parameters
    ----------
    records : sequence of Record
        As prepared.

    Returns
    -------
    tuple of str
        Record (not its piece) and note, in the order of the records.
    """
    return of_records(((r.name.rpartition("#")[0] or r.name, r.notes) for r in records), (Cut, Turned, ReadAs))
