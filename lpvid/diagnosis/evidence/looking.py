"""Looking: what effects outside of a set would change, to first order, which have most gain, and where lags begin."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.evidence.kinship import LAGGING
from lpvid.diagnosis.evidence.priors import inclusion
from lpvid.diagnosis.evidence.visited import RACED, VisitedSets
from lpvid.diagnosis.evidence.weighing import Weighed
from lpvid.diagnosis.problem import projector
from lpvid.diagnosis.screening import Direction, Move, directions, move, placed
from lpvid.diagnosis.signals import Signals

CHILDREN = 6
"""refitted children of a set"""
OF_EACH = 2
"""of the children at least so many without memory and so many with one: each imitates the other at first"""
LOOKED, POINTS = 14, 4
"""effects beside a set that are simulated anew, those of the largest gain by what they changed beside the
baseline alone, and points over which each is looked at, besides that of the largest gain"""
HOPELESS = 20.0
"""log-evidence by which a set may stay behind the best one, to first order, and is refitted all the same: a refit may
find more than first order does"""
Begin = tuple[float, np.ndarray]
"""squared error at a start of a fit, and the (P,) start"""


@dataclass(frozen=True, eq=False)
class FirstLook:
    """What was seen beside the baseline alone.

    Attributes
    ----------
    moved : sequence of Move
        What each effect changed at each of its points.
    following : mapping of str to sequence of (float, (P,) array)
        By the name of a lag, where a fit of the law with it alone may begin and the squared error there, the least
        first.
    """

    moved: Sequence[Move] = ()
    following: Mapping[str, Sequence[Begin]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _SetView:
    """A set, effects outside of it, where each is looked at, the simulation, and what its parameters can yield to."""

    of: Weighed
    outside: Sequence[Effect]
    points: Mapping[str, np.ndarray]
    now: Sequence[np.ndarray]
    basis: np.ndarray


def first_look(sets: VisitedSets) -> FirstLook:
    """What each effect would change beside the baseline alone, and where fits with a lag may begin.

    Parameters
    ----------
    sets : VisitedSets
        The baseline alone among them.

    Returns
    -------
    FirstLook
    """
    view = _view(sets, FirstLook(), sets.root)
    lags = [(e, v) for e in view.outside if e.path in LAGGING for v in view.points[e.name]]
    calls: list[Callable[[], Any]] = [partial(_followed, sets, *lag) for lag in lags]
    calls += [partial(_moves, view, e) for e in view.outside]
    found = sets.each(lambda call: call(), calls)
    following: dict[str, list[Begin]] = {}
    for name in dict.fromkeys(e.name for e, _ in lags):
        of_lag = [kinds for (e, _), kinds in zip(lags, found, strict=False) if e.name == name]
        raced = [sorted([k[n] for k in of_lag if len(k) > n], key=lambda t: t[0])[:RACED] for n in (0, 1)]
        following[name] = sorted([t for kind in raced for t in kind], key=lambda t: t[0])
    return FirstLook([m for moves in found[len(lags):] for m in moves], following)


def look(sets: VisitedSets, first: FirstLook, beside: Sequence[Weighed]) -> list[list[Direction]]:
    """What the effects outside of each of several sets would change, at the points where they are looked at.

    Beside the baseline alone that is what the first look found, of all effects. Beside another set this serves first:
    less the set's sensitivities, it is what each would take away if it acted as it did there. Those of the
    largest gain, and the partners of the members, are simulated anew.

    Parameters
    ----------
    sets : VisitedSets
    first : FirstLook
    beside : sequence of Weighed
        Looked at together.

    Returns
    -------
    list of list of Direction
        Of each of `beside`.
    """
    views = [_view(sets, first, w) if w.members else None for w in beside]
    items = [(v, e) for v in views if v is not None for e in v.outside]
    found = iter(sets.each(lambda t: directions(sets.problem, t[0].of.fit, _moves(*t), t[0].basis), items))
    return [directions(sets.problem, w.fit, first.moved) if v is None else [d for _ in v.outside for d in next(found)]
            for w, v in zip(beside, views, strict=True)]


def by_predicted_gain(sets: VisitedSets, first: FirstLook, w: Weighed, found: Sequence[Direction]
                      ) -> dict[Effect, float]:
    """Effects to refit beside a set: the best by what they would take away, and the best with and without memory.

    Those by the points that are spread over the range of every effect, and those by all points besides: a sharp one
    puts no other aside.

    Parameters
    ----------
    sets : VisitedSets
    first : FirstLook
    w : Weighed
        The set.
    found : sequence of Direction
        Of `look`.

    Returns
    -------
    dict of Effect to float
        Squared error that each would leave, to first order.
    """
    left = {e: lags[0][0] / w.fit.cost for e in sets.candidates if (lags := first.following.get(e.name))
            and not w.members}
    spread = dict(left)
    for d in found:
        if d.visible:
            leaves = min(1.0, 1 - max(d.gain, d.at_face_value, 0.0) / w.fit.cost)
            left[d.effect] = min(left.get(d.effect, 1.0), leaves)
            if not w.members or any(np.array_equal(d.values, v) for v in evenly(sets.data.looked_at[d.effect.name],
                                                                                POINTS)):
                spread[d.effect] = min(spread.get(d.effect, 1.0), leaves)
    return {e: left[e] * w.fit.cost for e in dict.fromkeys([*_chosen(sets, w, spread), *_chosen(sets, w, left)])}


def _chosen(sets: VisitedSets, w: Weighed, left: Mapping[Effect, float]) -> list[Effect]:
    """The best `CHILDREN` effects by the share of the error that each leaves, and `OF_EACH` with and without memory."""
    count = 0.5 * sets.kept * sets.problem.n_samples
    lost = {e: count * np.log(max(left[e], 1e-12)) - inclusion(e) for e in left}
    enough = sets.score(w) - sets.score(sets.best) + HOPELESS
    ranked = sorted((e for e in left if lost[e] < enough), key=lambda e: lost[e])
    chosen = ranked[:CHILDREN]
    for memoryless in (True, False):
        have = sum(e.memoryless is memoryless for e in chosen)
        more = [e for e in ranked[CHILDREN:] if e.memoryless is memoryless]
        chosen = [*chosen, *more[: max(OF_EACH - have, 0)]]
    return chosen


def evenly(points: np.ndarray, count: int) -> np.ndarray:
    """So many of the points, evenly among them.

    Parameters
    ----------
    points : (n, k) array
        In an order.
    count : int

    Returns
    -------
    (m, k) array
        With m at most `count` and n.
    """
    return points[np.unique(np.linspace(0, len(points) - 1, count).round().astype(int))]


def _view(sets: VisitedSets, first: FirstLook, w: Weighed) -> _SetView:
    """A set and the effects outside of it that are worth a look."""
    outside = [e for e in sets.candidates if e.name not in w.members and sets.allowed((*w.effects, e))]
    points, basis = sets.data.looked_at, projector(w.fit.yielding)
    if w.members and first.moved:
        predicted = _predicted(sets, first, w, outside, basis)
        outside = _foremost(first, w, outside, predicted)
        points = {e.name: _few(points[e.name], predicted.get(e.name)) for e in outside}
    errors = sets.problem.errors(w.fit.composition, w.fit.vector)
    now = [s.output - e for s, e in zip(sets.problem.signals, errors, strict=True)]
    return _SetView(w, outside, points, now, basis)


def _predicted(sets: VisitedSets, first: FirstLook, w: Weighed, outside: Sequence[Effect], basis: np.ndarray
              ) -> dict[str, Direction]:
    """Per effect the point of the largest gain beside a set, if it acts there as it did beside the baseline alone."""
    names = {e.name for e in outside}
    best: dict[str, Direction] = {}
    for d in directions(sets.problem, w.fit, [m for m in first.moved if m.effect.name in names], basis):
        if d.visible and (d.effect.name not in best or d.gain > best[d.effect.name].gain):
            best[d.effect.name] = d
    return best


def _foremost(first: FirstLook, w: Weighed, outside: Sequence[Effect], predicted: Mapping[str, Direction]
              ) -> list[Effect]:
    """Effects worth a look beside a set: the partners of its members, then those of the largest gain."""
    linked = {p for e in w.effects for p in e.partners}
    unseen = {e.name for e in outside} - {m.effect.name for m in first.moved}
    ranked = sorted(outside, key=lambda e: (e.name not in linked | unseen,
                                            -predicted[e.name].gain if e.name in predicted else 0.0))
    return ranked[: LOOKED + len((linked | unseen) & {e.name for e in outside})]


def _few(points: np.ndarray, predicted: Direction | None) -> np.ndarray:
    """`POINTS` of the points of an effect, evenly among them, and the one of the largest predicted gain besides.

    The period of a resonance is sharp: four of fourteen points may all miss it.
    """
    few = evenly(points, POINTS)
    if predicted is None or any(np.array_equal(predicted.values, v) for v in few):
        return few
    return np.vstack([few, predicted.values])


def _moves(view: _SetView, e: Effect) -> list[Move]:
    """What an effect would change at each of its points at which it can be simulated."""
    tried = (move(view.of.data.problem, view.of.fit, e, v, view.now) for v in view.points[e.name])
    return [m for m in tried if m is not None]


def _followed(sets: VisitedSets, lag: Effect, values: np.ndarray) -> list[Begin]:
    """Where fits of the law with a lag of these values may begin: near the law as it stands, and from anew.

    A law whose motion is early or late is fitted to next to nothing, beside which no lag shows: its numbers must
    follow. By how much they can is found to first order. Where the cost is too curved for that, a law without memory
    begins anew from the signals as the lag leaves them.
    """
    w, problem = sets.root, sets.problem
    composition = Composition(w.fit.composition.baseline, (lag,))
    own = range(composition.own)
    near = placed(composition, w.fit, {lag.name: values})
    slopes = problem.stack([composition.sensitivities(s, near, free=own) for s in problem.signals])
    found = [(sets.left(composition, near, projector(slopes[:, own])), near)]
    begun = [np.concatenate([b, near[own.stop:]]) for b in _starts_behind(lag, values, w, problem.signals)]
    if begun:
        found.append(min(((sets.left(composition, b), b) for b in begun), key=lambda t: t[0]))
    return found


def _starts_behind(e: Effect, values: np.ndarray, w: Weighed, signals: Sequence[Signals]) -> list[np.ndarray]:
    """Starts of the law of a set from signals as an effect turns them; none where it leaves them alone."""
    baseline, seen = w.fit.composition.baseline, []

    def law(s: Signals) -> np.ndarray:
        seen.append(s)
        return np.zeros(s.n_samples)

    for s in signals:
        e.compose(law, values, baseline)(s)
    return baseline.starts(seen) if any(a is not b for a, b in zip(seen, signals, strict=False)) else []
