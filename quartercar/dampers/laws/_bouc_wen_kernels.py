"""One step of the Bouc-Wen pair (y, z), implicit, and the free run of the Spencer model on it."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit
from quartercar.dampers.stepper import FINE, GAMMA, RATIO, Move

ITERATIONS = 40
"""most Newton or bisection steps of one stage; three or four are usual"""
CLOSE = 1e-8
"""Newton step, as a share of |z| + |δ w|, that ends the stage: what is left is its square. An imaginary part is one
step behind and takes one more"""


@njit(error_model="numpy")
def node_rate(y, z, x, v, c0, k0, c1, alpha):
    """ẏ = [α z + c_0 v + k_0 (x − y)]/(c_0 + c_1), the rate of the internal node [m/s].

    The force without gas spring is c_1 ẏ; the slip rate that drives z is v − ẏ. Dyke et al. 1996, equation (2.2) of the
    equation sheet; with ẋ_a = 0 also (2) of source 002.
    """
    return (alpha * z + c0 * v + k0 * (x - y)) / (c0 + c1)


@njit(error_model="numpy")
def advance(y, z, x0, x1, v0, v1, h, c0, k0, c1, alpha, beta, gamma, delta, n):
    """Advance the pair (y, z) by one step of any length, stable however stiff the parameters are.

        ẏ = [α z + c_0 v + k_0 (x − y)]/(c_0 + c_1),      r = v − ẏ
        ż = δ r − γ |r| z |z|^{n−1} − β r |z|^n

    Two-stage SDIRK (Alexander 1977, SIAM J. Numer. Anal. 14, 1006-1021): second order, L-stable. In a stage the slip
    w = a h r is affine in z, and its sign is that of the residual at the old z, so that what is left to solve is one
    smooth scalar equation in z. Call it with parameters at the middle of the step where they change in time.

    Parameters
    ----------
    y, z : float or complex
        Internal node [m] and hysteretic state (any unit: that of `alpha` follows).
    x0, x1, v0, v1 : float
        Relative displacement [m] and velocity [m/s] at both ends of the step, linear in between.
    h : float
        Step [s].
    c0, k0, c1, alpha, beta, gamma, delta, n : float or complex
        Of this step: [N·s/m], [N/m], [N·s/m], [N per unit of z], …; c0 + c1 > 0.

    Returns
    -------
    tuple
        (y, z) at the end of the step.
    """
    ah = GAMMA * h
    va = v0 + GAMMA * (v1 - v0)
    xa = x0 + GAMMA * (x1 - x0)
    slip, za = _stage(y, z, xa, va, ah, c0, k0, c1, alpha, beta, gamma, delta, n, z)
    yb = y + RATIO * (ah * va - slip)
    zb = _capped(z, z + RATIO * (za - z), beta + gamma, delta, n)
    slip, zc = _stage(yb, zb, x1, v1, ah, c0, k0, c1, alpha, beta, gamma, delta, n, zb)
    return yb + ah * v1 - slip, zc


@njit(error_model="numpy")
def _capped(z, ahead, bend, delta, n):
    """`ahead`, what the second stage starts from, but not beyond saturation, (δ/(β + γ))^{1/n}, where z is not, either.

    It passes there only where the step is too long to follow the build-up, and then the yield force would overshoot.
    """
    ratio = bend / delta if delta.real > 0.0 else 0.0 * bend
    if ratio.real <= 0.0:
        return ahead
    side = 1.0 if ahead.real >= 0 else -1.0
    size, before = side * ahead, abs(z.real)
    share = ratio * size * size if n == 2.0 else ratio * size**n
    if share.real <= 1.0:
        return ahead
    top = ratio**-0.5 if n == 2.0 else ratio ** (-1.0 / n)
    return side * top + 0.0 * ahead if before <= top.real else ahead


@njit(error_model="numpy")
def _stage(y, z, x, v, ah, c0, k0, c1, alpha, beta, gamma, delta, n, start):
    """Slip a h r and state z of an implicit stage: z' = z + G(z') w, w = p − q z', G = δ − (γ sgn(r z') + β)|z'|^n.

    `start` is the first guess of z'.
    """
    span = c0 + c1 + ah * k0
    p = ah * (c1 * v - k0 * (x - y - ah * v)) / span
    q = ah * alpha / span
    w = p - q * z
    sense = 1.0 if w.real >= 0 else -1.0
    root = start + 0.0 * w
    low, high = -math.inf, math.inf
    done = False
    scale = abs(z.real) + abs((delta * w).real)
    for _ in range(ITERATIONS):
        side = 1.0 if root.real >= 0 else -1.0
        size = side * root
        bend = gamma * sense * side + beta
        if size.real > 0.0:
            power = size * size if n == 2.0 else size**n
            slope = -bend * n * power / root
        else:
            power = 0.0 * root
            slope = 0.0 * root
        gain = delta - bend * power
        w = p - q * root
        error = root - z - gain * w
        if error.real > 0.0:
            high = min(high, root.real)
        elif error.real < 0.0:
            low = max(low, root.real)
        steep = 1.0 + q * gain - slope * w
        step = error / steep if steep.real > 0.0 else error
        guess = root.real - step.real
        if done:
            root = root - step
            break
        if (guess <= low or guess >= high) and abs(step.real) > CLOSE * scale and high - low < math.inf:
            root = root + (0.5 * (low + high) - root.real)
            continue
        root = root - step
        done = abs(step.real) <= CLOSE * scale
        if done and step.imag == 0.0:
            break
    return p - q * root, root


@njit(error_model="numpy")
def spencer_run(x, v, current, h, substeps, theta, state):
    """Force of the Spencer model without its gas spring, c_1 ẏ, at every sample.

    Parameters
    ----------
    x, v, current : (N,) float array
        Linear between samples [m], [m/s].
    h : float
        Sample time [s].
    substeps : (N − 1,) int array
        Steps from each sample to the next.
    theta : (12,) array, float or complex
        c_0, its share per current, k_0, c_1, its share per current, α, its share per current, β, γ, δ, n, η; η = 0
        where the current acts at once.
    state : (3,) array
        y, z, w at the first sample; w is the lagged current, ẇ = −η(w − current), exact for a linear current.

    Returns
    -------
    (N,) array
        Of the type of `theta` [N].
    """
    c0a, c0b, k0, c1a, c1b, aa, ab, beta, gamma, delta, n, eta = theta
    y, z, w = state
    force = np.empty(x.size, theta.dtype)
    force[0] = (c1a + c1b * w) * node_rate(y, z, x[0], v[0], c0a + c0b * w, k0, c1a + c1b * w, aa + ab * w)
    step, decay, count = h, np.exp(-0.5 * h * eta), 1
    lagged = eta.real > 0.0
    for k in range(x.size - 1):
        if substeps[k] != count:
            count = substeps[k]
            step = h / count
            decay = np.exp(-0.5 * step * eta)
        dx, dv, di = (x[k + 1] - x[k]) / count, (v[k + 1] - v[k]) / count, (current[k + 1] - current[k]) / count
        for j in range(count):
            now = current[k] + j * di
            middle = now + 0.5 * di + 0.0 * w
            after = now + di + 0.0 * w
            if lagged:
                behind = di / (step * eta)
                middle = middle - behind + (w - now + behind) * decay
                after = after - behind + (w - now + behind) * decay * decay
            y, z = advance(y, z, x[k] + j * dx, x[k] + (j + 1) * dx, v[k] + j * dv, v[k] + (j + 1) * dv, step,
                           c0a + c0b * middle, k0, c1a + c1b * middle, aa + ab * middle, beta, gamma, delta, n)
            w = after
        c1 = c1a + c1b * w
        force[k + 1] = c1 * node_rate(y, z, x[k + 1], v[k + 1], c0a + c0b * w, k0, c1, aa + ab * w)
    return force


def bouc_wen_move(damper, step: float) -> Move:
    """Steps of the modified Bouc-Wen model by its own compiled integration."""
    theta, (stiffness, gas) = damper.coefficients(damper.vector)
    c0a, c0b, k0, c1a, c1b, aa, ab, beta, gamma, delta, n, eta = map(float, theta)
    h = step / FINE

    def move(state, here, there):
        y, z = float(state[0]), float(state[1])
        w = float(state[2]) if damper.scheduled else 0.0
        dx, dv = (there[0] - here[0]) / FINE, (there[1] - here[1]) / FINE
        i0, i1 = max(here[2], 0.0), max(there[2], 0.0)
        for j in range(FINE):
            old, w = w, lagged(w, i0 + (i1 - i0) * j / FINE, i0 + (i1 - i0) * (j + 1) / FINE, h, eta)
            mid = 0.5 * (old + w)
            y, z = advance(y, z, here[0] + j * dx, here[0] + (j + 1) * dx, here[1] + j * dv, here[1] + (j + 1) * dv, h,
                           c0a + c0b * mid, k0, c1a + c1b * mid, aa + ab * mid, beta, gamma, delta, n)
        c1 = c1a + c1b * w
        rate = node_rate(y, z, there[0], there[1], c0a + c0b * w, k0, c1, aa + ab * w)
        return np.array([y, z, w][: len(state)]), c1 * rate + stiffness * there[0] + gas

    return move


def lagged(w: float, u0: float, u1: float, h: float, rate: float) -> float:
    """ẇ = −η(w − u) over h, exact for a linear u; at once where η is 0."""
    if rate <= 0.0:
        return u1
    behind = (u1 - u0) / (h * rate)
    return u1 - behind + (w - u0 + behind) * math.exp(-h * rate)
