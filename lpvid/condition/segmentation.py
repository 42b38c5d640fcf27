"""Cut records at missing samples and gaps: the gate between measured data and everything that fits or validates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lpvid import _checks
from lpvid.condition.repeated_stamps import one_row_per_stamp, refuse_contradictions
from lpvid.condition.resampling import on_clock, resample, true_runs
from lpvid.condition.tables import as_records
from lpvid.errors import InputError, TooFewSamples
from lpvid.record import Record
from lpvid.remark import Cut, Derivation, LeftOut
from lpvid.timebase import JITTER_LIMIT
from lpvid.units import contradiction_mend, contradicts, in_doubt

RATE_TOLERANCE = 1e-3
"""relative difference of the sampling periods of two records that still counts as one rate."""


def segments(records: Record | Sequence[Record], channels: str | Sequence[str], *, sample_rate: float | None = None,
             minimum: int = 2, remedy: str = "") -> list[Record]:
    """Uniform, finite, gap-free records at one rate, cut from measured ones; nothing is interpolated over.

    Parameters
    ----------
    records : Record or sequence of Record
        As read.
    channels : str or sequence of str
        Names or roles of the channels in use; the pieces keep the others too, which may hold NaN.
    sample_rate : float, optional
        Rate [Hz] to which every piece is resampled (anti-aliased, zero phase); needed when the stamps jitter by
        more than 1 % of the period or the records differ in rate.
    minimum : int
        Shortest piece worth keeping [samples, at the rate of the result].
    remedy : str
        What would make shorter pieces do, for the message where none is long enough, e.g. ``"a lower order"``.

    Returns
    -------
    list of Record
        Named ``stem``, or ``stem#1``, ``stem#2``, … where a record was cut; the notes state what was dropped and why.

    Raises
    ------
    InputError
        A channel in use is missing, of unknown unit, or holds infinity or text; time runs backward, repeats or is no
        number; unsteady or unequal rates without `sample_rate`; no piece long enough.

    Examples
    --------
    >>> record = Record({"u": [1.0, 2.0, float("nan"), 4.0, 5.0, 6.0]}, sample_time=0.1, name="run")
    >>> [(r.name, r["u"].tolist(), round(r.start, 3)) for r in segments(record, "u")]
    [('run#1', [1.0, 2.0], 0.0), ('run#2', [4.0, 5.0, 6.0], 0.3)]
    """
    listed = as_records(records)
    if not listed:
        raise InputError("no records given")
    wanted = _checks.names(channels, "channels")
    minimum = max(_checks.count(minimum, "minimum", at_least=1), 1)
    for record in listed:
        _refuse_channels(record, wanted)
    listed = [one_row_per_stamp(record, wanted) for record in listed]
    for record in listed:
        _refuse_time(record, wanted)
    cut = [_pieces(record, wanted, sample_rate) for record in listed]
    if sample_rate is None:
        cut = _one_rate(listed, cut)
    else:
        rate = _checks.positive(sample_rate, "sample_rate", "Hz")
        cut = [[resample(piece, rate) if piece.n_samples > 1 else piece for piece in pieces] for pieces in cut]
    return _keep(listed, cut, minimum, remedy)


def refuse_text(records: Sequence[Record], channels: Sequence[str]) -> None:
    """Refuse text among the numbers of a channel in use, before anything is said of its length.

    Parameters
    ----------
    records : sequence of Record
        As read.
    channels : sequence of str
        Names or roles; those that a record lacks are passed over.

    Raises
    ------
    InputError
        Names record, channel, text and row.
    """
    for record in records:
        for name in dict.fromkeys(record.resolve(c) for c in channels if record.has(c)):
            fault = record.channels[name].fault
            if fault:
                raise InputError(f"record '{record.name}', channel '{name}' is not all numbers", got=fault,
                                 mend="leave the field empty or write nan where a sample is missing")


def _refuse_channels(record: Record, wanted: Sequence[str]) -> None:
    for name in dict.fromkeys(record.resolve(w) for w in wanted):
        channel = record.channels[name]
        refuse_text([record], [name])
        made_of = name == "velocity" and any(isinstance(n, Derivation) for n in record.notes)
        if made_of and record.has("displacement"):  # whose unit the derivative has
            _refuse_unknown_unit(record, record.resolve("displacement"))
            _refuse_unit(record, record.resolve("displacement"), ["displacement"])
        _refuse_unknown_unit(record, name)
        _refuse_unit(record, name, [w for w in wanted if record.resolve(w) == name])
        infinite = np.flatnonzero(np.isinf(channel.values))
        if infinite.size:
            raise InputError(f"record '{record.name}', channel '{name}' must be finite",
                             got=f"{channel.values[infinite[0]]} in row {infinite[0] + 1}",
                             why="an infinite sample cannot be used", mend="write nan where a sample is missing")


def _refuse_unknown_unit(record: Record, name: str) -> None:
    channel = record.channels[name]
    if not channel.unit_known:
        raise InputError(f"record '{record.name}', channel '{name}': unknown unit", got=f"'{channel.source_unit}'",
                         mend="correct the unit in the header, or leave it out if the values are SI")


def _refuse_unit(record: Record, name: str, used_as: Sequence[str]) -> None:
    """Refuse a channel whose unit is not one of its own name's quantity, nor of a role in which it is used."""
    channel = record.channels[name]
    roles = [w for w in used_as if w.casefold() != name.casefold()]
    found = [(contradicts(w, channel.unit), f"role '{w}'") for w in roles]
    found.append((contradicts(name, channel.unit, channel.source_unit), "name"))
    for expected, caller in found:
        if expected:
            source = channel.source_unit or channel.unit
            doubt = source.strip() if caller == "name" and in_doubt(name, source) else ""
            calls = "states neither mass nor acceleration" if doubt else f"calls for {expected[0]}"
            role = caller.removeprefix("role ").strip("'") if caller != "name" else ""
            raise InputError(f"record '{record.name}', channel '{name}' has a unit of "
                             f"{'two meanings' if doubt else 'another quantity'}", got=f"'{name} [{source}]'",
                             why=f"its {caller} {calls}",
                             mend=contradiction_mend(channel.unit, expected, name, role, doubt))


def _refuse_time(record: Record, wanted: Sequence[str]) -> None:
    base = record.time_base
    if record.n_samples < 2:
        raise TooFewSamples(f"record '{record.name}' has too few rows", got=record.n_samples,
                            why="two samples are the least")
    times = record.times
    for rows, what, mend in ((base.invalid, "time is not a finite number", "drop the row or restore its stamp"),
                             (base.backward, "time runs backward", "sort the rows or cut the file there")):
        if rows:
            row = rows[0]
            after = f" after {times[row - 1]:.9g} s" if row else ""
            more = f" and {len(rows) - 1} more row(s)" if len(rows) > 1 else ""
            raise InputError(f"record '{record.name}': {what} in row {row + 1}", got=f"{times[row]:.9g} s{after}{more}",
                             mend=mend)
    refuse_contradictions(record, wanted)


def _pieces(record: Record, wanted: Sequence[str], sample_rate: float | None) -> list[Record]:
    """Runs without a missing sample or a gap, each on a uniform clock."""
    good = np.asarray(np.isfinite(record.matrix(wanted)).all(axis=1))
    starts = np.array(record.time_base.gaps, dtype=int)
    pieces = []
    for first, last in true_runs(good):
        inside = starts[np.searchsorted(starts, first, "right"):np.searchsorted(starts, last)]
        edges = [first, *inside.tolist(), last]
        pieces += [record.slice(a, b) for a, b in pairwise(edges)]
    if record.is_uniform:
        return [_clocked(piece, record.sample_time, record, piece.start) for piece in pieces]
    base = record.time_base
    long = [p for p in pieces if p.n_samples > 1]
    steady = base.steady or (bool(long) and all(p.time_base.steady for p in long))
    if steady and base.steady:
        return [_clocked(p, base.period, record, p.start) for p in pieces]
    if steady:
        period = float(np.average([p.time_base.period for p in long], weights=[p.n_samples - 1 for p in long]))
        return [_clocked(p, period, record, p.start) for p in pieces]
    if sample_rate is None:
        raise InputError(f"record '{record.name}': unsteady sampling",
                         got=f"jitter {100 * base.jitter_rms:.3g} % rms of the period",
                         why=f"more than {100 * JITTER_LIMIT:g} %", mend=f"--sample-rate {1 / base.period:.4g}")
    return [_on_clock(p, _own_clock(base.period, sample_rate)) for p in pieces]


def _own_clock(period: float, sample_rate: float) -> float:
    """Period of the clock that unsteady samples are brought onto before they are resampled [s].

    Their mean one differs between a record and a part of it, and with it every sample: a model would not recognise the
    record that it was fitted to a part of. So it is that of the least multiple of the rate asked for that is no lower
    than their mean rate. Where their mean rate is below the rate asked for, it is that of the mean rate.
    """
    many = (1 - RATE_TOLERANCE) / (period * sample_rate)
    return period if many < 1 - 2 * RATE_TOLERANCE else 1 / (sample_rate * max(int(np.ceil(many)), 1))


def _on_clock(piece: Record, period: float) -> Record:
    if piece.n_samples < 2:
        return replace(piece, time=None, sample_time=period)
    clocked, note = on_clock(replace(piece, sample_time=None), period)
    return clocked.with_note(note) if note else clocked


def _clocked(piece: Record, period: float | None, parent: Record, start: float) -> Record:
    return replace(parent, channels=piece.channels, time=None, sample_time=period, start=start)


def _one_rate(listed: Sequence[Record], cut: list[list[Record]]) -> list[list[Record]]:
    """The same pieces with one sampling period, or an error that shows which records differ."""
    flat = [(record, piece) for record, pieces in zip(listed, cut, strict=True) for piece in pieces]
    if not flat:
        return cut
    periods = np.array([piece.sample_time for _, piece in flat], dtype=float)
    low, high = int(np.argmin(periods)), int(np.argmax(periods))
    if periods[high] - periods[low] > RATE_TOLERANCE * periods[low]:
        slowest = 1 / periods[high]
        raise InputError("records of different sampling rates", mend=f"--sample-rate {slowest:.6g}",
                         got=f"{1 / periods[low]:.6g} Hz in '{flat[low][0].name}', {slowest:.6g} Hz in "
                             f"'{flat[high][0].name}'")
    common = float(np.average(periods, weights=[piece.n_samples for _, piece in flat]))
    if np.ptp(periods) <= 1e-12 * common:
        common = float(periods[0])
    return [[replace(piece, time=None, sample_time=common) for piece in pieces] for pieces in cut]


def _keep(listed: Sequence[Record], cut: list[list[Record]], minimum: int, remedy: str) -> list[Record]:
    """Name the pieces, drop the short ones, and note what was lost."""
    result: list[Record] = []
    orphaned: list[LeftOut] = []
    for record, pieces in zip(listed, cut, strict=True):
        kept = [piece for piece in pieces if piece.n_samples >= minimum]
        notes = _losses(record, pieces, minimum)
        if not kept:
            orphaned += [LeftOut(f"record '{record.name}' left out: {note}") for note in notes]
            continue
        many = len(pieces) > 1
        result += [replace(piece, time=None, name=f"{record.name}#{i}" if many else record.name,
                           notes=(*piece.notes, *notes)) for i, piece in enumerate(kept, start=1)]
    if not result:
        empty = [(r.name, n) for r in listed for n in r.channels if not np.isfinite(r[n]).any()]
        if empty:
            raise InputError(f"record '{empty[0][0]}', channel '{empty[0][1]}' holds no number at all",
                             mend="export the data again, or leave that file out")
        longest = max((piece.n_samples for pieces in cut for piece in pieces), default=0)
        if all(len(pieces) == 1 and _whole(r, pieces[0]) for r, pieces in zip(listed, cut, strict=True)):
            raise TooFewSamples("no record is long enough", got=f"{longest} samples in the longest",
                                why=f"{minimum} are needed",
                                mend=f"a longer record{f', or {remedy}' if remedy else ''}")
        raise TooFewSamples("no segment long enough between missing samples and gaps",
                            got=f"{longest} samples in the longest", why=f"{minimum} are needed",
                            mend=f"a longer record, {f'{remedy}, ' if remedy else ''}or fewer channels in use")
    if orphaned:
        result[0] = replace(result[0], time=None, notes=(*result[0].notes, *orphaned))
    return result


def _whole(record: Record, piece: Record) -> bool:
    """Whether a piece is its record, at another rate perhaps: no gap, and no missing sample in the channels in use."""
    return not record.time_base.gaps and all(np.isfinite(record[n]).all() for n in piece.channels)


def _losses(record: Record, pieces: Sequence[Record], minimum: int) -> list[Cut]:
    notes = []
    gaps = len(record.time_base.gaps)
    if len(pieces) > 1:
        between = f"{gaps} time gap{'s' * (gaps > 1)}"
        places = "missing samples" if not gaps else between if len(pieces) == gaps + 1 else (
            f"missing samples and {between}")
        notes.append(Cut(f"cut into {len(pieces)} pieces at {places}"))
    short = [piece for piece in pieces if piece.n_samples < minimum]
    if short:
        spans = ", ".join(f"{piece.n_samples} samples from {piece.start:.6g} s" for piece in short[:5])
        more = f" and {len(short) - 5} more" if len(short) > 5 else ""
        notes.append(Cut(f"dropped {len(short)} piece(s) shorter than {minimum} samples: {spans}{more}"))
    if not pieces:
        notes.append(Cut("no row has all channels in use"))
    return notes
