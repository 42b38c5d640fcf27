"""Sensors: an input channel whose scale or whose sign is wrong; which one is a choice that the effect makes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.effect import Effect, EffectParameter, LpvChange
from lpvid.diagnosis.signals import Core, Signals
from quartercar.effects.electrical import in_proportion

SENSORS: Mapping[str, tuple[str, ...]] = {
    "road": ("road",), "actuator": ("actuator",), "motion": ("displacement", "velocity", "acceleration"),
    "current": ("current",)}
"""Sensors of inputs, and the channels that each of them feeds."""
SMALL = (-1e-6, 1e-6)
"""gains at which it is looked at: so small that their effect is the derivative"""
LAST = len(SENSORS) - 1.0
CHANNEL = EffectParameter("channel", "", "the sensor", 0.0, (0.0, LAST), (0.0, LAST), (0.0,), tuple(SENSORS))


class SensorEffect(Effect):
    """A sensor whose signal is multiplied by a wrong number."""

    family: ClassVar[str] = "measurement"
    memoryless: ClassVar[bool] = True
    stage: ClassVar[str] = "channel"
    reference: ClassVar[str] = "equation sheet 3.20"

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        read = {c for c in baseline.channels if c != baseline.output}
        return None if any(read & set(c) for c in SENSORS.values()) else f"{baseline.name} reads none of the inputs"

    def lpv_change(self) -> LpvChange | None:
        return None


def _present(signals: tuple[Signals, ...]) -> list[float]:
    """Numbers of the sensors that every record has."""
    return [float(k) for k, c in enumerate(SENSORS.values()) if all(any(s.has(n) for n in c) for s in signals)]


def scaled(core: Core, sensor: float, factor: float) -> Core:
    """The simulation with all that one sensor feeds multiplied.

    Parameters
    ----------
    core : Core
    sensor : float
        Place in `SENSORS`, rounded to a whole one.
    factor : float
        By which its channels are multiplied; −1 turns their sign.

    Returns
    -------
    Core
    """
    channels = list(SENSORS.values())[round(sensor)]
    return lambda s: in_proportion(s.replace(**{n: factor * s[n] for n in channels if s.has(n)}), s).passed(core)


class SensorScale(SensorEffect):
    """The gain of an input channel is off (equation sheet 3.20).

    A damper's law takes up the gain of its motion or its current by numbers of its own, which are fitted: of
    F = c v a gain g makes c (1 + g) v. What is left of it beside them is a number of the law beyond its bound. A
    car reads a road and an actuator's force besides, of which nothing in it sets the size.
    """

    name: ClassVar[str] = "sensor-scale"
    title: ClassVar[str] = "the scale of an input channel is wrong"
    equation: ClassVar[str] = "u = u_recorded (1 + g)"
    experiment: ClassVar[str] = "calibrate the channel against a known displacement, force or current"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return EffectParameter("gain", "", "g", 0.0, (-0.5, 0.5), (-0.9, 2.0), SMALL), CHANNEL

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        if {"road", "actuator"}.isdisjoint(baseline.channels):
            return f"the numbers of {baseline.name} take up the gain of what it reads"
        return super().applies(baseline, signals)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return [np.array([gain, k]) for k in _present(signals) for gain in SMALL]

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        return core if values[0] == 0 else scaled(core, float(values[1]), 1 + float(values[0]))


class ChannelSign(SensorEffect):
    """An input channel is recorded with the other sign (equation sheet 3.20)."""

    name: ClassVar[str] = "channel-sign"
    title: ClassVar[str] = "an input channel has the wrong sign"
    equation: ClassVar[str] = "u = -u_recorded"
    experiment: ClassVar[str] = "a known static displacement, force or current"
    smooth: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("turned", "", "whether the sign is wrong", 0.0, (0.0, 1.0), (0.0, 1.0), (1.0,),
                                ("as recorded", "turned")), CHANNEL)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return [np.array([1.0, k]) for k in _present(signals)]

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        return core if round(float(values[0])) == 0 else scaled(core, float(values[1]), -1.0)
