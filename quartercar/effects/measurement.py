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
SMOOTH_OVER = 0.025
"""length of the local cubic by which a motion is differentiated before a filter is undone [s]: it passes about 70 Hz,
beyond which undoing a filter would raise little but the noise of the sensor"""


def shifted(values: np.ndarray, samples: float) -> np.ndarray:
    """Values read `samples` later (earlier where negative), linear in between, the ends held."""
    n = np.arange(values.size)
    return np.interp(n + samples, n, values)


class ChainEffect(GridEffect):
    """A cause in the measurement chain."""

    family: ClassVar[str] = "measurement"

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return None if baseline.output == "force" else f"{baseline.name} does not simulate a force"


class DisplacementDelay(ChainEffect):
    """The motion is recorded late against the force (equation sheet 3.20)."""

    name: ClassVar[str] = "displacement-delay"
    stepwise: ClassVar[bool] = True
    title: ClassVar[str] = "the motion is recorded later than the force"
    stage: ClassVar[str] = "channel"
    equation: ClassVar[str] = "x(t) = x_recorded(t + T), v alike"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "a spring in place of the damper, or a synchronisation pulse on all channels"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    resolution: ClassVar[float] = 0.5

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("delay", "s", "T", 0.0, (0.0, 0.02), (0.0, 0.1), (0.001, 0.003, 0.008, 0.016)),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        delay = float(values[0])
        if delay <= 0:
            return core

        def run(s: Signals) -> np.ndarray:
            late = {m: shifted(s[m], delay / s.sample_time) for m in MOTION if s.has(m)}
            return core(s.replace(**late))

        return run

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the input's delay chosen anew", delay=True)


class ForceDelay(ChainEffect):
    """The force is recorded late against all that drives it: every input is read T earlier (equation sheet 3.20)."""

    name: ClassVar[str] = "force-delay"
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
    """The motion alone has passed a second-order low-pass, which is undone before the law sees it (sheet 1.4.10)."""

    name: ClassVar[str] = "one-sided-filter"
    title: ClassVar[str] = "the motion was low-passed and the force was not"
    stage: ClassVar[str] = "channel"
    equation: ClassVar[str] = "x = x_r + 2 zeta T dx_r/dt + T^2 d2x_r/dt2, T = 1/(2 pi f_c)"
    reference: ClassVar[str] = "equation sheet 1.4.10, E4.10"
    experiment: ClassVar[str] = "the same record with both channels unfiltered, or both through the same filter"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    resolution: ClassVar[float] = 0.5

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("time_constant", "s", "T = 1/(2 pi corner frequency)", 0.0, (0.0, 0.04), (0.0, 0.2),
                                (0.002, 0.005, 0.01, 0.02)),
                EffectParameter("damping", "", "zeta", 0.7071, (0.4, 1.2), (0.3, 2.0), (0.5, 0.7071, 1.0)))

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        t, zeta = float(values[0]), float(values[1])
        if t <= 0:
            return core

        def run(s: Signals) -> np.ndarray:
            undone = {}
            for m in MOTION:
                if s.has(m):
                    first, second = derivatives(s, m)
                    undone[m] = s[m] + 2 * zeta * t * first + t**2 * second
            return core(s.replace(**undone))

        return run

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("two more samples of the input", order=2)


def derivatives(s: Signals, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """(n,) first and second time derivative of a channel by local cubics over `SMOOTH_OVER`."""
    from scipy.signal import savgol_filter

    def make() -> np.ndarray:
        x = s[channel]
        width = max(2 * round(0.5 * SMOOTH_OVER / s.sample_time) + 1, 5)
        if x.size < width:
            return np.zeros((2, x.size))
        return np.array([savgol_filter(x, width, 3, deriv=k, delta=s.sample_time) for k in (1, 2)])

    both = s.cached(("derivatives", channel), make)
    return both[0], both[1]


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
        return (EffectParameter("reciprocal_limit", "1/N", "r = 1/F_max", 0.0, (0.0, 0.01), (0.0, 0.1), (1e-3,)),)

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
