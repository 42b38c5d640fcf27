"""Measurement chain: what happens to the signals between the damper and the file."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.effect import Effect, EffectParameter, GridEffect, LpvChange
from lpvid.diagnosis.signals import Core, Signals
from quartercar.effects.electrical import read_earlier

MOTION = ("displacement", "velocity", "acceleration")
"""channels that one position sensor feeds"""
QUIET = 0.3
"""share of the Nyquist frequency, at the top of a channel's spectrum, whose level counts as its sensor's noise"""
SHORT = 100
"""samples below which nothing is undone"""
EDGE, NOISY = 0.1, 0.002
"""share of a channel's range that a jump between two samples makes, and of its size that is taken for noise"""
STRETCH, ABOVE = 1.0, 2.0
"""length of the stretches whose spectra are averaged before they are compared with that level [s]; times that they must
stand above it"""


def shifted(values: np.ndarray, samples: float) -> np.ndarray:
    """Values read `samples` later (earlier where negative), linear in between, the ends held."""
    n = np.arange(values.size)
    return np.interp(n + samples, n, values)


def glided(values: np.ndarray, samples: float) -> np.ndarray:
    """Values of a smooth signal read `samples` later, by cubic splines in between, the ends held.

    A straight line between samples would take away cos(π f T) of what moves with f, half-way between them.
    """
    from scipy.ndimage import shift

    return shift(values, -samples, order=3, mode="nearest")


class ChainEffect(GridEffect):
    """A cause in the measurement chain."""

    family: ClassVar[str] = "measurement"

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return None if baseline.output == "force" else f"{baseline.name} does not simulate a force"


class DisplacementDelay(ChainEffect):
    """The motion is recorded late against the force (equation sheet 3.20)."""

    name: ClassVar[str] = "displacement-delay"
    path: ClassVar[str] = "motion"
    stepwise: ClassVar[bool] = True
    title: ClassVar[str] = "the motion is recorded later than the force"
    stage: ClassVar[str] = "channel"
    equation: ClassVar[str] = "x(t) = x_recorded(t + T), v alike"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "a spring in place of the damper, or a synchronisation pulse on all channels"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    resolution: ClassVar[float] = 0.7

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("delay", "s", "T", 0.0, (0.0, 0.02), (0.0, 0.1), (0.001, 0.003, 0.008, 0.016)),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        delay = float(values[0])
        if delay <= 0:
            return core

        def run(s: Signals) -> np.ndarray:
            late = {m: glided(s[m], delay / s.sample_time) for m in MOTION if s.has(m)}
            return core(s.replace(**late))

        return run

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the input's delay chosen anew", delay=True)


class ForceDelay(ChainEffect):
    """The force is recorded late against all that drives it: every input is read T earlier (equation sheet 3.20)."""

    name: ClassVar[str] = "force-delay"
    path: ClassVar[str] = "force"
    stepwise: ClassVar[bool] = True
    title: ClassVar[str] = "the force is recorded later than the motion"
    stage: ClassVar[str] = "channel"
    equation: ClassVar[str] = "F_recorded(t) = F(t - T)"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "a spring in place of the damper, or a synchronisation pulse on all channels"
    resolution: ClassVar[float] = 1.0

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("delay", "s", "T", 0.0, (0.0, 0.02), (0.0, 0.1), (0.001, 0.003, 0.008, 0.016)),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        delay = float(values[0])
        if delay <= 0:
            return core

        def run(s: Signals) -> np.ndarray:
            early = {k: shifted(c, -delay / s.sample_time) for k, c in s.channels.items() if k != "current"}
            return core(s.replace(**early, **({"current": read_earlier(s, delay)} if s.has("current") else {})))

        return run

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the input's delay chosen anew", delay=True)


class OneSidedFilter(ChainEffect):
    """The motion alone has passed a low-pass of order two or three, undone before the law sees it (sheet 1.4.10)."""

    name: ClassVar[str] = "one-sided-filter"
    path: ClassVar[str] = "motion"
    title: ClassVar[str] = "the motion was low-passed and the force was not"
    stage: ClassVar[str] = "channel"
    equation: ClassVar[str] = ("X = (1 + 2 zeta T s + T^2 s^2)(1 + T_3 s) X_recorded, T = 1/(2 pi f_c), in bands with "
                               "more than the sensor's noise")
    reference: ClassVar[str] = "equation sheet 1.4.10, E4.10"
    experiment: ClassVar[str] = "the same record with both channels unfiltered, or both through the same filter"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    resolution: ClassVar[float] = 0.5

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("time_constant", "s", "T = 1/(2 pi corner frequency)", 0.0, (0.0, 0.04), (0.0, 0.2),
                                (0.002, 0.005, 0.01, 0.02)),
                EffectParameter("damping", "", "zeta", 0.7071, (0.4, 1.2), (0.3, 2.0), (0.5, 0.7071, 1.0)),
                EffectParameter("further_lag", "s", "T_3, of a third pole", 0.0, (0.0, 0.04), (0.0, 0.2), (0.0,)))

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        t, zeta, third = (float(v) for v in values)
        if t <= 0:
            return core

        def run(s: Signals) -> np.ndarray:
            undone = {m: s[m] + lost(s, m, (2 * zeta * t + third, t**2 + 2 * zeta * t * third, t**2 * third))
                      for m in MOTION if s.has(m)}
            return core(s.replace(**undone))

        return run

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("two more samples of the input", order=2)


def lost(s: Signals, channel: str, factors: tuple[float, ...]) -> np.ndarray:
    """(n,) Σ_k c_k dᵏx/dtᵏ of a channel, c from k = 1 on: what a low-pass with the inverse 1 + Σ_k c_k sᵏ took away.

    Differentiated in the frequency domain, each frequency weighed with Wiener's share (S − 2N)₊/S, N the sensor's
    noise taken twice to be safe, S the power: elsewhere to undo a filter raises little but noise. N is the level at the
    top of the spectrum. The ends are continued by their odd reflection, which keeps the slope.
    """
    n = s[channel].size
    if n < SHORT:
        return np.zeros(n)
    spectrum, omega, share = s.cached(("spectrum", channel), lambda: _spectrum(s[channel], s.sample_time))
    inverse = sum(c * (1j * omega) ** (k + 1) for k, c in enumerate(factors))
    return np.fft.irfft(spectrum * share * inverse, 2 * spectrum.size - 2)[n // 2: n // 2 + n]


def _spectrum(x: np.ndarray, sample_time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spectrum of a channel continued at both ends, its frequencies [rad/s], and the share of each that is motion."""
    from scipy.signal import welch

    spectrum, omega = _continued(x, sample_time)
    at, power = welch(x, 1 / sample_time, nperseg=min(x.size, round(STRETCH / sample_time)))
    noise = float(np.median(power[-round(QUIET * power.size):]))
    share = np.maximum(1 - ABOVE * noise / np.maximum(np.interp(omega, 2 * np.pi * at, power), 1e-300), 0.0)
    return spectrum, omega, share


def _continued(x: np.ndarray, sample_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Spectrum of a signal continued by its odd reflection at both ends and closed by a ramp; frequencies [rad/s]."""
    from scipy.fft import next_fast_len

    n = x.size
    before = 2 * x[0] - x[1: n // 2 + 1][::-1]
    after = 2 * x[-1] - x[-2: -2 - n // 2: -1]
    longer = np.concatenate([before, x, after])
    size = 2 * int(next_fast_len((longer.size + 1) // 2, real=True) or 0)
    ramp = np.linspace(longer[-1], longer[0], size - longer.size + 2)[1:-1]
    return np.fft.rfft(np.concatenate([longer, ramp])), 2 * np.pi * np.fft.rfftfreq(size, sample_time)


class SharedFilter(ChainEffect):
    """All channels have passed the same low-pass, which does not commute with a law that bends (sheet 1.4.10)."""

    name: ClassVar[str] = "shared-filter"
    title: ClassVar[str] = "all channels were low-passed alike, which a bent law does not commute with"
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "F_recorded = F(X)/H, X = H X_recorded, H = 1 + 2 zeta T s + T^2 s^2"
    reference: ClassVar[str] = "equation sheet 1.4.10, E4.10"
    experiment: ClassVar[str] = "the same record at a higher corner frequency of the amplifiers' filters"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    resolution: ClassVar[float] = 0.15
    path: ClassVar[str] = "all"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("time_constant", "s", "T = 1/(2 pi corner frequency)", 0.0, (0.0, 0.01), (0.0, 0.05),
                                (5e-4, 1e-3, 3e-3)),
                EffectParameter("damping", "", "zeta", 0.7071, (0.4, 1.2), (0.3, 2.0), (0.7071,)))

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        if any("current" in baseline.channels and s.has("current") and jumps(s["current"]) for s in signals):
            return "the current jumps: what its filter took from the edges cannot be brought back"
        return super().applies(baseline, signals)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        t, zeta = float(values[0]), float(values[1])
        if t <= 0:
            return core

        def run(s: Signals) -> np.ndarray:
            if s.n_samples < SHORT:
                return core(s)
            return low_passed(core(_undone(s, t, zeta)), s.sample_time, t, zeta)

        return run

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("two more samples of input and output", order=2)


def jumps(x: np.ndarray) -> bool:
    """Whether a channel moves by a large part of its range from one sample to the next."""
    return bool(x.size > 1 and np.abs(np.diff(x)).max() > EDGE * np.ptp(x) > NOISY * np.abs(x).max())


def _undone(s: Signals, t: float, zeta: float) -> Signals:
    """Signals before a filter that all channels have passed; those asked for last are kept."""
    kept = s.cache.get("before the filter")  # a pair, so that threads that share the signals never see half of it
    if kept is not None and kept[0] == (t, zeta):
        return kept[1]
    undone = s.replace(**{c: s[c] + lost(s, c, (2 * zeta * t, t**2)) for c in s.channels})
    s.cache["before the filter"] = ((t, zeta), undone)
    return undone


def low_passed(x: np.ndarray, sample_time: float, t: float, zeta: float) -> np.ndarray:
    """(n,) x behind 1/(1 + 2ζTs + T²s²), in the frequency domain, its ends continued by their odd reflection."""
    spectrum, omega = _continued(x, sample_time)
    s = 1j * omega
    passed = spectrum / (1 + 2 * zeta * t * s + (t * s) ** 2)
    return np.fft.irfft(passed, 2 * spectrum.size - 2)[x.size // 2: x.size // 2 + x.size]


class ForceOffset(ChainEffect):
    """Zero of the load cell (equation sheet 3.20)."""

    name: ClassVar[str] = "force-offset"
    memoryless: ClassVar[bool] = True
    title: ClassVar[str] = "zero of the load cell"
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "F_recorded = F + F_0"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "the load cell unloaded before and after; creep at several positions and temperatures"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("offset", "N", "F_0", 0.0, (-500.0, 500.0), (-1e4, 1e4), (-50.0, 50.0)),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        offset = float(values[0])
        return lambda s: core(s) + offset

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("a constant as a further input", regressors=("1",))


class ForceClipping(Effect):
    """The amplifier saturates (equation sheet 3.20)."""

    name: ClassVar[str] = "force-clipping"
    memoryless: ClassVar[bool] = True
    title: ClassVar[str] = "the force is clipped by its amplifier"
    family: ClassVar[str] = "measurement"
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "|F_recorded| <= F_max = 1/r"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "a larger force range of the amplifier, or a smaller motion"
    smooth: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("reciprocal_limit", "1/N", "r = 1/F_max", 0.0, (0.0, 0.05), (0.0, 0.1), (1e-3,)),)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        peak = max(float(np.abs(s.output).max()) for s in signals)
        return [np.array([1 / (share * peak)]) for share in (0.55, 0.7, 0.85, 0.93, 0.97, 1.0) if peak > 0]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return None if baseline.output == "force" else f"{baseline.name} does not simulate a force"

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        reciprocal = float(values[0])
        if reciprocal <= 0:
            return core
        limit = 1 / reciprocal
        return lambda s: np.clip(core(s), -limit, limit)

    def lpv_change(self) -> LpvChange | None:
        return None
