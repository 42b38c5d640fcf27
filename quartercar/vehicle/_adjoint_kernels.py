"""Compiled run of a quarter car with its damper's memory, and the exact gradient of that run; arrays only."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import copy_values, njit
from quartercar.vehicle._nonlinear_kernels import law_slopes

ITERATIONS = 60
"""most Newton steps of one stage; two or three are usual"""
CLOSE = 1e-13
"""relative and absolute [N] residual at which a stage ends: an adjoint is that of the equations, not of a stop rule"""


@njit()
def settled(base, w, level, rate, guess, tyre, c, stop):
    """(f, g, z, v) with f = law(z, v) + stops and g = min(0, load - linear tyre force), Newton's steps in a bracket."""
    below = 1.0 + tyre[0] * w[2, 1] + tyre[1] * w[3, 1]
    free = tyre[2] - tyre[0] * (base[2] - level) - tyre[1] * (base[3] - rate)
    by_f = tyre[0] * w[2, 0] + tyre[1] * w[3, 0]
    low, high, f = -math.inf, math.inf, guess
    g = z = v = 0.0
    for _ in range(ITERATIONS):
        g = min(0.0, (free - by_f * f) / below)
        g_f = -by_f / below if g < 0.0 else 0.0
        z = base[0] - base[2] + (w[0, 0] - w[2, 0]) * f + (w[0, 1] - w[2, 1]) * g
        v = base[1] - base[3] + (w[1, 0] - w[3, 0]) * f + (w[1, 1] - w[3, 1]) * g
        y, y_z, y_v, _, bump, hard = law_slopes(z, v, c, stop)
        r = f - y - bump
        if abs(r) <= CLOSE * (1.0 + abs(f)):
            break
        if r > 0.0:
            high = f
        else:
            low = f
        z_f = w[0, 0] - w[2, 0] + (w[0, 1] - w[2, 1]) * g_f
        v_f = w[1, 0] - w[3, 0] + (w[1, 1] - w[3, 1]) * g_f
        slope = 1.0 - (y_z + hard) * z_f - y_v * v_f
        new = f - r / slope if slope > 0.0 else math.nan
        if not low < new < high:
            new = 0.5 * (low + high) if high - low < math.inf else y + bump
        if new == f:
            break
        f = new
    return f, g, z, v


@njit()
def forward(ends, state, road_in, force_in, profile, step, q, a, b, rest, first, stop, tyre, motion, pairs, places,
            past):
    """Run the car; every array at the end is filled.

    Parameters
    ----------
    ends, state, road_in, force_in : arrays
        As in `IntegratorStages`.
    profile : (N + 1,) array
        Elevation at the ends of the steps.
    step : float
        [s].
    q : (N, S, 8) array
        Law of each stage as in `_nonlinear_car_kernels.law`; q_0 without a filter's past, less the rest force.
    a, b : (N, na), (N, nb, 3) arrays
        Of the filter's past: y(k − 1 …), and velocity, displacement, tanh at k − 1 …; empty for a law without memory.
    rest, first : float
        Force at rest, which acts on no mass; all past forces of the filter at the start.
    stop, tyre : (3,) arrays
    motion : (N + 1, 4) array
        At rest on the road's first elevation at the start.
    pairs : (N + 1, S, 2) array
        f and g at the stages of each step; row 0, last stage: at the start.
    places : (N + 1, S, 2) array
        z and v of the stages.
    past : (N + 1, 4) array
        Filter's force y, and v, z, tanh, at the ends of the steps.
    """
    stages, n = ends.size, q.shape[0]
    base, c, kept = np.empty(4), np.empty(8), np.empty((stages + 1, 2))
    motion[0], pairs[0], places[0], past[0] = 0.0, 0.0, 0.0, 0.0
    motion[0, 0] = motion[0, 2] = profile[0]
    past[0, 0], pairs[0, stages - 1, 0] = first, first - rest
    for k in range(n):
        rate = (profile[k + 1] - profile[k]) / step
        copy_values(pairs[k, stages - 1], kept[0])
        memory = 0.0
        for i in range(a.shape[1]):
            memory -= a[k, i] * past[max(k - i, 0), 0]
        for i in range(min(b.shape[1], k + 1)):
            memory += b[k, i, 0] * past[k - i, 1] + b[k, i, 1] * past[k - i, 2] + b[k, i, 2] * past[k - i, 3]
        for j in range(stages):
            for i in range(4):
                total = road_in[j, i, 0] * profile[k] + road_in[j, i, 1] * rate
                for m in range(4):
                    total += state[j, i, m] * motion[k, m]
                for m in range(j + 1):
                    total += force_in[j, m, i, 0] * kept[m, 0] + force_in[j, m, i, 1] * kept[m, 1]
                base[i] = total
            copy_values(q[k, j], c)
            c[0] += memory
            w = force_in[j, j + 1]
            f, g, z, v = settled(base, w, profile[k] + ends[j] * step * rate, rate, kept[j, 0], tyre, c, stop)
            kept[j + 1, 0], kept[j + 1, 1] = f, g
            pairs[k + 1, j, 0], pairs[k + 1, j, 1] = f, g
            places[k + 1, j, 0], places[k + 1, j, 1] = z, v
        for i in range(4):
            motion[k + 1, i] = base[i] + w[i, 0] * f + w[i, 1] * g
        y, _, _, s, _, _ = law_slopes(z, v, c, stop)
        past[k + 1, 0], past[k + 1, 1], past[k + 1, 2], past[k + 1, 3] = y + rest, v, z, s


@njit()
def backward(ends, state, force_in, q, a, b, stop, tyre, pairs, places, past, motion_bar, pair_bar, q_bar, a_bar,
             b_bar):
    """Gradient of a scalar by every coefficient, from its gradient by what `forward` gave.

    motion_bar (N + 1, 4) and pair_bar (N + 1, 2) are the gradients by the states and by (f, g) at the ends of the
    steps, and are used up; q_bar (N, S, 7), a_bar, b_bar are filled. The discrete adjoint: each stage's implicit
    equation r(f) = f − law(z(f), v(f)) has the multiplier f̄/(∂r/∂f), which then goes back along everything r reads.
    """
    stages, n, na, nb = ends.size, q.shape[0], a.shape[1], b.shape[1]
    past_bar = np.zeros((n + 1, 4))
    kept_bar, base_bar, c = np.zeros((stages + 1, 2)), np.empty(4), np.empty(8)
    for k in range(n - 1, -1, -1):
        kept_bar[:] = 0.0
        copy_values(pair_bar[k + 1], kept_bar[stages])
        memory_bar = 0.0
        for j in range(stages - 1, -1, -1):
            last = j == stages - 1
            w = force_in[j, j + 1]
            g, z, v = pairs[k + 1, j, 1], places[k + 1, j, 0], places[k + 1, j, 1]
            copy_values(q[k, j], c)
            _, y_z, y_v, s, _, hard = law_slopes(z, v, c, stop)
            f_bar, g_bar = kept_bar[j + 1, 0], kept_bar[j + 1, 1]
            base_bar[:] = 0.0
            z_bar = v_bar = y_bar = sharp_bar = 0.0
            if last:
                for i in range(4):
                    base_bar[i] = motion_bar[k + 1, i]
                    f_bar += w[i, 0] * motion_bar[k + 1, i]
                    g_bar += w[i, 1] * motion_bar[k + 1, i]
                if na + nb > 0:
                    y_bar = past_bar[k + 1, 0]
                    knee = past_bar[k + 1, 3] * (1.0 - s * s)
                    v_bar = past_bar[k + 1, 1] + knee * c[4] + y_bar * y_v
                    z_bar = past_bar[k + 1, 2] + y_bar * y_z
                    sharp_bar = knee * v
            below = 1.0 + tyre[0] * w[2, 1] + tyre[1] * w[3, 1]
            on = 1.0 if g < 0.0 else 0.0
            g_f = -on * (tyre[0] * w[2, 0] + tyre[1] * w[3, 0]) / below
            a_z, b_z = w[0, 0] - w[2, 0], w[0, 1] - w[2, 1]
            a_v, b_v = w[1, 0] - w[3, 0], w[1, 1] - w[3, 1]
            total = f_bar + a_z * z_bar + a_v * v_bar + g_f * (g_bar + b_z * z_bar + b_v * v_bar)
            slope = 1.0 - (y_z + hard) * (a_z + b_z * g_f) - y_v * (a_v + b_v * g_f)
            force = total / slope
            law_bar = force + y_bar
            steep = law_bar * c[3] * (1.0 - s * s)
            q_bar[k, j, 0], q_bar[k, j, 1], q_bar[k, j, 2] = law_bar, law_bar * v, law_bar * z
            q_bar[k, j, 3], q_bar[k, j, 4], q_bar[k, j, 5] = law_bar * s, steep * v + sharp_bar, steep * z
            q_bar[k, j, 6] = steep * math.tanh(z / c[7]) if c[6] != 0.0 else 0.0
            memory_bar += law_bar
            z_bar += force * (y_z + hard)
            v_bar += force * y_v
            g_bar += b_z * z_bar + b_v * v_bar
            base_bar[0] += z_bar
            base_bar[1] += v_bar
            base_bar[2] += -z_bar - on * tyre[0] / below * g_bar
            base_bar[3] += -v_bar - on * tyre[1] / below * g_bar
            for m in range(4):
                total = 0.0
                for i in range(4):
                    total += state[j, i, m] * base_bar[i]
                motion_bar[k, m] += total
            for m in range(j + 1):
                for i in range(4):
                    kept_bar[m, 0] += force_in[j, m, i, 0] * base_bar[i]
                    kept_bar[m, 1] += force_in[j, m, i, 1] * base_bar[i]
        pair_bar[k, 0] += kept_bar[0, 0]
        pair_bar[k, 1] += kept_bar[0, 1]
        for i in range(na):
            at = max(k - i, 0)
            a_bar[k, i] = -memory_bar * past[at, 0]
            past_bar[at, 0] -= memory_bar * a[k, i]
        for i in range(nb):
            for m in range(3):
                b_bar[k, i, m] = memory_bar * past[k - i, 1 + m] if k >= i else 0.0
                if k >= i:
                    past_bar[k - i, 1 + m] += memory_bar * b[k, i, m]


@njit()
def currents(command, first, coil, lag, coil_out, out):
    """Current in the coil, and behind the model's lag, at the points within each sample, both settled at first.

    coil (2, M), lag (2,): what is left of the difference after falling, rising; coil counts from the sample's start,
    lag from point to point. Both outputs are (n, M).
    """
    i = p = first
    for k in range(command.size):
        rising = 1 if command[k] > i else 0
        for m in range(coil.shape[1]):
            here = command[k] + (i - command[k]) * coil[rising, m]
            p = here + (p - here) * lag[1 if here > p else 0]
            coil_out[k, m], out[k, m] = here, p
        i = coil_out[k, coil.shape[1] - 1]


@njit()
def currents_back(command, first, coil, lag, coil_out, out, out_bar, command_bar):
    """Gradient by the command from that by the lagged current (n, M); at a tie the current counts as rising."""
    size = coil.shape[1]
    i_bar = p_bar = 0.0
    for k in range(command.size - 1, -1, -1):
        before = coil_out[k - 1, size - 1] if k > 0 else first
        rising = 1 if command[k] >= before else 0
        total = ahead = 0.0
        for m in range(size - 1, -1, -1):
            here = coil_out[k, m]
            p = out[k, m - 1] if m > 0 else (out[k - 1, size - 1] if k > 0 else first)
            left = lag[1 if here >= p else 0]
            p_bar += out_bar[k, m]
            here_bar = (1.0 - left) * p_bar + (i_bar if m == size - 1 else 0.0)
            p_bar *= left
            total += here_bar * (1.0 - coil[rising, m])
            ahead += here_bar * coil[rising, m]
        command_bar[k] = total
        i_bar = ahead
