"""What a fitted damper remembers of its training data, so that nobody calls them held-out later."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lpvid.familiar import heads
from lpvid.record import Record
from quartercar.dampers.contract import Damper

D = TypeVar("D", bound=Damper)

USUAL = (0.01, 0.99)
"""quantiles between which a current is usual, once it is smoothed by a running median"""
RINGING = 9
"""samples of that median: an anti-alias filter rings at a step of the current for about two samples each way"""


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
        training["usual_currents"] = usual_currents([r["current"] for r in records])
    return damper.replace(metadata={**damper.metadata, "training": training})


def usual_currents(currents: Sequence[np.ndarray]) -> list[float]:
    """Lowest and highest current that a damper is driven at, without the ripple of filters and the rarest samples.

    Examples
    --------
    >>> steps = np.repeat([0.0, 2.0, 0.0, 2.0], 50)
    >>> steps[[49, 50, 99, 100]] += [-0.2, 0.2, 0.2, -0.2]
    >>> usual_currents([steps])
    [0.0, 2.0]
    """
    smooth = [np.median(sliding_window_view(np.pad(c, RINGING // 2, "edge"), RINGING), axis=1) for c in currents]
    return [float(c) for c in np.quantile(np.concatenate(smooth), USUAL)]
