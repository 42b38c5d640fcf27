"""Noise: its level, from repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.condition.constancy import DISTINCT
from lpvid.diagnosis.preparing import SHORTEST
from lpvid.diagnosis.signals import Signals
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
    for a in range(len(signals)):
        for b in range(a + 1, len(signals)):
            n = min(signals[a].n_samples, signals[b].n_samples)
            if _alike(signals[a], signals[b], channels, slice(0, n), slice(0, n)):
                keep = masks[a][:n] & masks[b][:n]
                squares += float(np.sum((signals[a].output[:n] - signals[b].output[:n])[keep] ** 2)) / 2
                count += int(keep.sum())
                stated.append(f"{signals[a].name} repeats {signals[b].name}")
    for s, m in zip(signals, masks, strict=True):
        lag = _period(s, channels)
        if lag:
            keep = m[:-lag] & m[lag:]
            squares += float(np.sum((s.output[:-lag] - s.output[lag:])[keep] ** 2)) / 2
            count += int(keep.sum())
            stated.append(f"{s.name} repeats after {lag * s.sample_time:.3g} s")
    if count < 2 * SHORTEST:
        return NoiseLevel(None, 0, "no input repeats, so the noise level is only bounded by the best model")
    return NoiseLevel(squares / count, count, "; ".join(stated[:3]) + (" …" if len(stated) > 3 else ""))


def _alike(a: Signals, b: Signals, channels: Sequence[str], at: slice, bt: slice) -> bool:
    for name in channels:
        x, y = a[name][at], b[name][bt]
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
