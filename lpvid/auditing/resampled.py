"""What --sample-rate mends: a clock that jitters, unequal rates, a rate far above what the signals fill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.condition.resampling import SAME_RATE, on_clock
from lpvid.record import Record

MENDED = {"jitter": "a uniform clock", "mixed-rates": "one rate"}
"""Findings that resampling mends at any rate, and what it gives."""


def on_steady_clock(record: Record) -> Record:
    """A record whose stamps jitter on the clock of its mean rate, between its gaps; others as they are.

    The checks of motion, force and spectrum need a rate. On the stamps as read they would find nothing.

    Parameters
    ----------
    record : Record

    Returns
    -------
    Record
        With the gaps of the record.

    Examples
    --------
    >>> stamps = 0.01 * np.arange(40) + 0.003 * (np.arange(40) % 2)
    >>> record = on_steady_clock(Record({"v": 2.0 * stamps}, time=stamps))
    >>> record.time_base.steady, record.n_samples, bool(np.allclose(record["v"], 2.0 * record.times))
    (True, 40, True)
    """
    base = record.time_base
    if not base.orderly or base.steady or record.n_samples < 3:
        return record
    cuts = [record.slice(a, b) for a, b in pairwise([0, *base.gaps, record.n_samples]) if b - a > 1]
    pieces = [on_clock(replace(c, sample_time=None, time=c.times), base.period)[0] for c in cuts]
    channels = {n: replace(c, values=np.concatenate([p[n] for p in pieces])) for n, c in record.channels.items()}
    return replace(record, channels=channels, time=np.concatenate([p.times for p in pieces]), sample_time=None)


def mended(findings: Sequence[Finding], rate: float) -> list[Finding]:
    """The findings, of which those that resampling mends are notes that state so.

    Parameters
    ----------
    findings : sequence of Finding
    rate : float
        To which the data are resampled [Hz].

    Returns
    -------
    list of Finding
    """
    return [_mended(f, rate) for f in findings]


def _mended(finding: Finding, rate: float) -> Finding:
    if finding.name in MENDED:
        stated = f"mended: {MENDED[finding.name]} by --sample-rate {rate:.6g}"
        return replace(finding, severity="note", mend=stated)
    wanted = finding.mend.removeprefix("--sample-rate ")
    if finding.name == "oversampled" and rate <= float(wanted) * (1 + SAME_RATE):
        return replace(finding, mend=f"mended by --sample-rate {rate:.6g}")
    return finding
