"""Noise: what of an error does not repeat where the inputs do, and what does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import stdtrit

from lpvid.baselines.signals import Signals
from lpvid.condition.constancy import DISTINCT
from lpvid.diagnosis.blocks import FEWEST
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.effects.preparing import SHORTEST
from lpvid.rounding import EPS, HALF_DIGITS, TINY
from lpvid.validation.trust import LEVEL


@dataclass(frozen=True)
class NoiseLevel:
    """Noise and misfit of a model, from repeats.

    Attributes
    ----------
    variance : float or None
        Of the error that does not repeat: noise, in the output's unit squared; None where nothing repeats.
    repeating : (float, float)
        Root mean square of the error that repeats, a misfit whatever its spectrum, in the output's unit: the ends of
        its 95 % interval.
    samples : int
        Pairs of samples that it was estimated from.
    description : str
    """

    variance: float | None
    repeating: tuple[float, float]
    samples: int
    description: str


def noise_level(problem: DiagnosisProblem, channels: Sequence[str], errors: Sequence[np.ndarray]) -> NoiseLevel:
    """Error of a model between repeats of the same input, records against records and halves of a periodic one.

    With e_k = m + n_k at repeat k, m a function of the inputs and n_k noise, the mean of e_1 e_2 is the variance of m,
    and the rest of the mean square is that of n. Inputs agree where every channel differs by less than `DISTINCT` of
    its spread; a good model states what such a difference changes at the output. The interval of the mean is Student's
    over `FEWEST` parts of the time, as slow noise is correlated over many blocks. Where e_1 opposes e_2, as with an
    offset of which the law has the mean, m is at most (e_1 + e_2)/2.

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
        Of variance None where fewer samples repeat than two of the shortest pieces have, or in one part only.
    """
    signals, number = problem.signals, problem.blocks.number
    pairs = [(j, k, 0, f"{a.name} repeats {b.name}") for (j, a), (k, b) in combinations(enumerate(signals), 2)
             if _alike(a, b, channels, min(a.n_samples, b.n_samples))]
    pairs += [(k, k, lag, f"{s.name} repeats after {lag * s.sample_time:.3g} s") for k, s in enumerate(signals)
              if (lag := _period(s, channels))]
    found: list[np.ndarray] = [np.zeros((3, 0))]
    for j, k, lag, _ in pairs:
        n = min(errors[j].size, errors[k].size - lag)
        inside = np.flatnonzero((number[j][:n] >= 0) & (number[k][lag: lag + n] >= 0))
        found.append(np.array([errors[j][inside], errors[k][lag + inside], inside * FEWEST // max(n, 1)]))
    *both, part = np.concatenate(found, axis=1)
    parts, of_part, samples = np.unique(part, return_inverse=True, return_counts=True)
    if of_part.size < 2 * SHORTEST or parts.size < 2:
        return NoiseLevel(None, (0.0, 0.0), 0, "no input repeats, so the noise level is only bounded by the best model")
    size = max(float(np.abs(both).max()), TINY)  # the square of an error that explodes is not finite
    both = np.array(both) / size
    sums, total = np.bincount(of_part, both[0] * both[1]), float(np.mean(both**2))
    common = float(sums.sum()) / of_part.size
    error = np.sqrt(parts.size / (parts.size - 1) * np.sum((sums - common * samples) ** 2)) / of_part.size * \
        stdtrit(parts.size - 1, (1 + LEVEL) / 2)
    most = common + error if common + error > 0 else float(np.mean(both.mean(axis=0) ** 2))
    low, high = size * np.sqrt(np.clip([common - error, most], 0.0, total))
    return NoiseLevel(size**2 * (total - max(common, 0.0)), (float(low), float(high)), of_part.size,
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
