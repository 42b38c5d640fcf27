"""What a fitted damper remembers of its training data, so that nobody calls them held-out later."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from lpvid.familiar import heads
from lpvid.record import Record
from quartercar.dampers.contract import Damper

D = TypeVar("D", bound=Damper)

USUAL = (0.01, 0.99)
"""quantiles between which a current is usual; ripple of a filter at its steps lies beyond them."""


def remembering(damper: D, records: Sequence[Record]) -> D:
    """The damper with names, size, rate, usual currents and first forces of its training records in its metadata.

    Parameters
    ----------
    damper : Damper
    records : sequence of Record
        Uniform, as fitted: cut and resampled, forces as measured.
    """
    training = {"records": [r.name for r in records], "n_samples": sum(r.n_samples for r in records),
                "sample_time": records[0].sample_time, "heads": heads(records, "force")}
    if "current" in damper.reads:
        currents = np.quantile(np.concatenate([r["current"] for r in records]), USUAL)
        training["usual_currents"] = [float(c) for c in currents]
    return damper.replace(metadata={**damper.metadata, "training": training})
