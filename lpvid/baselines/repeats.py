"""Repeats: where the inputs of records, or of the halves of a periodic one, are the same."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.condition.constancy import DISTINCT
from lpvid.rounding import EPS, HALF_DIGITS, TINY


class Repeat(NamedTuple):
    """Two stretches of the same inputs.

    Attributes
    ----------
    first, second : int
        Numbers of their records.
    lag : int
        Samples by which the second begins later; 0 for two records.
    """

    first: int
    second: int
    lag: int

    def pair(self, values: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Values along either stretch.

        Parameters
        ----------
        values : sequence of (n,) arrays
            Per record.

        Returns
        -------
        (m,), (m,) arrays
        """
        n = min(values[self.first].size, values[self.second].size - self.lag)
        return values[self.first][:n], values[self.second][self.lag: self.lag + n]

    def stated(self, signals: Sequence[Signals]) -> str:
        """In words, with the names of the records.

        Parameters
        ----------
        signals : sequence of Signals

        Returns
        -------
        str
        """
        a, b = signals[self.first], signals[self.second]
        return f"{a.name} repeats after {self.lag * a.sample_time:.3g} s" if self.lag else f"{a.name} repeats {b.name}"


def repeats(signals: Sequence[Signals], channels: Sequence[str]) -> list[Repeat]:
    """Records against records, and the halves of a periodic one.

    Inputs agree where every channel differs by less than `DISTINCT` of its spread.

    Parameters
    ----------
    signals : sequence of Signals
        One for each record, one rate.
    channels : sequence of str
        The inputs that must repeat.

    Returns
    -------
    list of Repeat
        Empty where nothing repeats.
    """
    found = [Repeat(j, k, 0) for (j, a), (k, b) in combinations(enumerate(signals), 2)
             if _alike(a, b, channels, min(a.n_samples, b.n_samples))]
    return found + [Repeat(k, k, lag) for k, s in enumerate(signals) if (lag := _period(s, channels))]


def _alike(a: Signals, b: Signals, channels: Sequence[str], n: int) -> bool:
    """Whether the first n samples of two records have the same inputs."""
    for name in channels:
        x, y = a[name][:n], b[name][:n]
        spread = max(float(np.std(x)), float(np.std(y)), EPS * float(np.abs(x).max(initial=0.0)))
        if spread > 0 and float(np.sqrt(np.mean((x - y) ** 2))) > DISTINCT * spread:
            return False
    return True


def _period(s: Signals, channels: Sequence[str]) -> int:
    """Longest lag in samples, up to half of the record, at which all inputs repeat; 0 where none does.

    The longest: slow noise is the same a short period later.
    """
    n = s.n_samples
    moving = [s[c] - s[c].mean() for c in channels if np.std(s[c]) > HALF_DIGITS * max(float(np.abs(s[c]).max()), TINY)]
    if not moving:
        return 0
    size = 1 << (2 * n - 1).bit_length()
    lags = np.arange(n // 2 + 1)
    worst = np.zeros(lags.size)
    for x in moving:
        power = np.cumsum(np.concatenate([[0.0], x**2]))
        cross = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[lags]
        worst = np.maximum(worst, (power[n - lags] + power[n] - power[lags] - 2 * cross) / (n - lags) / np.var(x))
    departed = np.maximum.accumulate(worst) > 1  # correlation below ½ before, as in `condition.repetition_period`
    good = np.flatnonzero(departed & (worst < DISTINCT**2))
    last = good[2 * good > 2 * good[-1] - good[0]] if good.size else np.zeros(1, int)  # its neighbours are alike too
    return int(last[np.argmin(worst[last])])
