"""Candidates for data of which only the channels are known."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid import _checks
from lpvid.condition import with_derived
from lpvid.condition.constancy import at_rest
from lpvid.condition.tables import as_records
from lpvid.identification.selection.candidates import Candidates
from lpvid.identification.selection.every_kind import every_kind
from lpvid.identification.selection.result import Selection
from lpvid.identification.selection.rounds import rounds
from lpvid.identification.selection.search import Progress
from lpvid.identification.selection.selecting import select
from lpvid.identification.structure import Structure
from lpvid.record import Record
from lpvid.scheduling import Spline

SEGMENTS = (4, 6)
"""segments of a basis in the velocity, for a damper without a scheduling variable."""


def auto(records: Record | Sequence[Record], input: str | Sequence[str], output: str | Sequence[str],
         scheduling: str | Sequence[str] = (), *, sample_rate: float | None = None, folds: int = 5,
         held_out: Record | Sequence[Record] | None = None, progress: Progress | None = None,
         budget: float | None = None, begun: float | None = None) -> Selection:
    """Choose a structure for these channels from candidates that fit their kind.

    One cheap structure of every kind comes first (`every_kind`); then ARX structures are
    screened. A damper (one input in m/s, output in N) gets input stages and, with a scheduling
    variable, a scheduling filter; without one its coefficients may depend on the velocity, or on its own simulated
    force (`QuasiLPV`). Everything else gets the full range of affine terms. Output error at several orders, subspace,
    prediction-error state space and refined instruments then compete with the best of the grid, and while the best is
    more than half a point below what the noise leaves possible, richer structures do (`rounds`). All are compared by
    their free run on blocks of the training data that they were not fitted to: the held-out data are not used.

    Parameters
    ----------
    records : Record or sequence of Record
        Training data.
    input, output, scheduling : str or sequence of str
        Channel names; no scheduling makes the model time-invariant.
    sample_rate, folds, held_out, progress, budget, begun
        As for `select`.

    Returns
    -------
    Selection
    """
    listed = as_records(records)
    candidates = _automatic_candidates(listed, input, output, scheduling)
    inputs, outputs = _checks.names(input, "input"), _checks.names(output, "output")
    variables = _checks.names(scheduling, "scheduling") if scheduling else ()
    damper = _is_damper(listed, inputs, outputs)
    return select(listed, candidates, sample_rate=sample_rate, folds=folds, held_out=held_out,
                  first=lambda pieces: every_kind(pieces, inputs, outputs, variables, damper),
                  rounds=lambda search: rounds(search, damper, bool(scheduling)), progress=progress, budget=budget,
                  begun=begun)


def _automatic_candidates(records: Sequence[Record], input: str | Sequence[str], output: str | Sequence[str],
                          scheduling: str | Sequence[str] = ()) -> list[Structure]:
    """The candidates that `auto` searches."""
    inputs, outputs = _checks.names(input, "input"), _checks.names(output, "output")
    variables = _checks.names(scheduling, "scheduling") if scheduling else ()
    if not _is_damper(records, inputs, outputs):
        return list(Candidates(inputs, outputs, variables, na=(1, 2, 3, 4, 5, 6), nk=(0, 1, 2), degree=(1, 2)))
    filters = (None,) if not variables or at_rest(records, variables) else (None, "rise-fall")
    return list(Candidates(inputs, outputs, variables, na=(1, 2, 3, 4, 5, 6), nk=(0, 1), degree=(1, 2),
                           affine=("none", "one"), stage=(None, "tanh", "three-zone"),
                           schedule_filter=filters,
                           bases=() if variables else tuple(Spline(inputs[0], n, 1) for n in SEGMENTS)))


def _is_damper(records: Sequence[Record], inputs: Sequence[str], outputs: Sequence[str]) -> bool:
    """Whether the one input is a velocity and the one output a force."""
    record = with_derived(records[:1], inputs)[0]
    return len(inputs) == len(outputs) == 1 and record.unit(inputs[0]) == "m/s" and record.unit(outputs[0]) == "N"
