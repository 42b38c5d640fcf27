"""Search for an admissible scheduling trajectory that makes a model grow: a proof that no certificate exists."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from lpvid.codec import Coded
from lpvid.lmi.certificate import grid
from lpvid.lmi.driven import Driven
from lpvid.lmi.search import frozen_rates
from lpvid.model.hull import Hull
from lpvid.scheduling import Scheduling

GROWTH = 1e-9  # what counts as growth, per sample or relative to the fastest pole


@dataclass(frozen=True, eq=False)
class Divergence(Coded):
    """A periodic scheduling trajectory, within box and rate bound, along which the state grows.

    Parameters
    ----------
    kind : str
        "frozen" (one value, held) or "periodic".
    names, units : tuple of str
        Scheduling variables.
    points : (L, len(names)) array
        One period: a value for each sample, or held for each of `durations`.
    durations : (L,) array
        How long each value holds [s].
    growth_rate : float
        Exponential growth of the state [1/s]: the log of the spectral radius over a period, over its length.
    """

    JSON = ("kind", "names", "units", "points", "durations", "growth_rate",
            ("growth_per_sample", "growth"), "sample_time")

    kind: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    points: np.ndarray
    durations: np.ndarray
    growth_rate: float
    sample_time: float | None

    @property
    def growth(self) -> float | None:
        """Factor per sample; None in continuous time."""
        return None if self.sample_time is None else math.exp(self.growth_rate * self.sample_time)

    @classmethod
    def array_shapes(cls, values: Mapping) -> dict[str, tuple[int, ...]]:
        return {"points": (-1, len(values["names"]))}

    def __repr__(self) -> str:
        speed = f"grows {self.growth:.6g}-fold per sample" if self.growth else f"grows as exp({self.growth_rate:.4g} t)"
        shown = [", ".join(f"{n} = {v:.6g} {u}".rstrip() for n, v, u in zip(self.names, p, self.units, strict=True))
                 for p in self.points[:4]]
        more = f" … ({len(self.points)} values a period)" if len(self.points) > 4 else ""
        what = "held at" if self.kind == "frozen" else "cycling through"
        return f"{speed} {what} {' | '.join(shown)}{more}" if self.names else speed


def diverging_trajectory(system: Driven, scheduling: Scheduling, hull: Hull | None = None) -> Divergence | None:
    """The fastest-growing trajectory found: frozen values first, then periodic ones within the rate bound.

    Products along cycles bound the joint spectral radius from below, max ρ(Π)^{1/L}; a search with a beam does not
    find every one, so None proves nothing.

    Parameters
    ----------
    system : Driven
    scheduling : Scheduling
        The variables themselves (not their delayed copies) with the box and the rates in question.
    hull : Hull, optional
        Polytope over the same variables that the trajectory must not leave; the box encloses it.

    Returns
    -------
    Divergence or None
        None also for a system without states.
    """
    if not system.order:
        return None
    columns = [scheduling.names.index(r.name) for r in system.readings]
    points = grid(scheduling, {0: 1, 1: 401, 2: 41, 3: 13}.get(len(scheduling.names), 5))
    points = points if hull is None else np.vstack([points[hull.contains(points)], hull.vertices()])
    rates = frozen_rates(system, points[:, columns])
    worst = int(rates.argmax())
    scale = 1 / system.sample_time if system.sample_time else float(np.abs(system.coefficients).sum())
    if rates[worst] > GROWTH * scale:
        return _found(system, scheduling, "frozen", points[worst : worst + 1], np.ones(1), float(rates[worst]))
    best: tuple[float, np.ndarray, np.ndarray] | None = None
    paths = _paths(system, scheduling, columns)
    if hull is not None:
        paths = (path for path in itertools.chain(_paths(system, scheduling, columns, _ends(hull)), paths)
                 if hull.contains(path[0]).all())
    for path, durations in paths:
        rate = _growth(system, path, durations, columns)
        if best is None or rate > best[0]:
            best = (rate, path, durations)
    if best is not None and system.sample_time is None and any(rate is not None for rate in scheduling.rate):
        path, durations = _finer(best[1], best[2])
        best = (min(best[0], _growth(system, path, durations, columns)), path, durations)
    if best is None or best[0] <= GROWTH * scale:
        return None
    return _found(system, scheduling, "periodic", best[1], best[2], best[0])


def _found(system: Driven, scheduling: Scheduling, kind: str, points: np.ndarray, durations: np.ndarray,
           rate: float) -> Divergence:
    if system.sample_time is not None:
        durations = np.full(len(points), system.sample_time)
    return Divergence(kind, scheduling.names, scheduling.units, points, durations, rate, system.sample_time)


def _finer(path: np.ndarray, durations: np.ndarray, times: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """The same periodic ramps in smaller steps: what grows only because of the steps does not pass."""
    middle = np.cumsum(durations) - 0.5 * durations
    small = np.repeat(durations / times, times)
    at = np.cumsum(small) - 0.5 * small
    return np.column_stack([np.interp(at, middle, column, period=float(durations.sum())) for column in path.T]), small


def _growth(system: Driven, path: np.ndarray, durations: np.ndarray, columns: list[int]) -> float:
    """Growth rate [1/s] along a periodic path, delayed readings included."""
    read = [np.roll(path[:, c], r.lag) for c, r in zip(columns, system.readings, strict=True)]
    matrices = system.state_matrices(np.column_stack(read) if read else np.zeros((len(path), 0)))
    if system.sample_time is None:
        from scipy.linalg import expm

        matrices = expm(matrices * durations[:, None, None])
        period = float(durations.sum())
    else:
        period = len(path) * system.sample_time
    product, log = np.eye(system.order), 0.0
    for matrix in matrices:
        product = matrix @ product
        size = float(np.abs(product).max())
        if size == 0.0:
            return -math.inf
        product, log = product / size, log + math.log(size)
    radius = float(np.abs(np.linalg.eigvals(product)).max())
    return (log + math.log(radius)) / period if radius > 0 else -math.inf


def _ends(hull: Hull) -> np.ndarray:
    """At most 16 vertices and the middle; one variable has five equidistant points."""
    vertices = hull.vertices()
    if len(hull.names) == 1:
        return np.linspace(vertices[0], vertices[-1], 5)
    return np.vstack([vertices[:: max(1, math.ceil(len(vertices) / 16))], hull.middle])


def _paths(system: Driven, scheduling: Scheduling, columns: list[int], ends: np.ndarray | None = None
           ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Periodic paths between points of the box, or between the points given."""
    if not any(up > low for low, up in zip(scheduling.lower, scheduling.upper, strict=True)):
        return
    bounded = any(rate is not None for rate in scheduling.rate)
    if system.sample_time is None:
        yield from (_slow_cycles(system, scheduling, ends) if bounded
                    else _switched_cycles(system, scheduling, columns, ends))
        return
    for path in _words(system, scheduling, columns, ends):
        yield path, np.ones(len(path))
    if bounded:
        yield from _slow_cycles(system, scheduling, ends)


def _neighbourhoods(system: Driven, scheduling: Scheduling, columns: list[int]) -> Iterator[np.ndarray]:
    """Sets of points between which every jump is admissible: the whole box, or boxes one step wide here and there."""
    ts = system.sample_time
    low, high = np.array(scheduling.lower), np.array(scheduling.upper)
    reach = np.array([math.inf if r is None or ts is None else r * ts for r in scheduling.rate])
    if np.all(reach >= high - low):
        yield _corners(low, high)
        return
    coarse = grid(scheduling, {1: 9, 2: 3}.get(len(low), 2))
    fine = grid(scheduling, {1: 101, 2: 11, 3: 5}.get(len(low), 3))
    worst = fine[np.argsort(frozen_rates(system, fine[:, columns]))[-2:]]
    for centre in np.vstack([worst, coarse]):
        half = 0.5 * np.minimum(reach, high - low)
        middle = np.clip(centre, low + half, high - half)
        yield _corners(middle - half, middle + half)


def _corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Corners (at most 16) and centre of a box; five equidistant points in one dimension."""
    if len(low) == 1:
        return np.linspace(low, high, 5)
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    return np.vstack([corners[:: max(1, len(corners) // 16)], 0.5 * (low + high)])


def _steps(system: Driven, scheduling: Scheduling) -> np.ndarray | None:
    """One variable: equidistant points from which the rate bound allows a step, where that takes few of them."""
    rate, ts = scheduling.rate[0], system.sample_time
    if len(scheduling.names) != 1 or not rate or ts is None:
        return None
    count = math.ceil((scheduling.upper[0] - scheduling.lower[0]) / (rate * ts)) + 1
    return grid(scheduling, max(count, 5)) if count <= 41 else None


def _words(system: Driven, scheduling: Scheduling, columns: list[int], ends: np.ndarray | None) -> Iterator[np.ndarray]:
    stepped = _steps(system, scheduling)
    for points in ([ends] if ends is not None else
                   (*_neighbourhoods(system, scheduling, columns), *(() if stepped is None else (stepped,)))):
        allowed = _admissible(system, scheduling, points)
        if any(r.lag for r in system.readings):
            yield from _delayed_words(points, allowed)
        else:
            yield from _beam(points, system.state_matrices(points[:, columns]), allowed)


def _beam(points: np.ndarray, matrices: np.ndarray, allowed: np.ndarray, longest: int = 8,
          beam: int = 160) -> Iterator[np.ndarray]:
    """Cycles up to `longest` samples through admissible steps: the best few of each length, by a beam."""
    words, products = np.arange(len(points))[:, None], matrices
    for _ in range(1, longest):
        last, following = np.nonzero(allowed[words[:, -1]])
        words = np.hstack([words[last], following[:, None]])
        products = matrices[following] @ products[last]
        closed = allowed[words[:, -1], words[:, 0]]
        radii = np.where(closed, np.abs(np.linalg.eigvals(products)).max(axis=1), 0.0)
        for index in np.argsort(radii)[-3:]:
            if radii[index] > 0:
                yield points[words[index]]
        size = np.linalg.norm(products, axis=(1, 2))
        keep = np.unique(np.concatenate([np.argsort(size)[-beam:], np.argsort(radii)[-beam // 4 :]]))
        words, products = words[keep], products[keep]


def _delayed_words(points: np.ndarray, allowed: np.ndarray) -> Iterator[np.ndarray]:
    """All short cycles: with delayed readings the matrix depends on the neighbours in the word."""
    for length in (2, 3, 4):
        for word in np.ndindex(*(len(points),) * length) if len(points) ** length <= 700 else ():
            if all(allowed[a, b] for a, b in zip(word, (*word[1:], word[0]), strict=True)):
                yield points[list(word)]


def _admissible(system: Driven, scheduling: Scheduling, points: np.ndarray) -> np.ndarray:
    assert system.sample_time is not None
    reach = np.array([math.inf if r is None else r * system.sample_time * (1 + 1e-12) for r in scheduling.rate])
    return np.all(np.abs(points[:, None] - points[None]) <= reach, axis=2)


def _slow_cycles(system: Driven, scheduling: Scheduling, ends: np.ndarray | None = None, longest: int = 1_500
                 ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Ramps at the rate bound between two points, with holds at the ends; of points given each and the farthest."""
    corners = grid(scheduling, 2)
    centre, half = scheduling.centre, corners[-1] - scheduling.centre
    pairs = [(corners[0], corners[-1])]
    pairs += [(centre + s * half - f * half, centre + s * half + f * half)
              for f, shifts in ((0.5, (-0.5, 0.0, 0.5)), (0.25, (-0.75, 0.0, 0.75))) for s in shifts]
    if len(scheduling.names) == 2:
        pairs.append((corners[1], corners[2]))
    if ends is not None:
        apart = np.linalg.norm((ends[:, None] - ends[None]) / np.maximum(half, 1e-300), axis=2)
        pairs = [(ends[i], ends[j]) for i, j in sorted({(min(i, j), max(i, j)) for i, j in enumerate(apart.argmax(1))})]
        middle = ends.mean(axis=0)
        pairs += [(0.5 * (middle + a), 0.5 * (middle + b)) for a, b in pairs]
    speeds = np.array([math.inf if r is None else r for r in scheduling.rate])
    for first, second in pairs:
        with np.errstate(divide="ignore", invalid="ignore"):
            times = np.abs(second - first) / speeds
        time = float(np.nanmax(times, initial=0.0))
        if not math.isfinite(time):
            continue
        fastest = float(np.abs(np.linalg.eigvals(system.coefficients.sum(axis=0))).max()) or 1.0
        tick = system.sample_time or max(time / 100, 0.02 / fastest)
        ramp = max(1, math.ceil(time / tick * (1 - 1e-12)))
        for hold in (0, 1, 2, 3, 5, 8, 16, 40, 120):
            if 2 * (ramp + hold) > longest:
                break
            share = np.concatenate([np.arange(ramp) / ramp, np.ones(hold + 1), 1 - np.arange(1, ramp) / ramp,
                                    np.zeros(hold)])
            yield first + share[:, None] * (second - first), np.full(len(share), tick)


def _switched_cycles(system: Driven, scheduling: Scheduling, columns: list[int], ends: np.ndarray | None = None
                     ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Continuous time, arbitrary variation: two or three points in turn, each held for a share of its own period."""
    points = _corners(np.array(scheduling.lower), np.array(scheduling.upper)) if ends is None else ends
    poles = np.linalg.eigvals(system.state_matrices(points[:, columns]))
    natural = np.abs(poles.imag).max(axis=1)
    natural = np.where(natural > 0, natural, np.abs(poles).max(axis=1))
    shares = np.array([0.125, 0.25, 0.5, 0.75, 1.0])
    for i in range(len(points)):
        for j in range(i + 1, len(points)):
            for a in shares * math.pi / max(natural[i], 1e-12):
                for b in shares * math.pi / max(natural[j], 1e-12):
                    yield points[[i, j]], np.array([a, b])
