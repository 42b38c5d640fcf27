"""Steps of the current: where a record jumps from one held level to another while the piston moves steadily."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from quartercar.characterisation.runs import NOISE, RecordPiece
from quartercar.dampers.bench.static_characteristic import SAME_SPEED

CLASSES = 50
"""classes of the current's histogram over its range"""
HELD = 2.0
"""a class that holds this many times the share of an evenly spread current belongs to a held level"""
SHORTEST_HOLD = 10
"""samples of a level that a step needs on either side"""


@dataclass(frozen=True, eq=False)
class CurrentStep:
    """One step at steady speed, in samples of the measurement.

    Attributes
    ----------
    before, after : slice
        Samples of the two held levels, as long as the speed is steady.
    low, high : float
        Currents before and after.
    velocity : float
        Mean [m/s].
    start : float
        Sample at which the current has gone a tenth of its step, interpolated.
    sharp : bool
        Whether the current jumps within one sample: its instant is then known to that sample only.
    """

    before: slice
    after: slice
    low: float
    high: float
    velocity: float
    start: float
    sharp: bool


def steps_of(run: RecordPiece) -> tuple[list[CurrentStep], str]:
    """Usable steps of a run, and where there are none, why."""
    raw = run.raw
    current = raw["current"]
    holds = _holds(current)
    if not holds:
        return [], "the current has no held levels"
    pairs = [(a, b) for a, b in pairwise(holds) if abs(_level(current, a) - _level(current, b)) > 0]
    long = [(a, b) for a, b in pairs if min(a.stop - a.start, b.stop - b.start) >= SHORTEST_HOLD]
    if not long:
        return [], f"no level is held for {SHORTEST_HOLD} samples"
    x = raw["displacement"] if raw.has("displacement") else _travel(raw["velocity"], float(raw.sample_time or 0.0))
    found = [s for a, b in long if (s := _step(current, x, float(raw.sample_time or 0.0), a, b)) is not None]
    return found, "" if found else "the speed is not constant about any step of the current"


def _travel(velocity: np.ndarray, period: float) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(0.5 * period * (velocity[1:] + velocity[:-1]))])


def _level(current: np.ndarray, span: slice) -> float:
    return float(np.median(current[span]))


def _holds(current: np.ndarray) -> list[slice]:
    """Stretches at the levels that the histogram of the current shows."""
    low, high = float(current.min()), float(current.max())
    if high == low:
        return []
    place = np.minimum(((current - low) / (high - low) * CLASSES).astype(int), CLASSES - 1)
    held = np.bincount(place, minlength=CLASSES) > HELD * current.size / CLASSES
    number = np.cumsum(np.diff(np.concatenate([[0], held.astype(int)])) == 1) * held  # neighbours are one level
    if number.max() < 2:
        return []
    middles = [float(np.median(current[number[place] == k])) for k in range(1, int(number.max()) + 1)]
    sigma = float(np.median(np.abs(np.diff(current)))) / (0.6745 * np.sqrt(2))
    gap = float(np.min(np.diff(middles)))
    reach = max(min(0.5 * NOISE * sigma + 0.5 * (high - low) / CLASSES, 0.4 * gap), 1e-12)
    nearest = np.abs(current[:, None] - np.array(middles)).argmin(axis=1)
    inside = np.abs(current - np.array(middles)[nearest]) <= reach
    label = np.where(inside, nearest, -1)
    cuts = np.flatnonzero(np.diff(label)) + 1
    edges = [0, *cuts.tolist(), label.size]
    return [slice(a, b) for a, b in pairwise(edges) if label[a] >= 0]


def _step(current: np.ndarray, x: np.ndarray, period: float, a: slice, b: slice) -> CurrentStep | None:
    """The step between two holds, cut to the stretch of steady speed; None where that is too short."""
    first, last = a.stop - 1, b.start
    begin, end = _steady(x, a.start, first, last, b.stop)
    if first + 1 - begin < SHORTEST_HOLD or end - last < SHORTEST_HOLD:
        return None
    before, after = slice(begin, first + 1), slice(last, end)
    low, high = _level(current, before), _level(current, after)
    velocity = float(x[end - 1] - x[begin]) / (period * (end - 1 - begin))
    tenth = low + 0.1 * (high - low)
    span = np.arange(first, last + 1)
    beyond = np.flatnonzero((current[span] - tenth) * np.sign(high - low) >= 0)
    if not beyond.size or velocity == 0:
        return None
    k = int(span[beyond[0]])
    sharp = last - first == 1
    step = current[k] - current[k - 1]
    start = k - 0.5 if sharp else k - 1 + float((tenth - current[k - 1]) / step) if step else float(k)
    return CurrentStep(before, after, low, high, velocity, start, sharp)


def _steady(x: np.ndarray, begin: int, first: int, last: int, end: int) -> tuple[int, int]:
    """The longest stretch about the step over which x is straight.

    The speed next to the step, over the shorter of the two holds, is the measure; blocks of that hold's fourth are
    taken on either side as long as their own slope is within 5 % of it.
    """
    width = max(4, min(first - begin, end - last) // 4)
    middle = slice(max(begin, first - width), min(end, last + width))
    slope = np.polyfit(np.arange(middle.stop - middle.start), x[middle], 1)[0]
    low, high = middle.start, middle.stop

    def like(a: int, b: int) -> bool:
        return b - a >= 4 and abs(np.polyfit(np.arange(b - a), x[a:b], 1)[0] - slope) <= SAME_SPEED * abs(slope)

    if not (like(low, (low + high) // 2) and like((low + high) // 2, high)):  # the step stands at a turn
        return high, high
    while low > begin and like(max(begin, low - width), low):
        low = max(begin, low - width)
    while high < end and like(high, min(end, high + width)):
        high = min(end, high + width)
    return low, high
