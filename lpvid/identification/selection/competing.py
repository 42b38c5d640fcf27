"""Rounds of structures against the best so far, as far as the noise leaves something to gain."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from lpvid.errors import InputError
from lpvid.identification.selection.ceiling import Ceiling, noise_ceiling
from lpvid.identification.selection.rounds import Round
from lpvid.identification.selection.search import StructureSearch, fit_percent
from lpvid.record import Record

NEAR = 0.5
"""points of fit [%] below the noise ceiling within which a choice counts as having reached it: about what the ceiling
itself is uncertain by where its truth is known (tests/lpvid/identification/test_selection.py)."""


def compete(search: StructureSearch, rounds: Iterable[Round], records: Sequence[Record]) -> list[str]:
    """Try the rounds in turn; those marked as further only while the best is far below the ceiling.

    Parameters
    ----------
    search : StructureSearch
    rounds : iterable of Round
        Requested one at a time, so that each may build on the trials before it.
    records : sequence of Record
        All training data, for the ceiling.

    Returns
    -------
    list of str
        How far the search went and why it ended.
    """
    search.report_progress("estimating the noise")
    ceiling, tried = _ceiling(search, records), []
    for entry in rounds:
        if (entry.further and not _far_below(search, ceiling)) or not entry.structures:
            continue
        if search.late():
            search.left_out.append(entry.name)
            continue
        search.try_others(entry.structures)
        tried.append(entry)
        unfinished = search.unfinished(entry.structures)
        if unfinished:
            search.left_out.append(f"{entry.name}: {unfinished} of {len(entry.structures)}")
        search.report_progress(f"round '{entry.name}' done after {search.seconds:.0f} s", line=True)
    return _conclusion(search, ceiling, any(entry.further for entry in tried))


def _far_below(search: StructureSearch, ceiling: Ceiling | None) -> bool:
    """Whether there may be something to gain: below the ceiling by more than `NEAR`, or no ceiling known."""
    best = search.best
    return best is not None and (ceiling is None or fit_percent(best[1]) < ceiling.fit_percent - NEAR)


def _ceiling(search: StructureSearch, records: Sequence[Record]) -> Ceiling | None:
    leader = search.leader()
    try:
        return None if leader is None else noise_ceiling(records, leader)
    except InputError:
        return None


def _conclusion(search: StructureSearch, ceiling: Ceiling | None, looked: bool) -> list[str]:
    best = search.best
    if best is None or ceiling is None or not _far_below(search, ceiling):
        return []
    gap = ceiling.fit_percent - fit_percent(best[1])
    more = "richer structures were tried too" if looked else "the time did not allow richer structures"
    return [f"the best stays {gap:.1f} points below what the noise leaves possible on training data "
            f"({fit_percent(best[1]):.1f} % in cross-validation against about {ceiling.fit_percent:.1f} %); {more}: "
            "none of them has the missing part, or the inputs and scheduling named do not contain it"]
