"""Quantisation: channels stored in coarse steps, and the estimate of the signal between two steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import Effect, EffectParameter, LpvChange
from lpvid.rounding import HALF_DIGITS
from quartercar.effects.force_output import no_force
from quartercar.effects.measurement import MOTION

COARSE = 2e-3
"""share of its range from which a channel's step counts as coarse, and of a step by which a value may miss the grid"""
DITHER = 0.15
"""standard deviation of the noise before the rounding, in steps, which smooths the mean rounded force"""


class Quantisation(Effect):
    """Channels rounded to coarse steps, recognised by their distinct values (equation sheet 3.20).

    A smooth motion is recovered: the part beyond the band in which the power of the channel exceeds that of a rounding
    error is removed, and the rest is limited to half a step from the stored values. The simulated force is replaced by
    the mean of the rounded force.
    """

    name: ClassVar[str] = "quantisation"
    title: ClassVar[str] = "channels stored in coarse steps"
    family: ClassVar[str] = "measurement"
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "y_recorded = q round(y/q), y = F, x, v"
    reference: ClassVar[str] = "equation sheet 3.20; Widrow & Kollár 2008, ch. 4 (mean of a rounded signal)"
    experiment: ClassVar[str] = "a smaller range of the amplifier; look at the distinct values of the channels"
    smooth: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("share", "", "share of the rounding that is modelled", 0.0, (0.0, 1.2), (0.0, 1.5),
                                (1.0,)),
                EffectParameter("force_step", "N", "q of the force, 0 where it is fine", 0.0, (0.0, 500.0), (0.0, 1e4),
                                (10.0,)))

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return [np.array([1.0, grid_step(np.concatenate([s.output for s in signals])) or 0.0])]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        if reason := no_force(baseline):
            return reason
        coarse = grid_step(np.concatenate([s.output for s in signals])) or any(_coarse(s) for s in signals)
        return None if coarse else "the values of no channel lie on a coarse grid"

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        share, step = float(values[0]), float(values[1])
        if share == 0:
            return core

        def finer(s: Signals) -> Signals:
            return s.replace(**{m: s[m] + share * (_between_steps(s, m) - s[m]) for m in _coarse(s)})

        def run(s: Signals) -> np.ndarray:
            force = s.along_others("between steps", share, lambda: finer(s), core)
            return force + share * mean_rounding(force, step) if step > 0 else force

        return run

    def lpv_change(self) -> LpvChange | None:
        return None


def grid_step(values: np.ndarray) -> float | None:
    """The step of a channel whose values are on a grid that is coarse for its range; None where there is none.

    Parameters
    ----------
    values : (n,) array

    Returns
    -------
    float or None
        In the unit of the values; None also where fewer than three values are distinct, or more than half of them.

    Examples
    --------
    >>> grid_step(np.round(np.linspace(-99, 99, 500) / 7) * 7), grid_step(np.linspace(-99, 99, 500))
    (7.0, None)
    """
    distinct = np.unique(values)
    distinct = distinct[np.append(True, np.diff(distinct) > HALF_DIGITS * np.ptp(values))]  # alike but for rounding
    if distinct.size < 3 or distinct.size > 0.5 * values.size:
        return None
    gaps = np.diff(distinct)
    step = float(np.median(gaps))
    off = np.abs(gaps / step - np.round(gaps / step))
    return step if step > COARSE * float(np.ptp(values)) and float(off.max()) < COARSE else None


def mean_rounding(values: np.ndarray, step: float) -> np.ndarray:
    """(n,) mean of q round((y + e)/q) − y over a Gaussian e of `DITHER` steps: its first two harmonics.

    Widrow & Kollár: Σ_k (−1)^k q/(πk) sin(2πk y/q) exp(−2π²k²σ²/q²).

    Parameters
    ----------
    values : (n,) array
        y.
    step : float
        q, in the unit of the values.

    Returns
    -------
    (n,) array
        In the unit of the values.
    """
    angle = 2 * np.pi * values / step
    weights = [(-1) ** k / (np.pi * k) * np.exp(-2 * (np.pi * k * DITHER) ** 2) for k in (1, 2)]
    return step * (weights[0] * np.sin(angle) + weights[1] * np.sin(2 * angle))


def _between_steps(s: Signals, channel: str) -> np.ndarray:
    """(n,) a coarse channel, smoothed within half a step of the stored values; a fine one unchanged."""
    def make() -> np.ndarray:
        step = grid_step(s[channel])
        return s[channel] if step is None else smoothed_within(s[channel], step)

    return s.cached(("between steps", channel), make)


def smoothed_within(values: np.ndarray, step: float) -> np.ndarray:
    """(n,) values after a low-pass without phase, limited to half a step from their original values.

    The corner is the lowest beyond which the channel has no more power than a rounding error of q²/12, spread evenly
    over all frequencies; a channel that has more up to the last frequency, as one that jumps, is unchanged.

    Parameters
    ----------
    values : (n,) array
    step : float
        q, in the unit of the values.

    Returns
    -------
    (n,) array
        In the unit of the values.
    """
    n = values.size
    line = np.linspace(values[0], values[-1], n)
    odd = np.concatenate([values - line, -(values - line)[-2:0:-1]])
    spectrum = np.fft.rfft(odd)
    power = 2 * np.abs(spectrum) ** 2 / odd.size**2
    above = np.cumsum(power[::-1])[::-1]
    allowed = (step / 2) ** 2 / 3 * (1 - np.arange(power.size) / power.size)
    quiet = np.flatnonzero(above <= allowed)
    corner = int(quiet[0]) if quiet.size else power.size
    spectrum[corner:] = 0.0
    smooth = np.fft.irfft(spectrum, odd.size)[:n] + line
    return np.clip(smooth, values - step / 2, values + step / 2)


def _coarse(s: Signals) -> Sequence[str]:
    """Channels of the motion that are stored in coarse steps."""
    return [m for m in MOTION if s.has(m) and s.cached(("step", m), lambda m=m: np.array(grid_step(s[m]) or 0.0)) > 0]
