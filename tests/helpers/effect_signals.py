"""Signals and laws on which effects are composed in tests."""

from __future__ import annotations

import numpy as np

from lpvid.baselines import spectra
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import Effect
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.laws.guo import Guo
from quartercar.dampers.laws.power_law import PowerLaw

PERIOD = 1 / 512


def guo() -> DamperBaseline:
    """Guo's law, affine in the current, at its default parameters."""
    return DamperBaseline(Guo(degree=1, span=(0.0, 2.5)))


def power_law() -> DamperBaseline:
    """The power law at its default parameters."""
    return DamperBaseline(PowerLaw())


def road_like(seed: int = 0, n: int = 4096, hold: int = 64) -> Signals:
    """A smooth random motion of 0.3 m/s at most, a current held for `hold` samples, and 10 N of noise as the output."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(n)
    x, v = np.zeros(n), np.zeros(n)
    for frequency in (0.7, 1.9, 4.3, 7.1):
        size, phase, w = rng.uniform(1e-3, 4e-3), rng.uniform(0, 6), 2 * np.pi * frequency
        x += size * np.sin(w * t + phase)
        v += size * w * np.cos(w * t + phase)
    current = np.repeat(rng.uniform(0.0, 2.5, -(-n // hold)), hold)[:n]
    return Signals(PERIOD, {"displacement": x, "velocity": v, "current": current}, 10 * rng.standard_normal(n),
                   span=(0.0, 1.0))


def without_noise(s: Signals, channel: str) -> np.ndarray:
    """(n,) a channel with each frequency weighed by that share of its power which is not its sensor's noise."""
    return spectra._weighed(s, channel, lambda omega, share: share)


def composed(effect: Effect, values: list[float], signals: Signals, core: Core) -> np.ndarray:
    """(n,) a core with one effect around it."""
    return effect.compose(core, np.array(values), guo())(signals)


def current_itself(signals: Signals) -> np.ndarray:
    """A law whose force is the current."""
    return signals["current"]


def speed_itself(signals: Signals) -> np.ndarray:
    """A law whose force is the velocity."""
    return signals["velocity"]


def nothing(signals: Signals) -> np.ndarray:
    """A law without force."""
    return np.zeros(signals.n_samples)


def motion(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and velocity with content up to 9 Hz."""
    x, v = np.zeros_like(times), np.zeros_like(times)
    for size, frequency, phase in ((4e-3, 0.8, 0.3), (2e-3, 2.7, 1.0), (8e-4, 9.0, 2.0)):
        w = 2 * np.pi * frequency
        x += size * np.sin(w * times + phase)
        v += size * w * np.cos(w * times + phase)
    return x, v
