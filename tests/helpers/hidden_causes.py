"""What the virtual rig can hide: its own causes by physical size, other laws for some of them, and unheard-of ones.

Everything here stands on the rig's fine clock and never sees a line of `quartercar.effects`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from lpvid.toolkit import njit
from quartercar.rig import effect
from quartercar.rig.damper import Motion, delayed, low_passed
from quartercar.rig.setup import Setup

FULL_CURRENT = 2.5


def _same(value: np.ndarray, rate: float) -> np.ndarray:
    return value


@dataclass(frozen=True)
class Imposed:
    """How a cause of one size enters the rig: before, inside or after its integrator, on the fine clock.

    Attributes
    ----------
    setup : callable
        Setup to Setup: the rig's own way.
    command, channel : callable
        (signal, rate) to signal: on the driver's current; on displacement and velocity as they are recorded.
    force : callable
        (force, motion) to force, behind the integrator.
    """

    setup: Callable[[Setup], Setup] = lambda s: s
    command: Callable[[np.ndarray, float], np.ndarray] = _same
    channel: Callable[[np.ndarray, float], np.ndarray] = _same
    force: Callable[[np.ndarray, Motion], np.ndarray] = lambda f, motion: f


@dataclass(frozen=True)
class Hideable:
    """A cause with a size in SI units, and what it needs in order to be visible at all.

    Attributes
    ----------
    name : str
    typical, largest : float
        A size to start from when its visibility is looked for; the largest that makes sense.
    rig : callable
        (size, scene) to `Imposed`, the law that the catalogue knows.
    other : callable or None
        The same cause by another law.
    parameter : str or None
        The number of the catalogue's entry that equals `size`; None where the two are told in different terms.
    current : bool
        Whether it needs a damper that listens to the current.
    least : float
        Size below which any lag is one sample late to a current that steps at the samples: not a size to be told.
    """

    name: str
    typical: float
    largest: float
    rig: Callable[[float, Scene], Imposed]
    other: Callable[[float, Scene], Imposed] | None = None
    parameter: str | None = None
    current: bool = False
    least: float = 0.0


@dataclass(frozen=True)
class Scene:
    """Scales of one experiment by which shapes are chosen: quantiles of |x|, peak force, length [s], a drawn number."""

    reach: float
    stroke: float
    speed: float
    peak: float
    duration: float
    ratio: float


def _own(name: str, parameter: str, strength: float = 1.0, **fixed: float) -> Callable[[float, Scene], Imposed]:
    return lambda size, scene: Imposed(setup=effect(name, strength, **{parameter: size}, **fixed).apply)


def _by_strength(name: str, **fixed: float) -> Callable[[float, Scene], Imposed]:
    return lambda size, scene: Imposed(setup=effect(name, size, **fixed).apply)


# -- other laws for the same causes -------------------------------------------------------------------------------
@njit()
def _lugre(velocity, level, step, out):
    """LuGre friction: bristles of 15 micrometres, 10 % stiction with 5 mm/s; implicit in the bristles."""
    z = 0.0
    for k in range(velocity.size):
        v = velocity[k]
        g = 15e-6 * (1.0 + 0.1 * np.exp(-((v / 5e-3) ** 2)))
        z = (z + step * v) / (1.0 + step * abs(v) / g)
        out[k] = level * z / 15e-6


def _lugre_friction(size: float, scene: Scene) -> Imposed:
    def force(f: np.ndarray, motion: Motion) -> np.ndarray:
        out = np.empty_like(f)
        _lugre(motion.velocity, size, 1.0 / motion.rate, out)
        return f + out

    return Imposed(force=force)


def _first_order(signal: np.ndarray, tau: float, rate: float) -> np.ndarray:
    decay = np.exp(-1.0 / (tau * rate))
    return np.asarray(lfilter([1 - decay], [1, -decay], signal - signal[0])) + signal[0]


def _two_lags(size: float, scene: Scene) -> Imposed:
    return Imposed(command=lambda i, rate: _first_order(_first_order(i, 0.85 * size, rate), 0.15 * size, rate))


def _late(size: float) -> Callable[[np.ndarray, float], np.ndarray]:
    """A signal (n,) at a rate [1/s] as late as `size` [s], .8 of it a pure delay, the rest a second-order lag."""
    return lambda x, rate: low_passed(delayed(x, 0.8 * size * rate), 8 / (2 * np.pi * size), 0.8, rate)


def _late_driver(size: float, scene: Scene) -> Imposed:
    return Imposed(command=_late(size))


def _froehlich(size: float, scene: Scene) -> Imposed:
    return Imposed(command=lambda i, rate: i / (1 + size * np.abs(i)))


def _plays(size: float, scene: Scene) -> Imposed:
    def command(i: np.ndarray, rate: float) -> np.ndarray:
        starts = np.concatenate([[0], np.flatnonzero(np.diff(i)) + 1])
        lengths = np.diff(np.concatenate([starts, [i.size]]))
        out = np.zeros(starts.size)
        for width in (0.4 * size, size, 1.6 * size):
            y = float(i[0])
            for k, level in enumerate(i[starts]):
                y = min(max(y, level - width), level + width)
                out[k] += y / 3
        return np.repeat(out, lengths)

    return Imposed(command=command)


def _added(term: Callable[[Motion], np.ndarray]) -> Imposed:
    return Imposed(force=lambda f, motion: f + term(motion))


def _blunt_loss(size: float, scene: Scene) -> Imposed:
    return _added(lambda m: size * 0.1**0.2 * np.abs(m.velocity) ** 1.8 * np.sign(m.velocity))


def _slow_breakaway(size: float, scene: Scene) -> Imposed:
    return _added(lambda m: size * np.tanh(m.velocity / 2e-3) / (1 + (m.velocity / 0.01) ** 2))


def _hardening_gas(size: float, scene: Scene) -> Imposed:
    return _added(lambda m: size * m.displacement * (1 + 0.15 * (m.displacement / scene.stroke) ** 2))


def _hertz_stop(size: float, scene: Scene) -> Imposed:
    def term(m: Motion) -> np.ndarray:
        over = np.maximum(np.abs(m.displacement) - scene.reach, 0.0)
        return size * (scene.stroke - scene.reach) * (over / (scene.stroke - scene.reach)) ** 1.3 * np.sign(
            m.displacement)

    return _added(term)


def _sprung_mass(size: float, scene: Scene) -> Imposed:
    return _added(lambda m: size * low_passed(m.acceleration, 140.0, 0.05, m.rate))


def _warm_film(size: float, scene: Scene) -> Imposed:
    def force(f: np.ndarray, motion: Motion) -> np.ndarray:
        heat = np.maximum(f * motion.velocity, 0.0) / motion.rate / 30.0
        decay = 1 - 5.0 / 30.0 / motion.rate
        return f / (1 + size * np.asarray(lfilter([1.0], [1.0, -decay], heat)))

    return Imposed(force=force)


def _late_sensor(size: float, scene: Scene) -> Imposed:
    return Imposed(channel=_late(size))


def _third_order(size: float, scene: Scene) -> Imposed:
    t = size / 1.4142
    return Imposed(channel=lambda x, rate: _first_order(low_passed(x, 1 / (2 * np.pi * t), 0.5, rate), t, rate))


def _soft_clip(size: float, scene: Scene) -> Imposed:
    return Imposed(force=lambda f, motion: f / (1 + np.abs(f * size) ** 12) ** (1 / 12))


def _swelling(size: float, scene: Scene) -> Imposed:
    def force(f: np.ndarray, motion: Motion) -> np.ndarray:
        t = np.arange(f.size) / motion.rate
        return f * (1 + size * np.tanh(2 * np.sin(2 * np.pi * t / (0.8 * scene.duration))))

    return Imposed(force=force)


# -- the rig's own, by size ---------------------------------------------------------------------------------------
def _edges(size: float, scene: Scene) -> Imposed:
    return Imposed(setup=effect("rise-fall-lag", 1.0, rise=size * scene.ratio, fall=size / scene.ratio).apply)


HIDEABLE: tuple[Hideable, ...] = (
    Hideable("coulomb-friction", 20.0, 300.0, _own("coulomb-friction", "level"), _lugre_friction, "friction"),
    Hideable("stribeck-friction", 30.0, 300.0, _own("stribeck-friction", "level"), _slow_breakaway, "breakaway"),
    Hideable("gas-preload", 30.0, 800.0, _own("gas-preload", "preload"), None, "preload"),
    Hideable("gas-stiffness", 2000.0, 2e4, _own("gas-stiffness", "stiffness"), _hardening_gas, "stiffness"),
    Hideable("series-compliance", 2e-7, 4e-6,
             lambda size, scene: Imposed(setup=effect("series-compliance", 1.0, stiffness=1 / size).apply)),
    Hideable("backlash", 1e-4, 2e-3, _own("backlash", "play")),
    Hideable("entrained-air", 1e-4, 2e-3, _own("entrained-air", "stroke")),
    Hideable("quadratic-loss", 2000.0, 2e4, _own("quadratic-loss", "coefficient"), _blunt_loss),
    Hideable("relief-valve", 0.2, 0.9,
             lambda size, scene: Imposed(setup=effect("relief-valve", 1.0, slope=1 - size,
                                                      force=450 * scene.speed).apply)),
    Hideable("series-orifice", 1e4, 2e5,
             lambda size, scene: Imposed(setup=effect("series-orifice", 1.0, coefficient=size,
                                                      onset=0.4 * scene.speed).apply)),
    Hideable("asymmetry", 0.1, 2.0, _own("asymmetry", "gain")),
    Hideable("cavitation", 1 / 800.0, 1 / 50.0,
             lambda size, scene: Imposed(setup=effect("cavitation", 1.0, limit=1 / size).apply)),
    Hideable("valve-dynamics", 0.3, 1.0, _by_strength("valve-dynamics")),
    Hideable("network-topology", 0.3, 1.0, _by_strength("network-topology")),
    Hideable("input-nonlinearity", 0.2, 1.0,
             lambda size, scene: Imposed(setup=effect("input-nonlinearity", 1.0, exponent=1 + size).apply)),
    Hideable("coil-lag", 0.005, 0.1, _own("coil-lag", "tau"), _two_lags, "time_constant", True, 1e-3),
    Hideable("command-delay", 0.005, 0.03, _own("command-delay", "delay"), _late_driver, "delay", True, 2e-3),
    Hideable("rise-fall-lag", 0.008, 0.1, _edges, None, "time_constant", True, 1e-3),
    Hideable("current-saturation", 0.2, 2.0,
             lambda size, scene: Imposed(setup=effect("current-saturation", 1.0, limit=1 / size).apply), _froehlich,
             "saturation", True),
    Hideable("remanence", 0.08, 0.5, _own("remanence", "width"), _plays, "half_width", True),
    Hideable("scheduling-degree", 300.0, 1300.0, lambda size, scene: Imposed(
        setup=effect("scheduling-degree", 1.0, square=-size).apply), None, None, True),
    Hideable("thermal-fade", 0.01, 0.03, _own("thermal-fade", "rate", capacity=30.0), _warm_film),
    Hideable("viscous-fade", 0.03, 0.06, _own("viscous-fade", "rate", capacity=30.0)),
    Hideable("missing-scheduling", 0.05, 0.4,
             lambda size, scene: Imposed(setup=effect("missing-scheduling", 1.0, gain=size,
                                                      period=0.7 * scene.duration).apply), _swelling),
    Hideable("end-stop", 2e4, 1e6,
             lambda size, scene: Imposed(setup=effect("end-stop", 1.0, stiffness=size, position=scene.reach).apply),
             _hertz_stop, "stiffness"),
    Hideable("fixture-inertia", 2.0, 20.0, _own("fixture-inertia", "mass"), _sprung_mass, "mass"),
    Hideable("fixture-resonance", 0.003, 0.008,
             lambda size, scene: Imposed(setup=effect("fixture-resonance", 1.0,
                                                      frequency=1 / (2 * np.pi * size)).apply), None, "time_constant",
             False, 1.3e-3),
    Hideable("model-order", 0.2, 1.0, _own("model-order", "share"), None, "share"),
    Hideable("displacement-delay", 0.003, 0.02, _own("displacement-delay", "delay"), _late_sensor, "delay",
             False, 1e-3),
    Hideable("force-delay", 0.004, 0.02, _own("force-delay", "delay"), None, "delay", False, 2e-3),
    Hideable("one-sided-filter", 0.005, 0.04,
             lambda size, scene: Imposed(setup=effect("one-sided-filter", 1.0,
                                                      frequency=1 / (2 * np.pi * size)).apply),
             _third_order, "time_constant", False, 1e-3),
    Hideable("force-offset", 20.0, 500.0, _own("force-offset", "offset"), None, "offset"),
    Hideable("force-clipping", 1 / 900.0, 1 / 50.0,
             lambda size, scene: Imposed(setup=effect("force-clipping", 1.0, limit=1 / size).apply), _soft_clip,
             "reciprocal_limit"),
)
"""Causes of the catalogue, as the rig makes them."""


# -- causes that no catalogue describes ---------------------------------------------------------------------------
def _outside(term: Callable[[Motion, Scene], np.ndarray]) -> Callable[[float, Scene], Imposed]:
    return lambda size, scene: _added(lambda m: size * term(m, scene))


def _time(m: Motion) -> np.ndarray:
    return np.arange(m.displacement.size) / m.rate


@njit()
def _play(signal, width, out):
    y = signal[0]
    for k in range(signal.size):
        y = min(max(y, signal[k] - width), signal[k] + width)
        out[k] = y


def _bump(speed: np.ndarray) -> np.ndarray:
    """The force falls off about 45 % of the largest speed, in either direction."""
    return -np.sign(speed) * np.exp(-(((np.abs(speed) - 0.45) / 0.12) ** 2))


def _dragged(m: Motion, scene: Scene) -> np.ndarray:
    out = np.empty_like(m.displacement)
    _play(m.displacement, 0.25 * scene.stroke, out)
    return out / scene.stroke


def _ringing(m: Motion, scene: Scene) -> np.ndarray:
    """Struck by every change of the current: a decaying 9 Hz tone."""
    r, w = np.exp(-4.0 / m.rate), 2 * np.pi * 9.0 / m.rate
    steps = np.diff(m.command, prepend=m.command[0])
    return np.asarray(lfilter([r * np.sin(w)], [1, -2 * r * np.cos(w), r * r], steps))


OUTSIDE: tuple[Hideable, ...] = (
    Hideable("cubic-spring", 40.0, 2000.0, _outside(lambda m, s: (m.displacement / s.stroke) ** 3)),
    Hideable("root-of-speed", 40.0, 2000.0,
             _outside(lambda m, s: np.sqrt(np.abs(m.velocity) / s.speed) * np.sin(5 * m.displacement / s.stroke))),
    Hideable("friction-with-current", 40.0, 2000.0,
             _outside(lambda m, s: np.tanh(m.velocity / 2e-3) * np.sin(1.5 * np.pi * m.command / FULL_CURRENT)), None,
             None, True),
    Hideable("negative-damping", 40.0, 2000.0,
             _outside(lambda m, s: _bump(m.velocity / s.speed))),
    Hideable("damping-by-position", 40.0, 2000.0,
             _outside(lambda m, s: m.velocity / s.speed * m.displacement / s.stroke)),
    Hideable("beating-by-velocity", 40.0, 2000.0,
             _outside(lambda m, s: m.velocity / s.speed * np.sin(2 * np.pi * 3.0 * _time(m)))),
    Hideable("dragged-mass", 40.0, 2000.0, _outside(_dragged)),
    Hideable("struck-by-current", 40.0, 4000.0, _outside(_ringing), None, None, True),
    Hideable("cogging", 40.0, 2000.0, _outside(lambda m, s: np.sin(2 * np.pi * m.displacement / (0.3 * s.stroke)))),
)
"""Causes for which there is no entry: the right answer is to refuse."""


def find(name: str) -> Hideable:
    """Cause of either table by name."""
    return {h.name: h for h in (*HIDEABLE, *OUTSIDE)}[name]
