"""Relations: which effects may be in one set, and which may replace one another."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid.effects.effect import Effect

LAGGING = ("motion", "force", "all")
"""paths whose lags, delays and filters fit each other's error and that of every dynamic cause; a set holds one"""


def related(one: Effect, other: Effect) -> bool:
    """Whether two effects are related: different components of one family, or lags of motion and force.

    Parameters
    ----------
    one, other : Effect

    Returns
    -------
    bool
    """
    return one.component != other.component and (one.family == other.family
                                                 or (one.path in LAGGING and other.path in LAGGING))


def compatible(effects: Sequence[Effect], channels: Sequence[str]) -> bool:
    """Whether effects may be in one set: no component twice, `Effect.behind` fulfilled, one lag of motion and force.

    Of lags, delays and filters of motion and force a set holds one at most: two of them can fit almost any error. An
    effect that changes a channel (`Effect.turns`) needs something that reads this channel: the law (`channels`), or a
    member that brings it.

    Parameters
    ----------
    effects : sequence of Effect
    channels : sequence of str
        Roles that the law reads.

    Returns
    -------
    bool
    """
    read = {"", *channels, *(c for e in effects for c in e.brings)}
    if any(e.turns not in read for e in effects):
        return False
    components, stages = [e.component for e in effects], {e.stage for e in effects}
    return len(set(components)) == len(components) and all(not e.behind or e.behind in stages for e in effects) and \
        sum(e.path in LAGGING for e in effects) <= 1
