"""Noise: what of an error does not repeat where the inputs do, and what does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from lpvid.baselines.repeats import repeats
from lpvid.diagnosis.blocks import FEWEST
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.effects.preparing import SHORTEST
from lpvid.rounding import TINY
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
    and the rest of the mean square is that of n. The interval of the mean is Student's over `FEWEST` parts of
    the time, as slow noise is correlated over many blocks. Where e_1 opposes e_2, as with an offset of which the law
    has the mean, m is at most (e_1 + e_2)/2.

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
    pairs, number = repeats(problem.signals, channels), problem.blocks.number
    found: list[np.ndarray] = [np.zeros((3, 0))]
    for p in pairs:
        e1, e2 = p.pair(errors)
        (n1, n2), n = p.pair(number), e1.size
        inside = np.flatnonzero((n1 >= 0) & (n2 >= 0))
        found.append(np.array([e1[inside], e2[inside], inside * FEWEST // max(n, 1)]))
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
                      "; ".join(p.stated(problem.signals) for p in pairs[:3]) + (" …" if len(pairs) > 3 else ""))
