"""Blocks: stretches of the records that count as independent, in two folds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.baselines.repeats import record_halves, record_origins
from lpvid.baselines.signals import Signals
from lpvid.effects.scaling import Scales
from lpvid.errors import InputError

LONGEST, SHORTEST = 2.0, 0.4
"""length of a block [s]; records too short for `FEWEST` of the shortest have blocks of half a period of their motion at
least"""
WANTED = 30
"""blocks wanted over all records"""
FEWEST = 8
"""blocks at least, for a p-value of the sign-flip test; samples of a block; parts of the time of an interval of what
repeats"""
GAP = 0.1
"""share of a block left out at its start, so that neighbours are independent"""
START_UP = 0.25
"""time left out at the head of every record [s], or a twentieth of it if that is less; all of it at the head of a
stretch out of one, before which there is another motion"""
LOOK_AHEAD = 0.1
"""time left out at the end of every record or stretch [s], or a fiftieth of it if that is less: where a channel was
recorded late, by so much at most, its later samples are read, and beyond the end there are none"""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Which sample belongs to which block.

    Attributes
    ----------
    number : tuple of (n,) int arrays
        Per record: the block of every sample, counted over all records; −1 where it belongs to none.
    count : int
        Blocks in all.
    fold : (count,) int array
        0 or 1: of whole records, or alternating in time.
    halves : str
        Which.
    turn : (count,) int array
        0 and 1 alternating in time, by a period of the motion at least, alike in runs of one test. What memorises many
        samples is tested by these.
    length : float
        Of a block [s].
    """

    number: tuple[np.ndarray, ...]
    count: int
    fold: np.ndarray
    halves: str
    turn: np.ndarray
    length: float

    @classmethod
    def of(cls, signals: Sequence[Signals], start: int = 0) -> Blocks:
        """Cut records into blocks of equal length, at least `FEWEST` of them.

        An error lasts about as long as what causes it: a block holds a stroke at least, half a period of the motion.
        Where it is shorter than a period two blocks in a row are of one fold, so that every fold has strokes of either
        direction. Of several records each is of one fold (`record_halves`): a law that fits the motions of its records
        only has a larger error on a further record, which blocks of the same records do not show.

        Parameters
        ----------
        signals : sequence of Signals
            Of one rate; those that are cut together from stretches count as so many pieces.
        start : int
            Samples at the head of a piece that the simulation takes from the measurement; what belongs to no block
            there is as long at least.

        Returns
        -------
        Blocks

        Raises
        ------
        InputError
            Records too short for it.
        """
        period = signals[0].sample_time
        pieces = [(k, of, *ends, bool(s.stretches)) for k, s in enumerate(signals)
                  for ends, of in zip(s.pieces, [t.record for t in s.stretches] or [s], strict=True)]
        start_up = [START_UP / period if part else min(START_UP / period, 0.05 * (last - first))
                    for _, _, first, last, part in pieces]
        heads = [max(start, round(h)) for h in start_up]
        whole = list({id(of): of for _, of, *_ in pieces}.values())
        place, (parents, tests) = {id(of): k for k, of in enumerate(whole)}, record_origins(whole)
        pieces = [(k, place[id(of)], first + head, last - round(LOOK_AHEAD / START_UP * h))
                  for (k, of, first, last, _), head, h in zip(pieces, heads, start_up, strict=True)]
        total = sum(max(last - first, 0) for _, _, first, last in pieces) * period
        length = float(np.clip(total / WANTED, SHORTEST, LONGEST))
        in_a_row = 1
        if total < FEWEST * length:
            cycle = 2 * np.pi * Scales.of(signals).time or np.inf
            length = max(total / FEWEST - period, min(SHORTEST, cycle / 2))
            in_a_row = 1 if length >= min(SHORTEST, cycle) else 2
        size = max(round(length / period), FEWEST)
        numbers, records, turn, before = [np.full(s.n_samples, -1) for s in signals], [], [], [0] * len(whole)
        for k, record, begin, last in pieces:
            for first in range(begin, last - size + 1, size):
                numbers[k][first + round(GAP * size): first + size] = len(records)
                turn.append((before[parents[record]] // in_a_row + tests[record]) % 2)
                before[parents[record]] += 1
                records.append(record)
        if len(records) < FEWEST:
            raise InputError("too little data for a diagnosis", got=f"{total:.3g} s in {len(signals)} record(s)",
                             why=f"at least {FEWEST} blocks of {length:.3g} s are needed", mend="longer records")
        # else there are many runs of one test, of one block each
        turn = turn if len(turn) <= 3 * sum(turn) <= 2 * len(turn) else [k // in_a_row % 2 for k in range(len(turn))]
        half = dict(enumerate(record_halves([s.n_samples for s in whole], tests)))
        fold = found if 0 < sum(found := [half.get(record, 0) for record in records]) < len(found) else turn
        halves_of = f"alternating {'blocks' if fold is turn else 'records'}"
        return cls(tuple(numbers), len(records), np.array(fold), halves_of, np.array(turn), length)
