"""Compiled sensitivities of LPV recursions to all parameters at once: arrays only, no checks.

The recursion L z = f with L unit lower banded (equation sheet 5.8) gives L ∂z/∂θ = ∂f/∂θ − (∂L/∂θ) z: one banded system
with a right-hand side per parameter. Here L is never stored: its coefficients of a chunk of samples are read once for
four right-hand sides, whose newest values stay in registers. Import this module inside the function that needs it: it
loads numba.
"""

from __future__ import annotations

import numpy as np

from lpvid._compiling import copy_values, njit

PAST = 4
"""samples of past that are read at least, whatever the number of lags"""


@njit(error_model="numpy", fastmath={"contract"})
def recur(weights, z, history, rows):
    """z(k) ← z(k) − Σ_i w_i(k) z(k−i) in every row of z (K, history + rows), `rows` samples behind `history` of past.

    weights (lags, rows).
    """
    count, column = z.shape[0], np.int64(0)  # no literal: `_recur_four` would be compiled for it too
    w1, w2, w3, w4 = _lag(weights, 0), _lag(weights, 1), _lag(weights, 2), _lag(weights, 3)
    while column < count:
        group = min(4, count - column)
        if group == 4:
            _recur_four(w1, w2, w3, w4, weights, z, column, history, rows)
        else:
            for c in range(column, count):
                _recur_one(w1, w2, w3, w4, weights, z[c], history, rows)
        column += group


@njit()
def _lag(weights, i):
    return weights[i] if i < weights.shape[0] else 0.0 * weights[0]


@njit(error_model="numpy", fastmath={"contract"})
def _recur_one(w1, w2, w3, w4, weights, z, history, rows):
    lags = weights.shape[0]
    y1, y2, y3, y4 = z[history - 1], z[history - 2], z[history - 3], z[history - 4]
    for r in range(rows):
        total = z[history + r] - w4[r] * y4 - w3[r] * y3 - w2[r] * y2
        for i in range(4, lags):
            total -= weights[i, r] * z[history + r - i - 1]
        total -= w1[r] * y1
        z[history + r] = total
        y4, y3, y2, y1 = y3, y2, y1, total


@njit(error_model="numpy", fastmath={"contract"})
def _recur_four(w1, w2, w3, w4, weights, z, column, history, rows):
    lags = weights.shape[0]
    za, zb, zc, zd = z[column], z[column + 1], z[column + 2], z[column + 3]
    a1, a2, a3, a4 = za[history - 1], za[history - 2], za[history - 3], za[history - 4]
    b1, b2, b3, b4 = zb[history - 1], zb[history - 2], zb[history - 3], zb[history - 4]
    c1, c2, c3, c4 = zc[history - 1], zc[history - 2], zc[history - 3], zc[history - 4]
    d1, d2, d3, d4 = zd[history - 1], zd[history - 2], zd[history - 3], zd[history - 4]
    for r in range(rows):
        k = history + r
        v1, v2, v3, v4 = w1[r], w2[r], w3[r], w4[r]
        a = za[k] - v4 * a4 - v3 * a3 - v2 * a2
        b = zb[k] - v4 * b4 - v3 * b3 - v2 * b2
        c = zc[k] - v4 * c4 - v3 * c3 - v2 * c2
        d = zd[k] - v4 * d4 - v3 * d3 - v2 * d2
        for i in range(4, lags):
            w = weights[i, r]
            a -= w * za[k - i - 1]
            b -= w * zb[k - i - 1]
            c -= w * zc[k - i - 1]
            d -= w * zd[k - i - 1]
        a -= v1 * a1
        b -= v1 * b1
        c -= v1 * c1
        d -= v1 * d1
        za[k], zb[k], zc[k], zd[k] = a, b, c, d
        a4, a3, a2, a1 = a3, a2, a1, a
        b4, b3, b2, b1 = b3, b2, b1, b
        c4, c3, c2, c1 = c3, c2, c1, c
        d4, d3, d2, d1 = d3, d2, d1, d


@njit(error_model="numpy", fastmath={"contract"})
def recur_coupled(weights, z, history, rows):
    """`recur` with coupled outputs: weights (lags, ny, ny, rows), z (ny, K, history + rows)."""
    lags, ny = weights.shape[0], weights.shape[1]
    for c in range(z.shape[1]):
        for r in range(rows):
            k = history + r
            for o in range(ny):
                total = z[o, c, k]
                for i in range(lags):
                    for q in range(ny):
                        total -= weights[i, o, q, r] * z[q, c, k - i - 1]
                z[o, c, k] = total


@njit(error_model="numpy", fastmath={"contract"})
def moving_average(d, z, out, history, rows):
    """out(k) = z(k) + Σ_i d_i z(k−i) in every row of z (K, history + rows); out may have more rows."""
    for c in range(z.shape[0]):
        source, target = z[c], out[c]
        now = target[history: history + rows]
        copy_values(source[history: history + rows], now)
        for i in range(d.size):
            past = source[history - i - 1: history - i - 1 + rows]
            for r in range(rows):
                now[r] += d[i] * past[r]


@njit()
def copy_columns(block, z, history, rows, order, scale):
    """Row order[t] of z (K, history + rows), times `scale`, into row t of the transposed QR workspace `block`."""
    for t in range(order.size):
        source, target = z[order[t]][history: history + rows], block[t][:rows]
        for r in range(rows):
            target[r] = scale * source[r]
