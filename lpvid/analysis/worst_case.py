"""Moving schedulings with a large gain, and the inputs that reach it: lower bounds of an induced gain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from lpvid.analysis.path_ascent import ascended
from lpvid.codec import Coded, null
from lpvid.lmi.driven import Driven
from lpvid.scheduling import Scheduling

STEPS = 32  # per period
LONGEST = 1_600  # steps of a simulation
ITERATIONS = 12


@dataclass(frozen=True, eq=False)
class WorstCase(Coded):
    """A scheduling with which the gain is at least `gain`.

    Parameters
    ----------
    kind : str
        "frozen" or "periodic".
    names, units : tuple of str
        Scheduling variables as read.
    points : (L, len(names)) array
        One period, equally spaced in time; one row for a frozen scheduling.
    period : float
        [s]; 0 for a frozen scheduling.
    frequency : float
        Of the worst input at a frozen scheduling [rad/s]; not a number for a periodic one.
    gain : float
    """

    kind: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    points: np.ndarray
    period: float
    frequency: float = field(metadata=null(math.nan))
    gain: float

    @classmethod
    def frozen(cls, box: Scheduling, point: np.ndarray, frequency: float, gain: float) -> WorstCase:
        """One value, held.

        Parameters
        ----------
        box : Scheduling
            Names and units of the readings.
        point : (readings,) array
            Held value of each reading, in the variable's unit.
        frequency : float
            Of the worst input [rad/s].
        gain : float
            Reached there.

        Returns
        -------
        WorstCase
            Of kind "frozen", with period 0.
        """
        return cls("frozen", box.names, box.units, np.array(point, dtype=float).reshape(1, -1), 0.0, frequency, gain)

    @classmethod
    def array_shapes(cls, values: Mapping) -> dict[str, tuple[int, ...]]:
        return {"points": (len(values["points"]), len(values["names"]))}

    def __str__(self) -> str:
        if self.kind == "frozen":
            at = ", ".join(f"{n} = {v:.6g} {u}".rstrip() for n, v, u in
                           zip(self.names, self.points[0], self.units, strict=True))
            return f"reached at {self.frequency / (2 * math.pi):.4g} Hz" + (f" with {at} held" if at else "")
        spans = ", ".join(f"{n} between {lo:.6g} and {up:.6g} {u}".rstrip() for n, lo, up, u in
                          zip(self.names, self.points.min(axis=0), self.points.max(axis=0), self.units, strict=True))
        return f"reached on a trajectory with period {self.period:.4g} s, {spans}"


@dataclass(frozen=True, eq=False)
class _Cycle:
    """centre + amplitude · shape(t/period − phase): a triangle, or a square where a variable may jump."""

    centre: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    period: float

    def path(self, box: Scheduling, steps: int) -> np.ndarray:
        """(steps, variables) in the middle of each step."""
        turn = (np.arange(steps)[:, None] + 0.5) / steps - self.phase
        triangle = 4 * np.abs(turn - np.floor(turn + 0.5)) - 1
        jumps = np.array([r is None for r in box.rate])
        wave = np.where(jumps, np.where(triangle >= 0, 1.0, -1.0), triangle)
        return np.clip(self.centre + self.amplitude * wave, box.lower, box.upper)


def worst_trajectory(system: Driven, box: Scheduling, frozen: WorstCase) -> WorstCase:
    """The moving scheduling with the largest gain found, or `frozen` where none beats it.

    Periodic triangles within the rate bounds, squares where a variable may jump; the worst input of each is found by
    power iteration on the simulated response and its adjoint, over a window with zero state at its start. The best
    ones are varied at random. A search like this can only underestimate.

    Parameters
    ----------
    system : Driven
        Frozen-stable.
    box : Scheduling
        Of the readings.
    frozen : WorstCase

    Returns
    -------
    WorstCase
        `frozen` itself where nothing can move, and for a system that reads p at several times.
    """
    if not system.order or not any(u > lo and r != 0 for lo, u, r in
                                   zip(box.lower, box.upper, box.rate, strict=True)):
        return frozen
    if any(r.lag for r in system.readings):
        return frozen  # readings at several times do not move independently
    rng = np.random.default_rng(0)
    cycles = _cycles(system, box)
    gain, best = -1.0, cycles[0]
    for _ in range(4):
        gains = _gains(system, box, cycles, STEPS)
        order = np.argsort(gains)
        if gains[order[-1]] > gain:
            gain, best = float(gains[order[-1]]), cycles[order[-1]]
        cycles = [_varied(c, box, system, rng) for c in (best, cycles[order[-2 % len(order)]]) for _ in range(8)]
    if system.sample_time is None:
        gain = _beyond_steps(gain, float(_gains(system, box, [best], 4 * STEPS)[0]))
    path, period = best.path(box, _steps(system, best)), best.period
    for start, length in [(path, period), *_held(system, frozen)]:
        risen = ascended(lambda points, tick: _forms(system, points, tick), box, start, length / len(start))
        uphill = _gain_of(system, box, risen, length)
        if uphill > gain:
            path, period, gain = risen, length, uphill
    if not gain > frozen.gain:
        return frozen
    return WorstCase("periodic", box.names, box.units, path, period, math.nan, gain)


def _held(system: Driven, frozen: WorstCase) -> list[tuple[np.ndarray, float]]:
    """The worst scheduling that is held, as paths with once and twice the period of half its input's: what a change of
    stiffness feeds comes twice per cycle."""
    if not 0 < frozen.frequency < math.inf:
        return []
    found = []
    for turns in (0.5, 1.0):
        period, steps = turns * 2 * math.pi / frozen.frequency, STEPS
        if system.sample_time is not None:
            steps = max(2, round(period / system.sample_time))
            period = steps * system.sample_time
        if steps <= LONGEST // 4:
            found.append((np.repeat(frozen.points, steps, axis=0), period))
    return found


def _gain_of(system: Driven, box: Scheduling, path: np.ndarray, period: float) -> float:
    """Gain along one period of a path, repeated; in continuous time less what is owed to its steps."""
    def gain(points: np.ndarray) -> float:
        parts = _sampled(system, points, np.full(len(points), period / len(points)))
        if parts is None:
            return 0.0
        shaped = [x[None] for x in parts]
        found = float(_power_iteration(shaped, _repeats(shaped[0], len(points)))[0])
        return found if math.isfinite(found) else 0.0

    if system.sample_time is not None:
        return gain(path)
    finer = np.repeat(path, 4, axis=0)
    ahead = np.roll(path, -1, axis=0)
    for i, rate in enumerate(box.rate):
        if rate is not None:  # what moves at a bounded rate does so between the steps
            finer[:, i] = (path[:, None, i] + np.arange(4) / 4 * (ahead - path)[:, None, i]).ravel()
    return _beyond_steps(gain(path), gain(finer))


def _beyond_steps(coarse: float, fine: float) -> float:
    """Gain that is not owed to a scheduling which moves in steps, from that with so many and with four times as many.

    Points in the middle of the steps err by h² of their length: what a quarter of the length changes is 15 times what
    is left, and all of it is taken off.
    """
    return fine - abs(coarse - fine)


def _cycles(system: Driven, box: Scheduling) -> list[_Cycle]:
    half, centre = box.half_width, box.centre
    v = len(half)
    natural = _natural(system, box)
    directions = list(np.eye(v)) + ([np.array(s) for s in itertools.product((1.0, -1.0), repeat=v)
                                                if s[0] > 0] if 1 < v <= 4 else [])
    found = []
    for direction, (size, shifts) in itertools.product(directions, ((1.0, (0.0,)), (0.5, (-0.5, 0.0, 0.5)))):
        for shift in shifts:
            amplitude = size * half * direction
            for period in [_soonest(box, amplitude)] + [c * 2 * math.pi / w for w in natural for c in (0.5, 1.0, 2.0)]:
                cycle = _Cycle(centre + shift * half * np.abs(direction), amplitude, np.zeros(v), period)
                found.append(_admissible(cycle, box, system))
    if v == 2:
        found += [_admissible(_Cycle(centre, half, np.array([0.0, 0.25]), 2 * math.pi / w), box, system)
                  for w in natural]
    return found[:64]


def _natural(system: Driven, box: Scheduling) -> list[float]:
    """Up to three frequencies [rad/s] of the frozen system in the middle of the box."""
    poles = np.linalg.eigvals(system.matrices(box.centre[None, :])[0][0])
    if system.sample_time is not None:
        poles = np.log(np.where(np.abs(poles) > 1e-6, poles, 1e-6).astype(complex)) / system.sample_time
    sizes = np.unique(np.round(np.maximum(np.abs(poles), 1e-12), 12))
    return [float(x) for x in sizes[[0, len(sizes) // 2, -1][: len(sizes)]]]


def _soonest(box: Scheduling, amplitude: np.ndarray) -> float:
    """Shortest period [s] of a triangle that keeps the rates; 0 where everything may jump."""
    return max((4 * abs(a) / r for a, r in zip(amplitude, box.rate, strict=True) if r and a), default=0.0)


def _admissible(cycle: _Cycle, box: Scheduling, system: Driven) -> _Cycle:
    """The cycle within the rates and with a period that simulation can resolve."""
    still = np.array([r == 0 for r in box.rate])
    amplitude = np.where(still, 0.0, cycle.amplitude)
    tick = 2 * (system.sample_time or 0.0)
    period = max(cycle.period, _soonest(box, amplitude) * (1 + 1e-9), tick, 1e-9)
    if system.sample_time is not None:
        period = system.sample_time * math.ceil(period / system.sample_time * (1 - 1e-9))
    return _Cycle(cycle.centre, amplitude, cycle.phase, period)


def _varied(cycle: _Cycle, box: Scheduling, system: Driven, rng: np.random.Generator) -> _Cycle:
    half, v = box.half_width, len(box.half_width)
    amplitude = np.clip(cycle.amplitude * np.exp(0.3 * rng.normal(size=v)), -half, half)
    centre = np.clip(cycle.centre + 0.2 * rng.normal(size=v) * half, box.lower + np.abs(amplitude),
                     np.maximum(box.upper - np.abs(amplitude), box.lower + np.abs(amplitude)))
    trial = _Cycle(centre, amplitude, cycle.phase + 0.05 * rng.normal(size=v) * (v > 1),
                   cycle.period * math.exp(0.4 * rng.normal()))
    return _admissible(trial, box, system)


def _steps(system: Driven, cycle: _Cycle, steps: int = STEPS) -> int:
    return max(2, round(cycle.period / system.sample_time)) if system.sample_time is not None else steps


def _gains(system: Driven, box: Scheduling, cycles: list[_Cycle], steps: int) -> np.ndarray:
    """(len(cycles),) gains, cycles of a like number of steps together."""
    found = np.zeros(len(cycles))
    lengths = np.array([_steps(system, c, steps) for c in cycles])
    for length in np.unique(lengths):
        index = np.flatnonzero(lengths == length)
        if length > LONGEST:
            continue
        paths = np.stack([cycles[i].path(box, int(length)) for i in index])
        flat = paths.reshape(-1, paths.shape[2])
        tick = np.repeat([cycles[i].period / length for i in index], length)
        parts = _sampled(system, flat, tick)
        if parts is None:
            continue
        shaped = [x.reshape(len(index), length, *x.shape[1:]) for x in parts]
        found[index] = _power_iteration(shaped, _repeats(shaped[0], int(length)))
    return np.where(np.isfinite(found), found, 0.0)


def _forms(system: Driven, points: np.ndarray, tick: np.ndarray | float) -> tuple[np.ndarray, np.ndarray] | None:
    """Steps [A B] and energies of the sampled system whose ℓ2 gain is the L2 gain for inputs that are held for a step.

    ∫ |z|² over a step is a quadratic form in (x, w), whose factor gives the output matrices (Van Loan 1978).
    """
    a, b, c, d = system.matrices(points)
    output = np.concatenate([c, d], axis=2)
    if system.sample_time is not None:
        return np.concatenate([a, b], axis=2), output.swapaxes(1, 2) @ output
    from scipy.linalg import expm

    tick = np.broadcast_to(tick, (len(points),))

    count, n, m = len(points), a.shape[1], b.shape[2]
    f = np.zeros((count, n + m, n + m))
    f[:, :n, :n], f[:, :n, n:] = a, b
    big = np.zeros((count, 2 * (n + m), 2 * (n + m)))
    big[:, : n + m, : n + m], big[:, n + m :, n + m :] = -f.swapaxes(1, 2), f
    big[:, : n + m, n + m :] = output.swapaxes(1, 2) @ output
    if float((np.abs(f).sum(axis=2).max(axis=1) * tick).max(initial=0.0)) > 30:
        return None  # the step is too long for the fastest mode
    whole = expm(big * tick[:, None, None])
    step = whole[:, n + m :, n + m :]
    energy = step.swapaxes(1, 2) @ whole[:, : n + m, n + m :] / tick[:, None, None]
    return step[:, :n], 0.5 * (energy + energy.swapaxes(1, 2))


def _sampled(system: Driven, points: np.ndarray, tick: np.ndarray) -> list[np.ndarray] | None:
    """Matrices A, B, C, D of the sampled system, C and D from a factor of the energy."""
    if system.sample_time is not None:
        return list(system.matrices(points))
    found = _forms(system, points, tick)
    if found is None:
        return None
    step, energy = found
    n = step.shape[1]
    values, vectors = np.linalg.eigh(energy)
    factor = np.sqrt(np.maximum(values, 0.0))[:, :, None] * vectors.swapaxes(1, 2)
    return [step[:, :n, :n], step[:, :n, n:], factor[:, :, :n], factor[:, :, n:]]


def _repeats(a: np.ndarray, length: int) -> int:
    """Periods to simulate: until the slowest cycle has forgotten most of its start."""
    product = np.broadcast_to(np.eye(a.shape[2]), (len(a), *a.shape[2:]))
    for k in range(length):
        product = a[:, k] @ product
    radius = float(np.clip(np.abs(np.linalg.eigvals(product)).max(), 1e-3, 0.999))
    return int(np.clip(math.ceil(4 / -math.log(radius)) + 2, 3, max(3, LONGEST // length)))


def _power_iteration(parts: list[np.ndarray], repeats: int) -> np.ndarray:
    """(K,) gains ‖z‖/‖w‖ of K periodic systems over a finite window, from zero state."""
    a, b, c, d = parts
    count, length = a.shape[:2]
    total = repeats * length
    w = np.random.default_rng(1).normal(size=(total, count, b.shape[3], 1))
    gain = np.zeros(count)
    for _ in range(ITERATIONS):
        w = w / np.maximum(np.sqrt((w**2).sum(axis=(0, 2, 3))), 1e-300)[None, :, None, None]
        x, z = np.zeros((count, a.shape[2], 1)), np.empty((total, count, c.shape[2], 1))
        for k in range(total):
            i = k % length
            z[k] = c[:, i] @ x + d[:, i] @ w[k]
            x = a[:, i] @ x + b[:, i] @ w[k]
        gain = np.sqrt((z**2).sum(axis=(0, 2, 3)))
        costate = np.zeros_like(x)
        for k in range(total - 1, -1, -1):
            i = k % length
            w[k] = b[:, i].swapaxes(1, 2) @ costate + d[:, i].swapaxes(1, 2) @ z[k]
            costate = a[:, i].swapaxes(1, 2) @ costate + c[:, i].swapaxes(1, 2) @ z[k]
    return gain
