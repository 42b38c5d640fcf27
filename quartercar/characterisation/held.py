"""Held levels: cycles of a record at each current that it holds for several of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from quartercar.characterisation.cycles import Block
from quartercar.characterisation.runs import CurrentResolution, RecordPiece, RecordPieces, resolution_of

SEVERAL = 2
"""whole cycles in a row at one current that make a hold: one alone may lie in a slow sweep of the current"""


def with_held_levels(data: RecordPieces, blocks: Sequence[Block]) -> tuple[RecordPieces, tuple[Block, ...]]:
    """Add, for every record whose current moves between held levels, one run per level with the cycles at it.

    A cycle is at one current by the rule for a whole record: its current spans at most 2 % of the largest of the data
    set, or its noise (8 σ). Two such cycles in a row or more, at one level, are a hold. Levels that are no further
    apart than that are one, and the same as in records of constant current; where a chain of near ones reaches
    further, the current creeps and is held nowhere. A run has all cycles at its level, whichever hold they are of, and
    each counts as one in the standard errors: where holds differ (memory, temperature) these are too small, by at most
    the root of the cycles in a hold. The first cycle of a hold is left out of means like that of a record, where the
    hold has more than two.

    Parameters
    ----------
    data : RecordPieces
    blocks : sequence of Block
        Of its runs.

    Returns
    -------
    data : RecordPieces
        With the runs of held levels behind the others.
    blocks : tuple of Block
        With theirs.
    """
    moving = [b for b in blocks if b.run.current == "varies"]
    if not moving:
        return data, tuple(blocks)
    resolution = resolution_of([r.record["current"] for r in data.runs if r.record.has("current")])
    holds = [(b, hold) for b in moving for hold in _holds(b, resolution)]
    runs: dict[tuple[int, float], RecordPiece] = {}
    found: list[Block] = []
    for level, own in _levels(holds, resolution, data.levels):
        for block in dict.fromkeys(b for b, _ in own):
            run = runs.setdefault((id(block.run), level), replace(block.run, level=level, current="constant",
                                                                  held=_time(block.run, own)))
            found.append(_at(run, block, [hold for b, hold in own if b is block]))
    if not found:
        return data, tuple(blocks)
    levels = tuple(sorted({*data.levels, *(r.level for r in runs.values() if r.level is not None)}))
    records, held = len({r.source for r in runs.values()}), len({r.level for r in runs.values()})
    note = (f"current held over several cycles at {held} level{'s' if held > 1 else ''} within {records} "
            f"record{'s' if records > 1 else ''}: the cycles at each level are read like a record of their own")
    return replace(data, runs=(*data.runs, *runs.values()), levels=levels, notes=(*data.notes, note)), (*blocks, *found)


def _holds(block: Block, resolution: CurrentResolution) -> list[list[int]]:
    """Cycles (their numbers) of one level in a row, two or more; none where the level creeps from each to the next."""
    current = block.run.record["current"]
    held = [resolution.held(current[c.span]) for c in block.cycles]
    middle = [float(np.median(current[c.span])) for c in block.cycles]
    groups: list[list[int]] = [[0]] if held[0] else []
    for before, k in pairwise(range(len(held))):
        if held[k]:
            same = held[before] and abs(middle[k] - middle[before]) <= resolution.apart
            groups = [*groups[:-1], [*groups[-1], k]] if same else [*groups, [k]]
    return [g for g in groups if len(g) >= SEVERAL and np.ptp([middle[k] for k in g]) <= resolution.apart]


def _levels(holds: Sequence[tuple[Block, list[int]]], resolution: CurrentResolution,
            known: Sequence[float]) -> list[tuple[float, list[tuple[Block, list[int]]]]]:
    """(level, its holds), rising, each level once; without chains of holds that reach further than one level."""
    middles = [(float(np.median([np.median(b.run.record["current"][b.cycles[k].span]) for k in hold])), n)
               for n, (b, hold) in enumerate(holds)]
    found: dict[float, list[tuple[Block, list[int]]]] = {}
    for group in resolution.groups(middles):
        values = [v for v, _ in group]
        if values[-1] - values[0] > resolution.apart:
            continue
        own = resolution.level(values)
        near = [k for k in known if abs(k - own) <= resolution.apart]
        level = near[int(np.argmin([abs(k - own) for k in near]))] if near else own
        found.setdefault(level, []).extend(holds[n] for _, n in group)
    return list(found.items())


def _time(run: RecordPiece, holds: Sequence[tuple[Block, list[int]]]) -> float:
    """Time of the cycles of these holds that are of one record [s]."""
    return sum(b.cycles[k].period for b, hold in holds if b.run is run for k in hold)


def _at(run: RecordPiece, block: Block, holds: Sequence[list[int]]) -> Block:
    """The cycles of these holds as a block of the run at their level."""
    ordered = sorted(holds)
    numbers = [k for hold in ordered for k in hold]
    starting = tuple(numbers.index(hold[0]) for hold in ordered if len(hold) > 2)
    return Block(run, block.kind, tuple(block.cycles[k] for k in numbers), block.distortion, starting)
