"""Thinning: records on a slower clock for a search, where nothing of the output lies beyond its band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.evidence.discrepancy import USUAL
from lpvid.diagnosis.signals import Signals, jumps
from lpvid.record import Record

ENOUGH = 5000
"""samples for a search: its time is in proportion, about half a minute for so many"""
BAND = 0.8
"""share of half the sample rate that an anti-alias filter leaves"""


def thinned(records: Sequence[Record], baseline: Baseline) -> tuple[list[Record], int]:
    """Records decimated by a whole number, and it: 1 where they are short, or move or jump too fast for less."""
    from lpvid.condition import segments

    signals = [baseline.signals(r) for r in records]
    total = sum(s.n_samples for s in signals)
    factor = -(-total // ENOUGH)
    roles = list(records[0].channels)
    while factor > 1:
        if all(_quiet(s, factor) for s in signals):
            slow = [p for r in records for p in segments([r], roles, sample_rate=1 / (factor * signals[0].sample_time),
                                                         minimum=2)]
            if len(slow) == len(records):
                return slow, factor
        factor -= 1
    return list(records), 1


def _quiet(s: Signals, factor: int) -> bool:
    """Whether less of the output than a good law's misfit lies beyond the band that is left, and no input jumps."""
    if any(jumps(c) for c in s.channels.values()):
        return False
    power = np.abs(np.fft.rfft((s.output - s.output.mean()) * np.hanning(s.n_samples))) ** 2
    kept = int(BAND * power.size / factor)
    return bool(power[kept:].sum() < (2 * USUAL) ** 2 * power.sum())
