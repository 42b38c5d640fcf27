"""Noise: its level, from repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.condition.constancy import DISTINCT
from lpvid.effects.preparing import SHORTEST
from lpvid.rounding import EPS, HALF_DIGITS, TINY


@dataclass(frozen=True)
class NoiseLevel:
    """Noise level from repeats.

    Attributes
    ----------
    variance : float or None
        Of the noise on the output, in its unit squared; None where nothing repeats.
    samples : int
        Number of samples it was estimated from.
    description : str
    """

    variance: float | None
    samples: int
    description: str

    def bounded(self, most: float) -> NoiseLevel:
        """The same, at most the error of a model on data not seen: no model predicts noise.

        Repeats with slightly different inputs, or another initial state, differ by more than noise.

        Parameters
        ----------
        most : float
            Mean squared error of a model on data that it was not fitted to, which holds all of the noise.

        Returns
        -------
        NoiseLevel
        """
        if self.variance is None or self.variance <= most:
            return self
        return replace(self, variance=most, description=f"{self.description}: they differ by "
                       f"{np.sqrt(2 * self.variance):.3g} rms, and the error of the model out of fold bounds the noise")


def noise_level(signals: Sequence[Signals], channels: Sequence[str], masks: Sequence[np.ndarray]) -> NoiseLevel:
    """Variance of the output between repeats of the same input, records against records and periods within one.

    Two stretches with the same inputs have the same response, so that half the variance of their difference is noise,
    whatever the model. Inputs agree where every channel differs by less than `DISTINCT` of its spread.

    Parameters
    ----------
    signals : sequence of Signals
    channels : sequence of str
        The inputs that must repeat.
    masks : sequence of (n,) bool arrays
        Samples to use.

    Returns
    -------
    NoiseLevel
        Of variance None where fewer samples repeat than two of the shortest pieces have.
    """
    squares, count, stated = 0.0, 0, []

    def repeats(difference: np.ndarray, text: str) -> None:
        nonlocal squares, count
        squares += float(np.sum(difference**2)) / 2
        count += difference.size
        stated.append(text)

    for (a, m), (b, k) in combinations(zip(signals, masks, strict=True), 2):
        n = min(a.n_samples, b.n_samples)
        if _alike(a, b, channels, n):
            repeats((a.output[:n] - b.output[:n])[m[:n] & k[:n]], f"{a.name} repeats {b.name}")
    for s, m in zip(signals, masks, strict=True):
        if lag := _period(s, channels):
            repeats((s.output[:-lag] - s.output[lag:])[m[:-lag] & m[lag:]],
                    f"{s.name} repeats after {lag * s.sample_time:.3g} s")
    if count < 2 * SHORTEST:
        return NoiseLevel(None, 0, "no input repeats, so the noise level is only bounded by the best model")
    return NoiseLevel(squares / count, count, "; ".join(stated[:3]) + (" …" if len(stated) > 3 else ""))


def _alike(a: Signals, b: Signals, channels: Sequence[str], n: int) -> bool:
    """Whether the first n samples of two records have the same inputs."""
    for name in channels:
        x, y = a[name][:n], b[name][:n]
        spread = max(float(np.std(x)), float(np.std(y)), EPS * float(np.abs(x).max(initial=0.0)))
        if spread > 0 and float(np.sqrt(np.mean((x - y) ** 2))) > DISTINCT * spread:
            return False
    return True


def _period(s: Signals, channels: Sequence[str]) -> int:
    """Shortest lag in samples at which all inputs repeat over the rest of the record; 0 where none does."""
    n = s.n_samples
    moving = [s[c] - s[c].mean() for c in channels if np.std(s[c]) > HALF_DIGITS * max(float(np.abs(s[c]).max()), TINY)]
    if not moving:
        return 0
    size = 1 << (2 * n - 1).bit_length()
    lags = np.arange(n // 2)
    worst = np.zeros(n // 2)
    for x in moving:
        power = np.cumsum(np.concatenate([[0.0], x**2]))
        cross = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: n // 2]
        worst = np.maximum(worst, (power[n - lags] + power[n] - power[lags] - 2 * cross) / (n - lags) / np.var(x))
    departed = np.maximum.accumulate(worst) > 1  # correlation below ½ before, as in `condition.repetition_period`
    good = np.flatnonzero(departed & (worst < DISTINCT**2))
    return int(good[0]) if good.size else 0
