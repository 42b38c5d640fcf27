"""The viscous share of a simulation: how its force grows with the speed once everything else has settled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.signals import Core, Signals

TOP = 0.999
"""quantile of the speed at which the slope of a law is taken"""
HALF = 0.6
"""share of it that is the lower speed"""


def viscous_slope(s: Signals, core: Core, baseline: Baseline) -> np.ndarray:
    """(n,) c(i) ≥ 0, the growth of the force with the speed [N·s/m].

    Of a core without memory between two high speeds, at every sample's current and position; of one with memory by
    regression of its force on the speed.
    """
    v = s["velocity"]
    if not baseline.static:
        return np.full(s.n_samples, max(_regressed(v, core(s)), 0.0))
    top = _top(s)
    signs = s.cached("direction without rest", lambda: np.where(v < 0, -1.0, 1.0))
    fast = s.cached("signals at high speed", lambda: s.replace(velocity=signs * top))
    slower = s.cached("signals at a lower speed", lambda: s.replace(velocity=signs * (HALF * top)))
    return np.maximum(signs * (core(fast) - core(slower)) / ((1 - HALF) * top), 0.0)


def measured_slope(signals: Sequence[Signals]) -> float:
    """Slope of the measured force over the speed, in its upper half [N·s/m]: a scale for thresholds."""
    top = max(_top(s) for s in signals)
    v = np.concatenate([np.abs(s["velocity"]) for s in signals])
    f = np.concatenate([s.output * np.sign(s["velocity"]) for s in signals])
    fast, medium = v > 0.6 * top, (v > 0.2 * top) & (v < 0.4 * top)
    whole = abs(_regressed(v, f))
    if not fast.any() or not medium.any():
        return max(whole, 1e-9)
    rise = float(f[fast].mean() - f[medium].mean()) / float(v[fast].mean() - v[medium].mean())
    return max(rise, 0.1 * whole, 1e-9)


def speed_quantiles(signals: Sequence[Signals], shares: Sequence[float]) -> list[float]:
    """Quantiles of the speed over all records [m/s]."""
    speed = np.concatenate([np.abs(s["velocity"]) for s in signals])
    return [float(q) for q in np.quantile(speed, shares)]


def _top(s: Signals) -> float:
    return float(s.cached("fast", lambda: np.quantile(np.abs(s["velocity"]), TOP))) or 1e-6


def _regressed(v: np.ndarray, force: np.ndarray) -> float:
    """Least-squares slope through force and speed."""
    centred = v - v.mean()
    return float(centred @ force) / max(float(centred @ centred), 1e-300)
