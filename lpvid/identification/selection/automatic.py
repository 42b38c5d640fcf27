"""Candidates for data of which only the channels are known."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid import _checks
from lpvid.condition import with_velocity
from lpvid.identification.selection.candidates import Candidates
from lpvid.identification.selection.result import Selection
from lpvid.identification.selection.search import Progress
from lpvid.identification.selection.selecting import select
from lpvid.record import Record


def auto(records: Record | Sequence[Record], input: str | Sequence[str], output: str | Sequence[str],
         scheduling: str | Sequence[str] = (), *, sample_rate: float | None = None, folds: int = 5,
         held_out: Sequence[Record] | None = None, progress: Progress | None = None) -> Selection:
    """Choose a structure for these channels from candidates that fit their kind.

    A damper (one input in m/s, output in N) gets input stages and, with a scheduling variable, a scheduling filter;
    everything else gets the full range of affine terms and both kinds of coefficients.

    Parameters
    ----------
    records : Record or sequence of Record
        Training data.
    input, output, scheduling : str or sequence of str
        Channel names; no scheduling makes the model time-invariant.
    sample_rate, folds, held_out, progress
        As for `select`.

    Returns
    -------
    Selection
    """
    listed = [records] if isinstance(records, Record) else list(records)
    return select(listed, automatic_candidates(listed, input, output, scheduling), sample_rate=sample_rate, folds=folds,
                  held_out=held_out, progress=progress)


def automatic_candidates(records: Sequence[Record], input: str | Sequence[str], output: str | Sequence[str],
                         scheduling: str | Sequence[str] = ()) -> Candidates:
    """The candidates that `auto` searches."""
    inputs, outputs = _checks.names(input, "input"), _checks.names(output, "output")
    variables = _checks.names(scheduling, "scheduling") if scheduling else ()
    record = with_velocity(records[0]) if "velocity" in inputs else records[0]
    damper = len(inputs) == len(outputs) == 1 and record.unit(inputs[0]) == "m/s" and record.unit(outputs[0]) == "N"
    if not damper:
        return Candidates(inputs, outputs, variables, na=(1, 2, 3, 4, 5, 6), nk=(0, 1, 2), degree=(1, 2))
    return Candidates(inputs, outputs, variables, na=(1, 2, 3, 4, 5, 6), nk=(0, 1), degree=(1, 2),
                      affine=("none", "one"), stage=(None, "tanh", "three-zone"),
                      schedule_filter=(None, "rise-fall") if variables else (None,))
