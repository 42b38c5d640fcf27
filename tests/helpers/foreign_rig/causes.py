"""What the foreign rig can hide: by the names of the catalogue where it has one, and causes that are outside it.

All sizes are dimensionless (shares of the device's force, of its speed, of a second of that speed) or seconds. At size
0 each leaves everything as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from scipy.signal import bessel, lfilter, sosfilt

from .laws import AIR, GAP, RIGID, SPRING

Signals = dict[str, np.ndarray]
"""``x``, ``v``, ``a``, ``i`` and ``t`` on the fine clock."""


@dataclass(frozen=True)
class Scene:
    """Scales of one experiment: largest |x| and |v|, length [s], a number drawn evenly between 0 and 1."""

    reach: float
    speed: float
    duration: float
    chance: float


@dataclass(frozen=True)
class Imposed:
    """How a cause of one size enters: in the law, in series with it, on the command, on the force, on what is recorded.

    Attributes
    ----------
    law : dict
        Changes by their names in `laws.CHANGES`.
    elastic : tuple of float
        Element in series.
    command, motion, recorded : callable
        (signal, rate) to signal: the acting current; displacement and velocity as recorded; the force as recorded.
    force : callable
        (force, signals, rate) to force.
    """

    law: dict[str, float] = field(default_factory=dict)
    elastic: tuple[float, float, float] = (float(RIGID), 0.0, 0.0)
    command: Callable[[np.ndarray, float], np.ndarray] = lambda s, rate: s
    motion: Callable[[np.ndarray, float], np.ndarray] = lambda s, rate: s
    recorded: Callable[[np.ndarray, float], np.ndarray] = lambda s, rate: s
    force: Callable[[np.ndarray, Signals, float], np.ndarray] = lambda f, s, rate: f


@dataclass(frozen=True)
class Cause:
    """A cause that may be hidden.

    Attributes
    ----------
    name : str
        In the catalogue; or a name of its own.
    least, most : float
        Sizes between which the one is looked for that shows as much as the case wants.
    impose : callable
        (size, scene) to `Imposed`.
    current : bool
        Whether it needs a varying current.
    outside : bool
        Whether no catalogue of ours has it, as of writing.
    family : str
    """

    name: str
    least: float
    most: float
    impose: Callable[[float, Scene], Imposed]
    current: bool = False
    outside: bool = False
    family: str = ""


def _in_law(name: str, **fixed: float) -> Callable[[float, Scene], Imposed]:
    return lambda size, scene: Imposed(law={name: size, **fixed})


def _added(term: Callable[[Signals, Scene], np.ndarray]) -> Callable[[float, Scene], Imposed]:
    return lambda size, scene: Imposed(force=lambda f, s, rate: f + size * term(s, scene))


# -- signals ------------------------------------------------------------------------------------------------------
def late(signal: np.ndarray, seconds: float, rate: float) -> np.ndarray:
    """A signal by a time later, linear between fine samples, at rest before it begins."""
    if seconds == 0.0:
        return signal
    place = np.arange(signal.size) - seconds * rate
    return np.interp(place, np.arange(signal.size), signal)


def eddy(signal: np.ndarray, seconds: float, rate: float) -> np.ndarray:
    """Two lags in a row, nine tenths and one tenth of the time."""
    for tau in (0.9 * seconds, 0.1 * seconds):
        if tau > 0:
            decay = np.exp(-1.0 / (tau * rate))
            signal = np.asarray(lfilter([1 - decay], [1, -decay], signal - signal[0])) + signal[0]
    return signal


@njit(cache=True)
def _uneven(signal, rise, fall, out):
    y = signal[0]
    for k in range(signal.size):
        y += (signal[k] - y) * (rise if signal[k] > y else fall)
        out[k] = y


def uneven(signal: np.ndarray, seconds: float, rate: float, ratio: float) -> np.ndarray:
    """First-order lag, `ratio` times slower where it falls than where it rises."""
    if seconds == 0.0:
        return signal
    out = np.empty_like(signal)
    _uneven(signal, 1 - np.exp(-1 / (seconds * rate)), 1 - np.exp(-1 / (seconds * ratio * rate)), out)
    return out


@njit(cache=True)
def _plays(signal, width, out):
    y = np.full(4, signal[0])
    for k in range(signal.size):
        total = 0.0
        for m in range(4):
            half = width * (0.4 + 0.4 * m)
            y[m] = min(max(y[m], signal[k] - half), signal[k] + half)
            total += y[m]
        out[k] = total / 4


def remanent(signal: np.ndarray, width: float, rate: float) -> np.ndarray:
    """Mean of four plays (Prandtl-Ishlinskii)."""
    out = np.empty_like(signal)
    _plays(signal, width, out)
    return out


def smoothed(signal: np.ndarray, seconds: float, rate: float) -> np.ndarray:
    """Bessel low-pass of third order whose delay at low frequency is that time."""
    if seconds == 0.0:
        return signal
    corner = min(1.0 / (2 * np.pi * seconds), 0.45 * rate)
    sos = bessel(3, corner, fs=rate, output="sos", norm="delay")
    return np.asarray(sosfilt(sos, signal - signal[0])) + signal[0]


@njit(cache=True)
def _dragged(v, h, mass, limit, drag, out):
    """A mass that friction drags along: m du/dt = f, f = limit (1 - exp(-|v - u|/drag)) sgn(v - u), implicit in u."""
    u = 0.0
    for k in range(v.size):
        slip = v[k] - u
        f = limit * slip / (abs(slip) + drag)
        u += h * f / (mass + h * limit / (abs(slip) + drag))
        out[k] = f


def _dragged_mass(size: float, scene: Scene) -> Imposed:
    def force(f: np.ndarray, s: Signals, rate: float) -> np.ndarray:
        out = np.empty_like(f)
        _dragged(s["v"], 1.0 / rate, 0.05 + 0.1 * scene.chance, 1.0, 0.05, out)
        return f + size * out
    return Imposed(force=force)


@njit(cache=True)
def _bristles(v, h, depth, out):
    """Friction that builds up over a bristle's length, Dahl's law stepped exactly."""
    z = 0.0
    for k in range(v.size):
        path = v[k] * h
        end = 1.0 if path > 0 else -1.0
        z = end + (z - end) * np.exp(-abs(path) / depth)
        out[k] = z


def _friction(s: Signals, scene: Scene) -> np.ndarray:
    out = np.empty_like(s["v"])
    _bristles(s["v"], float(s["t"][1] - s["t"][0]), 3e-4, out)
    return out


def _polytropic(s: Signals, scene: Scene) -> np.ndarray:
    return (1 - np.clip(s["x"] / (3 * scene.reach), -0.9, 0.9)) ** -1.3 - 1


def _bump(s: Signals, scene: Scene) -> np.ndarray:
    stop = (0.6 + 0.2 * scene.chance) * scene.reach
    beyond = np.maximum(np.abs(s["x"]) - stop, 0.0) / scene.reach
    return beyond**1.5 * np.sign(s["x"])


def _air(size: float, scene: Scene) -> Imposed:
    return Imposed(elastic=(float(AIR), size, 0.5)) if size else Imposed()


def _resonant(size: float, scene: Scene) -> Imposed:
    """Second-order fixture, damping .1, its time `size`."""
    def recorded(f: np.ndarray, rate: float) -> np.ndarray:
        if size == 0.0:
            return f
        w, h = 1.0 / size, 1.0 / rate
        c = 2 * rate  # bilinear
        a = np.array([c * c + 0.2 * w * c + w * w, 2 * w * w - 2 * c * c, c * c - 0.2 * w * c + w * w])
        return np.asarray(lfilter(np.array([1.0, 2.0, 1.0]) * w * w / a[0], a / a[0], f)) if h else f
    return Imposed(recorded=recorded)


CAUSES: tuple[Cause, ...] = (
    Cause("coulomb-friction", 1e-3, 2.0, _added(_friction), family="friction"),
    Cause("stribeck-friction", 1e-3, 2.0, lambda size, scene: Imposed(
        law={"stribeck": size, "stribeck_speed": 0.1 + 0.2 * scene.chance}), family="friction"),
    Cause("gas-stiffness", 1e-3, 10.0, _added(_polytropic), family="gas"),
    Cause("series-compliance", 1e-5, 0.3, lambda size, scene: Imposed(
        elastic=(float(SPRING), size, 0.0)) if size else Imposed(), family="elastic"),
    Cause("backlash", 1e-5, 0.3, lambda size, scene: Imposed(
        elastic=(float(GAP), size, 0.02 * size)) if size else Imposed(), family="elastic"),
    Cause("entrained-air", 1e-5, 0.3, _air, family="elastic"),
    Cause("quadratic-loss", 1e-3, 2.0, _in_law("quadratic"), family="hydraulics"),
    Cause("relief-valve", 1e-2, 1.0, lambda size, scene: Imposed(
        law={"relief": size, "relief_force": 0.3 + 0.4 * scene.chance}), family="hydraulics"),
    Cause("series-orifice", 1e-2, 5.0, lambda size, scene: Imposed(
        law={"orifice": size, "orifice_speed": 0.4 + 0.5 * scene.chance}), family="hydraulics"),
    Cause("asymmetry", 5e-3, 2.0, _in_law("asymmetry"), family="hydraulics"),
    Cause("input-nonlinearity", 5e-3, 0.8, _in_law("power"), family="form"),
    Cause("coil-lag", 2e-4, 0.1, lambda size, scene: Imposed(command=lambda i, r: eddy(i, size, r)), True,
          family="electrical"),
    Cause("rise-fall-lag", 2e-4, 0.06, lambda size, scene: Imposed(
        command=lambda i, r: uneven(i, size, r, 2.5 + 1.5 * scene.chance)), True, family="electrical"),
    Cause("command-delay", 2e-4, 0.05, lambda size, scene: Imposed(command=lambda i, r: late(i, size, r)), True,
          family="electrical"),
    Cause("current-saturation", 1e-2, 5.0, lambda size, scene: Imposed(
        command=lambda i, r: i / (1 + size * i) if size else i), True, family="electrical"),
    Cause("remanence", 1e-3, 0.3, lambda size, scene: Imposed(command=lambda i, r: remanent(i, size, r)), True,
          family="electrical"),
    Cause("displacement-delay", 1e-4, 0.02, lambda size, scene: Imposed(motion=lambda s, r: late(s, size, r)),
          family="chain"),
    Cause("force-delay", 1e-4, 0.02, lambda size, scene: Imposed(recorded=lambda s, r: late(s, size, r)),
          family="chain"),
    Cause("one-sided-filter", 1e-4, 0.02, lambda size, scene: Imposed(motion=lambda s, r: smoothed(s, size, r)),
          family="chain"),
    Cause("thermal-fade", 1e-3, 1.0, _in_law("fade", cooling=100.0), family="thermal"),
    Cause("viscous-fade", 1e-3, 1.0, _in_law("viscous_fade", cooling=100.0), family="thermal"),
    Cause("end-stop", 1e-2, 50.0, _added(_bump), family="structure"),
    Cause("fixture-inertia", 1e-5, 0.1, _added(lambda s, scene: s["a"]), family="structure"),
    Cause("fixture-resonance", 5e-4, 0.006, _resonant, family="structure"),
    Cause("tone", 1e-3, 1.0, _added(lambda s, scene: np.sin(2 * np.pi * (7 + 16 * scene.chance) * s["t"])),
          outside=True),
    Cause("cubic-spring", 1e-3, 10.0, _added(lambda s, scene: (s["x"] / scene.reach) ** 3), outside=True,
          family="elastic-parallel"),
    Cause("cogging", 1e-3, 1.0, _added(lambda s, scene: np.sin(2 * np.pi * (3 + 4 * scene.chance) * s["x"]
                                                               / scene.reach)), outside=True),
    Cause("dragged-mass", 1e-3, 2.0, _dragged_mass, outside=True),
)


def cause(name: str) -> Cause:
    """The cause of a name."""
    return next(c for c in CAUSES if c.name == name)
