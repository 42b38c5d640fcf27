"""Shares of a simulation: how its force grows with the speed, and what is left of it without any."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.signals import Core, Signals
from lpvid.toolkit import found_once

TOP = 0.999
"""quantile of the speed at which the slope of a law is taken"""
HALF = 0.6
"""share of it that is the lower speed"""
KEPT = 4
"""sets of shares that signals keep"""


def viscous_slope(s: Signals, core: Core, baseline: Baseline) -> np.ndarray:
    """(n,) c(i) ≥ 0, the growth of the force with the speed [N·s/m].

    Of a core without memory between two high speeds, at every sample's current and position; of one with memory by
    regression of its force on the speed.

    Parameters
    ----------
    s : Signals
        With velocity.
    core : Core
        Force [N].
    baseline : Baseline
        Innermost law of the core.

    Returns
    -------
    (n,) array
        The same at all samples of a core with memory.
    """
    v = s["velocity"]
    if not baseline.static:
        return np.full(s.n_samples, max(_regressed(v, core(s)), 0.0))
    if s.record is not None:
        kept = _kept(s, s.record, core)
        return np.where(v < 0, kept.falling, kept.rising)
    signs = s.fact("velocity", "direction without rest", lambda v: np.where(v < 0, -1.0, 1.0))
    fast = s.cached("signals at high speed", lambda: s.evaluated(velocity=signs * _top(s)))
    slower = s.cached("signals at a lower speed", lambda: s.evaluated(velocity=signs * (HALF * _top(s))))
    return np.maximum(signs * (core(fast) - core(slower)) / ((1 - HALF) * _top(s)), 0.0)


def static_share(s: Signals, core: Core, baseline: Baseline) -> np.ndarray:
    """(n,) the force that no motion makes, of gas and preload [N]; 0 for a core with memory.

    Whatever turns round with the speed, Coulomb's friction and a yield force too, drops out of
    e(v) = (F(v) + F(−v))/2; two high speeds, extrapolated to none, leave out what grows with the speed in one direction
    more than in the other. An unequal yield stays in it, but not in the force at rest; a hysteresis stays in that, but
    not in e: the smaller of the two counts, and none where they differ in sign.

    Parameters
    ----------
    s : Signals
        With velocity.
    core : Core
        Force [N].
    baseline : Baseline
        Innermost law of the core.

    Returns
    -------
    (n,) array
    """
    if not baseline.static:
        return np.zeros(s.n_samples)
    return _kept(s, s if s.record is None else s.record, core).static


@dataclass(frozen=True, eq=False)
class _Shares:
    """Slopes in either direction, and the static share, of a core at signals, each worked out when it is read.

    Attributes
    ----------
    s : Signals
    core : Core
    top : float
        The higher of the two speeds [m/s].
    count : int
        How many times the samples are repeated.
    channels : list of arrays
        That these belong to.
    """

    s: Signals
    core: Core
    top: float
    count: int
    channels: list[np.ndarray]

    def _at(self, share: float) -> np.ndarray:
        """The core at a share of the top speed."""
        return self.core(self.s.evaluated(velocity=np.full(self.s.n_samples, share * self.top)))

    @found_once
    def _forwards(self) -> tuple[np.ndarray, np.ndarray]:
        return self._at(1.0), self._at(HALF)

    @found_once
    def _backwards(self) -> tuple[np.ndarray, np.ndarray]:
        return self._at(-1.0), self._at(-HALF)

    @found_once
    def rising(self) -> np.ndarray:
        """(n,) slope at positive speeds [N·s/m]."""
        high, low = self._forwards
        return self._repeated(np.maximum((high - low) / ((1 - HALF) * self.top), 0.0))

    @found_once
    def falling(self) -> np.ndarray:
        """(n,) slope at negative speeds [N·s/m]."""
        high, low = self._backwards
        return self._repeated(np.maximum((low - high) / ((1 - HALF) * self.top), 0.0))

    @found_once
    def static(self) -> np.ndarray:
        """(n,) static share [N]."""
        (high, low), (back_high, back_low) = self._forwards, self._backwards
        even, even_low = (high + back_high) / 2, (low + back_low) / 2
        even, still = even_low - (even - even_low) * HALF / (1 - HALF), self._at(0.0)
        share = np.where(even * still > 0, np.sign(still) * np.minimum(np.abs(even), np.abs(still)), 0.0)
        return self._repeated(share)

    def _repeated(self, values: np.ndarray) -> np.ndarray:
        return np.tile(values, self.count) if self.count > 1 else values


def _kept(s: Signals, record: Signals, core: Core) -> _Shares:
    """The shares of signals, kept while a law is evaluated at one speed after the other."""
    rest = [s[r] for r in s.channels if r != "velocity"]
    kept: OrderedDict = record.cached("shares of the force", OrderedDict)
    key = (core, s.n_samples, *map(id, rest))
    found = kept.pop(key, None)
    if found is None:  # channels kept alive keep their identity
        few, count = s.distinct
        found = _Shares(few, core, _top(s), count, rest)
    kept[key] = found
    with suppress(KeyError):  # several threads may share the signals
        if len(kept) > KEPT:
            kept.popitem(last=False)
    return found


def measured_slope(signals: Sequence[Signals]) -> float:
    """Slope of the measured force over the speed, in its upper half [N·s/m]: a scale for thresholds.

    Parameters
    ----------
    signals : sequence of Signals
        With velocity; the output is the force [N].

    Returns
    -------
    float
        Above zero.
    """
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
    """Quantiles of the speed over all records [m/s].

    Parameters
    ----------
    signals : sequence of Signals
        With velocity.
    shares : sequence of float
        From 0 to 1.

    Returns
    -------
    list of float
        One for each share.
    """
    speed = np.concatenate([np.abs(s["velocity"]) for s in signals])
    return [float(q) for q in np.quantile(speed, shares)]


def _top(s: Signals) -> float:
    """Of the record, where a law is only evaluated at these signals."""
    return (s.record or s).fact("velocity", "fast", lambda v: float(np.quantile(np.abs(v), TOP))) or 1e-6


def _regressed(v: np.ndarray, force: np.ndarray) -> float:
    """Least-squares slope through force and speed."""
    centred = v - v.mean()
    return float(centred @ force) / max(float(centred @ centred), 1e-300)
