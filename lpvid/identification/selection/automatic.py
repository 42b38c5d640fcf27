"""Candidates for data of which only the channels are known."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid import _checks
from lpvid.condition import with_velocity
from lpvid.condition.tables import as_records
from lpvid.identification.arx import ARX
from lpvid.identification.output_error import OutputError
from lpvid.identification.quasi_lpv import QuasiLPV
from lpvid.identification.selection.candidates import Candidates
from lpvid.identification.selection.result import Selection
from lpvid.identification.selection.search import Progress
from lpvid.identification.selection.selecting import select
from lpvid.identification.structure import Structure
from lpvid.record import Record
from lpvid.scheduling import Spline

SEGMENTS = (4, 6)
"""segments of a basis in the velocity, for a damper without a scheduling variable."""

NEARLY_ODD = 900.0
"""samples that a damper's departure from y(−u) = −y(u) must be worth, in the candidates that expect symmetry."""


def auto(records: Record | Sequence[Record], input: str | Sequence[str], output: str | Sequence[str],
         scheduling: str | Sequence[str] = (), *, sample_rate: float | None = None, folds: int = 5,
         held_out: Record | Sequence[Record] | None = None, progress: Progress | None = None) -> Selection:
    """Choose a structure for these channels from candidates that fit their kind.

    A damper (one input in m/s, output in N) gets input stages and, with a scheduling variable, a scheduling filter;
    without one its coefficients may depend on the velocity, or on its own simulated force (`QuasiLPV`). Everything
    else gets the full range of affine terms. The output-error structure of the best orders competes with the grid.

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
    listed = as_records(records)
    candidates = automatic_candidates(listed, input, output, scheduling)
    return select(listed, candidates, sample_rate=sample_rate, folds=folds,
                  then=output_error_of, held_out=held_out, progress=progress)


def output_error_of(arx: ARX) -> list[Structure]:
    """The output-error structure of an ARX's orders."""
    return [OutputError(arx.na, arx.nb, arx.nk, arx.input, arx.output, arx.basis, arx.affine, arx.lagged, arx.stage,
                        arx.schedule_filter)] if arx.na and arx.weight is None else []


def automatic_candidates(records: Sequence[Record], input: str | Sequence[str], output: str | Sequence[str],
                         scheduling: str | Sequence[str] = ()) -> list[Structure]:
    """The candidates that `auto` searches."""
    inputs, outputs = _checks.names(input, "input"), _checks.names(output, "output")
    variables = _checks.names(scheduling, "scheduling") if scheduling else ()
    record = with_velocity(records[0]) if "velocity" in inputs else records[0]
    damper = len(inputs) == len(outputs) == 1 and record.unit(inputs[0]) == "m/s" and record.unit(outputs[0]) == "N"
    if not damper:
        return list(Candidates(inputs, outputs, variables, na=(1, 2, 3, 4, 5, 6), nk=(0, 1, 2), degree=(1, 2)))
    own: list[Structure] = []
    if not variables:
        own = [QuasiLPV(nb=nb, input=inputs, output=outputs, basis=Spline(outputs[0], 10, 1), on="trial", trial=trial,
                        oddness=odd) for nb in (4, 10) for trial in (1, 3) for odd in (0.0, NEARLY_ODD)]
    grid = Candidates(inputs, outputs, variables, na=(1, 2, 3, 4, 5, 6), nk=(0, 1), degree=(1, 2),
                      affine=("none", "one"), stage=(None, "tanh", "three-zone"),
                      schedule_filter=(None, "rise-fall") if variables else (None,),
                      bases=() if variables else tuple(Spline(inputs[0], n, 1) for n in SEGMENTS))
    return [*grid, *own]
