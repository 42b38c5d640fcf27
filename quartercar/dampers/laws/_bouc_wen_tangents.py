"""Derivatives of the Bouc-Wen pair over a step, and of the Spencer model's run: carried along it, all at once.

A stage solves E = z' − z − G(z') w(z') = 0, so that dz' = −∂E/∂(·) / (∂E/∂z') d(·): one division for each input, where
a complex step would repeat the whole iteration.
"""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit
from quartercar.dampers.laws._bouc_wen_kernels import _capped, _stage, node_rate
from quartercar.dampers.stepper import GAMMA, RATIO

INPUTS = 10
"""of a step: y, z, c_0, k_0, c_1, α, β, γ, δ, n"""


@njit(error_model="numpy")
def stage_partials(slip, root, x, v, ah, point, before, out):
    """∂(slip, root) of a solved stage into out (2, 10).

    `point` (10,) holds the stage's own y and z before the coefficients, `before` (2, 10) their derivatives in the
    inputs of the step.
    """
    y, c0, k0, c1, alpha = point[0], point[2], point[3], point[4], point[5]
    beta, gamma, delta, n = point[6], point[7], point[8], point[9]
    span = c0 + c1 + ah * k0
    p = ah * (c1 * v - k0 * (x - y - ah * v)) / span
    q = ah * alpha / span
    sense = 1.0 if p - q * point[1] >= 0 else -1.0
    side = 1.0 if root >= 0 else -1.0
    size, bend = side * root, gamma * sense * side + beta
    power = size**n if size > 0.0 else 0.0
    gain = delta - bend * power
    slope = -bend * n * power / root if size > 0.0 else 0.0
    steep = 1.0 + q * gain - slope * slip
    for i in range(INPUTS):
        dy, dz = before[0, i], before[1, i]
        wide = (1.0 if i == 2 or i == 4 else 0.0) + (ah if i == 3 else 0.0)
        dp = ah * k0 * dy
        if i == 3:
            dp -= ah * (x - y - ah * v)
        elif i == 4:
            dp += ah * v
        dp = (dp - p * wide) / span
        dq = ((ah if i == 5 else 0.0) - q * wide) / span
        rise = 0.0
        if i == 6:
            rise = -power
        elif i == 7:
            rise = -power * sense * side
        elif i == 8:
            rise = 1.0
        elif i == 9 and size > 0.0:
            rise = -bend * power * math.log(size)
        droot = (dz + slip * rise + gain * (dp - root * dq)) / steep
        out[0, i] = dp - root * dq - q * droot
        out[1, i] = droot


@njit(error_model="numpy")
def advance_partials(x0, x1, v0, v1, h, point, between, part):
    """`advance` of (y, z) = point[:2] in place, and ∂(y, z)/∂(y, z, c_0, k_0, c_1, α, β, γ, δ, n) into part (2, 10).

    point (10,) holds y, z and the coefficients of the step; between (2, 10) is room to work in.
    """
    y, z = point[0], point[1]
    c0, k0, c1, alpha = point[2], point[3], point[4], point[5]
    beta, gamma, delta, n = point[6], point[7], point[8], point[9]
    ah = GAMMA * h
    va, xa = v0 + GAMMA * (v1 - v0), x0 + GAMMA * (x1 - x0)
    slip, za = _stage(y, z, xa, va, ah, c0, k0, c1, alpha, beta, gamma, delta, n, z)
    for i in range(INPUTS):
        between[0, i] = 1.0 if i == 0 else 0.0
        between[1, i] = 1.0 if i == 1 else 0.0
    stage_partials(slip, za, xa, va, ah, point, between, part)
    ahead = z + RATIO * (za - z)
    zb = _capped(z, ahead, beta + gamma, delta, n)
    for i in range(INPUTS):
        between[0, i] -= RATIO * part[0, i]
        between[1, i] += RATIO * (part[1, i] - between[1, i])
    if zb != ahead:  # held at saturation, r^(−1/n) with r = (β + γ)/δ
        ratio = (beta + gamma) / delta
        for i in range(INPUTS):
            dratio = (1.0 if i == 6 or i == 7 else -ratio if i == 8 else 0.0) / delta
            between[1, i] = -zb * dratio / (ratio * n) + (zb * math.log(ratio) / (n * n) if i == 9 else 0.0)
    point[0], point[1] = y + RATIO * (ah * va - slip), zb
    slip, zc = _stage(point[0], zb, x1, v1, ah, c0, k0, c1, alpha, beta, gamma, delta, n, zb)
    stage_partials(slip, zc, x1, v1, ah, point, between, part)
    for i in range(INPUTS):
        part[0, i] = between[0, i] - part[0, i]
    point[0], point[1] = point[0] + ah * v1 - slip, zc


@njit(error_model="numpy")
def force_slopes(y, z, x, v, c0, k0, c1, alpha, out):
    """∂F/∂(y, z, c_0, k_0, c_1, α) of F = c_1 ẏ into out (6,)."""
    rate, share = node_rate(y, z, x, v, c0, k0, c1, alpha), c1 / (c0 + c1)
    out[0], out[1], out[2] = -share * k0, share * alpha, share * (v - rate)
    out[3], out[4], out[5] = share * (x - y), rate * c0 / (c0 + c1), share * z


@njit(error_model="numpy")
def spencer_tangents(x, v, current, h, substeps, theta, state):
    """Derivatives of `spencer_run` (arguments as there) in theta and in the first state: (15, N)."""
    c0a, c0b, k0, c1a, c1b, aa, ab, beta, gamma, delta, n, eta = theta
    out, tangents = np.zeros((15, x.size)), np.zeros((15, 2))
    tangents[12, 0] = tangents[13, 1] = 1.0
    point, part, between = np.empty(INPUTS), np.zeros((2, INPUTS)), np.zeros((2, INPUTS))
    w, by_rate, by_start = state[2], 0.0, 1.0  # the lagged current, its derivatives in η and in its first value
    point[0], point[1] = state[0], state[1]
    slopes = np.empty(6)
    step, decay, count = h, math.exp(-0.5 * h * eta), 1
    for k in range(x.size):
        if k:
            if substeps[k - 1] != count:
                count = substeps[k - 1]
                step = h / count
                decay = math.exp(-0.5 * step * eta)
            dx, dv, di = (x[k] - x[k - 1]) / count, (v[k] - v[k - 1]) / count, (current[k] - current[k - 1]) / count
        else:
            dx = dv = di = 0.0
        for j in range(count if k else 0):
            now = current[k - 1] + j * di
            middle, after = now + 0.5 * di, now + di
            rate_middle = start_middle = rate_after = start_after = 0.0
            if eta > 0.0:
                behind = di / (step * eta)
                away = w - now + behind
                pulled, square = by_rate - behind / eta, decay * decay
                middle += away * decay - behind
                after += away * square - behind
                rate_middle = behind / eta + pulled * decay - 0.5 * step * away * decay
                rate_after = behind / eta + pulled * square - step * away * square
                start_middle, start_after = by_start * decay, by_start * square
            point[2], point[3], point[4], point[5] = c0a + c0b * middle, k0, c1a + c1b * middle, aa + ab * middle
            point[6], point[7], point[8], point[9] = beta, gamma, delta, n
            xa, va = x[k - 1] + j * dx, v[k - 1] + j * dv
            advance_partials(xa, x[k - 1] + (j + 1) * dx, va, v[k - 1] + (j + 1) * dv, step, point, between, part)
            for t in range(15):
                dy, dz = tangents[t, 0], tangents[t, 1]
                for i in range(2):
                    push = 0.0
                    if t == 0 or t == 1:
                        push = part[i, 2] * (middle if t == 1 else 1.0)
                    elif t == 2:
                        push = part[i, 3]
                    elif t == 3 or t == 4:
                        push = part[i, 4] * (middle if t == 4 else 1.0)
                    elif t == 5 or t == 6:
                        push = part[i, 5] * (middle if t == 6 else 1.0)
                    elif t < 11:
                        push = part[i, t - 1]
                    elif t == 11 or t == 14:
                        push = ((c0b * part[i, 2] + c1b * part[i, 4] + ab * part[i, 5])
                                * (rate_middle if t == 11 else start_middle))
                    tangents[t, i] = part[i, 0] * dy + part[i, 1] * dz + push
            w, by_rate, by_start = after, rate_after, start_after
        force_slopes(point[0], point[1], x[k], v[k], c0a + c0b * w, k0, c1a + c1b * w, aa + ab * w, slopes)
        for t in range(15):
            out[t, k] = slopes[0] * tangents[t, 0] + slopes[1] * tangents[t, 1]
        out[0, k] += slopes[2]
        out[1, k] += slopes[2] * w
        out[2, k] += slopes[3]
        out[3, k] += slopes[4]
        out[4, k] += slopes[4] * w
        out[5, k] += slopes[5]
        out[6, k] += slopes[5] * w
        through = slopes[2] * c0b + slopes[4] * c1b + slopes[5] * ab
        out[11, k] += through * by_rate
        out[14, k] += through * by_start
    return out
