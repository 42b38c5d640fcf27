"""Rivals: which of two sets the error is nearer to, along what they differ in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.evidence.weighing import Weighed

LAGGING = ("motion", "force", "all")
"""paths whose lags, delays and filters imitate each other and every dynamic cause; a set holds one of them"""
LISTED = 0.05
"""share of the weight of a set from which a rival counts beside it, and weight from which one is listed"""


def nearer(one: Weighed, other: Weighed, noise: bool = False) -> float:
    """Log-likelihood of one set less that of another, by their difference in the error (Davidson, MacKinnon 1981).

    e is the error of `one` and d its output less that of the other. In e = −a d + rest, a is 0 where the one is true
    and 1 where the other is; what the law gets wrong elsewhere does not matter, which in the squared errors hides a
    small difference. With blocks b, nᵦ = Σ e d and qᵦ = Σ d² within each,

        a = −Σ nᵦ/Σ qᵦ,    s² = Σ (nᵦ + a qᵦ)²/(Σ qᵦ)² + min(|a|, |1 − a|)²,

    the second term for a misfit that follows d, of which neither hypothesis knows. Either is Student's t of as many
    degrees of freedom as there are blocks less one. Where the sensors' `noise` is carried into both outputs (to undo a
    filter raises it), its share of Σ e d and Σ d² is taken off.

    Parameters
    ----------
    one, other : Weighed
        On the same data.
    noise : bool
        Whether the sensors' noise counts: of lags, delays and filters.

    Returns
    -------
    float
        In nats; positive for the one, zero where the data do not tell them apart.
    """
    problem = one.data.problem
    error = one.fit.errors
    apart = other.fit.errors - error
    products, squares = problem.block_sums(error * apart), problem.block_sums(apart**2)
    if noise:
        mine, theirs = one.noise_carried, other.noise_carried
        products = products + problem.block_sums(mine * (mine - theirs))
        squares = squares - problem.block_sums((mine - theirs) ** 2)
    total = float(squares.sum())
    if not total > np.finfo(float).eps * float(error @ error):
        return 0.0
    share = -float(products.sum()) / total
    variance = float(np.sum((products + share * squares) ** 2)) / total**2 + min(abs(share), abs(1 - share)) ** 2
    freedom = max(problem.blocks.count - 1, 1)
    odds = np.log1p((1 - share) ** 2 / (variance * freedom)) - np.log1p(share**2 / (variance * freedom))
    return 0.5 * (freedom + 1) * float(odds)



def settled(sets: Sequence[Weighed], weights: np.ndarray) -> np.ndarray:
    """Weights of sets, shared anew among those that differ in one effect of either.

    Squared errors are worth few samples, for what the law gets wrong everywhere is in all of them. What tells a delay
    from a filter is the error where the two differ (`nearer`), and their sum stays what it was.

    Parameters
    ----------
    sets : sequence of Weighed
    weights : (n,) array

    Returns
    -------
    (n,) array
        Of the same sum.
    """
    found, left = weights.copy(), {int(k): sets[k] for k in np.argsort(-weights) if weights[k] > 0}
    while left:
        k, first = next(iter(left.items()))
        group = [k, *(j for j, w in left.items() if weights[j] > LISTED * weights[k] and swapped(first, w))]
        if len(group) > 1:
            odds = np.array([0.0, *(-nearer(first, sets[j], noise=True) for j in group[1:])])
            shares = np.exp(odds - odds.max())
            found[group] = weights[group].sum() * shares / shares.sum()
        left = {j: w for j, w in left.items() if j not in group}
    return found


def swapped(one: Weighed, other: Weighed) -> bool:
    """Whether two sets are the same but for one effect of either.

    Parameters
    ----------
    one, other : Weighed

    Returns
    -------
    bool
    """
    mine, theirs = ([e for e in w.effects if e.name not in v.members] for w, v in ((one, other), (other, one)))
    return len(mine) == len(theirs) == 1


def akin(one: Effect, other: Effect) -> bool:
    """Whether two effects are next of kin: other components of one family, or lags on the way of motion and force.

    Parameters
    ----------
    one, other : Effect

    Returns
    -------
    bool
    """
    return one.component != other.component and (one.family == other.family
                                                 or (one.path in LAGGING and other.path in LAGGING))
