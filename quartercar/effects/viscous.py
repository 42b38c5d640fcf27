"""Shares of a simulated force: its slope over the speed, and its static share."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.budgets import REPLACED
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import MOST_SIZES
from lpvid.rounding import TINY
from lpvid.toolkit import found_once

SLOW = 0.01
"""share of a record's largest or rms speed that is slow: a friction reverses there, a law is even between the nodes of
its table, its slope is a difference, and a motion that differs by less is the same"""
TOP = 0.999
"""quantile of the speed at which the slope of a law is taken"""


def viscous_slope(s: Signals, core: Core, baseline: Baseline) -> np.ndarray:
    """(n,) c(i) ≥ 0, the slope of the force over the speed [N·s/m].

    For a core without memory between two high speeds, at the current and position of every sample; for one with memory
    by regression of its force on the speed.

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
        shares = _cached_shares(s, s.record, core)
        return np.where(v < 0, shares.falling, shares.rising)
    signs = s.fact("velocity", "direction without rest", lambda v: np.where(v < 0, -1.0, 1.0))
    fast = s.cached("signals at high speed", lambda: s.evaluated(velocity=signs * _top(s)))
    slower = s.cached("signals at a lower speed", lambda: s.evaluated(velocity=signs * (0.5 * _top(s))))
    return np.maximum(signs * (core(fast) - core(slower)) / (0.5 * _top(s)), 0.0)


def static_share(s: Signals, core: Core, baseline: Baseline) -> np.ndarray:
    """(n,) force without motion, of gas and preload [N]; 0 for a core with memory.

    Odd functions of the speed, also Coulomb friction and a yield force, cancel in e(v) = (F(v) + F(−v))/2, and its
    linear extrapolation from two high speeds to zero removes a slope that is larger in one direction. A yield that
    differs between the directions remains in e(0), but not in the force at rest; hysteresis remains in the latter, but
    not in e(0). The share is the smaller of the two, and zero where they differ in sign.

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
    return _cached_shares(s, s if s.record is None else s.record, core).static


@dataclass(frozen=True, eq=False)
class _Shares:
    """Slopes in either direction, and the static share, of a core along signals, each computed at first use.

    Attributes
    ----------
    s : Signals
    core : Core
    top : float
        The higher of the two speeds [m/s].
    count : int
        Number of repetitions of the samples.
    channels : list of arrays
        For which these hold; a reference keeps their identities unique.
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
        return self._at(1.0), self._at(0.5)

    @found_once
    def _backwards(self) -> tuple[np.ndarray, np.ndarray]:
        return self._at(-1.0), self._at(-0.5)

    @found_once
    def rising(self) -> np.ndarray:
        """(n,) slope at positive speeds [N·s/m]."""
        high, low = self._forwards
        return self._repeated(np.maximum((high - low) / (0.5 * self.top), 0.0))

    @found_once
    def falling(self) -> np.ndarray:
        """(n,) slope at negative speeds [N·s/m]."""
        high, low = self._backwards
        return self._repeated(np.maximum((low - high) / (0.5 * self.top), 0.0))

    @found_once
    def static(self) -> np.ndarray:
        """(n,) static share [N]."""
        (high, low), (back_high, back_low) = self._forwards, self._backwards
        even, even_low = (high + back_high) / 2, (low + back_low) / 2
        even, still = 2 * even_low - even, self._at(0.0)
        share = np.where(even * still > 0, np.sign(still) * np.minimum(np.abs(even), np.abs(still)), 0.0)
        return self._repeated(share)

    def _repeated(self, values: np.ndarray) -> np.ndarray:
        return np.tile(values, self.count) if self.count > 1 else values


def _cached_shares(s: Signals, record: Signals, core: Core) -> _Shares:
    """The shares of signals, cached for the evaluations of a law at further speeds."""
    rest = [s[r] for r in s.channels if r != "velocity"]
    kept: OrderedDict = record.cached("shares of the force", OrderedDict)
    key = (core, s.n_samples, *map(id, rest))
    found = kept.pop(key, None)
    if found is None:
        few, count = s.distinct
        found = _Shares(few, core, _top(s), count, rest)
    kept[key] = found
    with suppress(KeyError):  # several threads may share the signals
        if len(kept) > REPLACED:
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
    fast, medium = v > top / 2, (v > top / 4) & (v < top / 2)
    whole = abs(_regressed(v, f))
    if not fast.any() or not medium.any():
        return max(whole, TINY)
    rise = float(f[fast].mean() - f[medium].mean()) / float(v[fast].mean() - v[medium].mean())
    return rise if rise > 0 else max(whole, TINY)


def thresholds(sizes: Sequence[np.ndarray]) -> list[float]:
    """Levels at which a cause that acts beyond one is screened: beyond each lie half of the samples beyond the last.

    Quantiles ½, ¾, ⅞ … and the largest value, so that what the cause changes differs alike from level to level.

    Parameters
    ----------
    sizes : sequence of (n,) arrays
        Speeds, displacements or forces, record by record, of which the modulus counts.

    Returns
    -------
    list of float
        Increasing, `MOST_SIZES` of them, in the unit of the values.

    Examples
    --------
    >>> thresholds([np.linspace(-64.0, 0.0, 65)])
    [32.0, 48.0, 56.0, 60.0, 62.0, 64.0]
    """
    shares = np.append(1 - 0.5 ** np.arange(1, MOST_SIZES), 1.0)
    return [float(q) for q in np.quantile(np.abs(np.concatenate(sizes)), shares)]


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


def top_speed(signals: Sequence[Signals]) -> float:
    """The speed of nearly all samples: quantile `TOP` over all records [m/s]; 1 where there is no motion.

    Parameters
    ----------
    signals : sequence of Signals
        With velocity.

    Returns
    -------
    float
    """
    return speed_quantiles(signals, (TOP,))[0] or 1.0


def _top(s: Signals) -> float:
    """Of the record, where a law is only evaluated at these signals."""
    return (s.record or s).fact("velocity", "fast", lambda v: float(np.quantile(np.abs(v), TOP))) or 1.0


def _regressed(v: np.ndarray, force: np.ndarray) -> float:
    """Least-squares slope through force and speed."""
    centred = v - v.mean()
    return float(centred @ force) / max(float(centred @ centred), TINY)
