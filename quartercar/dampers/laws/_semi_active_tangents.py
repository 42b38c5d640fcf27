"""Derivatives of the extended Bouc-Wen run, carried along it: a step is differentiated once, not once per parameter."""

from __future__ import annotations

import numpy as np

from lpvid.toolkit import copy_values, njit
from quartercar.dampers.laws._bouc_wen_kernels import advance, node_rate
from quartercar.dampers.laws._semi_active_kernels import lag, mixed, place, sense

TINY = 1e-30
"""imaginary step"""


@njit()
def step_partials(y, z, x0, x1, v0, v1, h, row, n, out):
    """∂(y, z)/∂(y, z, c_0, k_0, c_1, α, β, γ, δ) over one step into out (2, 9), by the complex step; returns (y, z)."""
    a = np.empty(9, np.complex128)
    a[0], a[1] = y, z
    copy_values(row, a[2:])
    for i in range(9):
        a[i] += 1j * TINY
        moved = advance(a[0], a[1], x0, x1, v0, v1, h, a[2], a[3], a[4], a[5], a[6], a[7], a[8], n)
        a[i] = a[i].real
        out[0, i] = moved[0].imag / TINY
        out[1, i] = moved[1].imag / TINY
    return moved[0].real, moved[1].real


@njit()
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


@njit()
def slopes(nodes, tables, s, uf, out):
    """∂row/∂u_f into out (7,)."""
    out[:] = 0.0
    if nodes.size < 2 or uf < nodes[0] or uf > nodes[-1]:
        return
    j, _ = place(nodes, uf)
    for p in range(out.size):
        rise = (1.0 - s) * (tables[0, j + 1, p] - tables[0, j, p]) + s * (tables[1, j + 1, p] - tables[1, j, p])
        out[p] = rise / (nodes[j + 1] - nodes[j])


@njit()
def lag_tangents(uf, tangent, u, k, a, b, period, s, settings):
    """New u_f, and its derivatives in (T, τ) (8,) in place; settings (8,) complex, real on entry."""
    for q in range(8):
        settings[q] += 1j * TINY
        moved = lag(uf + 1j * TINY * tangent[q], u, k, a, b, period, s, settings[:4], settings[4:])
        settings[q] = settings[q].real
        tangent[q] = moved.imag / TINY
    return moved.real


@njit()
def tangent_run(x, v, u, period, parts, width, nodes, tables, times, delays, n, state, first, last):
    """Derivatives of the force in table entries (2, rows, 7, n), in T and τ (8, n), and in the first z (n,)."""
    rows, size = last - first + 1, x.size
    entries, lags, initial = np.zeros((2, rows, 7, size)), np.zeros((8, size)), np.zeros(size)
    dt, dl, dz = np.zeros((2, rows, 7, 2)), np.zeros((8, 2)), np.array([0.0, 1.0])
    follow, before, part, share = np.zeros(8), np.zeros(8), np.zeros((2, 9)), np.zeros((2, rows))
    row, slope, out = np.empty(7), np.empty(7), np.zeros(9)
    settings = np.empty(8, np.complex128)
    copy_values(times, settings[:4])
    copy_values(delays, settings[4:])
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
                uf = lag_tangents(uf, follow, u, k, a, b, period, s, settings)
            middle = 0.5 * (old + uf)
            mixed(tables, nodes, s, middle, row)
            weights(nodes, s, middle, first, share)
            slopes(nodes, tables, s, middle, slope)
            y, z = step_partials(y, z, xa, xb, va, vb, h, row, n, part)
            for d in range(2):
                for j in range(rows):
                    for p in range(7):
                        carry(dt[d, j, p], part, share[d, j] * part[0, 2 + p], share[d, j] * part[1, 2 + p])
            push_y, push_z = part[0, 2:] @ slope, part[1, 2:] @ slope
            for q in range(8):
                moved = 0.5 * (before[q] + follow[q])
                carry(dl[q], part, push_y * moved, push_z * moved)
            carry(dz, part, 0.0, 0.0)
        s = sense(v[k], width)
        mixed(tables, nodes, s, uf, row)
        weights(nodes, s, uf, first, share)
        slopes(nodes, tables, s, uf, slope)
        force_partials(y, z, x[k], v[k], row, out)
        for d in range(2):
            for j in range(rows):
                for p in range(7):
                    entries[d, j, p, k] = (out[0] * dt[d, j, p, 0] + out[1] * dt[d, j, p, 1]
                                           + share[d, j] * out[2 + p])
        rise = out[2:] @ slope
        for q in range(8):
            lags[q, k] = out[0] * dl[q, 0] + out[1] * dl[q, 1] + rise * follow[q]
        initial[k] = out[0] * dz[0] + out[1] * dz[1]
    return entries, lags, initial


@njit()
def carry(tangent, part, push_y, push_z):
    """Tangent (2,) of (y, z) over a step, in place."""
    dy = part[0, 0] * tangent[0] + part[0, 1] * tangent[1] + push_y
    tangent[1] = part[1, 0] * tangent[0] + part[1, 1] * tangent[1] + push_z
    tangent[0] = dy


@njit()
def force_partials(y, z, x, v, row, out):
    """∂F/∂(y, z, c_0, k_0, c_1, α) of F = c_1 ẏ into out (9,); β, γ, δ have no part in it."""
    c0, k0, c1, alpha = row[0], row[1], row[2], row[3]
    rate, share = node_rate(y, z, x, v, c0, k0, c1, alpha), c1 / (c0 + c1)
    out[0], out[1], out[2] = -share * k0, share * alpha, share * (v - rate)
    out[3], out[4], out[5] = share * (x - y), rate * c0 / (c0 + c1), share * z
