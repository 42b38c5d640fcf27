"""Causes in a quarter car: strut, masses, tyre, actuator."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import EffectParameter, GridEffect, LpvChange
from quartercar.baselines.quarter_car import QuarterCarBaseline
from quartercar.effects.sensors import SMALL
from quartercar.vehicle.strut_friction import CarCore


class CarEffect(GridEffect):
    """A cause inside a quarter car."""

    family: ClassVar[str] = "car"
    stage: ClassVar[str] = "inside"
    needs: ClassVar[tuple[str, ...]] = ("road", "sprung", "unsprung")
    reference: ClassVar[str] = "equation sheet 4.1"

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return None if isinstance(baseline, QuarterCarBaseline) else f"{baseline.name} is no quarter car"

    def lpv_change(self) -> LpvChange | None:
        return None


def _car(core: Core) -> CarCore:
    assert isinstance(core, CarCore)
    return core


class StrutFriction(CarEffect):
    """Dry friction between sprung and unsprung mass (equation sheet 3.1, 4.1)."""

    name: ClassVar[str] = "strut-friction"
    title: ClassVar[str] = "dry friction in the strut"
    equation: ClassVar[str] = "F_strut += F_c sign(dz_s/dt - dz_us/dt)"
    experiment: ClassVar[str] = "slow, small steps of the road: the body stays within the band of the friction"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("friction", "N", "F_c", 0.0, (0.0, 500.0), (0.0, 1e4), (0.05, 0.5, 5.0, 50.0)),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        return _car(core).changed(friction=float(values[0]))


class Payload(CarEffect):
    """A sprung mass other than assumed (equation sheet 4.1)."""

    name: ClassVar[str] = "payload"
    title: ClassVar[str] = "the sprung mass is not what was assumed"
    equation: ClassVar[str] = "m_s -> m_s (1 + g)"
    experiment: ClassVar[str] = "weigh it, or the same road with a known further mass"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("relative_mass", "", "g", 0.0, (-0.5, 1.0), (-0.9, 5.0), SMALL),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        car = _car(core)
        return car.changed(sprung_mass=car.car.sprung_mass * (1 + float(values[0])))


class TyreStiffness(CarEffect):
    """A tyre stiffness other than assumed: pressure, load (equation sheet 4.1)."""

    name: ClassVar[str] = "tyre-stiffness"
    title: ClassVar[str] = "the tyre is stiffer or softer than assumed"
    equation: ClassVar[str] = "k_t -> k_t (1 + g)"
    experiment: ClassVar[str] = "a sweep through the wheel hop, or a static load on the tyre"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("relative_stiffness", "", "g", 0.0, (-0.7, 2.0), (-0.95, 20.0), SMALL),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        car = _car(core)
        return car.changed(tyre_stiffness=car.car.tyre_stiffness * (1 + float(values[0])))


class TyreDamping(CarEffect):
    """Damping of the tyre that was left out (equation sheet 4.1)."""

    name: ClassVar[str] = "tyre-damping"
    title: ClassVar[str] = "the tyre damps more or less than assumed"
    equation: ClassVar[str] = "c_t -> c_t + g sqrt(k_t m_us)"
    experiment: ClassVar[str] = "a sweep through the wheel hop at small amplitude"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("relative_damping", "", "g", 0.0, (-0.5, 1.0), (-5.0, 10.0), SMALL),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        car = _car(core)
        scale = float(np.sqrt(car.car.tyre_stiffness * car.car.unsprung_mass))
        return car.changed(tyre_damping=max(car.car.tyre_damping + float(values[0]) * scale, 0.0))


class ActuatorDelay(GridEffect):
    """The actuator acts later than it is recorded (equation sheet 3.13)."""

    name: ClassVar[str] = "actuator-delay"
    stepwise: ClassVar[bool] = True
    title: ClassVar[str] = "the actuator acts later than it is recorded"
    family: ClassVar[str] = "car"
    stage: ClassVar[str] = "channel"
    equation: ClassVar[str] = "F(t) = F_recorded(t - T)"
    reference: ClassVar[str] = "equation sheet 3.13"
    experiment: ClassVar[str] = "steps of the actuator on a level road"
    needs: ClassVar[tuple[str, ...]] = ("actuator",)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("delay", "s", "T", 0.0, (0.0, 0.1), (0.0, 0.5), (0.004, 0.01, 0.03)),)

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return None if "actuator" in baseline.channels else f"{baseline.name} has no actuator"

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        delay = float(values[0])
        if delay <= 0:
            return core
        return lambda s: core(s.replace(actuator=np.interp(s.times - delay, s.times, s["actuator"])))

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the input's delay chosen anew", delay=True)
