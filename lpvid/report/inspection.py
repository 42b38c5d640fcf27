"""Report of `inspect`: findings first, then what the records look like."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid import plot
from lpvid.auditing import Audit
from lpvid.auditing.view import view
from lpvid.record import Record
from lpvid.report.page import Figure, Item, Mark, Page, Section, Table, listing, number

SHOWN_RECORDS = 3
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
    """Findings with their evidence and mend; those of one name stand together."""
    rows: list[tuple[str, ...]] = []
    marks: list[Mark] = []
    for finding in audit.findings:
        where = " · ".join(part for part in (finding.record, finding.channel) if part) or "whole data set"
        rows.append((finding.name, finding.severity, where, finding.evidence, finding.mend or "–"))
        marks.append(_MARKS[finding.severity])
    if not rows:
        rows, marks = [("none", "–", "whole data set", "no check found anything", "–")], ["good"]
    return Table(("finding", "severity", "where", "evidence", "mend"), tuple(rows), marks=tuple(marks))


def _records_table(records: Sequence[Record]) -> Table:
    rows = []
    for r in records:
        rate = number(1 / r.time_base.period, 6) if r.time_base.period > 0 else "–"
        channels = ", ".join(f"{k} [{c.unit or '1'}]" for k, c in r.channels.items())
        rows.append((r.name, f"{r.n_samples:,}", rate, channels, "; ".join(r.notes) or "–"))
    return Table(("record", "samples", "rate [Hz]", "channels", "remarks"), tuple(rows), numeric=(1, 2))


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
