"""Edges of a current that jumps, recorded behind a low-pass: where each began, and the current before the filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.signals import Signals

EDGE, NOISY = 0.1, 0.002
"""share of a channel's range that a jump between two samples makes, and of its size that is taken for noise"""
STEP = 0.01
"""share of its range by which a current that jumps must move between two samples to count as a jump"""
BUSY, SLOWEST = 0.012, 0.03
"""time after the start of a jump during which a filter may still be busy with it, where that is not known, and for
which the current is put at its level [s]"""
TURNS, EARLIER, ASTRAY = 3, 2, 1.6
"""samples that one jump may rest at the turn of its overshoot; the most by which it may begin before it is seen; and
the way that it may go, to and fro, in jumps"""
LASTS, LEAST, RIPPLE = 6, 2, 0.1
"""samples after a jump and before the next that measure a level, the least of them, and the share of the jump by
which it may change meanwhile"""
MISSED, CERTAIN = 0.01, 3.0
"""share of a jump by which the first sample after it misses the level where a filter has been at work, and standard
errors by which that must be sure"""
OUTLYING = 4.0
"""standard deviations from which on a jump is set aside"""
RESTLESS = 6.0
"""times the median step from sample to sample, the sensor's noise, below which nothing counts as a jump"""
SEEN = 5
"""samples after its start by which a jump is placed"""
PLACES = np.linspace(-0.3, 1.05, 28)
"""where a jump may begin, in samples after the last one that has not moved by `STEP`"""


def leaps(x: np.ndarray) -> bool:
    """Whether a channel moves by a large part of its range from one sample to the next.

    Parameters
    ----------
    x : (n,) array
        In any unit.

    Returns
    -------
    bool
        False for a constant, and for a range that is small beside the channel's size.
    """
    return bool(x.size > 1 and np.abs(np.diff(x)).max() > EDGE * np.ptp(x) > NOISY * np.abs(x).max())


@dataclass(frozen=True, eq=False)
class Edges:
    """Jumps of a current between levels.

    Attributes
    ----------
    first, until, next : (k,) int arrays
        Last sample before each, the first sample on which a filter is no longer busy with it, and the first one beyond
        those that it may rule.
    before, after : (k,) arrays
        Levels [A]; NaN where one does not last.
    size : int
        Samples of the current.
    """

    first: np.ndarray
    until: np.ndarray
    next: np.ndarray
    before: np.ndarray
    after: np.ndarray
    size: int

    @property
    def known(self) -> np.ndarray:
        """(k,) bool: those between levels that last."""
        return np.isfinite(self.before) & np.isfinite(self.after)

    def near(self, some: np.ndarray) -> np.ndarray:
        """(n,) bool: samples on which a filter may be busy with some of them, (k,) bool.

        Parameters
        ----------
        some : (k,) bool array
            Which of the jumps.

        Returns
        -------
        (n,) bool array
        """
        change = np.zeros(self.size + 1)
        np.add.at(change, self.first[some], 1.0)
        np.add.at(change, self.until[some], -1.0)
        return np.cumsum(change)[:-1] > 0


def edges_of(s: Signals) -> Edges | None:
    """Of the current, found once; None where there is none or it does not leap.

    Parameters
    ----------
    s : Signals

    Returns
    -------
    Edges or None
    """
    if not s.has("current"):
        return None
    return s.fact("current", "edges", lambda c: find_edges(c, s.sample_time) if leaps(c) else None)


def find_edges(current: np.ndarray, sample_time: float) -> Edges:
    """The jumps of a current.

    Parameters
    ----------
    current : (n,) array
        [A].
    sample_time : float
        [s].

    Returns
    -------
    Edges
        Of no jumps where the current does not move by more than its noise.

    Examples
    --------
    >>> e = find_edges(np.repeat([0.0, 2.0, 1.0], 10), 0.002)
    >>> e.first.tolist(), e.before.tolist(), e.after.tolist()
    ([9, 19], [0.0, 2.0], [2.0, 1.0])
    """
    steps = np.abs(np.diff(current))
    noise = RESTLESS * float(np.median(steps)) if steps.size else 0.0
    moving = np.flatnonzero(steps > max(STEP * np.ptp(current), noise))
    if not moving.size:
        none, nowhere = np.zeros(0), np.zeros(0, int)
        return Edges(nowhere, nowhere, nowhere, none, none, current.size)
    parted = np.flatnonzero(np.diff(moving) > TURNS)
    first = moving[np.concatenate([[0], parted + 1])]
    last = moving[np.concatenate([parted, [moving.size - 1]])] + 1
    seen = np.maximum(STEP * np.abs(current[last] - current[first]), noise)
    for _ in range(EARLIER):  # a small one has begun before it is seen by the measure of the range
        begun = np.abs(current[first] - current[np.maximum(first - 1, 0)]) > seen
        first = np.where(begun & (np.append(-1, last[:-1]) < first - 1), first - 1, first)
    size = np.abs(current[last] - current[first])
    starts, ends = np.append(0, last), np.append(first, current.size - 1) + 1
    rest = ends - starts
    before = _levels(current, np.maximum(ends - LASTS, starts + rest // 2)[:-1], ends[:-1], size)
    begun = (starts + np.minimum(LASTS, rest // 2))[1:]
    after = _levels(current, begun, np.minimum(begun + LASTS, ends[1:]), size)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    after[way[last] - way[first] > ASTRAY * size] = np.nan  # several jumps at once
    until, then = (np.minimum(first + 1 + round(time / sample_time), ends[1:]) for time in (BUSY, SLOWEST))
    return Edges(first, until, then, before, after, current.size)


def _levels(current: np.ndarray, start: np.ndarray, end: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(k,) medians of current[start:end], `LASTS` samples at most, beside jumps of a size; NaN where it is restless."""
    count, k = end - start, np.arange(start.size)
    at = start[:, None] + np.arange(LASTS)
    rest = np.sort(np.where(at < end[:, None], current[np.minimum(at, current.size - 1)], np.inf), axis=1)
    top = rest[k, np.maximum(count - 1, 0)]
    middle = 0.5 * (rest[k, np.maximum(count - 1, 0) // 2] + rest[k, np.minimum(count // 2, LASTS - 1)])
    with np.errstate(invalid="ignore"):
        return np.where((count >= LEAST) & (top - rest[:, 0] < RIPPLE * size), middle, np.nan)


def is_sharp(s: Signals) -> bool:
    """Whether the current's jumps show no trace of a filter; judged once, over all records of a diagnosis.

    Parameters
    ----------
    s : Signals
        With current.

    Returns
    -------
    bool
        True also where no record has a current that leaps.
    """
    def find(_: np.ndarray) -> bool:
        found = [(p["current"], e) for p in s.as_recorded("current") if (e := edges_of(p)) is not None]
        return at_once(*zip(*found, strict=True)) if found else True

    return s.fact("current", "is sharp", find)


def at_once(currents: Sequence[np.ndarray], edges: Sequence[Edges]) -> bool:
    """Whether jumps between levels show no trace of a filter, the noise of the sensor aside.

    One that lags misses its level at the first sample, and one that overshoots misses it by as much throughout: by the
    share s of the jump that fits all of them, r = s j + noise, those set aside that chance does not send astray so far.

    Parameters
    ----------
    currents : sequence of (n,) arrays
        [A], one for each record.
    edges : sequence of Edges
        Theirs.

    Returns
    -------
    bool
        True where no jump lies between levels that last.

    Examples
    --------
    >>> steps = np.repeat([0.0, 2.0, 1.0, 1.5], 10)
    >>> behind = np.convolve(steps, [1.04, -0.04])[:40]
    >>> [at_once([x], [find_edges(x, 0.002)]) for x in (steps, behind)]
    [True, False]
    """
    pairs = [_missed(current, e) for current, e in zip(currents, edges, strict=True)]
    missed, jump = (np.concatenate(part) for part in zip(*pairs, strict=True))
    if not jump.size:
        return True
    astray = np.abs(missed - float(np.median(missed / jump)) * jump)
    fair = astray <= OUTLYING * 1.48 * np.median(astray)  # of a normal distribution, by its median deviation
    missed, jump = missed[fair], jump[fair]
    share = float(missed @ jump) / float(jump @ jump)
    spread = float(np.sqrt(np.mean((missed - share * jump) ** 2) / (jump @ jump)))
    return abs(share) < max(MISSED, CERTAIN * spread)


def _missed(current: np.ndarray, edges: Edges) -> tuple[np.ndarray, np.ndarray]:
    """By how much a current misses its level at the first sample after each known jump, and the jumps, (k,) each."""
    known = edges.known
    seen = np.minimum(edges.first[known] + 1, current.size - 1)
    return current[seen] - edges.after[known], edges.after[known] - edges.before[known]


def step_response(time: np.ndarray, t: float, zeta: float) -> np.ndarray:
    """Of 1/(1 + 2ζTs + T²s²) to a unit step at 0, with the poles s₁, s₂: 1 + (s₂ e^{s₁ t} − s₁ e^{s₂ t})/(s₁ − s₂).

    Parameters
    ----------
    time : array
        Since the step [s].
    t : float
        T [s], above zero.
    zeta : float
        Damping ratio.

    Returns
    -------
    array
        Of the shape of `time`; 0 before the step.
    """
    root = np.sqrt(complex(zeta**2 - 1 + 1e-9))
    one, two = (-zeta + root) / t, (-zeta - root) / t
    late = np.maximum(time, 0.0)
    return np.real(1 + (two * np.exp(one * late) - one * np.exp(two * late)) / (one - two))


def current_before(s: Signals, edges: Edges, t: float, zeta: float, finer: int) -> np.ndarray:
    """(n finer,) a current before the low-pass, on a clock `finer` times as fast: its known edges jump at once.

    A jump between known levels that the filter has made round is placed by least squares over the samples that follow,
    anywhere between two of them; elsewhere the current is as recorded.

    Parameters
    ----------
    s : Signals
        With current.
    edges : Edges
        Of that current.
    t, zeta : float
        T [s] and damping ratio of the low-pass.
    finer : int

    Returns
    -------
    (n finer,) array
        [A].
    """
    current, period = s["current"], s.sample_time
    fine = np.repeat(current, finer)
    known = edges.known
    first, before = edges.first[known], edges.before[known]
    size = edges.after[known] - before
    if not first.size:
        return fine
    begun = finer * (first + _lowest(_misfit(current, edges, t / period, zeta)))
    cells = finer * first[:, None] + np.arange(finer * (1 + round(SLOWEST / period)))
    inside = cells < finer * edges.next[known][:, None]
    covered = np.clip(cells - begun[:, None] + 0.5, 0.0, 1.0)
    fine[cells[inside]] = (before[:, None] + size[:, None] * covered)[inside]
    return fine


def _misfit(current: np.ndarray, edges: Edges, t: float, zeta: float) -> np.ndarray:
    """(k, places) squared misfit of a filter's step response to the known edges; t in samples."""
    known = edges.known
    first, before = edges.first[known], edges.before[known]
    after = np.arange(1, SEEN + 1)
    expected = step_response(after[None, :] - PLACES[:, None], t, zeta)
    seen = np.minimum(first[:, None] + after, current.size - 1)
    counts = (seen < edges.next[known][:, None]).astype(float)
    part = (current[seen] - before[:, None]) / (edges.after[known] - before)[:, None]
    return np.sum(counts[:, None, :] * (part[:, None, :] - expected[None]) ** 2, axis=2)


def _lowest(misfit: np.ndarray) -> np.ndarray:
    """(k,) places of least misfit, (k, places), by the parabola through the lowest and its neighbours."""
    at = np.clip(np.argmin(misfit, axis=1), 1, PLACES.size - 2)
    k = np.arange(at.size)
    a, b, c = misfit[k, at - 1], misfit[k, at], misfit[k, at + 1]
    bend = a - 2 * b + c
    shift = np.where(bend > 0, 0.5 * (a - c) / np.where(bend > 0, bend, 1.0), 0.0)
    return PLACES[at] + np.clip(shift, -1.0, 1.0) * (PLACES[1] - PLACES[0])
