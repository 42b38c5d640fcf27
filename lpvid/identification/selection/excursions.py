"""A fold for cross-validation that holds out the stretches in which inputs and scheduling go furthest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from lpvid.record import Record


def furthest(records: Sequence[Record], channels: Sequence[str], count: int,
             length: int) -> tuple[list[Record], list[Record]] | None:
    """Training part and held-out part: one stretch in `count` is held out, those that go furthest.

    Consecutive blocks of one experiment all cover about the same range, so that folds of them only test how a model
    interpolates. Later data go further somewhere: the largest of M new values exceeds the largest of N known ones
    with probability M/(M + N) wherever both are drawn alike. What a model does there is asked here. A stretch goes as
    far as the largest deviation of any channel from its mean, in that channel's standard deviations.

    Parameters
    ----------
    records : sequence of Record
        Uniform and finite.
    channels : sequence of str
        Inputs and scheduling variables.
    count : int
        Number of the other folds: as large a share of the stretches is held out here as in each of them.
    length : int
        Samples of a stretch, at least; a shorter record is one.

    Returns
    -------
    (list of Record, list of Record) or None
        None where there are fewer than two stretches for each fold, or where nothing moves.

    Examples
    --------
    >>> import numpy as np
    >>> from lpvid import Record
    >>> u = np.tile([0.0, 1.0], 20)
    >>> u[25] = 3.0
    >>> training, held_out = furthest([Record({"u": u}, sample_time=1.0)], ["u"], 4, 5)
    >>> sorted(float(r["u"].max()) for r in training), [float(r["u"].max()) for r in held_out]
    ([1.0, 1.0], [1.0, 3.0])
    """
    stretches = [(r, a, b) for r in range(len(records)) for a, b in _stretches(records[r].n_samples, length)]
    if len(stretches) < 2 * count:
        return None
    moving = []
    for name in channels:
        values = np.concatenate([r[name] for r in records])
        spread = float(values.std())
        if spread > 0:
            moving.append((name, float(values.mean()), spread))
    if not moving:
        return None
    peaks = [max(float(np.abs(records[r][name][a:b] - mean).max()) / spread for name, mean, spread in moving)
             for r, a, b in stretches]
    held = set(np.argsort(np.negative(peaks), kind="stable")[: len(stretches) // count].tolist())
    parts: tuple[list[Record], list[Record]] = [], []
    runs = groupby(range(len(stretches)), key=lambda i: (stretches[i][0], i in held))
    for (r, is_held), members in runs:
        places = list(members)
        piece = records[r].slice(stretches[places[0]][1], stretches[places[-1]][2])
        parts[is_held].append(replace(piece, time=None))
    return parts


def _stretches(n: int, length: int) -> list[tuple[int, int]]:
    """Borders of equal stretches of at least `length` samples."""
    edges = np.linspace(0, n, max(n // length, 1) + 1).astype(int)
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
