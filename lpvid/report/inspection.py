"""Report of `inspect`: findings first, then what the records look like."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid import plot
from lpvid.auditing import Audit
from lpvid.auditing.view import view
from lpvid.record import Record
from lpvid.report.page import Figure, Item, Mark, Page, Section, Table, listing, number

SHOWN_RECORDS = 3
"""Records drawn over time."""
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
                Section("What was measured", tuple(_figures(records, channels))))
    return Page(f"Audit of {listing(audit.names, 4)}", f"{audit.verdict[:1].upper()}{audit.verdict[1:]}.", mark, facts,
                ("Nothing in the data was changed, and nothing was flipped or interpolated.",), sections)


def findings_table(audit: Audit) -> Item:
    """Findings with their evidence and mend, gravest first; of one kind at most `SHOWN_ALIKE` are spelled out."""
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
    return Table(("finding", "severity", "where", "evidence", "mend"), tuple(rows), marks=tuple(marks))


def _records_table(records: Sequence[Record]) -> Table:
    rows = []
    for r in records:
        rate = number(1 / r.time_base.period, 6) if r.time_base.period > 0 else "–"
        channels = ", ".join(f"{k} [{c.unit or '1'}]" for k, c in r.channels.items())
        rows.append((r.name, f"{r.n_samples:,}", rate, channels, "; ".join(r.notes) or "–"))
    columns = ("record", "samples", "rate [Hz]", "channels", "remarks")
    width = 5 if any(r.notes for r in records) else 4
    return Table(columns[:width], tuple(row[:width] for row in rows), numeric=(1, 2))


def _rates(records: Sequence[Record]) -> str:
    rates = sorted({float(f"{1 / r.time_base.period:.5g}") for r in records if r.time_base.period > 0})
    if not rates:
        return "–"
    return f"{rates[0]:g} Hz" if len(rates) == 1 else f"{rates[0]:g} … {rates[-1]:g} Hz"


def _figures(records: Sequence[Record], channels: Sequence[str]) -> list[Item]:
    items: list[Item] = []
    for record in [r for r in records if r.n_samples > 1 and not r.time_base.invalid][:SHOWN_RECORDS]:
        named = [c for c in channels if record.has(c)] or list(record.channels)
        items.append(Figure.of(plot.channel_traces(record, named),
                               f"{record.name}: the channels over time, as read."))
    named = list(dict.fromkeys(c for r in records for c in (channels or r.channels)))
    spectra = plot.spectra(records, named)
    if spectra is not None:
        items.append(Figure.of(spectra, "Amplitude spectral density of the longest unbroken stretch (Welch, Hann)."))
    strokes = [(v.name, *v.stroke) for v in (view(r, None) for r in records) if v.stroke is not None]
    if strokes:
        items.append(Figure.of(plot.strokes(strokes), "Force over velocity and over displacement, as measured. A "
                               "passive damper fills the first and third quadrant of the left figure."))
    return items
