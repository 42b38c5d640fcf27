"""Derivatives of the extended Bouc-Wen run, carried along it: a step is differentiated once, not once per parameter."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import copy_values, njit
from quartercar.dampers.laws._bouc_wen_tangents import INPUTS, advance_partials, force_slopes
from quartercar.dampers.laws._semi_active_kernels import delayed, mixed, place, sense


@njit(error_model="numpy")
def weights(nodes, s, uf, first, out):
    """∂row/∂table entry into out (2, rows): by direction and node."""
    out[:] = 0.0
    if nodes.size < 2:
        out[0, 0], out[1, 0] = 1.0 - s, s
        return
    j, w = place(nodes, uf)
    for i, share in ((j, 1.0 - w), (j + 1, w)):
        k = i - first
        if 0 <= k < out.shape[1]:
            out[0, k] = (1.0 - s) * share
            out[1, k] = s * share


@njit(error_model="numpy")
def slopes(nodes, tables, s, uf, out):
    """∂row/∂u_f into out (7,)."""
    out[:] = 0.0
    if nodes.size < 2 or uf < nodes[0] or uf > nodes[-1]:
        return
    j, _ = place(nodes, uf)
    for p in range(out.size):
        rise = (1.0 - s) * (tables[0, j + 1, p] - tables[0, j, p]) + s * (tables[1, j + 1, p] - tables[1, j, p])
        out[p] = rise / (nodes[j + 1] - nodes[j])


@njit(error_model="numpy")
def ramp_slopes(uf, u0, u1, dt, time):
    """`ramp` and its derivatives: u_f at the end, then in u_f, u_0, u_1, dt and T."""
    r = dt / time
    decay = math.exp(-r)
    held, bent = 1.0 - 0.5 * r, -0.5
    if r > 1e-7:
        held = (1.0 - decay) / r
        bent = (decay - held) / r
    steep = -(uf - u0) * decay - (u1 - u0) * bent
    return u1 + (uf - u0) * decay - (u1 - u0) * held, decay, held - decay, 1.0 - held, steep / time, -steep * r / time


@njit(error_model="numpy")
def rise_of(u, k, q):
    """Derivative of `delayed` in q."""
    i = k + min(math.floor(q), -1)
    return 0.0 if i < 0 else u[(i + 1) % u.size] - u[i % u.size]


@njit(error_model="numpy")
def lag_tangents(uf, tangent, u, k, a, b, period, s, times, delays):
    """New u_f of `lag`, and its derivatives in (T, τ) (8,) in place: the chain rule through one ramp or two."""
    up = ((1.0 - s) * delays[0] + s * delays[2]) / period
    down = ((1.0 - s) * delays[1] + s * delays[3]) / period
    rising = delayed(u, k, b - 1.0 - up) > uf
    falling = delayed(u, k, b - 1.0 - down) < uf
    if rising and falling:
        rising = up < down
    elif not rising and not falling:
        return uf
    edge, late = (0, up) if rising else (1, down)
    time = (1.0 - s) * times[edge] + s * times[edge + 2]
    begin, end = a - 1.0 - late, b - 1.0 - late
    kink = math.floor(end)
    u0, u1 = delayed(u, k, begin), delayed(u, k, end)
    r0, r1 = rise_of(u, k, begin), rise_of(u, k, end)
    if begin < kink < end:
        turn = u[max(k + kink, 0) % u.size]
        uf, decay, by_first, _, by_span, in_time = ramp_slopes(uf, u0, turn, (kink - begin) * period, time)
        in_delay = by_span * period - by_first * r0
        uf, again, _, by_last, by_span, more = ramp_slopes(uf, turn, u1, (end - kink) * period, time)
        in_time = again * in_time + more
        in_delay = again * in_delay - by_span * period - by_last * r1
        decay *= again
    else:
        uf, decay, by_first, by_last, _, in_time = ramp_slopes(uf, u0, u1, (b - a) * period, time)
        in_delay = -by_first * r0 - by_last * r1
    for q in range(8):
        tangent[q] *= decay
    tangent[edge] += (1.0 - s) * in_time
    tangent[edge + 2] += s * in_time
    tangent[edge + 4] += (1.0 - s) * in_delay / period
    tangent[edge + 6] += s * in_delay / period
    return uf


@njit(error_model="numpy")
def lagged_tangents(u, v, period, parts, width, times, delays):
    """(8, n) derivatives of `lagged` in (T, τ)."""
    out, tangent = np.zeros((8, u.size)), np.zeros(8)
    uf = u[0]
    for k in range(1, u.size):
        for i in range(parts):
            a, b = i / parts, (i + 1.0) / parts
            s = sense(v[k - 1] + 0.5 * (a + b) * (v[k] - v[k - 1]), width)
            uf = lag_tangents(uf, tangent, u, k, a, b, period, s, times, delays)
        for q in range(8):
            out[q, k] = tangent[q]
    return out


@njit(error_model="numpy")
def tangent_run(x, v, u, period, parts, width, nodes, tables, times, delays, n, state, first, last):
    """Derivatives of the force in table entries (2, rows, 7, n), in T and τ (8, n), and in the first z (n,)."""
    rows, size = last - first + 1, x.size
    entries, lags, initial = np.zeros((2, rows, 7, size)), np.zeros((8, size)), np.zeros(size)
    dt, dl, dz = np.zeros((2, rows, 7, 2)), np.zeros((8, 2)), np.array([0.0, 1.0])
    follow, before, share = np.zeros(8), np.zeros(8), np.zeros((2, rows))
    part, between, point = np.zeros((2, INPUTS)), np.zeros((2, INPUTS)), np.empty(INPUTS)
    row, slope, out = np.empty(7), np.empty(7), np.zeros(6)
    uf, y, z = state[0], state[1], state[2]
    h = period / parts
    for k in range(size):
        for i in range(parts if k else 0):
            a, b = i / parts, (i + 1.0) / parts
            va, vb = v[k - 1] + a * (v[k] - v[k - 1]), v[k - 1] + b * (v[k] - v[k - 1])
            xa, xb = x[k - 1] + a * (x[k] - x[k - 1]), x[k - 1] + b * (x[k] - x[k - 1])
            s, old = sense(0.5 * (va + vb), width), uf
            if nodes.size > 1:
                copy_values(follow, before)
                uf = lag_tangents(uf, follow, u, k, a, b, period, s, times, delays)
            middle = 0.5 * (old + uf)
            mixed(tables, nodes, s, middle, row)
            weights(nodes, s, middle, first, share)
            slopes(nodes, tables, s, middle, slope)
            point[0], point[1], point[9] = y, z, n
            copy_values(row, point[2:9])
            advance_partials(xa, xb, va, vb, h, point, between, part)
            y, z = point[0], point[1]
            for d in range(2):
                for j in range(rows):
                    for p in range(7):
                        carry(dt[d, j, p], part, share[d, j] * part[0, 2 + p], share[d, j] * part[1, 2 + p])
            push_y, push_z = 0.0, 0.0
            for p in range(7):
                push_y += part[0, 2 + p] * slope[p]
                push_z += part[1, 2 + p] * slope[p]
            for q in range(8):
                moved = 0.5 * (before[q] + follow[q])
                carry(dl[q], part, push_y * moved, push_z * moved)
            carry(dz, part, 0.0, 0.0)
        s = sense(v[k], width)
        mixed(tables, nodes, s, uf, row)
        weights(nodes, s, uf, first, share)
        slopes(nodes, tables, s, uf, slope)
        force_slopes(y, z, x[k], v[k], row[0], row[1], row[2], row[3], out)
        for d in range(2):
            for j in range(rows):
                for p in range(7):
                    entries[d, j, p, k] = (out[0] * dt[d, j, p, 0] + out[1] * dt[d, j, p, 1]
                                           + (share[d, j] * out[2 + p] if p < 4 else 0.0))
        rise = out[2] * slope[0] + out[3] * slope[1] + out[4] * slope[2] + out[5] * slope[3]
        for q in range(8):
            lags[q, k] = out[0] * dl[q, 0] + out[1] * dl[q, 1] + rise * follow[q]
        initial[k] = out[0] * dz[0] + out[1] * dz[1]
    return entries, lags, initial


@njit(error_model="numpy")
def carry(tangent, part, push_y, push_z):
    """Tangent (2,) of (y, z) over a step, in place."""
    dy = part[0, 0] * tangent[0] + part[0, 1] * tangent[1] + push_y
    tangent[1] = part[1, 0] * tangent[0] + part[1, 1] * tangent[1] + push_z
    tangent[0] = dy
