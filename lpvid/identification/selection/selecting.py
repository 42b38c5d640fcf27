"""The verb `select`: records and candidates in, a ranked `Selection` out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.condition import segments, with_derived
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.identification import Identification, identify
from lpvid.identification.arx import ARX, require_motion_of
from lpvid.identification.selection.competing import NEAR, compete
from lpvid.identification.selection.free_run import make_folds, unstable_share
from lpvid.identification.selection.hasty import in_full
from lpvid.identification.selection.result import Selection
from lpvid.identification.selection.rounds import Round
from lpvid.identification.selection.search import Progress, StructureSearch
from lpvid.identification.selection.starting import fit_from_measured_samples
from lpvid.identification.structure import Structure
from lpvid.record import Record

SAMPLES = 60_000
"""samples on which candidates are compared; the final fit uses all."""
PLACES = 14
"""candidates on the short list for cross-validation."""


def select(records: Record | Sequence[Record], candidates: Iterable[Structure], *, sample_rate: float | None = None,
           folds: int = 5, outside: float = 0.0, then: Callable[[ARX], Iterable[Structure]] | None = None,
           rounds: Callable[[StructureSearch], Iterable[Round]] | None = None,
           first: Callable[[Sequence[Record]], Iterable[Structure]] | None = None,
           held_out: Record | Sequence[Record] | None = None, progress: Progress | None = None,
           budget: float | None = None, begun: float | None = None) -> Selection:
    """Choose a structure by what it does in free run on training data it was not fitted to.

    ARX candidates are screened by BIC and AICc from nested QR factors, on the same equations. Those on a short list
    (both criteria, and every trait at least once where it may be) whose frozen poles stay inside the unit circle along
    the training trajectory go to blocked cross-validation in free run, then the neighbours of the best. Of those within
    one standard error, the ones whose frozen poles lie outside in the smallest part of the range remain; of these the
    simplest wins, unless AIC on all training data is against it (`choosing`). One that runs worse
    there than the mean of the output is taken only if all do. Other structures go to cross-validation directly. Stages
    requested by name are fitted once for every basis and held while orders are compared; the choice is refitted with
    them.

    Parameters
    ----------
    records : Record or sequence of Record
        Training data.
    candidates : iterable of Structure
        E.g. a `Candidates` grid.
    sample_rate : float, optional
        As for `identify`.
    folds : int
        Blocks of the cross-validation. One fold more holds out as large a share of the data, the stretches that go
        furthest, where the records are long enough for it (`excursions`).
    outside : float
        Largest share of training samples at which a frozen pole may lie outside the unit circle.
    then : callable, optional
        Further structures to try, given the ARX of least free-run error with its basis bound and its stages fitted,
        e.g. the output-error structure of the same orders.
    rounds : callable, optional
        Further structures round by round, given the search with all its trials. Rounds that are marked as further are
        entered only while the fit is more than half a point below what the noise leaves possible.
    first : callable, optional
        Structures to cross-validate before all others, given the records; the first of them whatever the budget.
    held_out : Record or sequence of Record, optional
        Data that are not used in the choice; the final model's figures on them are reported.
    progress : callable, optional
        Called with steps done, steps in sight, and what is being done.
    budget : float, optional
        Processor time [s] of the search and of the refit of its choice: no further fit is begun once what is left of it
        is what the refit of the best takes. The first fit that can be taken always stays. The order of the search does
        not depend on it, nor on what else the machine does; `Selection.left_out` names what it did not allow.
    begun : float, optional
        Processor time of the process from which the budget counts [s], where work before the call belongs to it.

    Returns
    -------
    Selection
        With ``complete=False`` and what there is after a KeyboardInterrupt.

    Raises
    ------
    InputError
        No candidates, or none that these data can carry; a constant input or output.
    """
    listed = as_records(records)
    _checks.instance(candidates, Iterable, "a selection is among several structures", "[ARX(...), ARX(...)]")
    structures = list(dict.fromkeys(candidates))
    if not listed or not structures:
        raise InputError("nothing to select from", got=f"{len(listed)} records and {len(structures)} candidates")
    _checks.count(folds, "folds", at_least=2)
    if budget is not None:
        _checks.positive(budget, "the budget of a search", "s")
    if len({s.output for s in structures if isinstance(s, ARX)}) > 1:
        raise InputError("candidates must share their outputs to be compared")
    channels = tuple(dict.fromkeys(c for s in structures for c in s.channels))
    listed = with_derived(listed, channels)
    start = max(s.start for s in structures)
    pieces = segments(listed, channels, sample_rate=sample_rate, minimum=start + 2, remedy="lower orders")
    _require_motion(pieces, structures)
    sample = _shortened(pieces, start)
    with single_thread():
        parts, notes = make_folds(sample, folds, start, _driving(structures))
        if len(sample) < len(pieces) or sample[0].n_samples < pieces[0].n_samples:
            notes.append(f"candidates compared on {sum(r.n_samples for r in sample)} of "
                         f"{sum(r.n_samples for r in pieces)} samples; the final fit uses all")
        search = StructureSearch(sample, parts, outside, PLACES, progress, budget, begun)
        complete = True
        try:
            if first is not None:
                search.try_first(first(sample))
            search.screen(structures)
            search.cross_validate()
            leader = search.leader()
            if then is not None and leader is not None:
                search.try_others(then(leader))
            if rounds is not None:
                notes += compete(search, rounds(search), pieces)
            refits = _settled(search, pieces)
        except KeyboardInterrupt:
            if not search.screened and not search.others:
                raise
            complete, refits = False, {}
        return _concluded(search, pieces, held_out, folds, complete, notes, refits)


Refits = dict[Structure, tuple[Identification, str]]


def _settled(search: StructureSearch, pieces: Sequence[Record]) -> Refits:
    """Refits on all data of those that were ever the best, down to the first that can be taken.

    One that cannot has ended the trials of others before their last fold, which continue then.
    """
    refits: Refits = {}
    while (best := search.best) is not None and best[0] not in refits:
        refits[best[0]] = found = _refit(search, in_full(best[0]), pieces)
        if found[1]:
            search.barred.add(best[0])
            search.resume()
    return refits


def _concluded(
    search: StructureSearch,
    pieces: Sequence[Record],
    held_out: Record | Sequence[Record] | None,
    folds: int,
    complete: bool,
    notes: list[str],
    refits: Refits,
) -> Selection:
    """The first in the ranking whose refit on all data keeps its poles inside and does not diverge.

    Reported figures begin at measured samples. A structure that amplifies their noise, and so runs worse from them on
    all training data than in cross-validation, counts with the worse of the two, and of its start's average over as
    many places as there are folds (`starting`): one that does better by more than `NEAR` takes its place.
    """
    ranked = search.ranked()
    table = [row for _, row in ranked]
    tested = [i for i, row in enumerate(table) if row.esr is not None]
    if not tested and complete:
        reasons = list(dict.fromkeys(row.reason for row in table))
        inside = (table[0].outside or 0.0) <= search.limit
        mend = "try other" if inside else "allow a share outside with outside=…, or try other"
        raise InputError(f"none of {len(table)} candidates survives", got="; ".join(reasons[:2]),
                         mend=f"{mend} orders, bases or longer records")
    left_out = _left_out(search)
    if left_out:
        notes.append(f"the search ended at its budget of {search.budget:.4g} s of processor time and left out "
                     f"{'; '.join(left_out)}: a longer one may find better")
    if tested and all(table[i].diverges for i in tested):
        notes.append("every candidate that was cross-validated runs worse than the mean of the output (the best has a "
                     f"free-run fit of {max(table[i].fit_percent or 0.0 for i in tested):.3g} %): the choice is the "
                     "least bad of them and no model of these data")
    final: Identification | None = None
    chosen, highest = tested[0] if tested else 0, -np.inf
    try:
        for i in [i for i in tested if not table[i].diverges] or tested:
            own, first_of_all = table[i].fit_percent, table[tested[0]].fit_percent
            assert own is not None and first_of_all is not None
            expected = min(own, first_of_all)  # a lead of the folds over the ranking's first has been counted there
            if expected < highest + NEAR:
                break
            if final is not None and search.late() and ranked[i][0] not in refits:
                continue  # what the search took for the best has been refitted: no time is needed to weigh it
            found, fault = refits.get(ranked[i][0]) or _refit(search, in_full(ranked[i][0]), pieces)
            if fault:
                table[i] = replace(table[i], reason=f"refitted on all training data: {fault}")
                continue
            fit = min(expected, -np.inf if found.fit is None else found.fit)
            if fit > highest:
                fit = min(fit, fit_from_measured_samples(found.model, pieces, folds))
            if fit < expected - NEAR:
                table[i] = replace(table[i], reason=f"{table[i].reason}; from measured samples its free-run fit on "
                                                    f"training data is {fit:.1f} %")
            if fit > highest:
                final, chosen, highest = found, i, fit
        if final is None and tested:
            notes.append("no refit on all training data keeps its frozen poles inside: the first choice stands")
            final = identify(pieces, ranked[chosen][0])
    except KeyboardInterrupt:
        complete = False
    if tested and chosen != tested[0]:
        first, best = tested[0], table[chosen]
        table[first] = replace(table[first], reason=table[first].reason.replace("chosen", "first by that"))
        table[chosen] = replace(best, reason=f"chosen: least free-run error from measured samples too; {best.reason}")
    if final is not None and held_out is not None:
        final = _with_held_out(final, held_out)
    table.insert(0, table.pop(chosen))
    table[0] = replace(table[0], structure=in_full(table[0].structure))
    return Selection(table[0].structure, tuple(table), final, complete, folds, tuple(notes), left_out)


def _left_out(search: StructureSearch) -> tuple[str, ...]:
    """What the budget did not allow, in the order in which it would have been tried."""
    first = [(search.unfinished(search.first), f"of {len(search.first)} kinds that come first"),
             (search.unscreened, "ARX not screened"), (len(search.unreached), "ARX of the short list"),
             (search.unfinished(search.direct), "other candidates")]
    return (*(f"{count} {name}" for count, name in first if count), *dict.fromkeys(search.left_out))


def _refit(search: StructureSearch, structure: Structure, pieces: Sequence[Record]) -> tuple[Identification, str]:
    """The estimate on all training data, and what is wrong with it; fitted stages are kept where a refit fails."""
    found = identify(pieces, structure)
    fault = _fault(search, found, pieces)
    held = [s.structure for s in search.screened if s.asked is structure and s.structure != structure]
    if held and isinstance(structure, ARX) and not structure.ridge:
        other = identify(pieces, held[0])
        other_fault = _fault(search, other, pieces)
        if not other_fault and (fault or (other.fit or 0.0) > (found.fit or 0.0)):
            return other, ""
    return found, fault


def _fault(search: StructureSearch, found: Identification, pieces: Sequence[Record]) -> str:
    share = unstable_share(found.model, pieces)
    if share > search.limit:
        return f"frozen pole outside at {100 * share:.2g} % of training samples"
    return "diverges in free run" if found.fit is None else ""


def _with_held_out(found: Identification, held_out: Record | Sequence[Record]) -> Identification:
    from lpvid.identification.separation import independence_remarked
    from lpvid.validation import validate

    checked = found.replace(held_out=validate(found.model, held_out, label="held-out"))
    return independence_remarked(checked, held_out)


def _driving(structures: Sequence[Structure]) -> tuple[str, ...]:
    """Inputs and measured scheduling variables; of what is not an ARX, its first channel, an input."""
    found = [(*s.input, *s.basis.names) if isinstance(s, ARX) else s.channels[:1] for s in structures]
    return tuple(dict.fromkeys(name for names in found for name in names))


def _require_motion(pieces: Sequence[Record], structures: Sequence[Structure]) -> None:
    """Refuse, before the search, a constant output, or input of all candidates: none can be fitted."""
    plain = [s for s in structures if isinstance(s, ARX)]
    if len(plain) < len(structures):
        return
    for what, shared in (("input", [set(s.input) for s in plain]), ("output", [set(s.output) for s in plain])):
        for name in sorted(set.intersection(*shared)):
            require_motion_of(pieces, name, what)


def _shortened(pieces: Sequence[Record], start: int) -> list[Record]:
    from lpvid.identification.stage_fit import shorten

    return shorten(pieces, SAMPLES, 20 * (start + 5))
