"""Effective samples: how many independent samples an error counts as."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from scipy.optimize import lsq_linear

from lpvid.diagnosis.localise import spectrum_lines
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.rounding import EPS, EXPLODED, TINY
from lpvid.validation.trust import QUANTILE
from lpvid.validation.whitening import Whitening

STRUCTURED_SAMPLES = 25.0
"""α, independent samples that a structured error counts as, by blind cases of two rigs (docs/diagnosis_boards.md): the
error of a law has few mechanisms, however many samples show them"""
STRUCTURED_SAMPLES_RANGE = tuple((STRUCTURED_SAMPLES * np.geomspace(1 / 2, 2, 5)).tolist())
"""values of α over which the weights of sets are averaged: it is uncertain by a factor of two; even in the logarithm"""
SEGMENT = 64
"""samples of a segment of the averaged spectrum of which the noise floor is estimated: 3000 hold 90 of them"""
BRIEF = SEGMENT // 4
"""samples of a segment of the spectra that distinguish noise from bursts"""
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
    samples : int
        N.
    whitening : Whitening, optional
        Noise known by repeats, beside the misfit.
    """

    kappa: float
    structured: float
    floor: float
    samples: int = 0
    whitening: Whitening | None = None

    def kappa_at(self, alpha: float) -> float:
        """κ at another α.

        Parameters
        ----------
        alpha : float
            α.

        Returns
        -------
        float
        """
        return self.whitening.independent_share(self.samples, alpha) if self.whitening else \
            kappa_of(self.structured, self.samples, alpha)


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


def white_noise(problem: DiagnosisProblem, error: np.ndarray) -> float:
    """Variance of white noise in an error: its level in the quarter of the band where it has least, at most times.

    There is noise at all times. The misfit of a law is short where the motion reverses, and as wide as the band: a mean
    over time would count it as noise. So the mean is reduced by the ratio of the median to the mean of the power over
    time, where the error has least, over that of normal noise.

    Parameters
    ----------
    problem : DiagnosisProblem
    error : (N,) array
        In the output's unit, one record after the other.

    Returns
    -------
    float
        In its unit squared, at most the mean square of the error.
    """
    total = float(np.mean(error**2))
    if not total > 0:
        return 0.0
    power, count = _spectrum(problem, error)
    lowest = np.sort(power)[: max(int(MOTIONLESS_BAND * power.size), 1)]
    level = float(lowest.mean()) / max(1.0 - QUARTER_MEAN / np.sqrt(count), MOTIONLESS_BAND)
    return min(level * _usual_share(problem, error) * total / float(power.mean()), total)


def sensor_noise_share(problem: DiagnosisProblem, errors: Sequence[np.ndarray], carried: Sequence[np.ndarray]) -> float:
    """Largest share a of the assumed noise of the motion sensors that errors of several models of one run may hold.

    The errors have the spectra a C_k + b: C_k is that of what as much noise of the sensors again changes at the output
    of model k, b white noise at the output. The sensors and the output's noise are the same whatever the model. a, from
    0 to 1, and b have the least squares of 1 - (a C_k + b)/S_k: bands that hold more than noise hardly count. Returned
    is the upper end of the 95 % interval of a: where the models pass the sensors' noise on as white, little is known.

    Parameters
    ----------
    problem : DiagnosisProblem
    errors, carried : sequences of (N,) arrays
        In the output's unit, one record after the other.

    Returns
    -------
    float
        0 where a model carries none, or a change explodes.
    """
    rows = []
    for error, change in zip(errors, carried, strict=True):
        if not (np.any(error) and np.any(change) and np.abs(change).max() < EXPLODED):
            return 0.0
        power = _spectrum(problem, error)[0]
        columns = np.column_stack([_spectrum(problem, change)[0], np.ones_like(power)])
        rows.append(columns / np.maximum(power, EPS * power.mean())[:, None])
    stacked = np.vstack(rows)
    scale = np.maximum(stacked.max(axis=0), TINY)
    stacked = stacked / scale
    found = lsq_linear(stacked, np.ones(len(stacked)), ([0.0, 0.0], [scale[0], np.inf]))
    variance = 2 * found.cost / (len(stacked) - 2) * np.linalg.pinv(stacked.T @ stacked)[0, 0]
    return float(min(found.x[0] + QUANTILE * np.sqrt(variance), scale[0]) / scale[0])


def effective_samples(problem: DiagnosisProblem, errors: Sequence[np.ndarray], alpha: float = STRUCTURED_SAMPLES
                      ) -> EffectiveSamples:
    """κ of an error: 1/κ = (1 − p) + p N/α.

    p is the share of the error beyond white noise, at the level that the error has in the band without motion, and
    beyond lines of its spectrum that nothing of the motion has. All of it is a misfit of the law, or noise too slow to
    be distinguished from one. Each sample of noise counts as independent, a misfit as α samples in all. Noise of the
    motion sensors that the model carries counts as a misfit too: every lag reduces it, whether or not anything lags.
    Where repeats give the spectrum of the noise, the misfit is what the error has beside it (`Whitening`).

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
        return EffectiveSamples(1.0, 0.0, 0.0, stacked.size)
    if problem.whitening is not None:
        w = problem.whitening.beside(stacked)
        share = float(w.misfit.mean()) / (w.variance + float(w.misfit.mean()))
        return EffectiveSamples(w.independent_share(stacked.size, alpha), share, w.variance, stacked.size, w)
    floor = min(white_noise(problem, stacked) + total * sum(x.share for x in spectrum_lines(problem, errors)), total)
    return EffectiveSamples(kappa_of(1 - floor / total, stacked.size, alpha), 1 - floor / total, floor, stacked.size)


def _usual_share(problem: DiagnosisProblem, error: np.ndarray) -> float:
    """Median over time of an error's power at the frequency where it has least, over that of normal noise of the same
    mean power; the segments are short, so that a burst is in few of them. The power of normal noise in a segment is
    exponentially distributed, except at no frequency and at half the rate; its median is ln 2 of its mean."""
    power = np.abs(_spectra(problem, error, BRIEF)[0][:, 1:-1]) ** 2
    least = power[:, int(np.argmin(power.mean(axis=0)))] if power.size else np.zeros(0)
    return float(np.median(least) / (np.log(2) * least.mean())) if least.any() else 1.0


def _spectrum(problem: DiagnosisProblem, stacked: np.ndarray) -> tuple[np.ndarray, int]:
    """Averaged power within the blocks over frequencies of both signs up to half the rate, the mean of which is that
    over time (Parseval), and segments averaged."""
    spectra, window = _spectra(problem, stacked, SEGMENT)
    power = np.mean(np.abs(spectra) ** 2, axis=0)
    return np.concatenate([power, power[1: -1 if window.size % 2 == 0 else None]]), len(spectra)


def _spectra(problem: DiagnosisProblem, stacked: np.ndarray, longest: int) -> tuple[np.ndarray, np.ndarray]:
    """(segments, frequencies) spectra of windowed segments within the blocks, half of each in the next one; the
    window."""
    size = int(min(longest, np.bincount(problem.block).min()))
    window, parts = np.hanning(size + 2)[1:-1], []
    for b in range(problem.blocks.count):
        x = stacked[problem.block == b]
        parts += [window * x[first: first + size] for first in range(0, x.size - size + 1, max(size // 2, 1))]
    return np.fft.rfft(parts, axis=1), window
