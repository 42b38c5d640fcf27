"""Weighed sets: the visited sets that are confirmed, their weights, and the one to report."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from lpvid.diagnosis.evidence.laplace import EvaluatedSet, Members, WeighedSets
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.diagnosis.evidence.visited import posterior


def confirmed_sets(search: SetSearch, rejected_sets: Collection[Members], smaller: Mapping[Members, Members]
                   ) -> WeighedSets:
    """Visited sets and their weights, without the rejected ones; the baseline alone where no other is left.

    Where some members of a set do not lower the error out of fold, its weight goes to the most probable visited set
    within what is left: to drop it would lower the weight of its other members too. So does that of a rejected set. A
    component counts as the same wherever it sits, also in a rejected set: friction behind a spring is friction without
    it. A flexible form is no component. Where no visited set with a cause is left the weight is dropped: that the set
    fails is no evidence for the baseline alone.

    Parameters
    ----------
    search : SetSearch
    rejected_sets : collection of frozenset of str
        Sets with no lower error on further records than the baseline.
    smaller : mapping of frozenset of str to frozenset of str
        Sets of which some members do not lower the error out of fold, and the sets without these.

    Returns
    -------
    sequence of (EvaluatedSet, float)
    """
    visited = {w.members: w for w, _ in posterior(search)}  # the most probable first
    weights = {members: 0.0 for members in visited if members not in smaller and members not in rejected_sets}
    for w, p in posterior(search):
        members = w.members
        while members in smaller:
            members = smaller[members]
        within = (m for m in weights if m and _parts(visited[m], m) <= _parts(w, members))
        if (target := w.members if w.members in weights else next(within, None)) is not None:
            weights[target] += p
    total = sum(weights.values())
    if total <= 0:
        return [(search.root, 1.0)]
    return sorted(((visited[m], p / total) for m, p in weights.items()), key=lambda t: -t[1])


def _parts(w: EvaluatedSet, members: Members) -> set[str]:
    """Components of some members of a set, wherever they sit; flexible forms by their own names."""
    return {e.name if e.flexible else e.component for e in w.effects if e.name in members}


def reported_set(sets: WeighedSets) -> EvaluatedSet:
    """The set to report: of the most probable components, in their most probable forms.

    The weights of sets with the same components in different forms are added. The components are those that are more
    probable than not, if a visited set holds exactly these: the median probability model, which predicts best among
    single sets (Barbieri and Berger 2004). Otherwise, or where no component is so probable, they are those of the most
    probable set that holds all of these: else the baseline alone could come before rivals that share a weight.

    Parameters
    ----------
    sets : sequence of (EvaluatedSet, float)
        With their probabilities, the most probable first.

    Returns
    -------
    EvaluatedSet
    """
    weights = component_weights(sets)
    median = frozenset(c for components in weights for c in components
                       if sum(p for k, p in weights.items() if c in k) > 0.5)
    larger = [k for k in weights if median <= k] or list(weights)
    components = median if median and median in weights else max(larger, key=lambda k: weights[k])
    return next(w for w, _ in sets if frozenset(w.components) == components)


def component_weights(sets: WeighedSets) -> dict[Members, float]:
    """Weight of every set of components, in any forms.

    Parameters
    ----------
    sets : sequence of (EvaluatedSet, float)

    Returns
    -------
    dict of frozenset of str to float
    """
    weights: dict[Members, float] = {}
    for w, p in sets:
        weights[frozenset(w.components)] = weights.get(frozenset(w.components), 0.0) + p
    return weights
