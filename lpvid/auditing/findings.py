"""What an audit returns: findings with evidence and mend, and the audit that lists them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lpvid._shown import Shown
from lpvid.codec import Encoded

SCHEMA = "lpvid/audit/1"
SEVERITIES = ("fault", "warning", "note")
"""fault: cannot be used as it stands. warning: usable, but would mislead. note: for information."""


@dataclass(frozen=True)
class Finding(Encoded):
    """One finding of the audit about the data.

    Attributes
    ----------
    name : str
        Kebab-case id of the check's outcome, e.g. ``"reversed-polarity"``.
    record, channel : str
        Where; empty when it concerns the whole data set or the whole record.
    severity : {"fault", "warning", "note"}
    evidence : str
        What was measured, with units.
    mend : str
        What to do about it; empty when nothing needs doing.
    value : float or None
        The number behind the evidence.
    """

    name: str
    record: str
    channel: str
    severity: str
    evidence: str
    mend: str = ""
    value: float | None = None

    def __str__(self) -> str:
        where = " · ".join(part for part in (self.record, self.channel) if part)
        mend = f" → {self.mend}" if self.mend else ""
        return f"{self.severity} {self.name}{f' [{where}]' if where else ''}: {self.evidence}{mend}"


@dataclass(frozen=True, eq=False)
class Audit(Encoded, Shown):
    """Findings about a data set, the most severe first; prints the verdict and one line for each kind of finding.

    Attributes
    ----------
    findings : tuple of Finding
        Ordered by severity, name, record (as given), channel.
    records : tuple of str
        One line about each record.
    names : tuple of str
        Names of the records.
    """

    schema = SCHEMA
    JSON = ("schema", "verdict", "records", "findings")

    findings: tuple[Finding, ...]
    records: tuple[str, ...]
    names: tuple[str, ...]

    def of(self, name: str) -> tuple[Finding, ...]:
        """The findings of one name.

        Parameters
        ----------
        name : str
            Name of a finding.

        Returns
        -------
        tuple of Finding
            Empty where there is none.
        """
        return tuple(f for f in self.findings if f.name == name)

    def count(self, severity: str) -> int:
        """How many findings have this severity.

        Parameters
        ----------
        severity : str
            One of `SEVERITIES`.

        Returns
        -------
        int
            Their number.
        """
        return sum(f.severity == severity for f in self.findings)

    @property
    def clean(self) -> bool:
        """True when nothing but notes was found."""
        return all(f.severity == "note" for f in self.findings)

    @property
    def verdict(self) -> str:
        """One sentence."""
        faults, warnings, notes = (self.count(s) for s in SEVERITIES)
        if faults:
            return f"{_many(faults, 'fault')} to mend before use, {_many(warnings, 'warning')}, {_many(notes, 'note')}"
        if warnings:
            return f"usable with care: {_many(warnings, 'warning')}, {_many(notes, 'note')}"
        return f"nothing against these data; {_many(notes, 'note')}" if notes else "nothing against these data"

    def __str__(self) -> str:
        head = self.records[0] if len(self.records) == 1 else f"{len(self.records)} records"
        lines = [f"Audit of {head}: {self.verdict}"]
        groups: dict[tuple[str, str], list[Finding]] = {}
        for finding in self.findings:
            groups.setdefault((finding.severity, finding.name), []).append(finding)
        lines += [_line(members) for members in groups.values()]
        return "\n".join(lines)


def _many(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def _line(members: Sequence[Finding]) -> str:
    first = members[0]
    return str(first) if len(members) == 1 else f"{first}  (and {len(members) - 1} more)"


def ordered(findings: Sequence[Finding], names: Sequence[str]) -> tuple[Finding, ...]:
    """Most severe first, then by name, record as given, channel.

    Parameters
    ----------
    findings : sequence of Finding
        In any order.
    names : sequence of str
        Records in the order that they were given in.

    Returns
    -------
    tuple of Finding
        Sorted.
    """
    place = {name: i for i, name in reversed(list(enumerate(names)))}
    return tuple(sorted(findings, key=lambda f: (SEVERITIES.index(f.severity), f.name, place.get(f.record, -1),
                                                 f.channel)))
