"""Cycles: the periodic stretches of a run, found from its displacement, and the smooth motion along them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from quartercar.characterisation.runs import NOISE, RecordPiece
from quartercar.dampers.bench.static_characteristic import SAME_SPEED
from quartercar.dampers.bench.strokes import turning_points

SMALLEST = 0.01
"""stroke, as a share of the run's travel, below which a reversal is no stroke"""
FEWEST = 3
"""like cycles in a row that make a block: two neighbours are alike by chance once in a hundred cycles of a random
motion, three once in ten thousand"""
RECENT = 15
"""cycles before it that the next one must be like: a slow drift of the test is allowed"""
MOST_OF = 1.0 / 3.0
"""part of the record from which fewer cycles do, if they are a sine or a triangle, and up to which blocks of less than
six cycles are taken for chance: a random record has more strokes. Three cycles from one middle of the stroke to another
have a single whole one between crossings, a third of the record: as much less is allowed as cycles may differ by"""
SINE = 1.0 / 18.0
"""distortion of the displacement up to which it counts as a sine: half of a triangle's, whose third harmonic is 1/9"""
FLAT = 0.5
"""share of a cycle at constant speed from which it counts as a triangle: a sine's speed is within 5 % of its mean over
0.07, a triangle's over all but its corners"""
CHORDS = 64
"""chords of 1/32 of a cycle give the velocity of what is no sine; only the corners of a triangle are rounded by that"""
HARMONICS = 8
"""most harmonics that the motion of a sine test is described by"""


@dataclass(frozen=True, eq=False)
class RecordedCycle:
    """One cycle, from one crossing of mid stroke to the next of the same direction.

    Attributes
    ----------
    span : slice
        Its samples.
    start, stop : float
        The two crossings, in samples.
    period, amplitude, centre : float
        [s], half the stroke [m], middle of the stroke [m].
    displacement, velocity : (n,) array
        Of its samples: for a sine, the Fourier series fitted to the displacement and its derivative; else as measured,
        and the slope of chords of 1/32 of the cycle.
    """

    span: slice
    start: float
    stop: float
    period: float
    amplitude: float
    centre: float
    displacement: np.ndarray = field(repr=False)
    velocity: np.ndarray = field(repr=False)


@dataclass(frozen=True, eq=False)
class Block:
    """Cycles of one amplitude and period: consecutive, or all those of a record at one held current.

    Attributes
    ----------
    run : RecordPiece
    kind : {"sine", "triangle", "periodic"}
    cycles : tuple of RecordedCycle
    distortion : float
        Harmonics of the displacement beyond the first, over the first.
    starting : tuple of int
        Cycles that may still hold the start of the test, or of the current's hold.
    """

    run: RecordPiece
    kind: str
    cycles: tuple[RecordedCycle, ...]
    distortion: float
    starting: tuple[int, ...] = (0,)

    def __repr__(self) -> str:
        return f"Block('{self.run.name}': {self.label}, {len(self.cycles)} cycles)"

    @property
    def frequency(self) -> float:
        """Mean [Hz]."""
        return 1.0 / float(np.mean([c.period for c in self.cycles]))

    @property
    def amplitude(self) -> float:
        """Mean [m]."""
        return float(np.mean([c.amplitude for c in self.cycles]))

    @property
    def peak(self) -> float:
        """Speed of the test [m/s], mean of cycles: half the range of the velocity, of a triangle the median |v|."""
        if self.kind == "triangle":
            return float(np.mean([np.median(np.abs(c.velocity)) for c in self.cycles]))
        ends = (0.0, 1.0) if self.kind == "sine" else (0.01, 0.99)  # a measured velocity is noisy
        return float(np.mean([0.5 * np.ptp(np.quantile(c.velocity, ends)) for c in self.cycles]))

    @property
    def is_settled(self) -> np.ndarray:
        """(n,) bool: all cycles but those that may still hold a start, where there are more than two."""
        kept = np.ones(len(self.cycles), dtype=bool)
        if kept.size > 2:
            kept[list(self.starting)] = False
        return kept

    @property
    def settled(self) -> tuple[RecordedCycle, ...]:
        """The cycles of `is_settled`."""
        return tuple(c for c, kept in zip(self.cycles, self.is_settled, strict=True) if kept)

    @property
    def last(self) -> RecordedCycle:
        """The last complete cycle."""
        return self.cycles[-1]

    @property
    def label(self) -> str:
        """Of the test in tables: shape, amplitude, frequency."""
        return f"{self.kind} ±{1e3 * self.amplitude:.3g} mm, {self.frequency:.3g} Hz"


def blocks_of(run: RecordPiece) -> tuple[Block, ...]:
    """The periodic blocks of a run, in order of time.

    A stroke lies between two turning points that are further apart than the noise of the displacement (8 σ, σ from its
    fourth differences) and a hundredth of the travel. A cycle goes from one upward crossing of mid stroke to the next,
    interpolated: turning points are flat and their time is not sharp. Cycles whose periods and amplitudes differ by
    less than 5 % from the median of the fifteen before belong to the same block. Where the downward crossings make more
    blocks, or as many of steadier period, the cycles go between those: a test that starts and ends at rest in mid
    stroke, upward, has one whole falling stroke more than whole rising ones, which the rest at both ends lengthens.

    Parameters
    ----------
    run : RecordPiece

    Returns
    -------
    tuple of Block
        Empty for random motion.
    """
    x = run.displacement
    turns = turning_points(x, least_stroke(x))
    upward, downward = (_between(run, _crossings(sign * x, turns)) for sign in (1.0, -1.0))
    return max(upward, downward, key=lambda blocks: (len(blocks), -_unsteadiness(blocks)))


def _unsteadiness(blocks: Sequence[Block]) -> float:
    """The furthest that a cycle's period is from the median of its block, over the median."""
    periods = [np.array([c.period for c in b.cycles]) for b in blocks]
    return max((float(np.abs(p / np.median(p) - 1).max()) for p in periods), default=0.0)


def _between(run: RecordPiece, marks: list[tuple[float, float, float]]) -> tuple[Block, ...]:
    """The blocks whose cycles go from one of these crossings to the next."""
    found: list[Block] = []
    enough = MOST_OF * (1.0 - SAME_SPEED) * run.displacement.size
    for group in (_without_rests(run.displacement, marks, g) for g in _alike(marks)):
        whole = marks[group[-1] + 1][0] - marks[group[0]][0]
        if len(group) >= FEWEST or whole > enough:
            block = _block(run, [(marks[k], marks[k + 1]) for k in group])
            if block is not None and (len(group) >= FEWEST or block.kind != "periodic"):
                found.append(block)
    covered = sum(c.span.stop - c.span.start for b in found for c in b.cycles)
    return tuple(b for b in found if covered > enough or len(b.cycles) >= 2 * FEWEST)


def noise_of(x: np.ndarray) -> float:
    """Standard deviation of white noise on a smooth signal, from the median of its fourth differences.

    Parameters
    ----------
    x : (n,) array

    Returns
    -------
    float
        In the unit of x; 0 for fewer than five samples.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> float(round(noise_of(np.sin(0.01 * np.arange(9000)) + 0.01 * rng.standard_normal(9000)), 3))
    0.01
    """
    if x.size < 5:
        return 0.0
    return float(np.median(np.abs(np.diff(x, 4)))) / (0.6745 * np.sqrt(70.0))


def least_stroke(x: np.ndarray) -> float:
    """Least stroke: a hundredth of the travel, or the noise where it is larger but for a motion that is all noise.

    Parameters
    ----------
    x : (n,) array

    Returns
    -------
    float
        In the unit of x.
    """
    travel = float(np.ptp(x))
    return max(SMALLEST * travel, min(NOISE * noise_of(x), 5.0 * SMALLEST * travel))


def _crossings(x: np.ndarray, turns: np.ndarray) -> list[tuple[float, float, float]]:
    """(sample of the upward crossing of mid stroke, half stroke, middle) of every rising stroke.

    The first and the last stroke are cut off by the ends of the record: middle and length are their neighbour's.
    """
    found = []
    strokes = list(pairwise(turns))
    for n, (a, b) in enumerate(strokes):
        if x[b] <= x[a]:
            continue
        low, high = strokes[1] if n == 0 and len(strokes) > 2 else strokes[-2] if n == len(strokes) - 1 > 1 else (a, b)
        middle, half = 0.5 * float(x[low] + x[high]), 0.5 * abs(float(x[high] - x[low]))
        above = np.flatnonzero(x[a:b + 1] >= middle)
        below = np.flatnonzero(x[a:b + 1] < middle)
        if not above.size or not below.size:
            continue
        first, last = a + int(above[0]), a + int(below[-1])  # they differ where noise crosses more than once
        place = _crossing(x, first, middle) if first > a else float(first)
        if last >= first:
            place = 0.5 * (place + _crossing(x, min(last + 1, b), middle))
        found.append((place, half, middle))
    return found


def _crossing(x: np.ndarray, k: int, level: float) -> float:
    step = x[k] - x[k - 1]
    return float(k) if step == 0 else k - 1 + float((level - x[k - 1]) / step)


def _alike(marks: list[tuple[float, float, float]]) -> list[list[int]]:
    """Groups of consecutive cycles with like period and amplitude; cycle k goes from mark k to k + 1."""
    cycles = [(b[0] - a[0], 0.5 * (a[1] + b[1])) for a, b in pairwise(marks)]
    groups: list[list[int]] = []
    for k, (period, amplitude) in enumerate(cycles):
        tolerance = max(SAME_SPEED, 2.0 / max(period, 1.0))  # a crossing is uncertain by about a sample
        if groups and groups[-1][-1] == k - 1:
            past = np.median([cycles[j] for j in groups[-1][-RECENT:]], axis=0)
            if abs(period / past[0] - 1) < tolerance and abs(amplitude / past[1] - 1) < SAME_SPEED:
                groups[-1].append(k)
                continue
        groups.append([k])
    return groups


def _without_rests(x: np.ndarray, marks: list[tuple[float, float, float]], group: list[int]) -> list[int]:
    """A group without the cycles at its ends that are of another shape: between two tests there is a rest.

    Over the phase of the cycle a displacement, less its mean, differs from the group's median by less than 5 % of the
    amplitude (rms), or by the sensor's noise, of which the median of three or more holds as much at most: √2 σ.
    """
    if len(group) < FEWEST:
        return group
    k = np.arange(x.size)
    shapes = np.array([np.interp(np.linspace(marks[n][0], marks[n + 1][0], CHORDS + 1), k, x) for n in group])
    shapes = shapes - shapes.mean(axis=1, keepdims=True)
    apart = np.sqrt(np.mean((shapes - np.median(shapes, axis=0)) ** 2, axis=1))
    most = np.hypot(SAME_SPEED * np.median([marks[n][1] for n in group]), np.sqrt(2) * noise_of(x))
    like = np.flatnonzero(apart <= most)
    return group[like[0]:like[-1] + 1] if like.size else group


def _block(run: RecordPiece, pairs: list) -> Block | None:
    spans = []
    for a, b in pairs:
        first, last = int(np.ceil(a[0])), int(np.ceil(b[0]))
        if last - first >= 8:
            spans.append((slice(first, last), (b[0] - a[0]) * run.period, a[0], b[0]))
    if not spans:
        return None
    x = run.displacement
    v = _chords(x, run.period, max(1, int(np.median([s.stop - s.start for s, *_ in spans])) // CHORDS))
    order = _order(x, spans, run.period)
    series = [series_of(x[s], run.period, T, order) for s, T, *_ in spans]
    distortion = float(np.median([_distortion(c) for c, _, _ in series]))
    kind = "sine" if distortion < SINE else "triangle" if _flat(v, spans) > FLAT else "periodic"
    cycles = []
    for (span, period, start, stop), (_, smooth, slope) in zip(spans, series, strict=True):
        if kind != "sine":
            smooth, slope = x[span], v[span]
        high, low = float(smooth.max()), float(smooth.min())
        cycles.append(RecordedCycle(span, start, stop, period, 0.5 * (high - low), 0.5 * (high + low), smooth, slope))
    return Block(run, kind, tuple(cycles), distortion)


def series_of(x: np.ndarray, period: float, cycle: float, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fourier series with a linear drift, by least squares over one cycle::

        x(t) = a_0 + d t + Σ_k (a_k cos kωt + b_k sin kωt),   v(t) = d + Σ_k kω (b_k cos kωt − a_k sin kωt)

    Parameters
    ----------
    x : (n,) array
    period, cycle : float
        Of the sampling and of the cycle [s].
    order : int

    Returns
    -------
    coefficients : (order,) complex array
        c_k = a_k − i b_k, so that the k-th term is Re(c_k e^{ikωt}).
    value, slope : (n,) arrays
    """
    design, omega = _design(x.size, period, cycle, order)
    solution = np.linalg.lstsq(design, x, rcond=None)[0]
    a, b = solution[2::2], solution[3::2]
    k = np.arange(1, order + 1) * omega
    turned = np.empty((x.size, 2 * order))
    turned[:, 0::2], turned[:, 1::2] = -k * design[:, 3::2], k * design[:, 2::2]
    drift = solution[1] * (design[1, 1] - design[0, 1]) / period if x.size > 1 else 0.0
    return a - 1j * b, design @ solution, turned @ solution[2:] + drift


def harmonics_of(x: np.ndarray, period: float, cycle: float, order: int) -> np.ndarray:
    """Complex amplitudes c_k of x = a_0 + Σ Re c_k e^{ikωt} by least squares over one cycle, without a drift.

    Parameters
    ----------
    x : (n,) array
        From the start of the cycle on.
    period, cycle : float
        Of the sampling and of the cycle [s].
    order : int

    Returns
    -------
    (order,) complex array
        In the unit of x.
    """
    design, _ = _design(x.size, period, cycle, order)
    solution = np.linalg.lstsq(np.delete(design, 1, axis=1), x, rcond=None)[0]
    return solution[1::2] - 1j * solution[2::2]


def _design(n: int, period: float, cycle: float, order: int) -> tuple[np.ndarray, float]:
    t = period * np.arange(n)
    omega = 2 * np.pi / cycle
    design = np.empty((n, 2 + 2 * order))
    design[:, 0], design[:, 1] = 1.0, t / cycle - 0.5
    for k in range(order):
        design[:, 2 + 2 * k], design[:, 3 + 2 * k] = np.cos((k + 1) * omega * t), np.sin((k + 1) * omega * t)
    return design, omega


def _order(x: np.ndarray, spans: list, period: float) -> int:
    """Harmonics by the Bayesian criterion on one cycle in the middle, with as many equations left as unknowns."""
    span, cycle, *_ = spans[len(spans) // 2]
    values = x[span]
    n = values.size
    most = max(1, min(HARMONICS, n // 8))
    scores = []
    for order in range(1, most + 1):
        rest = values - series_of(values, period, cycle, order)[1]
        power = max(float(rest @ rest) / n, (1e-9 * float(np.ptp(values))) ** 2)
        scores.append((n * np.log(power) + 2 * (order + 1) * np.log(n), order))
    return min(scores)[1]


def _distortion(c: np.ndarray) -> float:
    return float(np.sqrt(np.sum(np.abs(c[1:]) ** 2)) / max(abs(c[0]), 1e-300))


def _chords(x: np.ndarray, period: float, reach: int) -> np.ndarray:
    """Slope of the chord from `reach` samples before to as many after: a derivative that averages the noise."""
    k = np.arange(x.size)
    low, high = np.maximum(k - reach, 0), np.minimum(k + reach, x.size - 1)
    return (x[high] - x[low]) / (period * (high - low))


def _flat(v: np.ndarray, spans: list) -> float:
    """Share of the cycles in which the speed is within 5 % of its median."""
    shares = []
    for span, *_ in spans:
        speed = np.abs(v[span])
        middle = float(np.median(speed))
        shares.append(float(np.mean(np.abs(speed - middle) < SAME_SPEED * middle)))
    return float(np.median(shares))
