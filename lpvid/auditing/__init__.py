"""What is wrong with measured data, before any model: findings with their evidence and mend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lpvid import _checks
from lpvid.auditing import coherence, feedback, motion, resting, values
from lpvid.auditing.checks import CLOCKED_CHECKS, DATA_SET_CHECKS, RECORD_CHECKS
from lpvid.auditing.findings import Audit, Finding, ordered
from lpvid.auditing.force import polarity, turned_apart
from lpvid.auditing.resampled import mended, on_steady_clock
from lpvid.auditing.streamed import audit_stream
from lpvid.auditing.view import View, check_names, view
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.files.streaming import Chunks
from lpvid.record import Record

__all__ = ["Audit", "Finding", "audit", "record_remarks"]


def audit(records: Record | Sequence[Record] | Chunks, *, scheduling: Sequence[str] | None = None,
          inputs: Sequence[str] = (), outputs: Sequence[str] = (), units: Mapping[str, str] | None = None,
          sample_rate: float | None = None) -> Audit:
    """Examine measured records before any model is fitted; nothing is changed.

    Parameters
    ----------
    records : Record, sequence of Record, or Chunks
        As read; anything that parses can be audited. `Chunks` of files larger than memory are examined part by part.
    scheduling : sequence of str, optional
        Names or roles of the scheduling variables; by default every channel in A, V or K and every pure number.
    inputs : sequence of str
        Names or roles of a model's inputs; of several it is checked whether they move apart from each other.
    outputs : sequence of str
        Names or roles of its outputs; where the excitation repeats it is checked whether an input follows one of them.
    units : mapping of str to str, optional
        Of columns whose name states none, where the data are no Records; of a plain array, its columns in order.
    sample_rate : float, optional
        Rate [Hz] to which the data will be resampled: what that mends is a note, and a record whose stamps jitter is
        examined on a uniform clock as well.

    Returns
    -------
    Audit
        Findings, the most severe first; prints itself.

    Raises
    ------
    InputError
        No records; an input, output or scheduling variable that no record has and no channel gives; a rate for a
        stream, which keeps its own.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 200
    >>> v = np.sin(2 * np.pi * 1.3 * t) + np.sin(2 * np.pi * 3.1 * t)
    >>> record = Record({"velocity": v, "force": -100 * v}, sample_time=0.005,
    ...                 units={"velocity": "m/s", "force": "N"})
    >>> [f.mend for f in audit(record).of("reversed-polarity")]
    ['--flip force']
    """
    rate = None if sample_rate is None else _checks.positive(sample_rate, "sample_rate", "Hz")
    if isinstance(records, Chunks):
        if rate is not None:
            raise InputError("a stream keeps its own rate", got=f"{rate:g} Hz", mend="resample the files before")
        return audit_stream(records, scheduling=scheduling, inputs=inputs, outputs=outputs)
    listed = as_records(records, units=units)
    if not listed:
        raise InputError("no records to audit")
    check_names(listed, (*inputs, *outputs))
    views = [view(record, scheduling) for record in listed]
    found = [finding for one in views for check in RECORD_CHECKS for finding in check(one)]
    if rate is not None:
        raw, views = views, [_steadied(one, scheduling) for one in views]
        found += [finding for one, old in zip(views, raw, strict=True) if one is not old
                  for check in CLOCKED_CHECKS for finding in check(one)]
    found += [finding for check in DATA_SET_CHECKS for finding in check(views)]
    found += coherence.coherent_inputs(views, inputs)
    found += feedback.feedback(views, inputs, outputs)
    names = tuple(record.name for record in listed)
    found = list(dict.fromkeys(found if rate is None else mended(found, rate)))
    return Audit(ordered(turned_apart(found), names), tuple(repr(record) for record in listed), names)


def reversed_polarity(records: Sequence[Record]) -> bool:
    """Whether a record's force surely drives its motion, so that a model of these records has the other sign.

    Parameters
    ----------
    records : sequence of Record
        Those that a model is fitted to; others do not count.

    Returns
    -------
    bool
    """
    return any(f.name == "reversed-polarity" for r in records for f in polarity(view(on_steady_clock(r), None)))


def _steadied(one: View, scheduling: Sequence[str] | None) -> View:
    """The view of the record on a uniform clock; itself where it is on one, or cannot be brought onto one."""
    record = on_steady_clock(one.record)
    return one if record is one.record else view(record, scheduling)


def record_remarks(records: Sequence[Record]) -> tuple[str, ...]:
    """What spoils a fit and is not seen in it, for results of commands that do not audit.

    A velocity that is not the derivative of its displacement, and a force that was cut off.

    Parameters
    ----------
    records : sequence of Record
        As read.

    Returns
    -------
    tuple of str
        With record, channel and mend; a unit of velocity or displacement that is wrong shows in their scale.
    """
    views = [view(on_steady_clock(r), None) for r in records]
    found = [f for v in views for f in motion.velocity_against_displacement(v)]
    found += [f for v in views for check in (values.clipped, resting.flat_peaks) for f in check(v)
              if f.channel == v.force]
    return tuple(dict.fromkeys(str(f) for f in found if f.severity == "warning"))
