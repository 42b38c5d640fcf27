"""Motion and current of the foreign rig on its fine clock, dimensionless: root mean square of the velocity 1."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfilt

MOTIONS = ("road", "multisine", "sweep", "programme", "slow")
CURRENTS = ("steps", "ramps", "constant")
FREQUENCIES = (0.4, 0.9, 2.0, 4.5, 9.0)
"""Hz of the sines of a test programme"""


def motion(kind: str, n: int, rate: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and velocity (n,), from rest."""
    t = np.arange(n) / rate
    x = {"road": _road, "multisine": _multisine, "sweep": _sweep, "programme": _programme, "slow": _slow}[kind](
        t, rate, rng)
    rise = np.clip(t / 0.5, 0.0, 1.0)
    x = x * rise**3 * (10 - 15 * rise + 6 * rise**2)
    v = np.gradient(x, 1.0 / rate)
    size = np.sqrt(np.mean(v**2))
    x = x - x.mean()
    return x / size, v / size


def _road(t: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """White velocity between .3 and some 15 Hz."""
    sos = butter(2, (0.3, rng.uniform(8.0, 20.0)), "bandpass", fs=rate, output="sos")
    return np.cumsum(sosfilt(sos, rng.standard_normal(t.size))) / rate


def _multisine(t: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Twenty-four incommensurate sines from .2 to 20 Hz, of equal velocity."""
    total = np.zeros_like(t)
    for f in np.geomspace(0.2, 20.0, 24) * rng.uniform(0.97, 1.03, 24):
        total += np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) / f
    return total


def _sweep(t: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Logarithmic sweep from .3 to some 15 Hz, velocity falling slowly."""
    first, last = 0.3, rng.uniform(10.0, 20.0)
    growth = np.log(last / first) / t[-1]
    frequency = first * np.exp(growth * t)
    return np.sin(2 * np.pi * (frequency - first) / growth) / frequency**0.8


def _programme(t: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Sines one after the other, amplitude and frequency drawn, joined smoothly."""
    count = 8
    edges = np.linspace(0.0, t[-1], count + 1)
    total = np.zeros_like(t)
    for k in range(count):
        f = rng.choice(FREQUENCIES)
        length = edges[k + 1] - edges[k]
        place = (t - edges[k]) / length
        window = np.sin(np.pi * np.clip(place, 0, 1)) ** 2
        total += window**0.25 * rng.uniform(0.4, 1.6) / f * np.sin(2 * np.pi * f * (t - edges[k])) * (
            (place >= 0) & (place <= 1))
    sos = butter(2, 40.0, fs=rate, output="sos")
    return np.asarray(sosfilt(sos, total))


def _slow(t: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Rounded triangles of several speeds."""
    speeds = rng.permutation(np.geomspace(0.2, 2.0, 6))
    velocity = np.zeros_like(t)
    edges = np.linspace(0.0, t[-1] + 1e-9, speeds.size + 1)
    for k, speed in enumerate(speeds):
        inside = (t >= edges[k]) & (t < edges[k + 1])
        velocity[inside] = speed * np.sign(np.sin(2 * np.pi * (2 + k % 2) * (t[inside] - edges[k])
                                                  / (edges[k + 1] - edges[k])))
    sos = butter(2, 8.0, fs=rate, output="sos")
    return np.cumsum(sosfilt(sos, velocity)) / rate


def current(kind: str, n: int, rate: float, hold: int, rng: np.random.Generator) -> np.ndarray:
    """(n,) current between 0 and 1, held over `hold` fine samples as a digital output holds it."""
    t = np.arange(0, n, hold) / rate
    if kind == "constant":
        level = np.full(t.size, rng.choice((0.0, 0.3, 0.6)))
    elif kind == "steps":
        moments = np.cumsum(rng.uniform(0.1, 0.7, int(t[-1] / 0.1) + 2))
        level = rng.uniform(0, 1, moments.size + 1)[np.searchsorted(moments, t)]
    else:
        knots = np.arange(0, t[-1] + 1.5, 0.8)
        level = np.interp(t, knots, rng.uniform(0, 1, knots.size))
    return np.repeat(level, hold)[:n]
