"""Compiled loops of the semi-active dampers: delayed and lagged current, table look-ups, one sample of each model.

Histories of the current are ring buffers of `u.size` samples (a whole record is one that never wraps), so that a free
run and a real-time step are the same code. Every function takes float or complex parameters.
"""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit
from quartercar.dampers.laws._bouc_wen_kernels import advance, node_rate


@njit(error_model="numpy")
def delayed(u, k, q):
    """Current at q ≤ 0 samples after sample k, linear in between; before sample 0 it is that of sample 0."""
    j = min(math.floor(q.real), -1)
    i = k + j
    w = q - j
    if i < 0:
        return u[0] + 0.0 * w
    m = u.size
    return u[i % m] * (1.0 - w) + u[(i + 1) % m] * w


@njit(error_model="numpy")
def ramp(uf, u0, u1, dt, time):
    """T u̇_f + u_f = u over dt, exact for an input that is linear from u0 to u1."""
    r = dt / time
    decay = np.exp(-r)
    held = (1.0 - decay) / r if r.real > 1e-7 else 1.0 - 0.5 * r
    return u1 + (uf - u0) * decay - (u1 - u0) * held


@njit(error_model="numpy")
def sense(v, width):
    """s(v) = ½ tanh(v/ε) + ½: 1 in rebound, 0 in compression; source 002, equation (5)."""
    return 0.5 * math.tanh(v / width) + 0.5


@njit(error_model="numpy")
def lag(uf, u, k, a, b, period, s, times, delays):
    """Advance u_f over the part a…b of the interval that ends at sample k.

    A rise follows u(t − τ_r) while that lies above u_f, a fall u(t − τ_f) while that lies below; where both do, the
    later command counts; where neither does, u_f rests. times, delays (4,): compression rise, fall, rebound rise, fall.
    That is decided by the command at b; the part is cut where u(t − τ) has a kink.
    """
    up = ((1.0 - s) * delays[0] + s * delays[2]) / period
    down = ((1.0 - s) * delays[1] + s * delays[3]) / period
    rising = (delayed(u, k, b - 1.0 - up) - uf).real > 0.0
    falling = (delayed(u, k, b - 1.0 - down) - uf).real < 0.0
    if rising and falling:
        rising = up.real < down.real
    elif not rising and not falling:
        return uf
    if rising:
        late, time = up, (1.0 - s) * times[0] + s * times[2]
    else:
        late, time = down, (1.0 - s) * times[1] + s * times[3]
    begin, end = a - 1.0 - late, b - 1.0 - late
    kink = math.floor(end.real)
    u0, u1 = delayed(u, k, begin), delayed(u, k, end)
    if kink > begin.real and kink < end.real:
        turn = u[max(k + kink, 0) % u.size]
        uf = ramp(uf, u0, turn, (kink - begin) * period, time)
        return ramp(uf, turn, u1, (end - kink) * period, time)
    return ramp(uf, u0, u1, (b - a) * period, time)


@njit(error_model="numpy")
def lagged(u, v, period, parts, width, times, delays):
    """(n,) u_f along a record, settled at its first sample."""
    out = np.empty(u.size, times.dtype)
    uf = u[0] + 0.0 * times[0]
    out[0] = uf
    for k in range(1, u.size):
        for i in range(parts):
            a, b = i / parts, (i + 1.0) / parts
            s = sense(v[k - 1] + 0.5 * (a + b) * (v[k] - v[k - 1]), width)
            uf = lag(uf, u, k, a, b, period, s, times, delays)
        out[k] = uf
    return out


@njit(error_model="numpy")
def place(nodes, value):
    """Segment and weight of a value between rising nodes, held beyond the ends."""
    last = nodes.size - 2
    j = 0
    while j < last and value.real >= nodes[j + 1]:
        j += 1
    w = (value - nodes[j]) / (nodes[j + 1] - nodes[j])
    if w.real < 0.0:
        w = 0.0 * w
    elif w.real > 1.0:
        w = 0.0 * w + 1.0
    return j, w


@njit(error_model="numpy")
def mixed(tables, nodes, s, uf, row):
    """Parameters at u_f and s into `row`: linear between nodes, s·rebound + (1 − s)·compression; equation (4)."""
    if nodes.size < 2:
        for p in range(row.size):
            row[p] = (1.0 - s) * tables[0, 0, p] + s * tables[1, 0, p]
        return
    j, w = place(nodes, uf)
    for p in range(row.size):
        low = (1.0 - s) * tables[0, j, p] + s * tables[1, j, p]
        high = (1.0 - s) * tables[0, j + 1, p] + s * tables[1, j + 1, p]
        row[p] = (1.0 - w) * low + w * high  # low + w (high − low) rounds to 0 where low is 1e16 times high


@njit(error_model="numpy")
def bouc_wen_force(state, row, x, v, spring, preload):
    """Force of the extended Bouc-Wen model at a state: c_1 ẏ + gas; row: c_0, k_0, c_1, α, β, γ, δ."""
    rate = node_rate(state[1], state[2], x, v, row[0], row[1], row[2], row[3])
    return row[2] * rate + spring * x + preload


@njit(error_model="numpy")
def bouc_wen_step(state, row, u, k, x0, x1, v0, v1, period, parts, width, nodes, tables, times, delays, gas, n):
    """Advance state (u_f, y, z) in place from sample k − 1 to sample k; returns the force there."""
    h = period / parts
    for i in range(parts):
        a, b = i / parts, (i + 1.0) / parts
        va, vb = v0 + a * (v1 - v0), v0 + b * (v1 - v0)
        s = sense(0.5 * (va + vb), width)
        old = state[0]
        if nodes.size > 1:
            state[0] = lag(old, u, k, a, b, period, s, times, delays)
        mixed(tables, nodes, s, 0.5 * (old + state[0]), row)
        state[1], state[2] = advance(state[1], state[2], x0 + a * (x1 - x0), x0 + b * (x1 - x0), va, vb, h, row[0],
                                     row[1], row[2], row[3], row[4], row[5], row[6], n)
    mixed(tables, nodes, sense(v1, width), state[0], row)
    return bouc_wen_force(state, row, x1, v1, gas[0], gas[1])


@njit(error_model="numpy")
def bouc_wen_run(x, v, u, period, parts, width, nodes, tables, times, delays, gas, n, state):
    """(n,) force of the extended Bouc-Wen model from a state (u_f, y, z), which is used up."""
    out = np.empty(x.size, tables.dtype)
    row = np.empty(tables.shape[2], tables.dtype)
    mixed(tables, nodes, sense(v[0], width), state[0], row)
    out[0] = bouc_wen_force(state, row, x[0], v[0], gas[0], gas[1])
    for k in range(1, x.size):
        out[k] = bouc_wen_step(state, row, u, k, x[k - 1], x[k], v[k - 1], v[k], period, parts, width, nodes, tables,
                               times, delays, gas, n)
    return out


@njit(error_model="numpy")
def map_force(v, uf, knots, nodes, table):
    """Bilinear look-up in table (nodes, knots): end slopes held in v, ends held in u."""
    j, w = 0, 0.0
    last = knots.size - 2
    while j < last and v >= knots[j + 1]:
        j += 1
    w = (v - knots[j]) / (knots[j + 1] - knots[j])
    if nodes.size < 2:
        return table[0, j] + w * (table[0, j + 1] - table[0, j])
    i, weight = place(nodes, uf)
    low = table[i, j] + w * (table[i, j + 1] - table[i, j])
    high = table[i + 1, j] + w * (table[i + 1, j + 1] - table[i + 1, j])
    return low + weight * (high - low)


@njit(error_model="numpy")
def map_run(x, v, uf, knots, nodes, table, gas):
    """(n,) force of the map along a record."""
    out = np.empty(v.size, table.dtype)
    for k in range(v.size):
        out[k] = map_force(v[k], uf[k], knots, nodes, table) + gas[0] * x[k] + gas[1]
    return out


@njit(error_model="numpy")
def put(out, k, column, value):
    """Write into row k, where the column is one that is asked for."""
    if column >= 0:
        out[k, column] = value


@njit(error_model="numpy")
def map_columns(v, uf, knots, nodes, table, places, out, slope):
    """Weights of the table's entries into out (n, columns) of zeros, and ∂F/∂u_f into slope (n,).

    places (nodes·knots,): column of every entry, −1 for one that is not asked for.
    """
    size = knots.size
    last = size - 2
    for k in range(v.size):
        j = 0
        while j < last and v[k] >= knots[j + 1]:
            j += 1
        w = (v[k] - knots[j]) / (knots[j + 1] - knots[j])
        if nodes.size < 2:
            put(out, k, places[j], 1.0 - w)
            put(out, k, places[j + 1], w)
            continue
        i, weight = place(nodes, uf[k])
        put(out, k, places[i * size + j], (1.0 - weight) * (1.0 - w))
        put(out, k, places[i * size + j + 1], (1.0 - weight) * w)
        put(out, k, places[(i + 1) * size + j], weight * (1.0 - w))
        put(out, k, places[(i + 1) * size + j + 1], weight * w)
        if nodes[0] < uf[k] < nodes[-1]:
            low = table[i, j] + w * (table[i, j + 1] - table[i, j])
            high = table[i + 1, j] + w * (table[i + 1, j + 1] - table[i + 1, j])
            slope[k] = (high - low) / (nodes[i + 1] - nodes[i])


@njit(error_model="numpy")
def map_step(state, u, k, x1, v0, v1, period, parts, width, nodes, knots, table, times, delays, gas):
    """Advance state (u_f,) in place from sample k − 1 to sample k; returns the force there."""
    for i in range(parts):
        a, b = i / parts, (i + 1.0) / parts
        if nodes.size > 1:
            s = sense(v0 + 0.5 * (a + b) * (v1 - v0), width)
            state[0] = lag(state[0], u, k, a, b, period, s, times, delays)
    return map_force(v1, state[0], knots, nodes, table) + gas[0] * x1 + gas[1]
