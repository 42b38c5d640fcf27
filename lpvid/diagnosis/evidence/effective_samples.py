"""Effective samples: how many independent samples an error counts as."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from scipy.optimize import lsq_linear

from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.rounding import EPS, EXPLODED, TINY

STRUCTURED_SAMPLES = 25.0
"""α, independent samples that a structured error counts as, by blind cases of two rigs (docs/diagnosis_boards.md): the
error of a law has few mechanisms, however many samples show them"""
STRUCTURED_SAMPLES_RANGE = tuple((STRUCTURED_SAMPLES * np.geomspace(1 / 2, 2, 5)).tolist())
"""values of α over which the weights of sets are averaged: it is uncertain by a factor of two; even in the logarithm"""
SEGMENT = 64
"""samples of a segment of the averaged spectrum of which the noise floor is estimated: 3000 hold 90 of them"""
MOTIONLESS_BAND = 0.25
"""share of the band without motion: records are prepared at no less than four times the band that holds 99 % of the
motion"""
QUARTER_MEAN = NormalDist().pdf(NormalDist().inv_cdf(MOTIONLESS_BAND)) / MOTIONLESS_BAND
"""standard deviations below the mean at which the lowest quarter q of a normal sample lies: φ(Φ⁻¹(q))/q = 1.27"""


@dataclass(frozen=True)
class EffectiveSamples:
    """Share of independent samples in an error, and its noise floor.

    Attributes
    ----------
    kappa : float
        κ, share of the samples that is independent.
    structured : float
        p, share of the squared error beyond the noise floor.
    floor : float
        Variance of the noise.
    """

    kappa: float
    structured: float
    floor: float


def kappa_of(structured: float, samples: int, alpha: float) -> float:
    """κ of an error of which p is structured: 1/κ = (1 − p) + p N/α, at most one.

    Parameters
    ----------
    structured : float
        p.
    samples : int
        N.
    alpha : float
        α.

    Returns
    -------
    float

    Examples
    --------
    >>> kappa_of(0.0, 3000, 25.0), round(kappa_of(1.0, 3000, 25.0) * 3000, 6)
    (1.0, 25.0)
    """
    return 1 / max((1 - structured) + structured * samples / alpha, 1.0)


@dataclass(frozen=True)
class NoiseFloor:
    """Noise in an error, at most as much as the error holds: variances, in the output's unit squared.

    Attributes
    ----------
    white, carried : float
        Of white noise, and of the noise of the motion sensors that the model carries to its output.
    """

    white: float
    carried: float


def noise_floor(problem: DiagnosisProblem, error: np.ndarray, carried: np.ndarray | None = None) -> NoiseFloor:
    """Noise in an error of the spectrum S: a S_c(f) + b.

    Without motion sensors' noise b is the level that the error has in the quarter of the band where it has least: that
    without motion. S_c is the spectrum of that noise at the model's output. a, from 0 to 1, and b then have the least
    squares of 1 - (a S_c + b)/S: bands that hold more than noise hardly count. In white noise a is zero, in the
    sensors' noise b.

    Parameters
    ----------
    problem : DiagnosisProblem
    error : (N,) array
        In the output's unit, one record after the other.
    carried : (N,) array, optional
        Change of the output by as much noise of the motion sensors again; none where absent or where it explodes.

    Returns
    -------
    NoiseFloor
        Nothing where there is no error.
    """
    total = float(np.mean(error**2))
    if not total > 0:
        return NoiseFloor(0.0, 0.0)
    power, count = _spectrum(problem, error)
    white, of_sensors, scale = _lowest(power, count), np.zeros_like(power), total / float(power.mean())
    if carried is not None and np.any(carried) and np.abs(carried).max() < EXPLODED:
        mean, shape = float(power.mean()), _spectrum(problem, carried)[0]
        most = max(float(shape.mean()), TINY) / mean
        columns = np.column_stack([shape / most, np.full_like(power, mean)]) / np.maximum(power, EPS * mean)[:, None]
        share, level = lsq_linear(columns, np.ones_like(power), ([0.0, 0.0], [most, np.inf])).x
        of_sensors, white = share * shape / most, float(level) * mean
    share = min(float(of_sensors.mean()) * scale, total)
    return NoiseFloor(min(white * scale, total - share), share)


def effective_samples(problem: DiagnosisProblem, errors: Sequence[np.ndarray], alpha: float = STRUCTURED_SAMPLES
                      ) -> EffectiveSamples:
    """κ of an error: 1/κ = (1 − p) + p N/α.

    p is the share of the error beyond white noise at the level that the error has in the band without motion. All of it
    is a misfit of the law, or noise too slow to be distinguished from one. Each sample of white noise counts as
    independent, a misfit as α samples in all. Noise of the motion sensors that the model carries counts as a misfit
    too: every lag reduces it, whether or not anything lags. Repeats give no floor: where their inputs differ by a per
    cent, so do their outputs.

    Parameters
    ----------
    problem : DiagnosisProblem
    errors : sequence of (n,) arrays
        Per record, in the output's unit.
    alpha : float
        α.

    Returns
    -------
    EffectiveSamples
        κ = 1 and nothing structured where there is no error.
    """
    stacked = problem.stack(errors)
    total = float(np.mean(stacked**2))
    if not total > 0:
        return EffectiveSamples(1.0, 0.0, 0.0)
    white = noise_floor(problem, stacked).white
    return EffectiveSamples(kappa_of(1 - white / total, problem.n_samples, alpha), 1 - white / total, white)


def _spectrum(problem: DiagnosisProblem, stacked: np.ndarray) -> tuple[np.ndarray, int]:
    """Averaged power within the blocks over frequencies between none and half the rate, and segments averaged."""
    size = int(min(SEGMENT, np.bincount(problem.block).min()))
    window, total, count = np.hanning(size + 2)[1:-1], np.zeros(size // 2 + 1), 0
    for b in range(problem.blocks.count):
        x = stacked[problem.block == b]
        for first in range(0, x.size - size + 1, max(size // 2, 1)):
            total += np.abs(np.fft.rfft(window * x[first: first + size])) ** 2
            count += 1
    both = np.concatenate([total, total[1: -1 if size % 2 == 0 else None]])  # mean over both signs: Parseval
    return both / max(count, 1), max(count, 1)


def _lowest(power: np.ndarray, count: int) -> float:
    """Level of the lowest quarter of a spectrum, corrected for the scatter of averages over `count` segments."""
    lowest = np.sort(power)[: max(int(MOTIONLESS_BAND * power.size), 1)]
    return float(lowest.mean()) / max(1.0 - QUARTER_MEAN / np.sqrt(count), MOTIONLESS_BAND)

