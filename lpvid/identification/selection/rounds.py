"""Structures that compete with the screened ARX, round after round, each built on those before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.identification.arx import ARX
from lpvid.identification.output_error import OutputError
from lpvid.identification.quasi_lpv import QuasiLPV
from lpvid.identification.refined_iv import RefinedIV
from lpvid.identification.selection.hasty import hasty, in_full
from lpvid.identification.selection.search import StructureSearch
from lpvid.identification.state_space_error import StateSpaceError
from lpvid.identification.structure import Structure
from lpvid.identification.subspace import Subspace
from lpvid.scheduling import Polynomial, Spline

LOW_ORDERS = (1, 2, 3, 4)
"""orders at which the output error starts beside those of the best ARX: least squares needs more lags than the system
has poles wherever the noise is on the output, so that its best order gives little information on the output error's."""
MOST_LAGS = 10
"""highest order tried."""
STEPS = ((0, 0, 1), (0, 0, -1), (-1, -1, 0), (1, 1, 0), (0, -1, 0), (0, 1, 0), (-1, 0, 0), (1, 0, 0))
"""changes of output lags, input lags and first input lag that lead to a neighbour."""
SEGMENTS = 10
"""hat functions of the output, for a quasi-LPV structure."""
NEARLY_ODD = 900.0
"""samples that a damper's departure from y(−u) = −y(u) must be worth, in the candidates that expect symmetry."""
IN_FULL = 2
"""output errors that are compared again after the whole search."""
STATES_TRIED = 2
"""orders of the best output errors at which a state space is estimated."""
INPUT_LAGS = (4, 10)
"""input lags of a quasi-LPV structure without output lags, whose memory they are."""
TRIALS = (1, 3)
"""lags in its trial variable."""


@dataclass(frozen=True)
class Round:
    """Structures to be tried together.

    Attributes
    ----------
    name : str
    structures : tuple of Structure
    further : bool
        Whether they are only worth trying while the fit is far below what the noise leaves possible.
    """

    name: str
    structures: tuple[Structure, ...]
    further: bool = False


def rounds(search: StructureSearch, damper: bool, scheduled: bool) -> Iterator[Round]:
    """What to try after the screening, cheap before dear.

    Parameters
    ----------
    search : StructureSearch
        Its trials are read anew before every round.
    damper : bool
        Whether the one input is a velocity and the one output a force.
    scheduled : bool
        Whether there are measured scheduling variables.

    Yields
    ------
    Round
        None at all where nothing has been tried with success.
    """
    leader = search.asked_leader()
    if leader is None:
        return
    yield Round("output error at several orders", _first(leader))
    yield Round("state space by subspace", _subspaces(leader))
    if damper and not scheduled:
        yield Round("scheduled on its own output", _own_force(leader))
    yield Round("output error of other bases and stages", _others(search, leader))
    yield Round("refined instruments", _instruments(search))
    yield Round("more orders and terms", _richer(search), True)
    yield Round("scheduled on its own output", _own_output(leader, damper, scheduled), True)
    yield Round("around the best", _around(search.simplest(OutputError)))
    yield Round("around the least error", _around(next((s for s, _ in search.ranked_among(OutputError)), None)))
    leading = [s for s, _ in search.ranked_among(OutputError)[:IN_FULL]]
    yield Round("the best output errors in full", tuple(in_full(s) for s in leading))
    # the dearest: two of them take 186 of the 275 s of a search of the measured gyroscope
    yield Round("state space by prediction error", _state_spaces(search))
    yield Round("state space by prediction error at other orders", _more_states(search), True)


def output_error(arx: ARX) -> OutputError:
    """The output-error structure of an ARX's orders, searched where it may be taken: with its frozen poles inside.

    Parameters
    ----------
    arx : ARX
        Gives orders, channels, basis and stages.

    Returns
    -------
    OutputError
    """
    return OutputError(arx.na, arx.nb, arx.nk, arx.input, arx.output, arx.basis, arx.affine, arx.lagged, arx.stage,
                       arx.schedule_filter, frozen_poles="inside")


def _of_order(arx: ARX, order: int) -> ARX:
    """As many output lags and input lags, the affine terms in kind."""
    nb = tuple(max(order + 1 - k, 1) if k < 2 else order for k in arx.delay)
    return replace(arx, na=order, nb=nb, affine=arx.affine if arx.affine < 2 else order + 1)


def _first(leader: ARX) -> tuple[Structure, ...]:
    """The leader's orders, and low ones."""
    orders = [leader] if leader.na else []
    orders += [_of_order(leader, n) for n in LOW_ORDERS]
    return tuple(dict.fromkeys(hasty(output_error(s)) for s in orders))


def _around(best: Structure | None) -> tuple[Structure, ...]:
    """Output-error structures that differ from this one by one lag, in one place.

    Near the ceiling too: there the least error may be a tie of many orders, which the range of the scheduling
    separates (`simplest_supported`), and only what was tried can be chosen.
    """
    if not isinstance(best, OutputError):
        return ()
    nb, nk = best.arx.width, best.arx.delay
    near = [(best.na + i, tuple(b + j for b in nb), tuple(k + d for k in nk)) for i, j, d in STEPS]
    all_terms = best.affine == best.na + 1 and best.affine > 1
    return tuple(replace(best, na=a, nb=b, nk=k, affine=a + 1 if all_terms else best.affine) for a, b, k in near
                 if 1 <= a <= MOST_LAGS and min(b) >= 1 and min(k) >= 0)


def _subspaces(leader: ARX) -> tuple[Structure, ...]:
    """A subspace estimate that finds its order by itself."""
    if leader.basis.lags != (0, 0) or _staged(leader):
        return ()
    return (Subspace(input=leader.input, output=leader.output, basis=leader.basis, direct=0 in leader.delay,
                     affine=leader.affine > 0),)


def _others(search: StructureSearch, leader: ARX) -> tuple[Structure, ...]:
    """The best output error's orders with every other basis, input stage and filter of the candidates.

    Least squares of one step favours a basis that follows its noise, so that the kind of nonlinearity it prefers need
    not be that which runs freely best.
    """
    best = search.simplest(OutputError)
    if not isinstance(best, OutputError):
        return ()
    kinds: dict[tuple, ARX] = {}
    for found in search.screened:  # least BIC first
        kinds.setdefault((found.structure.basis, found.asked.stage, found.asked.schedule_filter), found.structure)
    kinds.pop((leader.basis, leader.stage, leader.schedule_filter), None)
    cheap = sorted(kinds, key=lambda kind: kind[0].size)
    return tuple(replace(best, basis=basis, stage=stage, schedule_filter=lag, lagged=kinds[basis, stage, lag].lagged)
                 for basis, stage, lag in cheap)


def _instruments(search: StructureSearch) -> tuple[Structure, ...]:
    """At the orders of the best output error, or the highest of the low ones, with stages as screened.

    A search with instruments takes many times longer at high orders.
    """
    best = search.simplest(OutputError)
    if not isinstance(best, OutputError):
        return ()
    arx = search.begin_of(best) or best.arx
    if arx.na > max(LOW_ORDERS):
        arx = _of_order(arx, max(LOW_ORDERS))
    shared = {n: getattr(arx, n) for n in ("na", "nb", "nk", "input", "output", "basis", "affine", "lagged", "stage",
                                           "schedule_filter")}
    return (RefinedIV(**shared, noise="output"),)


def _state_spaces(search: StructureSearch) -> tuple[Structure, ...]:
    """At the orders of the best output errors, with the basis of the best of them that has no stage.

    A state space has no stages. A basis in the input itself is left to output error: with six segments a state space
    of order six has 385 parameters, and its search took 300 s on the measured race damper.
    """
    ranked = [s for s, _ in search.ranked_among(OutputError) if isinstance(s, OutputError)]
    plain = next((s for s in ranked if not _staged(s.arx) and s.basis.lags == (0, 0)
                  and not set(s.basis.names) & set(_checks.names(s.input, "input"))), None)
    if plain is None:
        return ()
    orders = list(dict.fromkeys(s.na for s in ranked if s.na <= _most_states(plain)))
    return tuple(_states(plain, n) for n in orders[:STATES_TRIED])


def _most_states(structure: OutputError | StateSpaceError) -> int:
    """States that a subspace estimate, where the search begins, can resolve at its default future."""
    return Subspace.future * len(structure.output) * structure.basis.size


def _states(best: OutputError, order: int) -> StateSpaceError:
    return StateSpaceError(order=order, input=best.input, output=best.output, basis=best.basis,
                           direct=0 in best.arx.delay, affine=best.affine > 0)


def _more_states(search: StructureSearch) -> tuple[Structure, ...]:
    """One state less and more than the best prediction-error estimate has."""
    best = search.simplest(StateSpaceError)
    if not isinstance(best, StateSpaceError) or best.order is None:
        return ()
    return tuple(replace(best, order=n) for n in (best.order - 1, best.order + 1, best.order + 2)
                 if 1 <= n <= _most_states(best))


def _richer(search: StructureSearch) -> tuple[Structure, ...]:
    """More lags, affine terms of the other kind, lagged or not, a richer basis."""
    best = search.simplest(OutputError)
    if not isinstance(best, OutputError):
        return ()
    orders = [n for n in (best.na + 2, best.na + 4) if n <= MOST_LAGS]
    out: list[Structure] = [hasty(output_error(_of_order(best.arx, n))) for n in orders]
    if best.basis.names:
        out.append(replace(best, lagged=not best.lagged))
        out += [replace(best, affine=n) for n in (0, 1, best.na + 1) if n != best.affine]
        names = best.basis.names
        out += [replace(best, basis=Polynomial(names, degree=d)) for d in (2, 3)]
    return tuple(out)


def _own_force(leader: ARX) -> tuple[Structure, ...]:
    """A damper without a measured scheduling variable: scheduled on its own force."""
    name = leader.output[0]
    return tuple(QuasiLPV(nb=nb, input=leader.input, output=leader.output, basis=Spline(name, SEGMENTS, 1), on="trial",
                          trial=trial, oddness=odd)
                 for nb in INPUT_LAGS for trial in TRIALS for odd in (0.0, NEARLY_ODD))


def _own_output(leader: ARX, damper: bool, scheduled: bool) -> tuple[Structure, ...]:
    """Structures scheduled on their own output beside the measured variables, where there is one output."""
    if len(leader.output) > 1 or leader.basis.lags != (0, 0):
        return ()
    name = _checks.names(leader.output, "output")[0]
    external = Polynomial(leader.basis.names, degree=1) if scheduled else Polynomial()
    out: list[Structure] = []
    if damper and scheduled:
        named = leader.schedule_filter
        out += [QuasiLPV(nb=nb, input=leader.input, output=leader.output, basis=Spline(name, 6, 1), on="trial",
                         external=external, schedule_filter=named) for nb in INPUT_LAGS]
    if not damper:
        for order in (2, 3, 4):
            try:
                out.append(QuasiLPV(na=order, nb=order, nk=leader.delay, input=leader.input, output=leader.output,
                                    basis=Polynomial((name,), degree=2), on="output", external=external))
            except InputError:
                continue
    return tuple(out)


def _staged(leader: ARX) -> bool:
    return leader.stage is not None or leader.schedule_filter is not None
