"""Channels that move in records and that a baseline does not read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.record import Record
from lpvid.rounding import EPS


def unread_current(baseline: Baseline, records: Sequence[Record]) -> list[str]:
    """Advice where a current moves in the records and the baseline does not read it.

    It moves where the mean square of its steps is less than half of that of noise of its variance (von Neumann 1941).

    Parameters
    ----------
    baseline : Baseline
    records : sequence of Record

    Returns
    -------
    list of str
        At most one sentence.
    """
    if "current" in baseline.channels or not all(r.has("current") for r in records):
        return []
    currents = [r["current"] for r in records]
    pooled = np.concatenate(currents)
    steps = float(np.mean(np.concatenate([np.diff(c) for c in currents]) ** 2))
    if not steps / 2 < 0.5 * float(pooled.var()) > EPS * float(np.mean(pooled**2)):
        return []
    return [f"the current moves between {pooled.min():.3g} and {pooled.max():.3g} and {baseline.name} does not read "
            "it: its influence counts as error here, or as a cause. --baseline auto selects a law that reads it"]
