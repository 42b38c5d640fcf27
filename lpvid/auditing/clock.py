"""Checks of the time base: jitter, gaps, duplicates, backward steps, invalid stamps, rounding, unequal rates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View
from lpvid.condition.repeated_stamps import contradictions
from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.condition.tables import NO_TIME_UNIT
from lpvid.remark import Repeated
from lpvid.timebase import JITTER_LIMIT


def jitter(view: View) -> Iterator[Finding]:
    """Sampling intervals that differ by more than 1 % rms.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``jitter``, a fault; its value is the rms deviation as a share of the period.
    """
    base = view.record.time_base
    if base.n_samples > 2 and not base.invalid and not base.steady and base.period > 0:
        yield Finding("jitter", view.name, "", "fault",
                      f"sampling intervals deviate by {100 * base.jitter_rms:.3g} % rms, {100 * base.jitter_max:.3g} % "
                      f"at most, of {1e3 * base.period:.6g} ms", f"--sample-rate {1 / base.period:.4g}",
                      float(base.jitter_rms))


def rounded_stamps(view: View) -> Iterator[Finding]:
    """Stamps that look unsteady only because they were printed with few digits.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``rounded-stamps``, a note; its value is the step in which time is printed [s].
    """
    base = view.record.time_base
    if base.rounded and base.jitter_rms > JITTER_LIMIT:
        yield Finding("rounded-stamps", view.name, "", "note",
                      f"time is printed in steps of {1e3 * base.resolution:g} ms, {100 * base.jitter_rms:.3g} % rms of "
                      f"the period; the clock behind it is uniform at {1 / base.period:.6g} Hz",
                      "print more digits; the uniform clock is used", base.resolution)


def gaps(view: View) -> Iterator[Finding]:
    """Intervals longer than 1.5 periods, behind which the stamps stay late.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``time-gaps``, a warning; its value is the time lost [s].
    """
    base = view.record.time_base
    if base.gaps:
        times = view.record.times
        lost = sum(times[g] - times[g - 1] - base.period for g in base.gaps)
        yield Finding("time-gaps", view.name, "", "warning",
                      f"{len(base.gaps)} gap(s), {lost:.4g} s in all, the first before row {base.gaps[0] + 1}",
                      "nothing: the record is cut there", float(lost))


def repeated_rows(view: View) -> Iterator[Finding]:
    """Rows of one stamp that were read as one, since they nowhere contradict each other.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``repeated-rows``, a note.
    """
    for note in view.record.notes:
        if isinstance(note, Repeated):
            yield Finding("repeated-rows", view.name, "", "note", str(note), "nothing, or have each row written once")


def _with_others(view: View) -> str:
    """Which channels have two values at one time, in words; empty where none has."""
    names = list(contradictions(view.record, list(view.record.channels))) if view.record.time_base.duplicates else []
    return f" with other values of {', '.join(names[:3])}{' and more' * (len(names) > 3)}" if names else ""


def disorder(view: View) -> Iterator[Finding]:
    """Duplicate, backward and invalid stamps.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``duplicate-time`` (with other values, or it would have been read as one row), ``backward-time`` and
        ``invalid-time``, all faults; their values count the rows.
    """
    base = view.record.time_base
    for rows, name, what, mend in (
        (base.duplicates, "duplicate-time", f"time repeats{_with_others(view)}", "drop the wrong rows, or print the "
         "time with more digits"),
        (base.backward, "backward-time", "time runs backward", "sort the rows or cut the file there"),
        (base.invalid, "invalid-time", "time is not a finite number", "drop the rows or restore their stamps"),
    ):
        if rows:
            yield Finding(name, view.name, "", "fault", f"{what} in {len(rows)} row(s), the first row {rows[0] + 1}",
                          mend, float(len(rows)))


def unitless(view: View) -> Iterator[Finding]:
    """A time column that states no unit.

    Parameters
    ----------
    view : View

    Yields
    ------
    Finding
    """
    if any(note.endswith(NO_TIME_UNIT) for note in view.record.notes):
        period = view.record.time_base.period
        yield Finding("missing-unit", view.name, "time", "note",
                      f"the header gives no unit; taken as s, which makes {1 / period:.6g} Hz" if period > 0 else
                      "the header gives no unit; taken as s", "write the header as 'time [s]' or "
                      "'time [ms]', or --role 'time=COLUMN [ms]'")


def short(view: View) -> Iterator[Finding]:
    """Too few rows for any model.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``few-samples`` below 64, a fault below 2; its value is the number of samples.
    """
    n = view.record.n_samples
    if n < 64:
        yield Finding("few-samples", view.name, "", "fault" if n < 2 else "warning", f"{n} sample{'s' * (n != 1)}",
                      "a longer record", float(n))


def mixed_rates(views: Sequence[View]) -> Iterator[Finding]:
    """Records of one data set sampled at different rates.

    Parameters
    ----------
    views : sequence of View
        Records without a steady clock are left out.

    Yields
    ------
    Finding
        ``mixed-rates``, a warning; its value is the slowest record's period over the fastest's.
    """
    periods = [(v.period, v.name) for v in views if v.period]
    if not periods:
        return
    fastest, slowest = min(periods), max(periods)
    if slowest[0] - fastest[0] > RATE_TOLERANCE * fastest[0]:
        yield Finding("mixed-rates", "", "", "warning",
                      f"{1 / fastest[0]:.6g} Hz in '{fastest[1]}', {1 / slowest[0]:.6g} Hz in '{slowest[1]}'",
                      f"--sample-rate {1 / slowest[0]:.6g}", slowest[0] / fastest[0])
