"""Edges of a current that jumps, recorded after a low-pass: the start of each, and the current before the filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.condition.band_limited import jumps
from lpvid.condition.constancy import DISTINCT
from quartercar.effects.second_order import step_response, total_variation

STEP = 0.01
"""share of its range by which a current that jumps must move between two samples to count as a jump, and share of a
jump by which the first sample after it deviates from the level after a filter"""
SLOWEST = 0.03
"""time after the start of a jump during which the response of an unknown filter may last [s]"""
TURNS = 3
"""samples without movement within one jump, at the peak of its overshoot"""
LEAST_DAMPED = 0.4
"""least plausible damping ratio of a filter against aliasing"""
MOST_VARIATION = total_variation(LEAST_DAMPED)
"""its total variation after a step, in sizes of the step"""
LASTS, RIPPLE = 6, 0.1
"""samples after a jump and before the next from which a level is determined and the jump located, and the share of the
jump by which they may differ"""
CERTAIN = 3.0
"""standard errors by which a deviation must be significant, and standard deviations from which on one is an outlier"""
PLACES = np.linspace(-0.3, 1.05, 28)
"""candidates for the start of a jump, in samples after the last one that has not moved by `STEP`"""
SPACING = float(np.diff(PLACES).mean())
"""accuracy to which a jump after a filter is located, in samples"""


def normal_spread(values: np.ndarray) -> float:
    """Standard deviation of normal values with mean zero, by their median modulus, so that outliers have no effect.

    Parameters
    ----------
    values : (n,) array

    Returns
    -------
    float
        0 without values.

    Examples
    --------
    >>> round(normal_spread(np.append(np.random.default_rng(0).standard_normal(10_000), 1e6)), 1)
    1.0
    """
    return float(np.median(np.abs(values))) / NormalDist().inv_cdf(3 / 4) if values.size else 0.0


@dataclass(frozen=True, eq=False)
class Edges:
    """Jumps of a current between levels.

    Attributes
    ----------
    first, until : (k,) int arrays
        Last sample before each, and the first one after a filter's response to it.
    before, after : (k,) arrays
        Levels [A]; NaN where one is too short.
    size : int
        Samples of the current.
    """

    first: np.ndarray
    until: np.ndarray
    before: np.ndarray
    after: np.ndarray
    size: int

    @property
    def known(self) -> np.ndarray:
        """(k,) bool: those between two known levels."""
        return np.isfinite(self.before) & np.isfinite(self.after)

    def near(self, some: np.ndarray) -> np.ndarray:
        """(n,) bool: samples within a filter's response to some of them, (k,) bool.

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
    """Edges of the current, computed once; None where there is no current or it does not jump.

    Parameters
    ----------
    s : Signals

    Returns
    -------
    Edges or None
    """
    if not s.has("current"):
        return None
    return s.fact("current", "edges", lambda c: _edges(c, s.sample_time))


def _edges(current: np.ndarray, sample_time: float) -> Edges | None:
    """Edges of a current that is not constant, and that between them is at rest or moves less, but for noise.

    Noise hides from `jumps` that a current rests. Its increments are correlated by −1/2, those of a motion positively.
    """
    if np.ptp(current) <= DISTINCT * np.abs(current).max():
        return None
    edges = find_edges(current, sample_time)
    if not edges.first.size:
        return None
    increments = np.diff(current)
    small = np.where(np.abs(increments) > _noise_limit(increments), 0.0, increments)
    return edges if jumps(current) or float(small[1:] @ small[:-1]) < 0.0 else None


def _noise_limit(increments: np.ndarray) -> float:
    """About the largest increment of as much normal noise as a current's increments, (n,), have."""
    return normal_spread(increments) * float(np.sqrt(2 * np.log(increments.size + 1)))


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
    noise = _noise_limit(steps)
    moving = np.flatnonzero(steps > max(STEP * np.ptp(current), noise))
    if not moving.size:
        return _no_edges(current.size)
    parted = np.flatnonzero(np.diff(moving) > TURNS)
    first = moving[np.concatenate([[0], parted + 1])]
    last = moving[np.concatenate([parted, [moving.size - 1]])] + 1
    if (last - first).min() * sample_time > SLOWEST:  # ramps
        return _no_edges(current.size)
    seen = np.maximum(STEP * np.abs(current[last] - current[first]), noise)
    begun = np.ones(first.size, dtype=bool)
    while begun.any():  # a small one begins before its steps exceed `STEP` of the range
        begun = np.abs(current[first] - current[np.maximum(first - 1, 0)]) > seen
        begun &= np.append(-1, last[:-1]) < first - 1
        first = np.where(begun, first - 1, first)
    size = np.abs(current[last] - current[first])
    starts, ends = np.append(0, last), np.append(first, current.size - 1) + 1
    rest = ends - starts
    before = _levels(current, np.maximum(ends - LASTS, starts + rest // 2)[:-1], ends[:-1], size)
    begun = (starts + np.minimum(LASTS, rest // 2))[1:]
    after = _levels(current, begun, np.minimum(begun + LASTS, ends[1:]), size)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    after[way[last] - way[first] > MOST_VARIATION * size] = np.nan  # several jumps at once
    until = np.minimum(first + 1 + round(SLOWEST / sample_time), ends[1:])
    return Edges(first, until, before, after, current.size)


def _no_edges(size: int) -> Edges:
    none, nowhere = np.zeros(0), np.zeros(0, int)
    return Edges(nowhere, nowhere, none, none, size)


def _levels(current: np.ndarray, start: np.ndarray, end: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(k,) medians of current[start:end], `LASTS` samples at most; NaN where it moves by `RIPPLE` of a jump's size."""
    count, k = end - start, np.arange(start.size)
    at = start[:, None] + np.arange(LASTS)
    rest = np.sort(np.where(at < end[:, None], current[np.minimum(at, current.size - 1)], np.inf), axis=1)
    top = rest[k, np.maximum(count - 1, 0)]
    middle = 0.5 * (rest[k, np.maximum(count - 1, 0) // 2] + rest[k, np.minimum(count // 2, LASTS - 1)])
    with np.errstate(invalid="ignore"):
        return np.where((count > 1) & (top - rest[:, 0] < RIPPLE * size), middle, np.nan)


def is_sharp(s: Signals) -> bool:
    """Whether the current's jumps are unfiltered; decided once, over all records of a diagnosis.

    Parameters
    ----------
    s : Signals
        With current.

    Returns
    -------
    bool
        True also where no record has a current that jumps.
    """
    def find(_: np.ndarray) -> bool:
        found = [(p["current"], e) for p in s.as_recorded("current") if (e := edges_of(p)) is not None]
        return edges_unfiltered(*zip(*found, strict=True)) if found else True

    return s.fact("current", "is sharp", find)


def edges_unfiltered(currents: Sequence[np.ndarray], edges: Sequence[Edges]) -> bool:
    """Whether jumps between levels are unfiltered, within the noise of the sensor.

    After a filter, the first sample after a jump j deviates from the level by r = s j + noise, with one share s for all
    jumps; s is estimated by least squares without outliers.

    Parameters
    ----------
    currents : sequence of (n,) arrays
        [A], one for each record.
    edges : sequence of Edges
        Theirs.

    Returns
    -------
    bool
        True where no jump is between known levels.

    Examples
    --------
    >>> steps = np.repeat([0.0, 2.0, 1.0, 1.5], 10)
    >>> behind = np.convolve(steps, [1.04, -0.04])[:40]
    >>> [edges_unfiltered([x], [find_edges(x, 0.002)]) for x in (steps, behind)]
    [True, False]
    """
    pairs = [_missed(current, e) for current, e in zip(currents, edges, strict=True)]
    missed, jump = (np.concatenate(part) for part in zip(*pairs, strict=True))
    if not jump.size:
        return True
    deviation = np.abs(missed - float(np.median(missed / jump)) * jump)
    kept = deviation <= CERTAIN * normal_spread(deviation)
    missed, jump = missed[kept], jump[kept]
    share = float(missed @ jump) / float(jump @ jump)
    noise = max(float(np.mean((missed - share * jump) ** 2)), max(map(_missed_noise, currents)))
    spread = float(np.sqrt(noise / (jump @ jump)))
    return abs(share) < max(STEP, CERTAIN * spread)


def _missed_noise(current: np.ndarray) -> float:
    """Variance that the sensor's noise gives a deviation of `_missed`: of a sample, and of a median of `LASTS`.

    The fit of one share to few jumps has less, to one it has none.
    """
    return 0.5 * normal_spread(np.diff(current)) ** 2 * (1 + np.pi / (2 * LASTS))


def _missed(current: np.ndarray, edges: Edges) -> tuple[np.ndarray, np.ndarray]:
    """Deviation of a current from its level at the first sample after each known jump, and the jumps, (k,) each."""
    known = edges.known
    seen = np.minimum(edges.first[known] + 1, current.size - 1)
    return current[seen] - edges.after[known], edges.after[known] - edges.before[known]


def current_before(s: Signals, edges: Edges, t: float, zeta: float, finer: int) -> np.ndarray:
    """(n finer,) a current before the low-pass, on a clock `finer` times as fast, with sharp edges.

    The time of a jump between known levels is estimated by least squares of the filter's step response over the samples
    that follow; elsewhere the current is as recorded.

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
    begun = finer * (first + _least_misfit(_misfit(current, edges, t / period, zeta)))
    cells = finer * first[:, None] + np.arange(finer * (1 + round(SLOWEST / period)))
    inside = cells < finer * edges.until[known][:, None]
    covered = np.clip(cells - begun[:, None] + 0.5, 0.0, 1.0)
    fine[cells[inside]] = (before[:, None] + size[:, None] * covered)[inside]
    return fine


def _misfit(current: np.ndarray, edges: Edges, t: float, zeta: float) -> np.ndarray:
    """(k, places) squared misfit of a filter's step response to the known edges; t in samples."""
    known = edges.known
    first, before = edges.first[known], edges.before[known]
    after = np.arange(1, LASTS + 1)
    expected = step_response(after[None, :] - PLACES[:, None], t, zeta)
    seen = np.minimum(first[:, None] + after, current.size - 1)
    counts = (seen < edges.until[known][:, None]).astype(float)
    part = (current[seen] - before[:, None]) / (edges.after[known] - before)[:, None]
    return np.sum(counts[:, None, :] * (part[:, None, :] - expected[None]) ** 2, axis=2)


def _least_misfit(misfit: np.ndarray) -> np.ndarray:
    """(k,) places of least misfit, (k, places), by the parabola through the lowest and its neighbours."""
    at = np.clip(np.argmin(misfit, axis=1), 1, PLACES.size - 2)
    k = np.arange(at.size)
    a, b, c = misfit[k, at - 1], misfit[k, at], misfit[k, at + 1]
    bend = a - 2 * b + c
    shift = np.where(bend > 0, 0.5 * (a - c) / np.where(bend > 0, bend, 1.0), 0.0)
    return PLACES[at] + np.clip(shift, -1.0, 1.0) * SPACING
