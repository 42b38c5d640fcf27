"""Compiled run of the Spencer model with elements in series, its hysteresis along the motion behind the elements."""

from __future__ import annotations

import math

from lpvid.toolkit import njit
from quartercar.dampers.laws._bouc_wen_kernels import _capped, _stage, node_rate
from quartercar.dampers.stepper import GAMMA, RATIO
from quartercar.effects._series_kernels import _deflection

WIDENINGS = 60
"""doublings of a bracket: beyond, the run has diverged"""
ROUNDS = 60
"""halvings of a bracket, as many as a number has digits; three to six rounds are usual"""


@njit(error_model="numpy")
def spencer_in_series(x, v, current, h, substeps, theta, springs, state, element, fine, out):
    """Force of the Spencer model behind elements with the deflection d = D(F − F_0), ḋ = v − w (n,) [N].

        w, x − d ──►[ Bouc-Wen pair (y, z) ]──► F = c_1 ẏ + k_1 (x − d) + F_g

    Both stages of the rule by which the pair is integrated (`_bouc_wen_kernels.advance`) are those of d too: with
    `ah` = a h and d* the part of d that is known at a stage, d = d* + a h (v − w), and what is left to solve is one
    scalar equation D(F(w) − F_0) = d, increasing in w.

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
    out : (n,) array
    """
    c0a, c0b, k0, c1a, c1b, aa, ab, beta, gamma, delta, n, eta = theta
    y, z, u = state
    w = v[0]
    c1 = c1a + c1b * u
    own = c1 * node_rate(y, z, x[0], w, c0a + c0b * u, k0, c1, aa + ab * u) + springs[1]
    out[0] = _first(own, x[0], springs[0], element)
    d = _deflection(out[0], element)[0]
    y -= d  # as relaxed as without the elements
    for k in range(x.size - 1):
        count = substeps[k]
        step = h / count
        half, early = math.exp(-0.5 * step * eta), math.exp(-GAMMA * step * eta)
        dx, dv, di = (x[k + 1] - x[k]) / count, (v[k + 1] - v[k]) / count, (current[k + 1] - current[k]) / count
        for j in range(count):
            now = current[k] + j * di
            first, middle, after = now + GAMMA * di, now + 0.5 * di, now + di
            if eta > 0.0:
                behind = di / (step * eta)
                first += (u - now + behind) * early - behind
                middle += (u - now + behind) * half - behind
                after += (u - now + behind) * half * half - behind
            c0, c1, alpha = c0a + c0b * middle, c1a + c1b * middle, aa + ab * middle
            ah = GAMMA * step
            place = j + GAMMA
            there = c0a + c0b * first, c1a + c1b * first, aa + ab * first
            w, slip, ahead, stretched = _behind(y, z, x[k] + place * dx, v[k] + place * dv, ah, d, w, c0, k0, c1,
                                                alpha, beta, gamma, delta, n, there, springs, element, fine)
            known = d + RATIO * (stretched - d)
            yb = y + RATIO * (ah * w - slip)
            zb = _capped(z, z + RATIO * (ahead - z), beta + gamma, delta, n)
            there = c0a + c0b * after, c1a + c1b * after, aa + ab * after
            w, slip, z, d = _behind(yb, zb, x[k] + (j + 1) * dx, v[k] + (j + 1) * dv, ah, known, w, c0, k0, c1,
                                    alpha, beta, gamma, delta, n, there, springs, element, fine)
            y = yb + ah * w - slip
            u = after
        c1, inner = c1a + c1b * u, x[k + 1] - d
        rate = node_rate(y, z, inner, w, c0a + c0b * u, k0, c1, aa + ab * u)
        out[k + 1] = c1 * rate + springs[0] * inner + springs[1]


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
    """Speed behind the elements at a stage, with the slip, state and deflection there: bracketed, then by secants.

    Illinois' rule (Dowell and Jarratt 1971, BIT 11, 168-174), and a halving where it leaves more than half a bracket.
    """
    error, soft, slip, ahead, d = _gap(y, z, x, v, ah, known, w, c0, k0, c1, alpha, beta, gamma, delta, n, own,
                                       springs, element)
    if error == 0.0 or not math.isfinite(error):
        return w, slip, ahead, d
    move = -error / (ah + soft * c0 * c1 / (c0 + c1))
    low = high = w
    below = above = error
    for _ in range(WIDENINGS):
        w += move
        error, soft, slip, ahead, d = _gap(y, z, x, v, ah, known, w, c0, k0, c1, alpha, beta, gamma, delta, n, own,
                                           springs, element)
        if error > 0.0:
            high, above = w, error
        else:
            low, below = w, error
        if below <= 0.0 <= above or not math.isfinite(error):
            break
        move *= 2.0
    side = 0
    for _ in range(ROUNDS):
        if error == 0.0 or not high - low > fine:
            break
        width = high - low
        w = low + width * below / (below - above)
        if not low < w < high:
            w = low + 0.5 * width
        error, soft, slip, ahead, d = _gap(y, z, x, v, ah, known, w, c0, k0, c1, alpha, beta, gamma, delta, n, own,
                                           springs, element)
        if abs(error) <= ah * fine:  # the slope of the gap is a h at least
            break
        if error > 0.0:
            high, above = w, error
            below *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, below = w, error
            above *= 0.5 if side < 0 else 1.0
            side = -1
        if high - low > 0.5 * width:
            w = low + 0.5 * (high - low)
            error, soft, slip, ahead, d = _gap(y, z, x, v, ah, known, w, c0, k0, c1, alpha, beta, gamma, delta, n,
                                               own, springs, element)
            if error > 0.0:
                high, above = w, error
            else:
                low, below = w, error
            side = 0
    return w, slip, ahead, d


@njit(error_model="numpy")
def _gap(y, z, x, v, ah, known, w, c0, k0, c1, alpha, beta, gamma, delta, n, own, springs, element):
    """D(F(w) − F_0) less the deflection of the motion at a speed w, D' there, and slip, state and deflection.

    The pair takes the parameters of the middle of its step; the force those of the stage, `own`: c_0, c_1 and α.
    """
    d = known + ah * (v - w)
    inner = x - d
    slip, ahead = _stage(y, z, inner, w, ah, c0, k0, c1, alpha, beta, gamma, delta, n)
    rate = node_rate(y + ah * w - slip, ahead, inner, w, own[0], k0, own[1], own[2])
    force = own[1] * rate + springs[0] * inner + springs[1]
    under, soft = _deflection(force, element)
    return under - d, soft, slip, ahead, d
