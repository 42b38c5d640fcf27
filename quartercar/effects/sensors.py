"""Sensors: an input channel whose scale or sign is wrong; the channel is a parameter of the effect."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import Effect, EffectParameter, LpvChange
from lpvid.rounding import STEP
from quartercar.effects.electrical import with_same_jumps
from quartercar.effects.measurement import MOTION

SENSORS: Mapping[str, tuple[str, ...]] = {
    "road": ("road",), "actuator": ("actuator",), "motion": MOTION,
    "current": ("current",)}
"""Sensors of inputs, and the channels that each of them feeds."""
SMALL = (-STEP, STEP)
"""relative changes at which a gain or a parameter of a car is screened: so small that their effect is the derivative
(by the step that balances curvature and rounding in a central difference)"""
CHANNEL = EffectParameter("channel", "", "the sensor", 0.0, (0.0, len(SENSORS) - 1), (0.0, len(SENSORS) - 1), (0.0,),
                          tuple(SENSORS))


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
    """Indices of the sensors that every record has."""
    return [float(k) for k, c in enumerate(SENSORS.values()) if all(any(s.has(n) for n in c) for s in signals)]


def scaled(core: Core, sensor: float, factor: float) -> Core:
    """The simulation with all channels of one sensor multiplied.

    Parameters
    ----------
    core : Core
    sensor : float
        Index in `SENSORS`, rounded.
    factor : float
        By which its channels are multiplied; −1 reverses their sign.

    Returns
    -------
    Core
    """
    channels = list(SENSORS.values())[round(sensor)]

    def changed(s: Signals) -> Signals:
        return with_same_jumps(s.replace(**{n: factor * s[n] for n in channels if s.has(n)}), s)

    return lambda s: s.along_others("gain", (round(sensor), factor), lambda: changed(s), core)


class SensorScale(SensorEffect):
    """The gain of an input channel is off (equation sheet 3.20).

    The gain of a damper's motion or current is not identifiable beside the fitted parameters of its law: F = c v with a
    gain g is c (1 + g) v. A gain would only be found where such a parameter is at its bound. The gains of the road and
    of the actuator's force of a car are identifiable.
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
            return f"the parameters of {baseline.name} compensate the gain of its inputs"
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
