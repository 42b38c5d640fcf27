"""The law of a core, tabulated as a function of the speed, for elements in series with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lpvid.baselines.budgets import LONG
from lpvid.baselines.signals import Core, Signals
from lpvid.condition.constancy import DISTINCT
from lpvid.rounding import EPS, HALF_DIGITS, STEP, TINY
from quartercar.effects.electrical import held
from quartercar.effects.viscous import SLOW

NODES = 257
"""number of speeds at which a law is tabulated"""
REACH = 6.0
"""largest of them, in largest speeds of the record"""
SEEN = 48
"""number of samples at which a law is tabulated, evenly in time"""
RAMP = 0.1
"""share of the current's range that is a steep change of one that is not held; smaller ones are nearly linear"""
RANK = STEP
"""largest error of the combination of few speeds, as a share of the law's size, increasing with the speed"""
SAME = HALF_DIGITS
"""relative difference below which the output of a core does not depend on the other samples: it has no memory"""
SOFTEST = 0.05
"""least such slope, in slopes of the regression of the force on the speed"""


@dataclass(frozen=True, eq=False)
class Law:
    """F(w) = Σ_r b_r φ_r(w) at every sample.

    Attributes
    ----------
    speeds : (G,) array
        Nodes.
    nodes : (G, r) array
        φ there.
    rows, before, tilt : (n, r) arrays
        b at the samples, just before them where the current is held, and −∂b/∂x.
    jumps, steep : (n,) bool arrays
        Samples at which the current jumps; those before which the force changes fast.
    memory : bool
        Whether the core has memory: the law is then linear in the speed at every sample.
    rest : float
        Force at rest, which acts in parallel to the elements [N].
    """

    speeds: np.ndarray
    nodes: np.ndarray
    rows: np.ndarray
    before: np.ndarray
    tilt: np.ndarray
    jumps: np.ndarray
    steep: np.ndarray
    memory: bool = False
    rest: float = 0.0


def read_law(core: Core, s: Signals, rigid: np.ndarray, deflection: np.ndarray, static: bool) -> Law:
    """The law of a core along signals.

    Parameters
    ----------
    core : Core
    s : Signals
    rigid : (n,) array
        The core along them.
    deflection : (n,) array
        Approximate difference of the displacement and the position that the law reads [m].
    static : bool
        Whether the core may be without memory.

    Returns
    -------
    Law
        One with memory where the core may have memory, or its force decreases with the speed.
    """
    speeds = _nodes_of(s)
    seen = _table_samples(s)
    few_samples = s.cached("a law's samples", lambda: _at_samples(s, seen))
    here = core(few_samples)
    if not static or not np.allclose(here, rigid[seen], rtol=SAME, atol=SAME * np.ptp(rigid)):
        return with_memory(core, s, rigid)
    table = core(s.cached("a law's samples at every speed", lambda: _at_speeds(few_samples, speeds)))
    table = table.reshape(speeds.size, seen.size)
    turned = None
    if s.has("displacement"):
        moved = few_samples.evaluated(displacement=(s["displacement"] - deflection)[seen])
        if not np.array_equal(core(moved), here):  # the law depends on the position
            turned = core(_at_speeds(moved, speeds)).reshape(table.shape)
    size = float(np.abs(table).max())
    if not size < np.sqrt(np.finfo(float).max / table.size) or np.diff(table, axis=0).min() < -SAME * size:
        return with_memory(core, s, rigid)
    return replace(_combined(core, s, speeds, table, turned, deflection), rest=force_at_rest(core, s))


def force_at_rest(core: Core, s: Signals) -> float:
    """Mean force of a core without memory at rest in the middle of the stroke [N], as of a gas.

    Parameters
    ----------
    core : Core
    s : Signals

    Returns
    -------
    float
    """
    few_samples = s.cached("a law's samples", lambda: _at_samples(s, _table_samples(s)))
    still = {role: np.zeros(few_samples.n_samples) for role in ("velocity", "displacement") if s.has(role)}
    return float(np.mean(core(few_samples.evaluated(**still))))


def _combined(core: Core, s: Signals, speeds: np.ndarray, table: np.ndarray, turned: np.ndarray | None,
              deflection: np.ndarray) -> Law:
    """The law at every speed as a linear combination of its values at few speeds."""
    scale = 1 + REACH * np.abs(speeds) / speeds[-1]
    picks, shapes = _spanning((table if turned is None else np.hstack([table, turned])) / scale[:, None])
    shapes *= scale[:, None] / scale[picks]
    chosen = speeds[picks]

    def along(signals: Signals) -> np.ndarray:
        out, at_once = np.empty((s.n_samples, chosen.size)), max(LONG // s.n_samples, 1)
        for k in range(0, chosen.size, at_once):
            part = chosen[k:k + at_once]
            there = _at_speeds(signals, part, signals.record or signals) if part.size > 1 else \
                signals.evaluated(velocity=np.full(s.n_samples, part[0]))
            out[:, k:k + part.size] = core(there).reshape(part.size, s.n_samples).T
        return out

    rows = along(s)
    before, tilt = rows, np.zeros_like(rows)
    if turned is not None:
        reach = np.where(np.abs(deflection) > HALF_DIGITS, deflection, HALF_DIGITS)
        there = along(s.evaluated(displacement=s["displacement"] - reach))
        tilt = (there - rows) / reach[:, None]
    jumps, steep = _current_changes(s)
    if jumps.any():
        earlier = np.concatenate([rows[:1], rows[:-1]])
        if turned is not None:
            earlier[1:] -= tilt[:-1] * np.diff(s["displacement"])[:, None]
        before = np.where(jumps[:, None], earlier, rows)
    return Law(speeds, shapes, rows, before, tilt, jumps, steep)


def with_memory(core: Core, s: Signals, rigid: np.ndarray) -> Law:
    """F(w) = core + c'(w − v), c' the core's local slope: equation sheet 9.3, for cores with memory or falling force.

    Parameters
    ----------
    core : Core
    s : Signals
        With velocity.
    rigid : (n,) array
        The core along them [N].

    Returns
    -------
    Law
        Of the shapes 1 and w, its slope at least `SOFTEST` of that of the regression of the force on the speed.
    """
    v, speeds = s["velocity"], _nodes_of(s)
    change = SLOW * (float(np.sqrt(np.mean(v**2))) or 1.0)
    faster, slower = (s.along_others("a little faster", c, lambda c=c: s.evaluated(velocity=v + c), core)
                      for c in (change, -change))
    slope = (faster - slower) / (2 * change)
    least = SOFTEST * max(float(v @ rigid), 0.0) / max(float(v @ v), TINY)
    slope = np.maximum(slope, max(least, EPS))
    rows = np.column_stack([rigid - slope * v, slope])
    shapes = np.column_stack([np.ones(speeds.size), speeds])
    return Law(speeds, shapes, rows, rows, np.zeros_like(rows), *np.zeros((2, s.n_samples), dtype=bool), memory=True)


def _spanning(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a table of which all others are combinations, and the combinations: rows ≈ shapes @ rows[picks].

    Orthogonalisation with pivoting by the norms of the residual rows (Gram-Schmidt), down to `RANK` of the largest.

    Returns
    -------
    picks : (r,) array of int
    shapes : (G, r) array
        The identity in the rows of `picks`.

    Examples
    --------
    >>> picks, shapes = _spanning(np.outer([1.0, 2.0, 4.0], [1.0, 3.0]))
    >>> picks, shapes.ravel()
    (array([2]), array([0.25, 0.5 , 1.  ]))
    """
    picks, parts = [], []
    directions = np.empty((0, rows.shape[1]))
    sizes = np.einsum("gk,gk->g", rows, rows)
    largest = float(sizes.max())
    while len(picks) < min(rows.shape):
        k = int(np.argmax(sizes))
        if picks and not sizes[k] > RANK**2 * largest:
            break
        rest = rows[k]
        for _ in range(2):  # once more: the residual row may be far smaller than the row
            rest = rest - (directions @ rest) @ directions
        direction = rest / max(float(np.sqrt(rest @ rest)), TINY)
        along = rows @ direction
        along[picks] = 0.0
        sizes = sizes - along**2
        picks.append(k)
        sizes[picks] = 0.0
        directions = np.vstack([directions, direction])
        parts.append(along)
    weights = np.column_stack(parts)
    if not largest > TINY:  # a law that is zero everywhere
        return np.array(picks), np.zeros_like(weights)
    lower, shapes = weights[picks], weights
    for k in range(len(picks) - 1, -1, -1):  # shapes @ lower = weights, without BLAS, which starts threads
        shapes[:, k] = (weights[:, k] - shapes[:, k + 1:] @ lower[k + 1:, k]) / lower[k, k]
    shapes[picks] = np.eye(len(picks))
    return np.array(picks), shapes


def _top_speed(s: Signals) -> float:
    """Largest speed [m/s]; 1 m/s where there is no motion."""
    return s.fact("velocity", "top speed", lambda v: float(np.abs(v).max())) or 1.0


def _nodes_of(s: Signals) -> np.ndarray:
    """(G,) speeds at which a law is tabulated along these signals, evenly in asinh(w/w_0), w_0 `SLOW` of the top."""
    return SLOW * _top_speed(s) * np.sinh(np.linspace(-1.0, 1.0, NODES) * np.arcsinh(REACH / SLOW))


def _table_samples(s: Signals) -> np.ndarray:
    """Samples evenly in time, and those where a channel is largest or smallest."""
    def make() -> np.ndarray:
        ends = [k for c in s.channels.values() for k in (int(np.argmax(c)), int(np.argmin(c)))]
        even = np.linspace(0, s.n_samples - 1, SEEN).round().astype(int)
        return np.unique(np.concatenate([even, np.array(ends, dtype=int)]))

    return s.cached("samples at which a law is read", make)


def _at_speeds(s: Signals, speeds: np.ndarray, record: Signals | None = None) -> Signals:
    """Signals with these samples at every speed; their record is `record`, or that of the samples."""
    count = speeds.size
    channels = {role: np.tile(c, count) for role, c in s.channels.items()}
    channels["velocity"] = np.repeat(speeds, s.n_samples)
    return Signals(s.sample_time, channels, np.tile(s.output, count), s.name, s.span, record=record or s.record,
                   at=np.tile(s.places, count), finer=s.finer, peers=s.peers, repeats=(s, count))


def _current_changes(s: Signals) -> tuple[np.ndarray, np.ndarray]:
    """(n,) bool each: samples at which a held current jumps, and those whose interval needs short steps."""
    jumps, steep = np.zeros((2, s.n_samples), dtype=bool)
    if s.has("current"):
        change = np.abs(np.diff(s["current"]))
        if held(s):
            jumps[1:] = change > DISTINCT * np.ptp(s["current"])
            steep[1:] = jumps[:-1]
        else:
            steep[1:] = change > RAMP * np.ptp(s["current"])
    return jumps, steep


def _at_samples(s: Signals, seen: np.ndarray) -> Signals:
    channels = {role: c[seen] for role, c in s.channels.items()}
    return Signals(s.sample_time, channels, s.output[seen], s.name, s.span, record=s.record or s, at=s.places[seen])
