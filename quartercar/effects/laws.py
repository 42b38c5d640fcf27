"""Laws that a simple baseline lacks: a hardening spring, saturating damping, a dead zone of the force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import MOST_SIZES, EffectParameter, GridEffect, LpvChange
from lpvid.rounding import TINY
from quartercar.effects.force_output import no_force
from quartercar.effects.friction_gas import CoulombFriction, ParallelForce
from quartercar.effects.hydraulics import HydraulicEffect
from quartercar.effects.viscous import top_speed, viscous_slope


class CubicSpring(ParallelForce):
    """A spring that hardens or softens with the displacement: the next terms of its characteristic (Duffing 1918)."""

    name: ClassVar[str] = "cubic-spring"
    title: ClassVar[str] = "a spring that hardens or softens with the displacement"
    family: ClassVar[str] = "elastic"
    equation: ClassVar[str] = "F += k_3 x^3 + k_2 x^2"
    reference: ClassVar[str] = "Duffing 1918; Wigren, Schoukens 2013, the silverbox"
    experiment: ClassVar[str] = "slow strokes of several amplitudes: the mean of both directions over position"
    needs: ClassVar[tuple[str, ...]] = ("displacement",)
    strengths: ClassVar[int] = 2

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("cubic", "N/m^3", "k_3", 0.0, (-1e9, 1e9), (-1e15, 1e15), (-1e6, 1e6)),
                EffectParameter("quadratic", "N/m^2", "k_2", 0.0, (-1e7, 1e7), (-1e12, 1e12), (-1e4, 1e4)))

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return _each_alone([p.grid for p in self.parameters])

    def spread_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        return _each_alone([p.spread(scale(p.unit), strength=True) for p in self.parameters])

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        cubic, quadratic = float(values[0]), float(values[1])
        if not cubic and not quadratic:
            return core
        return lambda s: core(s) + s["displacement"] ** 2 * (cubic * s["displacement"] + quadratic)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("scheduled on the displacement too", degree=2, schedule=("displacement",))


def _each_alone(grids: Sequence[Sequence[float]]) -> list[np.ndarray]:
    """Points at which one strength is not zero: the effects of the strengths are linear and add up."""
    return [np.array([v if j == k else 0.0 for j in range(len(grids))]) for k, grid in enumerate(grids) for v in grid]


class SaturatingDamping(HydraulicEffect):
    """The viscous share saturates with the speed, towards a constant force (equation sheet 9.1).

    c(i) v becomes c(i) tanh(q v)/q: the smooth yield of a damper whose valve opens progressively. For large q it is dry
    friction. It is a form, whose cause may be a valve that opens at one pressure.
    """

    name: ClassVar[str] = "saturating-damping"
    title: ClassVar[str] = "the viscous share saturates with the speed"
    equation: ClassVar[str] = "c(i) v -> c(i) tanh(q v)/q"
    reference: ClassVar[str] = "equation sheet 1.2, 9.1; Kwok 2006 without its hysteresis"
    experiment: ClassVar[str] = "triangles at ten speeds over 1.5 decades at constant current"
    smooth: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("steepness", "s/m", "q, reciprocal of the speed of the bend", 0.0, (0.0, 1e3),
                                (0.0, 1e5), (3.0, 10.0, 30.0, 100.0)),)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        """From nearly linear up to the top speed to nearly dry, by factors of two."""
        return [np.array([k / top_speed(signals)]) for k in 2.0 ** np.arange(-1, MOST_SIZES - 2)]

    def added(self, s: Signals, core: Core, values: np.ndarray, baseline: Baseline) -> np.ndarray:
        q, v = float(values[0]), s["velocity"]
        return viscous_slope(s, core, baseline) * (np.tanh(q * v) / q - v)

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """A valve in parallel to the main path, whose knee is smoothed by the flow and the law's own error."""
        return ("relief-valve",)

    def comes_to(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """Dry friction, where friction that reverses over the speed 1/q would not be listed with it."""
        if not any(np.any(s["velocity"]) for s in signals):
            return ()
        friction = CoulombFriction()
        same = np.array([*friction.neutral[:2], 1 / max(float(values[0]), TINY)])
        return () if self.name in friction.stands_for(same, signals) else (friction.name,)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("v|v| as a further input", regressors=("velocity|velocity|",))


class ForceDeadZone(GridEffect):
    """The load cell measures no force below a threshold, and less above it: a lost preload, a loose joint."""

    name: ClassVar[str] = "force-dead-zone"
    title: ClassVar[str] = "a dead zone of the force about zero"
    family: ClassVar[str] = "elastic"
    memoryless: ClassVar[bool] = True
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "F_recorded = (|F| - F_d)+ sign F"
    reference: ClassVar[str] = "Tao, Kokotovic 1996, dead zone"
    experiment: ClassVar[str] = "a slow triangle about zero force, with the joints preloaded and not"
    smooth: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("threshold", "N", "F_d", 0.0, (0.0, 100.0), (0.0, 1e6), (5.0, 20.0)),)

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        threshold = float(values[0])
        if threshold <= 0:
            return core

        def run(s: Signals) -> np.ndarray:
            force = core(s)
            return force - np.clip(force, -threshold, threshold)

        return run

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """Play, which is a loose joint too and keeps the force near zero until the motion has passed it."""
        return ("backlash",)

    def lpv_change(self) -> LpvChange | None:
        return None
