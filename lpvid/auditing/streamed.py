"""audit for files larger than memory: every part is examined, and what its checks find is put together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from lpvid.auditing.checks import DATA_SET_CHECKS, RECORD_CHECKS
from lpvid.auditing.coherence import coherent_inputs
from lpvid.auditing.feedback import feedback
from lpvid.auditing.findings import SEVERITIES, Audit, Finding, ordered
from lpvid.auditing.view import View, check_names, view
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.timebase import GAP_FACTOR

THROUGHOUT = frozenset({"constant-channel", "few-samples", "repeated-segments", "displacement-rests",
                        "nominal-current", "polarity-unclear"})
"""Findings that hold for a record only where they hold for each of its parts."""
SHARED = 16
"""Parts, evenly spread, that the checks between records compare."""
BESIDE = 100_000
"""Samples of each of them: all of them together are one part of 1.6 million."""


@dataclass
class _Merged:
    """One finding in several parts of a record."""

    worst: Finding
    parts: int = 1

    def add(self, other: Finding) -> None:
        """The more severe one stands for all, among equals that of the larger number."""
        self.parts += 1
        here, there = (SEVERITIES.index(f.severity) for f in (self.worst, other))
        if there < here or (there == here and abs(other.value or 0.0) > abs(self.worst.value or 0.0)):
            self.worst = other


@dataclass
class _Parts:
    """Findings of one record, part by part."""

    name: str
    like: str
    parts: int = 0
    samples: int = 0
    end: float | None = None
    found: dict[tuple[str, str], _Merged] = field(default_factory=dict)

    def add(self, finding: Finding, label: str) -> None:
        """A finding of one part."""
        described = replace(finding, record=self.name, evidence=f"from {label}: {finding.evidence}")
        key = (finding.name, finding.channel)
        if key in self.found:
            self.found[key].add(described)
        else:
            self.found[key] = _Merged(described)

    def findings(self) -> Iterator[Finding]:
        """Those that hold for the record."""
        for (name, _), merged in self.found.items():
            if name in THROUGHOUT and merged.parts < self.parts:
                continue
            more = f" (in {merged.parts} of {self.parts} parts)" if self.parts > 1 else ""
            yield replace(merged.worst, evidence=merged.worst.evidence + more)


def audit_stream(chunks: Iterable[Record], *, scheduling: Sequence[str] | None = None, inputs: Sequence[str] = (),
                 outputs: Sequence[str] = (), report_progress: Callable[[str], None] = lambda text: None) -> Audit:
    """Examine records that arrive in parts; memory does not grow with their number.

    Every check of a record runs over each of its parts; the most severe of equal findings stands for all, with the
    number of parts. Checks between records compare up to 16 parts, evenly spread, so that a zero or a gain that moves
    within one file is found too. Coherent inputs and feedback are looked for in the beginnings of these parts.

    Parameters
    ----------
    chunks : iterable of Record
        E.g. ``read_chunks("hours.parquet")``.
    scheduling, inputs, outputs : sequences of str
        As for `audit`.
    report_progress : callable
        Receives progress.

    Returns
    -------
    Audit

    Raises
    ------
    InputError
        As `audit`.

    Examples
    --------
    >>> import numpy as np
    >>> v = np.sin(0.03 * np.arange(4000.0))
    >>> whole = Record({"velocity": v, "force": -100 * v}, sample_time=0.005, units={"velocity": "m/s", "force": "N"})
    >>> found = audit_stream([whole.slice(0, 2000), whole.slice(2000, 4000)])
    >>> found.of("reversed-polarity")[0].mend
    '--flip force'
    """
    records: dict[str, _Parts] = {}
    shared: list[View] = []
    every = 1
    for number, chunk in enumerate(chunks):
        here = records.setdefault(chunk.name, _Parts(chunk.name, repr(chunk)))
        label = f"{chunk.start:.6g} s"
        one = view(chunk, scheduling)
        for check in RECORD_CHECKS:
            for finding in check(one):
                here.add(finding, label)
        period = chunk.time_base.period
        if here.end is not None and period > 0 and chunk.start - here.end > GAP_FACTOR * period:
            lost = chunk.start - here.end - period
            here.add(Finding("time-gaps", chunk.name, "", "warning", f"1 gap, {lost:.4g} s, before this part",
                             "nothing: the record is cut there", lost), label)
        here.parts, here.samples = here.parts + 1, here.samples + chunk.n_samples
        here.end = float(chunk.times[-1])
        if number % every == 0:
            shared.append(view(_piece(chunk, f"{chunk.name} from {label}"), scheduling))
            if len(shared) > SHARED:
                shared, every = shared[::2], 2 * every
        report_progress(f"{sum(r.samples for r in records.values()):,} samples")
    if not records:
        raise InputError("no records to audit")
    check_names([v.record for v in shared], (*inputs, *outputs))
    found = [f for one in records.values() for f in one.findings()]
    found += [f for check in DATA_SET_CHECKS for f in check(shared)]
    found += coherent_inputs(shared, inputs)
    found += feedback(shared, inputs, outputs)
    names = tuple(records)
    lines = tuple(f"{r.like.split(': ')[0]}: {r.samples} samples in {r.parts} parts" for r in records.values())
    return Audit(ordered(found, names), lines, names)


def _piece(chunk: Record, name: str) -> Record:
    """The beginning of a part, in arrays of its own: a slice would hold the whole part."""
    cut = chunk.slice(0, BESIDE)
    channels = {k: replace(c, values=c.values.copy()) for k, c in cut.channels.items()}
    return replace(cut, channels=channels, name=name, **({"time": None} if cut.time is None else {"sample_time": None}))
