"""Has a model seen these data? A few samples of every training record travel with the model to tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lpvid.record import Record

SAMPLES = 32
"""samples kept of every training record's output."""
RECORDS = 64
"""most records whose samples are kept."""


def heads(records: Sequence[Record], output: str) -> list[list[float]]:
    """First samples of each record's output, for ``metadata["training"]["heads"]``; still ones say nothing."""
    cuts = (r[output][:SAMPLES] for r in records[:RECORDS])
    return [[float(f"{x:.9g}") for x in cut] for cut in cuts if len(cut) == SAMPLES and np.ptp(cut) > 0]


def familiar(metadata: Mapping, records: Sequence[Record], output: str) -> list[str]:
    """Names of the records that begin with the samples of a training record, turned round or not.

    Parameters
    ----------
    metadata : mapping
        A model's metadata.
    records : sequence of Record
        Uniform records at the model's rate.
    output : str
        The model's first output.
    """
    training = metadata.get("training", {})
    known = [np.asarray(h, dtype=float) for h in training.get("heads", [])] if isinstance(training, Mapping) else []

    def seen(record: Record) -> bool:
        head = record[output][:SAMPLES]
        return any(len(h) == len(head) and min(np.abs(h - head).max(), np.abs(h + head).max()) <= 1e-6 * np.ptp(h)
                   for h in known)

    return [r.name for r in records if seen(r)]
