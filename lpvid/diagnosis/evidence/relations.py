"""Kinship: which effects may be in one set, and which may take one another's place."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid.diagnosis.effect import Effect

LAGGING = ("motion", "force", "all")
"""paths whose lags, delays and filters imitate each other and every dynamic cause; a set holds one of them"""


def related(one: Effect, other: Effect) -> bool:
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


def compatible(effects: Sequence[Effect], channels: Sequence[str]) -> bool:
    """Whether effects may be in one set: no component twice, what sits behind a series element with one, one lag.

    Of lags, delays and filters on the way of motion and force a set holds one at most: two of them imitate whatever
    there is. An effect that turns a channel needs something that reads this channel: the law (`channels`), or a member
    that brings it.

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
