"""Report of `inspect`: findings first, then what the records look like."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from lpvid import plot
from lpvid.auditing import Audit
from lpvid.auditing.view import view
from lpvid.plot.audit import MOST_CHANNELS, MOST_RECORDS
from lpvid.record import Record
from lpvid.report.courses import record_traces
from lpvid.report.formatting import listing, number
from lpvid.report.page import Item, Mark, NextStep, Page, PageFigure, PageTable, Paragraph, Section

MOST_DRAWN = 60
"""Records drawn over time; more would leave too few points for each within the size of a page."""
SHOWN_ALIKE = 2
"""Findings of one kind that are spelled out."""
_MARKS: dict[str, Mark] = {"fault": "bad", "warning": "warn", "note": "plain"}


def inspection_page(audit: Audit, records: Sequence[Record], channels: Sequence[str] = ()) -> Page:
    """A page about measured data.

    Parameters
    ----------
    audit : Audit
    records : sequence of Record
    channels : sequence of str
        Which channels to draw; all by default.

    Returns
    -------
    Page
    """
    mark: Mark = "bad" if audit.count("fault") else "warn" if audit.count("warning") else "good"
    duration = sum(r.duration for r in records if r.n_samples > 1 and not r.time_base.invalid)
    facts = (("records", str(len(records))), ("samples", f"{sum(r.n_samples for r in records):,}"),
             ("duration", number(duration, 4, "s")), ("sampling", _rates(records)))
    sections = (Section("Findings", (findings_table(audit),)), Section("Records", (_records_table(records),)),
                Section("Channels over time", tuple(_figures(records, channels))))
    return Page(f"Audit of {listing(audit.names, 4)}", f"{audit.verdict[:1].upper()}{audit.verdict[1:]}.", mark, facts,
                ("Nothing in the data was changed, and nothing was flipped or interpolated.",), sections,
                _steps(audit, records))


def _steps(audit: Audit, records: Sequence[Record]) -> tuple[NextStep, ...]:
    """The mends of the most severe findings, then a model."""
    severe = [f for f in audit.findings if f.severity != "note" and f.mend]
    advice = (f"use {f.mend}" if f.mend.startswith("--") else f.mend for f in severe)
    mends = dict.fromkeys(f"{m[:1].upper()}{m[1:].rstrip('.')}." for m in advice)
    return (*(NextStep(m) for m in list(mends)[:3]),
            NextStep("Fit a model, with data kept out of the fit to judge it on.",
                 f"lpvid identify DATA {_channels_of_a_model(records)} --hold-out 1/3 --out model"))


def _channels_of_a_model(records: Sequence[Record]) -> str:
    """Options that name the channels: those of a damper where there are such, else in capitals what is to be named."""
    seen = view(records[0], None)
    motion = seen.velocity or ("velocity" if seen.displacement and seen.record.has("displacement") else None)
    driven = [n for n in seen.scheduling if n in seen.usable and seen.usable[n].unit in ("A", "V")]
    if seen.force and motion:
        named = {"--input": motion, "--output": seen.force, "--schedule": ",".join(driven)}
    else:
        named = {"--input": "INPUT", "--output": "OUTPUT", "--schedule": "SCHEDULING" if seen.scheduling else ""}
    return " ".join(f"{option} {shlex.quote(name)}" for option, name in named.items() if name)


def findings_table(audit: Audit) -> Item:
    """Findings with their evidence and mend, the most severe first; of one kind at most `SHOWN_ALIKE` are spelled out.

    Parameters
    ----------
    audit : Audit
        Of one data set.

    Returns
    -------
    PageTable
        One row states that nothing was found, where nothing was.
    """
    rows: list[tuple[str, ...]] = []
    marks: list[Mark] = []
    kinds = dict.fromkeys((f.severity, f.name) for f in audit.findings)
    for severity, name in kinds:
        alike = [f for f in audit.findings if (f.severity, f.name) == (severity, name)]
        shown = alike if len(alike) <= SHOWN_ALIKE + 1 else alike[:SHOWN_ALIKE]
        for finding in shown:
            where = " · ".join(part for part in (finding.record, finding.channel) if part) or "whole data set"
            rows.append((name, severity, where, finding.evidence, finding.mend or "–"))
        if len(shown) < len(alike):
            others = [" · ".join(part for part in (f.record, f.channel) if part) for f in alike[len(shown):]]
            rows.append((name, severity, f"{len(others)} more", listing(others, 12), "as above"))
        marks.extend(_MARKS[severity] for _ in rows[len(marks):])
    if not rows:
        rows.append(("none", "–", "whole data set", "no check found anything", "–"))
        marks.append("good")
    return PageTable(("finding", "severity", "where", "evidence", "mend"), tuple(rows), marks=tuple(marks))


def _records_table(records: Sequence[Record]) -> PageTable:
    rows = []
    for r in records:
        rate = number(1 / r.time_base.period, 6) if r.time_base.period > 0 else "–"
        channels = ", ".join(f"{k} [{c.unit or '1'}]" for k, c in r.channels.items())
        rows.append((r.name, f"{r.n_samples:,}", rate, channels, "; ".join(r.notes) or "–"))
    columns = ("record", "samples", "rate [Hz]", "channels", "remarks")
    width = 5 if any(r.notes for r in records) else 4
    return PageTable(columns[:width], tuple(row[:width] for row in rows), numeric=(1, 2))


def _rates(records: Sequence[Record]) -> str:
    rates = sorted({float(f"{1 / r.time_base.period:.5g}") for r in records if r.time_base.period > 0})
    if not rates:
        return "–"
    return f"{rates[0]:g} Hz" if len(rates) == 1 else f"{rates[0]:g} … {rates[-1]:g} Hz"


def _figures(records: Sequence[Record], channels: Sequence[str]) -> list[Item]:
    items: list[Item] = []
    usable = [r for r in records if r.n_samples > 1 and not r.time_base.invalid]
    for record in usable[:MOST_DRAWN]:
        named = [c for c in channels if record.has(c)] or list(record.channels)
        items.append(record_traces(record, named, f"{record.name}: the channels over time, as read."))
    left = _left_out(records, usable)
    if left:
        items.append(Paragraph(left, strong=True))
    named = list(dict.fromkeys(c for r in records for c in (channels or r.channels)))
    spectra = plot.spectra(records, named)
    if spectra is not None:
        items.append(PageFigure.of(spectra, "Amplitude spectral density of the longest unbroken stretch (Welch, Hann)."
                               + _of(len(records), MOST_RECORDS) + _channels(len(named))))
    strokes = [(v.name, *v.stroke) for v in (view(r, None) for r in records) if v.stroke is not None]
    if strokes:
        items.append(PageFigure.of(plot.strokes(strokes), "Force over velocity and over displacement, as measured. A "
                               "passive damper fills the first and third quadrant of the left figure."
                               + _of(len(strokes), MOST_RECORDS)))
    return items


def _left_out(records: Sequence[Record], usable: Sequence[Record]) -> str:
    """What is not drawn over time, and why; empty where everything is."""
    parts = []
    if len(usable) > MOST_DRAWN:
        parts.append(f"{listing([r.name for r in usable[MOST_DRAWN:]], 12)}: only the first {MOST_DRAWN} records are "
                     "drawn; name fewer files to see these")
    broken = [r.name for r in records if r.n_samples > 1 and r.time_base.invalid]
    if broken:
        parts.append(f"{listing(broken, 12)}: the clock does not rise, so that there is nothing to draw over")
    short = [r.name for r in records if r.n_samples < 2]
    if short:
        parts.append(f"{listing(short, 12)}: fewer than two samples")
    return f"Not drawn over time: {'; '.join(parts)}." if parts else ""


def _of(count: int, shown: int) -> str:
    return f" The first {shown} of {count} records; the others are left out here." if count > shown else ""


def _channels(count: int) -> str:
    return f" The first {MOST_CHANNELS} of {count} channels." if count > MOST_CHANNELS else ""
