"""Crossings of the stability boundary along a line: solved, polished, verified by counting unstable poles."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid.analysis.frozen import FrozenFamily, Line, stability_margin
from lpvid.analysis.guardian import REAL_POLE, Piece, candidates, pieces, polish

BOUNDARY = 1e-9
LOOSE_BOUNDARY = 1e-5
FRACTIONS = np.array([0.01, 0.06, 0.15, 0.3, 0.45, 0.55, 0.7, 0.85, 0.94, 0.99])


@dataclass(frozen=True)
class Crossing:
    """A pole on the boundary at s; `direction` is that of its own move for rising s.

    Parameters
    ----------
    s : float
        In the unit of the line.
    kind : str
        "+1", "-1" or "complex" (discrete time), "zero" or "imaginary" (continuous time).
    pole : complex
        z, or s [1/s].
    residual : float
        Distance of the pole to the boundary; in continuous time relative to the largest pole.
    direction : str
        "to-unstable", "to-stable" or "touching"; empty until it is known.
    """

    s: float
    kind: str
    pole: complex
    residual: float
    direction: str = ""


@dataclass(frozen=True)
class Group:
    """Crossings at one and the same s, and whether the model is stable just before and just after.

    Parameters
    ----------
    s : float
        In the unit of the line.
    crossings : tuple of Crossing
        All at s.
    before, after : bool
        No pole is unstable, or on the boundary throughout, below s and above it.
    """

    s: float
    crossings: tuple[Crossing, ...]
    before: bool
    after: bool

    @property
    def changes_stability(self) -> bool:
        """Whether the model is stable on one side at least."""
        return self.before or self.after


@dataclass(eq=False)
class LineSearch:
    """What was found along a line.

    Attributes
    ----------
    groups : list of Group
        Rising in s.
    stable_intervals : list of (float, float)
        Open, rising; ends may be infinite.
    always : list of (float, float, tuple of str)
        Where a pole stays on the boundary, from and to, and the kinds of crossing that it stands for.
    bisected : int
        Crossings that were found by bisection.
    exact : bool
        False where a grid was searched.
    window : (float, float)
        Range of that grid.
    why_grid : str
        Why it was; empty where `exact`.
    """

    groups: list[Group] = field(default_factory=list)
    stable_intervals: list[tuple[float, float]] = field(default_factory=list)
    always: list[tuple[float, float, tuple[str, ...]]] = field(default_factory=list)
    bisected: int = 0
    exact: bool = True
    window: tuple[float, float] = (-np.inf, np.inf)
    why_grid: str = ""


class UnstablePoleCounter:
    """Counts unstable poles along a line; −1 where a pole is too close to the boundary to decide.

    Parameters
    ----------
    models : FrozenFamily
        Matrices whose eigenvalues are the poles, by held scheduling.
    line : Line
        Along which poles are counted.
    always : list of (float, float, tuple of str)
        As in `LineSearch`; poles on the boundary there are no reason for −1.
    """

    def __init__(self, models: FrozenFamily, line: Line, always: list[tuple[float, float, tuple[str, ...]]]) -> None:
        self.models, self.line, self.always = models, line, always
        box = models.poles(line.points(line.centre + line.half_width * np.linspace(-1, 1, 11)))
        self.size = max(1e-3 * float(np.abs(box).max()), 1e-300)

    def fixed(self, s: np.ndarray) -> np.ndarray:
        """Whether a pole is known to lie on the boundary there.

        Parameters
        ----------
        s : (n,) array
            Values along the line.

        Returns
        -------
        (n,) array of bool
            False throughout where no pole stays on the boundary.
        """
        inside = [(s >= low) & (s <= high) for low, high, _ in self.always]
        return np.any(inside, axis=0) if inside else np.zeros(s.shape, dtype=bool)

    def margins(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, N) poles at `s` and their relative distance to the boundary.

        Parameters
        ----------
        s : (n,) array
            Values along the line.

        Returns
        -------
        (n, N) complex array
            z, or s [1/s].
        (n, N) array
            Negative where a pole decays; |z| − 1, or Re s over the size of the poles.
        """
        poles = self.models.poles(self.line.points(s))
        scale = np.ones(s.size) if self.models.discrete else np.maximum(np.abs(poles).max(axis=1), self.size)
        return poles, stability_margin(poles, self.models.discrete) / scale[:, None]

    def __call__(self, s: np.ndarray) -> np.ndarray:
        s = np.asarray(s, dtype=float)
        _, margin = self.margins(s)
        loose = self.fixed(s)
        tolerance = np.where(loose, LOOSE_BOUNDARY, BOUNDARY)[:, None]
        counted = (margin > tolerance).sum(axis=1)
        unclear = ~loose & (np.abs(margin) <= tolerance).any(axis=1)
        return np.where(unclear, -1, counted)


def search(models: FrozenFamily, names: tuple[str, ...], line: Line) -> LineSearch:
    """Every crossing along a line, and the intervals on which the frozen model is stable.

    Parameters
    ----------
    models : FrozenFamily
        Matrices whose eigenvalues are the poles, by held scheduling.
    names : tuple of str
        All scheduling variables, in the order of the line's points.
    line : Line
        Followed over the whole real line; on a grid over three half widths on either side of the middle.

    Returns
    -------
    LineSearch
        One stable interval, the whole line, for a model without poles.
    """
    if models.order == 0:
        return LineSearch(stable_intervals=[(-np.inf, np.inf)])
    result = LineSearch()
    listed = pieces(models, names, line)
    solved = [candidates(piece) for piece in listed or []]
    if listed is None or any(c is None for c in solved):
        result.exact = False
        result.why_grid = ("the basis is not piecewise polynomial" if listed is None
                           else "the eigenvalue problem is too large")
        result.window = (line.centre - 3 * line.half_width, line.centre + 3 * line.half_width)
        solved = []
    listed = listed or []
    result.always = [(p.low, p.high, p.always) for p in listed if p.always]
    found = _merged([c for p, t in zip(listed, solved, strict=False) for c in _polished(p, t or [], models)])
    edges = {x for p in listed if p.always for x in (p.low, p.high) if np.isfinite(x)}
    counter = UnstablePoleCounter(models, line, result.always)
    found, result.bisected = _completed(counter, line, found, edges, result)
    _classify(counter, line, found, edges, result)
    return result


def _polished(piece: Piece, solved: list[tuple[str, float]], models: FrozenFamily) -> list[Crossing]:
    listed = []
    for kind, t in solved:
        verified = polish(piece, kind, t, models.discrete)
        if verified is not None:
            s = piece.centre + piece.half * verified[0]
            if piece.contains(s):
                listed.append(Crossing(float(s), kind, verified[1], verified[2]))
    return listed


def _merged(found: list[Crossing]) -> list[Crossing]:
    """Sorted by s; the same pole found twice (double roots, neighbouring pieces) counts once."""
    kept: list[Crossing] = []
    for crossing in sorted(found, key=lambda c: c.s):
        twin = next((i for i, k in enumerate(kept) if _same(k, crossing)), None)
        if twin is None:
            kept.append(crossing)
        elif crossing.residual < kept[twin].residual:
            kept[twin] = crossing
    return _snapped(sorted(kept, key=lambda c: c.s))


def _snapped(found: list[Crossing]) -> list[Crossing]:
    """Different poles that cross within rounding of one value get the same value."""
    snapped: list[Crossing] = []
    for crossing in found:
        last = snapped[-1].s if snapped else np.nan
        close = abs(crossing.s - last) <= 1e-10 * max(abs(crossing.s), abs(last)) + 1e-13
        snapped.append(replace(crossing, s=last) if close else crossing)
    return snapped


def _same(a: Crossing, b: Crossing) -> bool:
    close = abs(a.s - b.s) <= 1e-7 * max(abs(a.s), abs(b.s)) + 1e-12
    return close and a.kind == b.kind and abs(a.pole - b.pole) <= 1e-4 * max(1.0, abs(a.pole))


def _stations(line: Line, found: list[Crossing], edges: set[float], window: tuple[float, float]) -> np.ndarray:
    """Rising boundaries of the intervals to look into, with finite stand-ins for the ends of the real line."""
    inner = sorted({c.s for c in found} | edges)
    low, high = min([line.low, *inner]), max([line.high, *inner])
    width = max(high - low, 2 * line.half_width)
    ends = window if np.isfinite(window[0]) else (low - 10 * width, high + 10 * width)
    return np.array([ends[0], *[x for x in inner if ends[0] < x < ends[1]], ends[1]])


def _completed(counter: UnstablePoleCounter, line: Line, found: list[Crossing], edges: set[float],
               result: LineSearch) -> tuple[list[Crossing], int]:
    """Add by bisection the crossings that the counts of unstable poles show to be missing."""
    added = 0
    for _ in range(8):
        stations = _stations(line, found, edges, result.window)
        s = np.concatenate([_samples(a, b) for a, b in itertools.pairwise(stations)]
                           + [line.centre + line.half_width * np.linspace(-1, 1, 41 if result.exact else 801)])
        s = np.unique(s[np.all(np.abs(s[:, None] - stations[None, 1:-1]) > 1e-9 * line.half_width, axis=1)])
        counts = counter(s)
        s, counts = s[counts >= 0], counts[counts >= 0]
        interval = np.searchsorted(stations, s)
        gaps = np.nonzero((np.diff(counts) != 0) & (np.diff(interval) == 0))[0]
        if gaps.size == 0:
            break
        fresh = [_bisected(counter, s[i], s[i + 1], counts[i]) for i in gaps]
        before = len(found)
        found = _merged(found + fresh)
        added += len(found) - before
        if len(found) == before:
            break
    return found, added


def _samples(a: float, b: float) -> np.ndarray:
    return a + (b - a) * FRACTIONS


def _bisected(counter: UnstablePoleCounter, a: float, b: float, count: int) -> Crossing:
    for _ in range(80):
        middle = 0.5 * (a + b)
        if middle in (a, b):
            break
        _, margin = counter.margins(np.array([middle]))
        tolerance = LOOSE_BOUNDARY if counter.fixed(np.array([middle]))[0] else 0.0
        if int((margin > tolerance).sum()) == count:
            a = middle
        else:
            b = middle
    if counter.fixed(np.array([b]))[0]:
        b = _extrapolated(counter, b)
    poles, margin = counter.margins(np.array([b]))
    i = int(np.argmin(np.abs(margin[0])))
    pole = complex(poles[0, i])
    size = 1.0 if counter.models.discrete else max(float(np.abs(poles).max()), 1e-300)
    if abs(pole.imag) > 1e2 * REAL_POLE * size:
        kind = "complex" if counter.models.discrete else "imaginary"
        pole = complex(pole.real, abs(pole.imag))
    elif counter.models.discrete:
        kind = "+1" if pole.real > 0 else "-1"
    else:
        kind = "zero"
    return Crossing(float(b), kind, pole, float(abs(margin[0, i])))


def _extrapolated(counter: UnstablePoleCounter, s: float) -> float:
    """From a pole a little outside the boundary, beside one that stays on it, to where the first one crosses."""
    step = 1e-6 * counter.line.half_width + 1e-6 * abs(s)
    at = s + step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    _, margin = counter.margins(at)
    near = np.sort(margin, axis=1)
    column = int(np.argmin(np.abs(near[2] - LOOSE_BOUNDARY)))
    slope, value = np.polyfit(at - s, near[:, column], 1)
    moved = s - value / slope if slope else s
    return float(moved) if abs(moved - s) < 0.1 * counter.line.half_width + 0.1 * abs(s) else s


def _classify(
    counter: UnstablePoleCounter, line: Line, found: list[Crossing], edges: set[float], result: LineSearch
) -> None:
    """Fill in groups, directions and stable intervals."""
    stations = _stations(line, found, edges, result.window)
    counts = [_count_between(counter, a, b) for a, b in itertools.pairwise(stations)]
    middles = 0.5 * (stations[:-1] + stations[1:])
    stable = [c == 0 and not f for c, f in zip(counts, counter.fixed(middles), strict=True)]
    for i, s in enumerate(stations[1:-1]):
        here = [c for c in found if c.s == s]
        change = counts[i + 1] - counts[i]
        direction = "to-unstable" if change > 0 else "to-stable" if change < 0 else "touching"
        if here:
            result.groups.append(Group(float(s), tuple(replace(c, direction=direction) for c in here),
                                       stable[i], stable[i + 1]))
    ends = stations.copy()
    if result.exact:
        ends[0], ends[-1] = -np.inf, np.inf
    joins = {g.s for g in result.groups}
    intervals: list[tuple[float, float]] = []
    for low, high, ok in zip(ends[:-1], ends[1:], stable, strict=True):
        if not ok:
            continue
        if intervals and intervals[-1][1] == low and low not in joins:
            intervals[-1] = (intervals[-1][0], float(high))
        else:
            intervals.append((float(low), float(high)))
    result.stable_intervals = intervals


def _count_between(counter: UnstablePoleCounter, a: float, b: float) -> int:
    """Unstable poles between two neighbouring crossings: the most frequent clear count."""
    counts = counter(_samples(a, b))
    clear = counts[counts >= 0]
    if clear.size == 0:
        _, margin = counter.margins(np.array([0.5 * (a + b)]))
        return int((margin >= 0).sum())
    return int(np.bincount(clear).argmax())
