"""Choose the first input lag by what it does to the free run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lpvid.condition import segments, with_derived
from lpvid.condition.tables import as_records
from lpvid.identification.arx import ARX
from lpvid.record import Record


def choose_delay(records: Record | Sequence[Record], structure: ARX, *, candidates: Sequence[int] = (0, 1, 2),
                 sample_rate: float | None = None) -> tuple[ARX, str]:
    """The structure with the delay nk whose model has the least free-run error on the training data.

    A sampled damper passes velocity to force within one sample; whether the first lag is 0 or 1 depends on the rate
    and on how velocity was derived, and a wrong choice can cost a factor of five in the free run.

    Parameters
    ----------
    records : Record or sequence of Record
        Training data.
    structure : ARX
        Its nk is ignored.
    candidates : sequence of int
        Delays to try, the same for all inputs. Of ties within 2 % the smallest from 1 on is taken: a model of order
        max(na, nb + nk − 1) has a state more for every further lag, and without a direct term (nk = 0) no controller
        closes an algebraic loop around it.
    sample_rate : float, optional
        As for `identify`.

    Returns
    -------
    structure : ARX
    note : str
        What was tried, with the training free-run errors.
    """
    from lpvid.identification import identify

    listed = as_records(records)
    listed = with_derived(listed, structure.channels)
    start = replace(structure, nk=max(candidates)).start
    pieces = segments(listed, structure.channels, sample_rate=sample_rate, minimum=start + 2,
                      remedy="a lower order")
    tried: list[tuple[float, ARX]] = []
    for delay in sorted(candidates):
        candidate = replace(structure, nk=delay)
        found = identify(pieces, candidate)
        assert found.training is not None
        esr = found.training.overall.free_run.esr
        tried.append((float("inf") if esr is None else esr, candidate))
    least = min(cost for cost, _ in tried)
    tied = [candidate for cost, candidate in tried if cost <= 1.02 * least]
    chosen = min(tied, key=lambda candidate: (candidate.delay[0] == 0, candidate.delay[0]))
    listing = ", ".join(f"nk={c.delay[0]} {'diverges' if e == float('inf') else f'{e:.4g}'}" for e, c in tried)
    best = min(tried, key=lambda t: t[0])[1]
    tie = "" if best is chosen else ", the least delay from 1 on within 2 % of the least error"
    return chosen, f"delay chosen by training free-run ESR: {listing}; took nk={chosen.delay[0]}{tie}"
