"""Noise: what of an error does not repeat where the inputs do, and what does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.condition.constancy import DISTINCT
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.effects.preparing import SHORTEST
from lpvid.rounding import EPS, HALF_DIGITS, TINY
from lpvid.validation.trust import QUANTILE


@dataclass(frozen=True)
class NoiseLevel:
    """Noise and misfit of a model, from repeats.

    Attributes
    ----------
    variance : float or None
        Of the error that does not repeat: noise, in the output's unit squared; None where nothing repeats.
    repeating : (float, float)
        Root mean square of the error that repeats, a misfit whatever its spectrum, in the output's unit: the ends of
        its 95 % interval over the blocks.
    samples : int
        Number of samples it was estimated from.
    description : str
    """

    variance: float | None
    repeating: tuple[float, float]
    samples: int
    description: str


def noise_level(problem: DiagnosisProblem, channels: Sequence[str], errors: Sequence[np.ndarray]) -> NoiseLevel:
    """Error of a model between repeats of the same input, records against records and halves of a periodic one.

    With e_k = m + n_k at repeat k, m a function of the inputs and n_k noise, the variance of n is the mean of
    (e_1 − e_2)²/2, and that of m the mean of e_1 e_2. Inputs agree where every channel differs by less than `DISTINCT`
    of its spread; what such a difference changes at the output is in the model too, and so in neither error.

    Parameters
    ----------
    problem : DiagnosisProblem
    channels : sequence of str
        The inputs that must repeat.
    errors : sequence of (n,) arrays
        Of the model, per record, in the output's unit.

    Returns
    -------
    NoiseLevel
        Of variance None where fewer samples repeat than two of the shortest pieces have.
    """
    signals, number = problem.signals, problem.blocks.number
    pairs = [(j, k, 0, f"{a.name} repeats {b.name}") for (j, a), (k, b) in combinations(enumerate(signals), 2)
             if _alike(a, b, channels, min(a.n_samples, b.n_samples))]
    pairs += [(k, k, lag, f"{s.name} repeats after {lag * s.sample_time:.3g} s") for k, s in enumerate(signals)
              if (lag := _period(s, channels))]
    first, second, block = [], [], []
    for j, k, lag, _ in pairs:
        n = min(errors[j].size, errors[k].size - lag)
        inside = np.flatnonzero((number[j][:n] >= 0) & (number[k][lag: lag + n] >= 0))
        first.append(errors[j][inside])
        second.append(errors[k][lag + inside])
        block.append(number[j][inside])
    count = sum(e.size for e in first)
    if count < 2 * SHORTEST:
        return NoiseLevel(None, (0.0, 0.0), 0, "no input repeats, so the noise level is only bounded by the best model")
    one, two = np.concatenate(first), np.concatenate(second)
    _, of_block, samples = np.unique(np.concatenate(block), return_inverse=True, return_counts=True)
    sums = np.bincount(of_block, one * two)
    common = float(sums.sum()) / count
    error = float(np.sqrt(sums.size / max(sums.size - 1, 1) * np.sum((sums - common * samples) ** 2))) / count
    low, high = np.sqrt(np.maximum([common - QUANTILE * error, common + QUANTILE * error], 0.0)).tolist()
    return NoiseLevel(float(np.mean((one - two) ** 2)) / 2, (low, high), count,
                      "; ".join(t for *_, t in pairs[:3]) + (" …" if len(pairs) > 3 else ""))


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
    lags = np.arange(n // 2)
    worst = np.zeros(n // 2)
    for x in moving:
        power = np.cumsum(np.concatenate([[0.0], x**2]))
        cross = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: n // 2]
        worst = np.maximum(worst, (power[n - lags] + power[n] - power[lags] - 2 * cross) / (n - lags) / np.var(x))
    departed = np.maximum.accumulate(worst) > 1  # correlation below ½ before, as in `condition.repetition_period`
    good = np.flatnonzero(departed & (worst < DISTINCT**2))
    last = good[2 * good > 2 * good[-1] - good[0]] if good.size else np.zeros(1, int)  # its neighbours are alike too
    return int(last[np.argmin(worst[last])])
