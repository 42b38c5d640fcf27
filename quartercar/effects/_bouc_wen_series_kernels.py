"""Compiled run of the Spencer model with elements in series, its hysteresis along the motion behind the elements."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit
from quartercar.dampers.laws._bouc_wen_kernels import _capped, _stage, node_rate
from quartercar.dampers.stepper import GAMMA, RATIO
from quartercar.effects._series_kernels import _deflection

ROUNDS = 60
"""steps towards a root at most, as many halvings as a number has digits; two or three are usual"""


@njit(error_model="numpy")
def spencer_in_series(x, v, current, h, substeps, theta, springs, state, element, fine, more, others, out, changes):
    """Force of the Spencer model behind elements with the deflection d = D(F − F_0), ḋ = v − w (n,) [N].

        w, x − d ──►[ Bouc-Wen pair (y, z) ]──► F = c_1 ẏ + k_1 (x − d) + F_g

    Both stages of the rule by which the pair is integrated (`_bouc_wen_kernels.advance`) are those of d too: with
    `ah` = a h and d* the part of d that is known at a stage, d = d* + a h (v − w), and what is left to solve is one
    scalar equation D(F(w) − F_0) = d, increasing in w.

    Its first-order changes are found with it: each stage is linearised about its own solution. With everything else
    given, the changes of slip, state and force are linear in that of the speed behind the elements, which follows from
    D'(δF − δF_0) + δD = δd* − a h δw.

    Parameters
    ----------
    x, v, current : (n,) arrays
        Linear between samples [m], [m/s].
    h : float
        Sample time [s].
    substeps : (n − 1,) int array
        Steps from each sample to the next.
    theta, springs, state
        As of `BoucWen.coefficients`, and y, z and the lagged current at the first sample.
    element : tuple of seven floats
        As for `_series_kernels.march`, without a floor.
    fine : float
        Error of the speed that is left [m/s].
    more : (m, 17) array
        Changes of `theta` (12), `springs` (2) and `state` (3); of no rows for the force alone.
    others : (m, 7) array
        Elements that differ little; their force at rest is that of `element`.
    out : (n,) array
    changes : (m, n) array
        [N].
    """
    c0a, c0b, k0, c1a, c1b, aa, ab, beta, gamma, delta, n, eta = theta
    y, z, u = state
    w, m = v[0], more.shape[0]
    dy, dz, du, dd = more[:, 14].copy(), more[:, 15].copy(), more[:, 16].copy(), np.zeros(m)
    dw, early, halfway, late = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m)
    c1 = c1a + c1b * u
    own = c1 * node_rate(y, z, x[0], w, c0a + c0b * u, k0, c1, aa + ab * u) + springs[1]
    out[0] = _first(own, x[0], springs[0], element)
    d, soft = _deflection(out[0], element)
    for j in range(m):
        down = _force_change(more[j], du[j], u, theta, springs, y, z, x[0], w, dy[j], dz[j], 0.0, 0.0)
        over = _deflection(out[0], _element(others, j))[0] - d
        down += more[j, 12] * (x[0] - d) + springs[0] * (soft * more[j, 13] - over)
        changes[j, 0] = down / (1.0 + springs[0] * soft)
        dd[j] = soft * (changes[j, 0] - more[j, 13]) + over
        dy[j] -= dd[j]
    y -= d  # as relaxed as without the elements
    for k in range(x.size - 1):
        count = substeps[k]
        step = h / count
        half, first_share = math.exp(-0.5 * step * eta), math.exp(-GAMMA * step * eta)
        dx, dv, di = (x[k + 1] - x[k]) / count, (v[k + 1] - v[k]) / count, (current[k + 1] - current[k]) / count
        for part in range(count):
            now = current[k] + part * di
            first, middle, after = now + GAMMA * di, now + 0.5 * di, now + di
            if eta > 0.0:
                behind = di / (step * eta)
                gap = u - now + behind
                first += gap * first_share - behind
                middle += gap * half - behind
                after += gap * half * half - behind
                for j in range(m):
                    slower = -behind / eta * more[j, 11]
                    early[j] = (du[j] + slower) * first_share - gap * GAMMA * step * first_share * more[j, 11] - slower
                    halfway[j] = (du[j] + slower) * half - gap * 0.5 * step * half * more[j, 11] - slower
                    late[j] = (du[j] + slower) * half * half - gap * step * half * half * more[j, 11] - slower
            ah, place = GAMMA * step, part + GAMMA
            c0, c1, alpha = c0a + c0b * middle, c1a + c1b * middle, aa + ab * middle
            there = c0a + c0b * first, c1a + c1b * first, aa + ab * first
            xa, va = x[k] + place * dx, v[k] + place * dv
            w, slip, ahead, stretched = _behind(y, z, xa, va, ah, d, w, c0, k0, c1, alpha, beta, gamma, delta, n, there,
                                                springs, element, fine)
            known = d + RATIO * (stretched - d)
            yb = y + RATIO * (ah * w - slip)
            free = z + RATIO * (ahead - z)
            zb = _capped(z, free, beta + gamma, delta, n)
            if m:
                _stage_changes(y, z, xa - stretched, w, ah, slip, ahead, middle, first, theta, springs, element, more,
                               others, halfway, early, RATIO, zb == free, dy, dz, dd, dw)
            there = c0a + c0b * after, c1a + c1b * after, aa + ab * after
            xa, va = x[k] + (part + 1) * dx, v[k] + (part + 1) * dv
            w, slip, ahead, d = _behind(yb, zb, xa, va, ah, known, w, c0, k0, c1, alpha, beta, gamma, delta, n, there,
                                        springs, element, fine)
            if m:
                _stage_changes(yb, zb, xa - d, w, ah, slip, ahead, middle, after, theta, springs, element, more, others,
                               halfway, late, 1.0, True, dy, dz, dd, dw)
            y, z, u = yb + ah * w - slip, ahead, after
            for j in range(m):
                du[j] = late[j]
        inner = x[k + 1] - d
        c0, c1, alpha = c0a + c0b * u, c1a + c1b * u, aa + ab * u
        out[k + 1] = c1 * node_rate(y, z, inner, w, c0, k0, c1, alpha) + springs[0] * inner + springs[1]
        for j in range(m):
            changes[j, k + 1] = _force_change(more[j], du[j], u, theta, springs, y, z, inner, w, dy[j], dz[j], -dd[j],
                                              dw[j]) + more[j, 12] * inner - springs[0] * dd[j]


@njit(error_model="numpy")
def _first(own, x, stiffness, element):
    """Force F = own + k_1 (x − D(F − F_0)), between that without elements and that with the deflection of it."""
    high = own + stiffness * x
    low = high - stiffness * _deflection(high, element)[0]
    for _ in range(ROUNDS):
        middle = 0.5 * (low + high)
        if own + stiffness * (x - _deflection(middle, element)[0]) - middle > 0.0:
            low, high = (middle, high) if low < high else (low, middle)
        else:
            low, high = (low, middle) if low < high else (middle, high)
    return 0.5 * (low + high)


@njit(error_model="numpy")
def _behind(y, z, x, v, ah, known, w, c0, k0, c1, alpha, beta, gamma, delta, n, own, springs, element, fine):
    """Speed behind the elements at a stage, with the slip, state and deflection there: Newton's method, safeguarded.

    A step goes to the middle of the root's bracket where it would leave that, or where the last one did not halve the
    error. Without a bracket it is then at least twice the last one.
    """
    low, high, before, move, ahead = -math.inf, math.inf, math.inf, 0.0, z
    for _ in range(ROUNDS):
        error, slope, slip, ahead, d = _gap(y, z, x, v, ah, known, w, c0, k0, c1, alpha, beta, gamma, delta, n, own,
                                            springs, element, ahead)
        if not abs(error) > slope * fine:
            break
        if error > 0.0:
            high = w
        else:
            low = w
        slow, step = abs(error) > 0.5 * before, -error / slope
        if high - low < fine:
            break
        if high - low < math.inf:
            w = w + step if not slow and low < w + step < high else 0.5 * (low + high)
        else:
            move = math.copysign(max(abs(step), 2.0 * abs(move)), step) if slow else step
            w += move
        before = abs(error)
    return w, slip, ahead, d


@njit(error_model="numpy")
def _gap(y, z, x, v, ah, known, w, c0, k0, c1, alpha, beta, gamma, delta, n, own, springs, element, start):
    """D(F(w) − F_0) less the deflection of the motion at a speed w, its slope, and slip, state and deflection.

    The pair takes the parameters of the middle of its step; the force those of the stage, `own`: c_0, c_1 and α.
    """
    d = known + ah * (v - w)
    inner = x - d
    slip, ahead = _stage(y, z, inner, w, ah, c0, k0, c1, alpha, beta, gamma, delta, n, start)
    rate = node_rate(y + ah * w - slip, ahead, inner, w, own[0], k0, own[1], own[2])
    force = own[1] * rate + springs[0] * inner + springs[1]
    under, soft = _deflection(force, element)
    span, left = c0 + c1 + ah * k0, inner - y - ah * w
    p, q = ah * (c1 * w - k0 * left) / span, ah * alpha / span
    _, _, _, slip_w, z_w = _slopes(z, p, q, slip, ahead, ah * c1 / span, beta, gamma, delta, n)
    force_w = own[1] * (own[2] * z_w + own[0] + k0 * slip_w) / (own[0] + own[1]) + springs[0] * ah
    return under - d, ah + soft * max(force_w, 0.0), slip, ahead, d


@njit(error_model="numpy")
def _slopes(z, p, q, slip, ahead, faster, beta, gamma, delta, n):
    """At a solved stage: bend, |z'|^n and the slope of z' over p − q z' + z'; slip and z' over the speed.

    By the speed alone `faster` is the change of p: the deflection falls by a h, and x − d − a h w stays.
    """
    side, sense = (1.0 if ahead >= 0.0 else -1.0), (1.0 if p - q * z >= 0.0 else -1.0)
    size, bend = abs(ahead), gamma * sense * side + beta
    power = (size * size if n == 2.0 else size**n) if size > 0.0 else 0.0
    tilt = bend * n * power / size * side if size > 0.0 else 0.0
    gain = delta - bend * power
    steep = 1.0 + q * gain + slip * tilt
    z_w = gain * faster / steep
    return bend, power, steep, faster - q * z_w, z_w


@njit(error_model="numpy")
def _element(others, j):
    """One of several elements as a tuple."""
    e = others[j]
    return e[0], e[1], e[2], e[3], e[4], e[5], e[6]


@njit(error_model="numpy")
def _force_change(change, du, u, theta, springs, y, z, inner, w, dy, dz, dinner, dw):
    """Change of c_1 ẏ + F_g at given changes of numbers, current and states."""
    c0, c1, alpha = theta[0] + theta[1] * u, theta[3] + theta[4] * u, theta[5] + theta[6] * u
    dc0 = change[0] + change[1] * u + theta[1] * du
    dc1 = change[3] + change[4] * u + theta[4] * du
    dalpha = change[5] + change[6] * u + theta[6] * du
    rate = node_rate(y, z, inner, w, c0, theta[2], c1, alpha)
    faster = dalpha * z + alpha * dz + dc0 * w + c0 * dw + change[2] * (inner - y) + theta[2] * (dinner - dy)
    return dc1 * rate + c1 * (faster - rate * (dc0 + dc1)) / (c0 + c1) + change[13]


@njit(error_model="numpy")
def _stage_changes(y, z, inner, w, ah, slip, ahead, middle, there, theta, springs, element, more, others, dmiddle,
                   dthere, ratio, free, dy, dz, dd, dw):
    """Changes of a stage about its solution: of the speed in `dw`, in `dy`, `dz`, `dd` of what the next begins with.

    `middle` and `there` are the currents of the pair and of the force, with their changes. The next stage begins with
    old + ratio (new − old), z with no change where it is capped (`free` is False).
    """
    k0, beta, gamma, delta, n = theta[2], theta[7], theta[8], theta[9], theta[10]
    c0, c1, alpha = theta[0] + theta[1] * middle, theta[3] + theta[4] * middle, theta[5] + theta[6] * middle
    e0, e1, ea = theta[0] + theta[1] * there, theta[3] + theta[4] * there, theta[5] + theta[6] * there
    span, left = c0 + c1 + ah * k0, inner - y - ah * w
    p, q = ah * (c1 * w - k0 * left) / span, ah * alpha / span
    bend, power, steep, slip_w, z_w = _slopes(z, p, q, slip, ahead, ah * c1 / span, beta, gamma, delta, n)
    gain, size = delta - bend * power, abs(ahead)
    side, sense = (1.0 if ahead >= 0.0 else -1.0), (1.0 if p - q * z >= 0.0 else -1.0)
    node = y + ah * w - slip
    rate = node_rate(node, ahead, inner, w, e0, k0, e1, ea)
    force = e1 * rate + springs[0] * inner + springs[1]
    here, soft = _deflection(force, element)
    force_w = e1 * (ea * z_w + e0 + k0 * slip_w) / (e0 + e1) + springs[0] * ah
    log = math.log(size) if size > 0.0 else 0.0
    for j in range(dy.size):
        c = more[j]
        dc0, dc1 = c[0] + c[1] * middle + theta[1] * dmiddle[j], c[3] + c[4] * middle + theta[4] * dmiddle[j]
        da = c[5] + c[6] * middle + theta[6] * dmiddle[j]
        grow = (dc0 + dc1 + ah * c[2]) / span
        dp = ah * (dc1 * w - c[2] * left + k0 * (dd[j] + dy[j])) / span - p * grow
        dq = ah * da / span - q * grow
        dbend = c[8] * sense * side + c[7]
        pushed = dz[j] + slip * (c[9] - dbend * power - bend * power * log * c[10]) + gain * (dp - dq * ahead)
        z_j = pushed / steep
        slip_j = dp - dq * ahead - q * z_j
        node_j = dy[j] - slip_j
        f_j = _force_change(c, dthere[j], there, theta, springs, node, ahead, inner, w, node_j, z_j, -dd[j], 0.0)
        f_j += c[12] * inner - springs[0] * dd[j]
        over = _deflection(force, _element(others, j))[0] - here
        dw[j] = (dd[j] - soft * (f_j - c[13]) - over) / (ah + soft * force_w)
        new_z, new_y, new_d = z_j + z_w * dw[j], node_j + (ah - slip_w) * dw[j], dd[j] - ah * dw[j]
        dz[j] = (dz[j] + ratio * (new_z - dz[j])) if free else 0.0
        dy[j] += ratio * (new_y - dy[j])
        dd[j] += ratio * (new_d - dd[j])
