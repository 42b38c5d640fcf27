"""Noise: its colour, as an autoregressive whitening filter; its level, from repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.signals import Signals

ORDERS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24)
SPECTRUM = 4096
"""points of a spectrum"""
FLOOR = 1e-3
"""share of the noise power taken as white, so that whitening never amplifies a band where there is none"""
ALIKE = 0.02
"""inputs that differ by less than this share of their spread count as a repeat"""


@dataclass(frozen=True, eq=False)
class Whitening:
    """A(q) e = ε: prediction-error filter of the noise.

    Attributes
    ----------
    coefficients : (order + 1,) array
        a_0 = 1, a_1 … of A(q).
    level : float
        Standard deviation of ε, in the output's unit.
    """

    coefficients: np.ndarray
    level: float

    @property
    def order(self) -> int:
        """Order of A."""
        return self.coefficients.size - 1

    @property
    def is_coloured(self) -> bool:
        """Whether the noise is anything but white."""
        return self.order > 0 and float(np.abs(self.coefficients[1:]).max()) > 0.1

    @property
    def memory(self) -> float:
        """Σ_k ρ_k² of the noise that it whitens, by Parseval mean(S²)/mean(S)², S = 1/|A|²; 1 if white."""
        power = 1 / np.abs(np.fft.rfft(self.coefficients, SPECTRUM)) ** 2
        return float(np.mean(power**2) / np.mean(power) ** 2)

    def apply(self, values: np.ndarray) -> np.ndarray:
        """(n,) or (n, k) filtered along time; before its start the signal is taken as zero."""
        if self.order == 0 or values.size == 0:
            return values
        from scipy.signal import lfilter

        return np.asarray(lfilter(self.coefficients, [1.0], values, axis=0))

    @classmethod
    def of(cls, residuals: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> Whitening:
        """Fit to residuals where their masks are true, order by BIC.

        The autocovariance is summed over pairs of samples that are both inside, with `FLOOR` of its value at lag zero
        added as a white part; Levinson's recursion gives every order.

        Parameters
        ----------
        residuals : sequence of (n,) arrays
        masks : sequence of (n,) bool arrays
        """
        top = ORDERS[-1]
        total, counts = np.zeros(top + 1), np.zeros(top + 1)
        for e, m in zip(residuals, masks, strict=True):
            x, w = np.where(m, e, 0.0), m.astype(float)
            size = 1 << (2 * x.size - 1).bit_length()
            total += np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: top + 1]
            counts += np.fft.irfft(np.abs(np.fft.rfft(w, size)) ** 2, size)[: top + 1]
        r = total / np.maximum(np.round(counts), 1.0)
        n = counts[0]
        if not r[0] > 0:
            return cls(np.ones(1), 0.0)
        r = r.copy()
        r[0] *= 1 + FLOOR
        best = np.inf
        chosen: tuple[np.ndarray, float] = (np.ones(1), float(r[0]))
        for order, (a, power) in enumerate(_levinson(r, top)):
            if order in ORDERS and power > 0:
                bic = n * np.log(power) + order * np.log(n)
                if bic < best - 1e-9:
                    best, chosen = bic, (a, power)
        return cls(chosen[0], float(np.sqrt(chosen[1])))


WHITE = Whitening(np.ones(1), 1.0)
"""of noise that is white, of level one: it changes nothing"""
WHITE.coefficients.flags.writeable = False


def _levinson(r: np.ndarray, order: int) -> list[tuple[np.ndarray, float]]:
    """Prediction-error filters of order 0 … `order` and their error powers."""
    a: np.ndarray = np.ones(1)
    power = float(r[0])
    found = [(a, power)]
    for k in range(1, order + 1):
        reflection = -float(a @ r[k:0:-1]) / power
        if not abs(reflection) < 1:
            break
        longer = np.concatenate([a, [0.0]])
        a = longer + reflection * longer[::-1]
        power *= 1 - reflection**2
        found.append((a, power))
    return found


@dataclass(frozen=True)
class NoiseLevel:
    """What repeats say about the noise.

    Attributes
    ----------
    variance : float or None
        Of the noise on the output, in its unit squared; None where nothing repeats.
    samples : int
        Samples it rests on.
    says : str
    """

    variance: float | None
    samples: int
    description: str

    def error(self, whitening: Whitening) -> float:
        """Standard error of the variance for noise that a filter whitens; 0 where none is known.

        σ² √(2 Σ_k ρ_k²/N), ρ_k the autocorrelation of the noise, k over all lags (Bartlett 1946): that of slow noise
        rests on few independent samples.
        """
        if self.variance is None:
            return 0.0
        return self.variance * float(np.sqrt(2 * whitening.memory / self.samples))


def noise_level(signals: Sequence[Signals], channels: Sequence[str], masks: Sequence[np.ndarray]) -> NoiseLevel:
    """Variance of the output between repeats of the same input, records against records and periods within one.

    Two stretches with the same inputs have the same response, so that half the variance of their difference is noise,
    whatever the model. Inputs agree where every channel differs by less than `ALIKE` of its spread.

    Parameters
    ----------
    signals : sequence of Signals
    channels : sequence of str
        The inputs that must repeat.
    masks : sequence of (n,) bool arrays
        Samples to use.
    """
    squares, count, stated = 0.0, 0, []
    for a in range(len(signals)):
        for b in range(a + 1, len(signals)):
            n = min(signals[a].n_samples, signals[b].n_samples)
            if n > 50 and _alike(signals[a], signals[b], channels, slice(0, n), slice(0, n)):
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
    if count < 100:
        return NoiseLevel(None, 0, "no input repeats, so the noise level is only bounded by the best model")
    return NoiseLevel(squares / count, count, "; ".join(stated[:3]) + (" …" if len(stated) > 3 else ""))


def _alike(a: Signals, b: Signals, channels: Sequence[str], at: slice, bt: slice) -> bool:
    for name in channels:
        x, y = a[name][at], b[name][bt]
        spread = max(float(np.std(x)), float(np.std(y)), 1e-12 * float(np.abs(x).max(initial=0.0)))
        if spread > 0 and float(np.sqrt(np.mean((x - y) ** 2))) > ALIKE * spread:
            return False
    return True


def _period(s: Signals, channels: Sequence[str]) -> int:
    """Shortest lag in samples at which all inputs repeat over the rest of the record; 0 where none does."""
    n = s.n_samples
    moving = [s[c] - s[c].mean() for c in channels if np.std(s[c]) > 1e-9 * max(float(np.abs(s[c]).max()), 1e-300)]
    if n < 200 or not moving:
        return 0
    size = 1 << (2 * n - 1).bit_length()
    lags = np.arange(n // 2)
    worst = np.zeros(n // 2)
    for x in moving:
        power = np.cumsum(np.concatenate([[0.0], x**2]))
        cross = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: n // 2]
        worst = np.maximum(worst, (power[n - lags] + power[n] - power[lags] - 2 * cross) / (n - lags) / np.var(x))
    good = np.flatnonzero(worst < ALIKE**2)
    good = good[good >= max(round(0.2 / s.sample_time), 20)]
    return int(good[0]) if good.size else 0
