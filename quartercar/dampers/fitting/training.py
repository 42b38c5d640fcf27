"""What a fitted damper remembers of its training data, so that they are never reported as held-out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from lpvid.record import Record
from lpvid.training_fingerprint import heads, ranges, roles, usual_range
from quartercar.dampers.contract import Damper

D = TypeVar("D", bound=Damper)


def remembering(damper: D, records: Sequence[Record]) -> D:
    """The damper with names, size, rate, ranges, roles and first forces of its training records in its metadata.

    Parameters
    ----------
    damper : Damper
    records : sequence of Record
        Uniform, as fitted: cut and resampled, forces as measured.
    """
    training = {"records": [r.name for r in records], "n_samples": sum(r.n_samples for r in records),
                "sample_time": records[0].sample_time, "heads": heads(records, "force")}
    seen = [n for n in (*dict.fromkeys(("velocity", *damper.reads)), "force") if all(r.has(n) for r in records)]
    training["ranges"] = ranges(records, seen)
    if "current" in damper.reads:
        training["usual_currents"] = usual_range([r["current"] for r in records])
    return damper.replace(metadata={**damper.metadata, "training": training, "roles": roles(records[0], seen)})
