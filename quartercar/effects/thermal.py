"""Thermal causes: the force decreases as the work of the damper heats the fluid."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import EffectParameter, GridEffect, LpvChange
from lpvid.rounding import HALF_DIGITS
from quartercar.effects.force_output import no_force
from quartercar.effects.viscous import static_share, viscous_slope

COOLING_TIME = EffectParameter("cooling_time", "s", "tau = C/(hA)", 60.0, (5.0, 2000.0), (5.0, 2900.0), (20.0, 200.0))
"""second parameter of the thermal causes"""
SWEEPS = 20
"""sweeps of heat and force at most. A sweep of a fade a reduces the error to (a P t)^k/k! of the heat, as the force
depends on the heat of earlier samples alone: to `HALF_DIGITS` where the force falls to e⁻³ of what it was"""


def stored_heat(s: Signals, power: np.ndarray, cooling: float) -> np.ndarray:
    """(n,) heat E in the fluid [J] above its start: dE/dt = P₊ − E/τ, exact for a power held over a sample.

    A stretch of a record starts with the heat of the measured work before it.

    Parameters
    ----------
    s : Signals
    power : (n,) array
        P = F v [W]; negative power does not heat.
    cooling : float
        τ [s].

    Returns
    -------
    (n,) array
        At each sample, from the power of those before; 0 at the first one of a record.
    """
    from scipy.signal import lfilter

    def after(power: np.ndarray) -> np.ndarray:
        warmed = np.maximum(power, 0.0) * cooling * -np.expm1(-s.sample_time / cooling)
        return np.asarray(lfilter([1.0], [1.0, -np.exp(-s.sample_time / cooling)], warmed))

    def before(past: Signals) -> float:
        return past.remembered("heat", cooling, lambda: float(after(past.output * past["velocity"])[-1]))

    if not s.stretches:
        return np.concatenate([[0.0], after(power)[:-1]])
    out = np.empty(s.n_samples)
    for t, (first, last) in zip(s.stretches, s.pieces, strict=True):
        out[first:last] = np.concatenate([[0.0], after(power[first:last])[:-1]])
        if t.past is not None:
            out[first:last] += before(t.past) * np.exp(-s.times[: last - first] / cooling)
    return out


Parts = tuple[np.ndarray, ...]
"""the cold force, (n,), and parts of it on which the heat acts differently, (n,) each"""


def heated(cold: Callable[[Signals], Parts], warm: Callable[[Parts, np.ndarray], np.ndarray], cooling: float) -> Core:
    """A core that changes with the heat of its own work.

    Where a law is only evaluated, at other speeds than those of the record, the heat is that of the record.

    Parameters
    ----------
    cold : callable
        Signals to the parts of the cold force.
    warm : callable
        These parts and the heat at their samples, (n,) [J], to the force, (n,).
    cooling : float
        Time constant [s].

    Returns
    -------
    Core
        From signals to the (n,) force [N].
    """
    known: list[tuple[Signals, np.ndarray]] = []

    def heat_along(record: Signals, parts: Parts | None = None) -> np.ndarray:
        for s, heat in known:
            if s is record:
                return heat
        parts = parts or cold(record)
        force, heat = parts[0], np.zeros(record.n_samples)
        for _ in range(SWEEPS):
            before, heat = heat, stored_heat(record, force * record["velocity"], cooling)
            force = warm(parts, heat)
            if not np.abs(heat - before).max() > HALF_DIGITS * heat.max():
                break
        known.append((record, heat))
        return heat

    def run(s: Signals) -> np.ndarray:
        if s.record is None:
            parts = cold(s)
            return warm(parts, heat_along(s, parts))
        return warm(cold(s), s.of_record(heat_along(s.record)))

    return run


class ThermalEffect(GridEffect):
    """A cause that depends on the heat in the damper."""

    family: ClassVar[str] = "thermal"
    stage: ClassVar[str] = "core"
    layer: ClassVar[int] = 1
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    reference: ClassVar[str] = "equation sheet 3.16"

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)


class ThermalFade(ThermalEffect):
    """The force of the flow decreases with the heat: F_s + (F − F_s)(1 − a E), a = α/C (equation sheet 3.16).

    The static share F_s, of gas and preload, does not: the pressure of a gas increases with its temperature.
    """

    name: ClassVar[str] = "thermal-fade"
    title: ClassVar[str] = "the force fades as the damper heats up"
    equation: ClassVar[str] = "F -> F_s + (F - F_s)(1 - a E), dE/dt = F v - E/tau, a = alpha/C"
    experiment: ClassVar[str] = "the same segment repeated through a long run of constant power, with rests"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("fade", "1/J", "a, share of the force lost per joule of heat", 0.0, (0.0, 1e-3),
                                (0.0, 1e6), (5e-6, 5e-5, 5e-4)),
                COOLING_TIME)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        fade, cooling = float(values[0]), float(values[1])
        if fade <= 0:
            return core

        def cold(s: Signals) -> Parts:
            return core(s), static_share(s, core, baseline)

        def warm(parts: Parts, heat: np.ndarray) -> np.ndarray:
            return parts[1] + (parts[0] - parts[1]) * np.maximum(1 - fade * heat, 0.0)

        return heated(cold, warm, cooling)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the heat as a slow second scheduling variable", schedule=("heat",))


class ViscousFade(ThermalEffect):
    """The viscous share alone decreases, as the viscosity does with the temperature (equation sheet 3.16)."""

    name: ClassVar[str] = "viscous-fade"
    title: ClassVar[str] = "the viscous share of the force fades as the damper heats up"
    equation: ClassVar[str] = "F -> F - c(i) v (1 - exp(-b E)), dE/dt = F v - E/tau"
    experiment: ClassVar[str] = "a long run of constant power in which low and high speeds alternate"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("fade", "1/J", "b, share of the damping lost per joule of heat, at first", 0.0,
                                (0.0, 1e-2), (0.0, 1e6), (2e-5, 2e-4, 2e-3)),
                COOLING_TIME)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        fade, cooling = float(values[0]), float(values[1])
        if fade <= 0:
            return core

        def cold(s: Signals) -> Parts:
            return core(s), viscous_slope(s, core, baseline) * s["velocity"]

        def warm(parts: Parts, heat: np.ndarray) -> np.ndarray:
            return parts[0] + parts[1] * np.expm1(-fade * heat)

        return heated(cold, warm, cooling)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the heat as a slow second scheduling variable", schedule=("heat",))
