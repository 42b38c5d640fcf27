"""Switching time: from the current's tenth to nine tenths of the force, with dip, overshoot and settling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from quartercar.characterisation.runs import NOISE, RecordPiece, integral
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


def _steps_of(run: RecordPiece) -> tuple[list[CurrentStep], str]:
    """Usable steps of a run, and where there are none, why."""
    raw = run.raw
    current = raw["current"]
    holds = _holds(current)
    if not holds:
        return [], "the current has no held levels"
    pairs = [(a, b) for a, b in pairwise(holds) if abs(_level(current, a) - _level(current, b)) > 0]
    long = [(a, b) for a, b in pairs if min(a.stop - a.start, b.stop - b.start) >= SHORTEST_HOLD]
    if not long:
        return [], (f"the current rests at no level for {SHORTEST_HOLD} samples in a row (the ripple of a pulse-width "
                    "modulated driver counts as a step)")
    x = raw["displacement"] if raw.has("displacement") else integral(raw["velocity"], float(raw.sample_time or 0.0))
    found = [s for a, b in long if (s := _step(current, x, float(raw.sample_time or 0.0), a, b)) is not None]
    return found, "" if found else "the speed is not constant about any step of the current"


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


SETTLED = 0.05
"""Band about the final force within which a step has settled, as a share of the step."""
FINAL = 1.0 / 3.0
"""Part of the hold after a step over which the final force is taken."""
RISE = (0.75, 0.97)
"""Stretch of the response over which a parabola gives the instant of nine tenths: about 2 time constants of a lag."""
ALIKE = 0.1
"""Shares of the current's range within which steps count as the same, and of the speed."""
STD_OF_UNIFORM = 1 / np.sqrt(12.0)


@dataclass(frozen=True, eq=False)
class SwitchingSteps:
    """Like steps of one record.

    Attributes
    ----------
    specimen, record : str
    low, high : float
        Current before and after.
    direction : {1, −1}
    speed : float
        [m/s].
    time, time_std : float
        t(F90) − t(I10), mean over the steps and its standard error, which holds the clock's resolution [s].
    spread : float
        Standard deviation between steps [s]; NaN from one.
    settling : float or None
        From I10 until the mean response stays within 5 % of the final force, or within its noise [s].
    dip : float
        How far the mean response first goes the other way, as a share of the step; 0 where it stays in the noise.
    overshoot : float
        How far it goes beyond the final force.
    step : float
        Change of the force [N].
    events : int
    resolution : float
        Uncertainty of one instant by the clock [s].
    times, response : (n,) arrays
        Mean response over the time since I10 [s], for a figure.
    """

    specimen: str
    record: str
    low: float
    high: float
    direction: int
    speed: float
    time: float
    time_std: float
    spread: float
    settling: float | None
    dip: float
    overshoot: float
    step: float
    events: int
    resolution: float
    times: np.ndarray
    response: np.ndarray


def switching_of(run: RecordPiece) -> tuple[list[SwitchingSteps], str]:
    """Switching times of a run whose current steps, and where there are none, why.

    At steady speed the force before and after a step lies on two lines of one slope (the gas spring's), F_0(t) and
    F_1(t). The response is y = (F − F_0)/(F_1 − F_0), the switching time t(y = 0.9) − t(I = I_0 + 0.1 (I_1 − I_0)). The
    instant of y = 0.9 is that of a parabola through each step's samples between 75 and 97 % of the mean response. Where
    the current jumps from one sample to the next, I10 lies halfway between them. The samples are those of the
    measurement, whatever rate the rest of the page works at.

    Parameters
    ----------
    run : RecordPiece

    Returns
    -------
    found : list of SwitchingSteps
        Like steps together.
    why : str
        Empty where there are some.
    """
    if not run.has_force:
        return [], "no force"
    steps, why = _steps_of(run)
    if not steps:
        return [], why
    force, period = run.polarity * run.raw["force"], float(run.raw.sample_time or 0.0)
    found, reasons = [], []
    for group in _alike(steps):
        one = _one_kind(run, group, force, period)
        if isinstance(one, str):
            reasons.append(one)
        else:
            found.append(one)
    return found, "" if found else reasons[0]


def _alike(steps: Sequence[CurrentStep]) -> list[list[CurrentStep]]:
    span = max(max(s.low, s.high) for s in steps) - min(min(s.low, s.high) for s in steps)
    groups: list[list[CurrentStep]] = []
    for s in steps:
        for g in groups:
            h = g[0]
            near = max(abs(s.low - h.low), abs(s.high - h.high)) <= ALIKE * span
            if near and s.velocity * h.velocity > 0 and abs(s.velocity / h.velocity - 1) <= ALIKE:
                g.append(s)
                break
        else:
            groups.append([s])
    return groups


def _one_kind(run: RecordPiece, group: Sequence[CurrentStep], force: np.ndarray, period: float) -> SwitchingSteps | str:
    slope = _common_slope(group, force)
    curves = [c for s in group if (c := _response(s, force, slope)) is not None]
    if not curves:
        return "the force has not settled before the next step or turn: hold each level longer"
    length = min(c[0][-1] for c in curves)
    before = max(c[0][0] for c in curves)
    grid = np.arange(np.ceil(before), np.floor(length) + 1)
    mean = np.mean([np.interp(grid, t, y) for t, y, _ in curves], axis=0)
    noise = float(np.std(mean[grid < 0])) if (grid < 0).sum() > 3 else 0.0
    after = grid >= 0
    window = _window(grid[after], mean[after])
    if window is None:
        return "the force does not reach nine tenths of its step"
    instants = np.array([i for t, y, _ in curves if (i := _instant(t, y, *window)) is not None]) * period
    if not instants.size:
        return "too few samples while the force rises: record at a higher rate"
    sharp = any(s.sharp for s in group)
    resolution = period * STD_OF_UNIFORM if sharp else 0.1 * period
    n = instants.size
    spread = float(instants.std(ddof=1)) if n > 1 else float("nan")
    error = float(np.hypot(np.nan_to_num(spread) / np.sqrt(n), resolution))
    y, t = mean[after], grid[after] * period
    limit = max(SETTLED, 0.5 * NOISE * noise)
    outside = np.flatnonzero(np.abs(y - 1.0) > limit)
    settled_at = int(outside[-1]) + 1 if outside.size else 0
    settling = float(t[settled_at]) if settled_at < y.size else None
    early = y[: max(int(np.argmax(y > 0.5)), 1)]
    low, beyond = -float(early.min()), float(y.max()) - 1.0
    first = group[0]
    return SwitchingSteps(run.specimen, run.name, first.low, first.high, int(np.sign(first.velocity)),
                     float(np.mean([abs(s.velocity) for s in group])), float(instants.mean()), error, spread, settling,
                     low if low > 0.5 * NOISE * noise else 0.0, beyond if beyond > 0.5 * NOISE * noise else 0.0,
                     float(np.mean([c[2] for c in curves])), n, resolution, grid * period, mean)


def _held(step: CurrentStep) -> tuple[np.ndarray, np.ndarray]:
    """Samples before the step (the half next to it: what came earlier may still settle) and of the settled end."""
    before, after = step.before, step.after
    length = after.stop - after.start
    return (np.arange(before.start + (before.stop - before.start) // 2, before.stop),
            np.arange(after.stop - max(4, int(FINAL * length)), after.stop))


def _common_slope(group: Sequence[CurrentStep], force: np.ndarray) -> float:
    """Slope of the force over time at held current [N per sample]: of a gas spring at this speed, one for all steps.

    Least squares over all held stretches, each about its own mean.
    """
    above = below = 0.0
    for step in group:
        for span in _held(step):
            off = span - span.mean()
            above += float(off @ force[span])
            below += float(off @ off)
    return above / below if below else 0.0


def _response(step: CurrentStep, force: np.ndarray, slope: float) -> tuple[np.ndarray, np.ndarray, float] | None:
    """(samples since I10, y, step of the force); None where the force is not settled at the end."""
    late, tail = _held(step)
    flat = force - slope * (np.arange(force.size) - step.start)
    start, level = float(flat[late].mean()), float(flat[tail].mean())
    change = level - start
    own, _ = np.polyfit(tail - tail.mean(), flat[tail], 1)
    noise = float(np.std(flat[tail] - level))
    unclear = abs(change) <= NOISE * noise / np.sqrt(tail.size)
    if unclear or abs(own) * tail.size > max(2 * SAME_SPEED * abs(change), noise):
        return None
    span = np.arange(late[0], step.after.stop)
    return span - step.start, (flat[span] - start) / change, change


def _window(t: np.ndarray, y: np.ndarray) -> tuple[float, float] | None:
    """From the first passage of 75 % to the first of 97 % of the mean response, as samples since I10."""
    reached = np.flatnonzero(y >= 0.9)
    if not reached.size:
        return None
    k = int(reached[0])
    below = np.flatnonzero(y[:k] < RISE[0])
    above = np.flatnonzero(y[k:] > RISE[1])
    return float(t[below[-1]]) if below.size else float(t[0]), float(t[k + above[0]]) if above.size else float(t[-1])


def _instant(t: np.ndarray, y: np.ndarray, first: float, last: float) -> float | None:
    """Where a parabola through the samples of the window crosses 0.9; interpolated where there are few."""
    keep = (t >= first) & (t <= last)
    if keep.sum() < 4:
        above = np.flatnonzero((t >= 0) & (y >= 0.9))
        if not above.size or above[0] == 0:
            return None
        k = int(above[0])
        return float(t[k - 1] + (0.9 - y[k - 1]) / (y[k] - y[k - 1]))
    middle, half = 0.5 * (first + last), 0.5 * (last - first)
    s = (t[keep] - middle) / half
    roots = np.roots(np.polyfit(s, y[keep], 2) - np.array([0.0, 0.0, 0.9]))
    real = [float(r.real) for r in roots if abs(r.imag) < 1e-9 and abs(r.real) <= 1.5]
    return middle + half * min(real, key=abs) if real else None
