"""Force of a damper-like device in plain numpy: the laws that an independent fit of the real records chooses from.

Written for judging: nothing of the project is imported. One branch, which may sit behind an elastic element, and
parallel terms that are linear in their coefficients::

    F = s(z) + beta' [1, v, x, x^3, a, friction(v), ...]        dz/dt = v - w,  L(w, i) = s(z)
    L(w, i) = (c0 + c1 i) |w/V|^n sgn w (1 + g [w > 0]) + (f0 + f1 i) tanh(w/eps) (1 + g_f [w > 0])
    s(z)    = d/kappa (1 + h (d/(kappa F))^2) sgn z,  d = (|z| - gap/2)+

so that with kappa = gap = 0 the branch is the law itself. The step is implicit (backward Euler in z): the scalar
equation L(w) = s(z + dt (v - w)) is monotone in w and is solved by Newton steps inside a bracket.
"""

from __future__ import annotations

import numpy as np
from numba import njit

BRANCH = ("c0", "c1", "n", "f0", "f1", "eps", "g", "gf", "kappa", "gap", "hard")
"""Parameters of the branch, in the order of the kernels' vector; velocities over V, forces over F."""


@njit(cache=True)
def _law(w, i, p):
    direction = 1.0 if w > 0 else -1.0
    size = abs(w)
    gain = 1.0 + (p[6] if w > 0 else 0.0)
    dry = 1.0 + (p[7] if w > 0 else 0.0)
    power = size if p[2] == 1.0 else (size**2 + 1e-12) ** (0.5 * p[2])
    return (p[0] + p[1] * i) * power * direction * gain + (p[3] + p[4] * i) * np.tanh(w / p[5]) * dry


@njit(cache=True)
def _spring(z, p):
    size = abs(z) - 0.5 * p[9]
    if size <= 0:
        return 0.0
    force = size / p[8]
    return force * (1.0 + p[10] * force * force) * (1.0 if z > 0 else -1.0)


@njit(cache=True)
def _inner(z, v, i, h, p):
    """The internal velocity w after a step h: L(w, i) = s(z + h (v - w)), by bisection and regula falsi (Illinois)."""
    reach = 1.0 + abs(v)
    low, high = -reach, reach
    f_low = _law(low, i, p) - _spring(z + h * (v - low), p)
    f_high = _law(high, i, p) - _spring(z + h * (v - high), p)
    for _ in range(60):
        if f_low <= 0 <= f_high:
            break
        reach *= 2.0
        low, high = -reach, reach
        f_low = _law(low, i, p) - _spring(z + h * (v - low), p)
        f_high = _law(high, i, p) - _spring(z + h * (v - high), p)
    side = 0
    w = 0.0
    for turn in range(80):
        w = 0.5 * (low + high) if turn % 3 == 2 or f_high == f_low else (low * f_high - high * f_low) / (f_high - f_low)
        f = _law(w, i, p) - _spring(z + h * (v - w), p)
        if abs(f) < 1e-9 or high - low < 1e-11 * (1.0 + abs(w)):
            break
        if f < 0:
            low, f_low = w, f
            if side == -1:
                f_high *= 0.5
            side = -1
        else:
            high, f_high = w, f
            if side == 1:
                f_low *= 0.5
            side = 1
    return w


@njit(cache=True)
def branch(v, i, dt, sub, p):
    """(n,) force of the branch; `v` over V, `i` over its scale, `dt` in units in which V dt is a deflection."""
    n = v.size
    out = np.empty(n)
    if p[8] == 0.0:
        for k in range(n):
            out[k] = _law(v[k], i[k], p)
        return out
    h = dt / sub
    z = 0.0
    out[0] = 0.0
    for k in range(1, n):
        for s in range(1, sub + 1):
            share = s / sub
            speed = v[k - 1] + (v[k] - v[k - 1]) * share
            current = i[k - 1] + (i[k] - i[k - 1]) * share
            w = _inner(z, speed, current, h, p)
            z += h * (speed - w)
        out[k] = _spring(z, p)
    return out


@njit(cache=True)
def presliding(v, dt, depth):
    """(n,) friction between -1 and 1 that builds up over a deflection: dz/d|x| = sgn v - z/depth, stepped exactly."""
    out = np.zeros(v.size)
    for k in range(1, v.size):
        path = 0.5 * (v[k] + v[k - 1]) * dt
        end = 1.0 if path > 0 else -1.0
        out[k] = end + (out[k - 1] - end) * np.exp(-abs(path) / depth)
    return out


@njit(cache=True)
def lagged(u, dt, rise, fall):
    """(n,) first-order lag of `u` with one time constant where |u| rises and another where it falls."""
    out = np.empty(u.size)
    out[0] = u[0]
    for k in range(1, u.size):
        tau = rise if abs(u[k]) > abs(out[k - 1]) else fall
        out[k] = out[k - 1] + (u[k] - out[k - 1]) * (1.0 - np.exp(-dt / tau) if tau > 0 else 1.0)
    return out


def advanced(values: np.ndarray, shift: float) -> np.ndarray:
    """(n,) values `shift` samples earlier (positive: the past), linear between the samples."""
    place = np.arange(values.size) - shift
    return np.interp(place, np.arange(values.size), values)
