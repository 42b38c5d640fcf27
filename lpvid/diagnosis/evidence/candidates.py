"""Candidates: first-order prediction of the cost with one effect more, and which effects to refit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from lpvid._projection import projector
from lpvid.baselines.signals import Signals
from lpvid.diagnosis.budgets import CHILDREN, CHILDREN_PER_KIND, REFITTED_STARTS, SCREENED_POINTS, SIMULATED
from lpvid.diagnosis.evidence.laplace import EvaluatedSet
from lpvid.diagnosis.evidence.priors import inclusion_prior
from lpvid.diagnosis.evidence.relations import LAGGING
from lpvid.diagnosis.evidence.visited import VisitedSets
from lpvid.diagnosis.screening import CandidateChange, Direction, candidate_change, directions, start_vector
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from lpvid.rounding import EPS

MOST_DEFICIT = 20.0
"""deficit of log-evidence against the best set, to first order, up to which a set is refitted: a refit may gain more
than the first-order prediction"""
StartPoint = tuple[float, np.ndarray]
"""squared error at a start vector, and the (P,) vector"""


@dataclass(frozen=True, eq=False)
class BaselineScreening:
    """Screening of all effects beside the baseline alone.

    Attributes
    ----------
    changes : sequence of CandidateChange
        Of each effect at each of its grid points.
    lag_starts : mapping of str to sequence of (float, (P,) array)
        By the name of a lag, start points of a fit of the law with it alone, the least squared error first.
    """

    changes: Sequence[CandidateChange] = ()
    lag_starts: Mapping[str, Sequence[StartPoint]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _ScreeningTask:
    """A set, effects outside of it, their grid points, the simulation, and a basis of its sensitivities."""

    base: EvaluatedSet
    outside: Sequence[Effect]
    points: Mapping[str, np.ndarray]
    simulated: Sequence[np.ndarray]
    basis: np.ndarray


def screen_beside_baseline(sets: VisitedSets) -> BaselineScreening:
    """Change of the output by each effect beside the baseline alone, and start points of fits with a lag.

    Parameters
    ----------
    sets : VisitedSets
        The baseline alone among them.

    Returns
    -------
    BaselineScreening
    """
    task = _screening_task(sets, BaselineScreening(), sets.root)
    lags = [(e, v) for e in task.outside if e.path in LAGGING for v in task.points[e.name]]
    calls: list[Callable[[], Any]] = [partial(_lag_starts, sets, *lag) for lag in lags]
    calls += [partial(_changes, task, e) for e in task.outside]
    found = sets.in_parallel(lambda call: call(), calls)
    lag_starts: dict[str, list[StartPoint]] = {}
    for name in dict.fromkeys(e.name for e, _ in lags):
        of_lag = [points for (e, _), points in zip(lags, found, strict=False) if e.name == name]
        best = [sorted([k[n] for k in of_lag if len(k) > n], key=lambda t: t[0])[:REFITTED_STARTS] for n in (0, 1)]
        lag_starts[name] = sorted([t for kind in best for t in kind], key=lambda t: t[0])
    return BaselineScreening([m for changes in found[len(lags):] for m in changes], lag_starts)


def screen_beside_sets(sets: VisitedSets, screening: BaselineScreening, beside: Sequence[EvaluatedSet]
                       ) -> list[list[Direction]]:
    """Change of the output by the effects outside of each of several sets, at their grid points.

    Beside the baseline alone these are the changes of its screening. Beside another set the gain of each effect is
    first predicted from these, with the set's sensitivities projected out. The effects of the largest predicted gain,
    and the partners of the members, are then simulated beside the set.

    Parameters
    ----------
    sets : VisitedSets
    screening : BaselineScreening
    beside : sequence of EvaluatedSet
        Screened together.

    Returns
    -------
    list of list of Direction
        Of each of `beside`.
    """
    tasks = [_screening_task(sets, screening, w) if w.members else None for w in beside]
    items = [(v, e) for v in tasks if v is not None for e in v.outside]
    found = iter(sets.in_parallel(lambda t: directions(sets.problem, t[0].base.fit, _changes(*t), t[0].basis), items))
    return [directions(sets.problem, w.fit, screening.changes) if v is None
            else [d for _ in v.outside for d in next(found)] for w, v in zip(beside, tasks, strict=True)]


def by_predicted_gain(sets: VisitedSets, screening: BaselineScreening, w: EvaluatedSet, found: Sequence[Direction]
                      ) -> dict[Effect, float]:
    """Effects to refit beside a set: those of the largest predicted gain, and the best with and without memory.

    They are ranked without lags by the grid points that are evenly spaced over the range of every effect, and with them
    by all points, so that a lag, or an effect at a further point, displaces no other effect.

    Parameters
    ----------
    sets : VisitedSets
    screening : BaselineScreening
    w : EvaluatedSet
        The set.
    found : sequence of Direction
        Of `screen_beside_sets`.

    Returns
    -------
    dict of Effect to float
        Squared error that each would leave, to first order.
    """
    remaining = {e: lags[0][0] / w.fit.cost for e in sets.candidates if (lags := screening.lag_starts.get(e.name))
                 and not w.members}
    spread = dict(remaining)
    for d in found:
        if d.visible:
            share = min(1.0, 1 - max(d.gain, d.unscaled_gain, 0.0) / w.fit.cost)
            remaining[d.effect] = min(remaining.get(d.effect, 1.0), share)
            even = evenly_spaced(sets.data.grid_points[d.effect.name], SCREENED_POINTS)
            if not w.members or (d.effect.path not in LAGGING and any(np.array_equal(d.values, v) for v in even)):
                spread[d.effect] = min(spread.get(d.effect, 1.0), share)
    chosen = dict.fromkeys([*_chosen(sets, w, spread), *_chosen(sets, w, remaining)])
    return {e: remaining[e] * w.fit.cost for e in chosen}


def _chosen(sets: VisitedSets, w: EvaluatedSet, remaining: Mapping[Effect, float]) -> list[Effect]:
    """The best `CHILDREN` effects by the share of the error that remains, and `CHILDREN_PER_KIND` of each kind."""
    deficit = {e: sets.deficit(max(share, EPS), 1.0) - inclusion_prior(e) for e, share in remaining.items()}
    most = sets.score(w) - sets.score(sets.best) + MOST_DEFICIT
    ranked = sorted((e for e in remaining if deficit[e] < most), key=lambda e: deficit[e])
    chosen = ranked[:CHILDREN]
    for memoryless in (True, False):
        have = sum(e.memoryless is memoryless for e in chosen)
        more = [e for e in ranked[CHILDREN:] if e.memoryless is memoryless]
        chosen = [*chosen, *more[: max(CHILDREN_PER_KIND - have, 0)]]
    return chosen


def evenly_spaced(points: np.ndarray, count: int) -> np.ndarray:
    """Some of the points, evenly spaced by their number.

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


def _screening_task(sets: VisitedSets, screening: BaselineScreening, w: EvaluatedSet) -> _ScreeningTask:
    """A set and the effects outside of it that are simulated beside it."""
    outside = [e for e in sets.candidates if e.name not in w.members and sets.allowed((*w.effects, e))]
    points, basis = sets.data.grid_points, projector(w.fit.free_jacobian)
    if w.members and screening.changes:
        predicted = _predicted(sets, screening, w, outside, basis)
        outside = _to_simulate(screening, w, outside, predicted)
        points = {e.name: points[e.name] if e.path in LAGGING else
                  _fewer_points(points[e.name], predicted.get(e.name)) for e in outside}
    errors = sets.problem.errors(w.fit.composition, w.fit.vector)
    simulated = [s.output - e for s, e in zip(sets.problem.signals, errors, strict=True)]
    return _ScreeningTask(w, outside, points, simulated, basis)


def _predicted(sets: VisitedSets, screening: BaselineScreening, w: EvaluatedSet, outside: Sequence[Effect],
               basis: np.ndarray) -> dict[str, Direction]:
    """Per effect the point of the largest gain beside a set, predicted from its changes beside the baseline alone."""
    names = {e.name for e in outside}
    best: dict[str, Direction] = {}
    for d in directions(sets.problem, w.fit, [m for m in screening.changes if m.effect.name in names], basis):
        if d.visible and (d.effect.name not in best or d.gain > best[d.effect.name].gain):
            best[d.effect.name] = d
    return best


def _to_simulate(screening: BaselineScreening, w: EvaluatedSet, outside: Sequence[Effect],
                 predicted: Mapping[str, Direction]) -> list[Effect]:
    """Effects to simulate beside a set: the partners of its members, then those of the largest gain."""
    linked = {p for e in w.effects for p in e.partners}
    unknown = {e.name for e in outside} - {m.effect.name for m in screening.changes}
    ranked = sorted(outside, key=lambda e: (e.name not in linked | unknown,
                                            -predicted[e.name].gain if e.name in predicted else 0.0))
    return ranked[: SIMULATED + len((linked | unknown) & {e.name for e in outside})]


def _fewer_points(points: np.ndarray, predicted: Direction | None) -> np.ndarray:
    """`SCREENED_POINTS` of the grid points of an effect, and the one of the largest predicted gain besides.

    The time constant of a resonance is sharp: four of fourteen points may all miss it.
    """
    fewer = evenly_spaced(points, SCREENED_POINTS)
    if predicted is None or any(np.array_equal(predicted.values, v) for v in fewer):
        return fewer
    return np.vstack([fewer, predicted.values])


def _changes(task: _ScreeningTask, e: Effect) -> list[CandidateChange]:
    """Change by an effect at each of its grid points at which it can be simulated."""
    tried = (candidate_change(task.base.data.problem, task.base.fit, e, v, task.simulated) for v in task.points[e.name])
    return [m for m in tried if m is not None]


def _lag_starts(sets: VisitedSets, lag: Effect, values: np.ndarray) -> list[StartPoint]:
    """Start points of fits of the law with a lag of these values: at the fitted law, and at starts of its own.

    A law fitted to a motion that is early or late has nearly no force left, beside which a lag has no effect: its
    parameters must be refitted with the lag. The gain of that is predicted to first order. Where the cost is too curved
    for this, a law without memory has start points from the signals as changed by the lag.
    """
    w, problem = sets.root, sets.problem
    composition = Composition(w.fit.composition.baseline, (lag,))
    own = range(composition.own)
    near = start_vector(composition, w.fit, {lag.name: values})
    slopes = problem.weighed(problem.stack([composition.sensitivities(s, near, free=own) for s in problem.signals]))
    found = [(sets.cost_at(composition, near, projector(slopes[:, own])), near)]
    starts = _starts_on_changed_signals(lag, values, w, problem.signals)
    restarted = [np.concatenate([b, near[own.stop:]]) for b in starts]
    if restarted:
        found.append(min(((sets.cost_at(composition, b), b) for b in restarted), key=lambda t: t[0]))
    return found


def _starts_on_changed_signals(e: Effect, values: np.ndarray, w: EvaluatedSet, signals: Sequence[Signals]
                               ) -> list[np.ndarray]:
    """Start vectors of the law of a set from signals as changed by an effect; none where it changes none."""
    baseline, changed = w.fit.composition.baseline, []

    def law(s: Signals) -> np.ndarray:
        changed.append(s)
        return np.zeros(s.n_samples)

    for s in signals:
        e.compose(law, values, baseline)(s)
    return baseline.starts(changed) if any(a is not b for a, b in zip(changed, signals, strict=False)) else []
