"""Laws of the foreign rig and their integrator, in units of a force, a speed and a second of that speed.

Five laws, each with a viscous share c(i) and a yield or friction share f(i), both affine in the current::

    herschel-bulkley   F = f (1 - exp(-|w|/eps)) sgn w + c |w|^m sgn w               Papanastasiou (1987)
    polynomial         F = f (2/pi) atan(w/eps) + c (w + a w|w| + b w^3)
    dahl               F = c w + f z,  dz = (sgn w - z) |w| dt/d                      Dahl (1968)
    lugre              F = c w + f z/d,  dz/dt = w - |w| z/g,  g = d (1 + s exp(-(w/w_s)^2))
                                                                                      Canudas de Wit et al. (1995)
    bouc-wen           F = c w + k x + f z,  dz/dt = (w/d) (1 - |z| (beta sgn(w z) + 1 - beta))
                                                                                      Wen (1976), n = 1

w is the velocity inside: that of the motion, or what an elastic element in series leaves of it. Then F = s(y),
dy/dt = v - w, solved at each step for w by bisection of law(w) = s(y + h (v - w)), both sides monotone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

LAWS = ("herschel-bulkley", "polynomial", "dahl", "lugre", "bouc-wen")
RIGID, SPRING, GAP, AIR = range(4)
SHAPES = ("viscous", "viscous_current", "yield", "yield_current", "shape_1", "shape_2", "stiffness")
CHANGES = ("inner_friction", "asymmetry", "relief", "relief_force", "quadratic", "power", "fade", "cooling",
           "viscous_fade", "orifice", "orifice_speed", "stribeck", "stribeck_speed")
"""What hidden causes change inside the law; all zero in the law itself."""


@njit(cache=True)
def _held(force, relief, level):
    """A force beyond `level` let through by the share `relief`, rounded over a tenth of the level."""
    if relief == 0.0:
        return force
    width = 0.1 * level
    beyond = abs(force) - level
    soft = width * math.log1p(math.exp(min(beyond / width, 40.0))) if beyond < 40 * width else beyond
    return force - relief * soft * (1.0 if force > 0 else -1.0)


@njit(cache=True)
def force_of(law, q, c, w, x, i, z, heat, h):
    """Force at the internal velocity w after a step h, and the law's new internal state."""
    viscous, dry = q[0] + q[1] * i, q[2] + q[3] * i
    size, sign = abs(w), (1.0 if w > 0 else -1.0)
    if law == 0:
        yielded, flow, state = dry * (1 - math.exp(-size / q[4])) * sign, size ** q[5] * sign, z
    elif law == 1:
        yielded = dry * 2 / math.pi * math.atan(w / 0.02)
        flow, state = w + q[4] * w * size + q[5] * w * w * w, z
    elif law == 2:
        state = sign + (z - sign) * math.exp(-size * h / q[4])
        yielded, flow = dry * state, w
    elif law == 3:
        level = 1.0 + q[5] * math.exp(-((w / 0.05) ** 2))
        state = (z + h * w / q[4]) / (1.0 + h * size / (q[4] * level))
        yielded, flow = dry * state, w
    else:
        path = w * h / q[4]
        state = (z + path) / (1.0 + abs(path) * (1.0 if w * z > 0 else 1.0 - 2.0 * q[5]))
        yielded, flow = dry * state, w
    if c[5] != 0.0 and size > 0:
        flow = flow * math.exp(c[5] * math.log(size))
    flow = _held(viscous * flow, c[2], c[3])
    if c[8] != 0.0:
        flow *= math.exp(-c[8] * heat)
    force = flow + yielded + c[4] * w * size
    if size > c[10] and c[9] != 0.0:
        force += c[9] * (size - c[10]) ** 2 * sign
    force += c[0] * math.tanh(w / 0.01) + c[11] * math.exp(-((w / max(c[12], 1e-9)) ** 2)) * math.tanh(w / 0.01)
    if w > 0:
        force *= 1.0 + c[1]
    if c[6] != 0.0:
        force *= 1.0 - min(c[6] * heat, 0.9)
    return force + q[6] * x, state


@njit(cache=True)
def _elastic(kind, a, b, y):
    """Force of the element in series at its deflection y, and the largest deflection there is."""
    size, sign = abs(y), (1.0 if y > 0 else -1.0)
    if kind == SPRING:
        return y / a
    if kind == GAP:
        return max(size - 0.5 * a, 0.0) / b * sign
    share = min(size / a, 0.999)
    return b * ((1.0 - share) ** -1.4 - 1.0) * sign


@njit(cache=True)
def integrate(law, q, c, v, x, i, h, elastic):
    """Force (n,) and internal velocity (n,) along a motion on the fine clock."""
    n = v.size
    force, inner = np.empty(n), np.empty(n)
    kind, a, b = int(elastic[0]), elastic[1], elastic[2]
    z = y = heat = 0.0
    for k in range(n):
        if kind == RIGID:
            w = v[k]
        else:
            reach = 1.0 + 2.0 * abs(v[k])
            low, high = -reach, reach
            while force_of(law, q, c, low, x[k], i[k], z, heat, h)[0] > _elastic(kind, a, b, y + h * (v[k] - low)):
                low *= 2.0
            while force_of(law, q, c, high, x[k], i[k], z, heat, h)[0] < _elastic(kind, a, b, y + h * (v[k] - high)):
                high *= 2.0
            for _ in range(44):
                w = 0.5 * (low + high)
                if force_of(law, q, c, w, x[k], i[k], z, heat, h)[0] > _elastic(kind, a, b, y + h * (v[k] - w)):
                    high = w
                else:
                    low = w
            w = 0.5 * (low + high)
            y += h * (v[k] - w)
        f, z = force_of(law, q, c, w, x[k], i[k], z, heat, h)
        if c[6] != 0.0 or c[8] != 0.0:
            heat += h * (f * w - heat / c[7])
        force[k], inner[k] = f, w
    return force, inner


@dataclass(frozen=True)
class Device:
    """A damper-like device.

    Attributes
    ----------
    law : str
        One of `LAWS`.
    force, speed, current : float
        What the unit of each is [N], [m/s], [A]. The unit of displacement is `speed` times a second.
    shape : tuple of float
        As `SHAPES`, dimensionless.
    error : float
        Root mean square of the smooth error of the law, as a share of that of the force.
    ripple : tuple of (float, float, float, float, float)
        Amplitude, wave numbers over w, x and i, and phase of the terms of the error.
    """

    law: str
    force: float
    speed: float
    current: float
    shape: tuple[float, ...]
    error: float
    ripple: tuple[tuple[float, ...], ...] = field(repr=False)

    def response(self, v: np.ndarray, x: np.ndarray, i: np.ndarray, step: float, changes: dict[str, float],
                 elastic: tuple[float, float, float]) -> np.ndarray:
        """(n,) dimensionless force along a dimensionless motion; `changes` by their names in `CHANGES`.

        The smooth error of the law vanishes at rest: it is that of a resistance.
        """
        c = np.array([changes.get(name, 0.0) for name in CHANGES])
        force, w = integrate(LAWS.index(self.law), np.array(self.shape), c, v, x, i, step, np.array(elastic))
        return force + self.error * self._wobble(w, x, i)

    def _wobble(self, w: np.ndarray, x: np.ndarray, i: np.ndarray) -> np.ndarray:
        """Random smooth function of velocity, position and current of about unit size."""
        total = np.zeros_like(w)
        for amplitude, over_w, over_x, over_i, phase in self.ripple:
            total += amplitude * np.sin(over_w * w + over_x * x + over_i * i + phase)
        return total * w**2 / (w**2 + 0.01)


def drawn(rng: np.random.Generator, law: str, with_current: bool, error: tuple[float, float]) -> Device:
    """A device of random size and shape.

    Sizes run from a dashpot of 20 N to a friction damper of 20 kN, speeds from 20 mm/s to .6 m/s, both evenly in their
    logarithm.
    """
    u = rng.uniform
    shapes = {"herschel-bulkley": (u(0.02, 0.08), u(0.8, 1.1), 0.0),
              "polynomial": (u(-0.05, 0.25), u(0.0, 0.05), 0.0), "dahl": (u(0.002, 0.015), 0.0, 0.0),
              "lugre": (u(0.001, 0.006), u(0.0, 0.3), 0.0), "bouc-wen": (u(0.002, 0.01), u(0.3, 0.5), u(0.0, 0.5))}
    dry = u(0.05, 0.2) if law == "polynomial" else u(0.3, 0.9)
    viscous = u(0.6, 1.0) if law == "polynomial" else u(0.2, 0.6)
    current = (viscous * u(0.1, 0.6), dry * u(0.5, 2.5)) if with_current else (0.0, 0.0)
    waves = rng.standard_normal((8, 3)) * (1.5, 1.5, 2.0)
    ripple = np.column_stack([rng.standard_normal(8) / 2.0, waves, u(0, 2 * np.pi, 8)])
    return Device(law, float(np.exp(u(np.log(20.0), np.log(2e4)))), float(np.exp(u(np.log(0.02), np.log(0.6)))),
                  float(rng.choice((1.0, 2.0, 3.0))) if with_current else 1.0,
                  (viscous, current[0], dry, current[1], *shapes[law]), u(*error),
                  tuple(tuple(map(float, row)) for row in ripple))
