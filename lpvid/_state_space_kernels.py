"""Compiled runs of a state-space predictor and of its exact sensitivities: arrays only, no checks.

Import this module inside the function that needs it: it loads numba.
"""

from __future__ import annotations

import numpy as np

from lpvid._compiling import copy_values, njit

STATE_LIMIT = 1e100
"""states beyond this have diverged, whatever the output."""


@njit()
def mixed(stack, weights, out):
    """out = Σ_m weights[m] stack[m] for a stack (M, rows, columns)."""
    out[:] = 0.0
    for m in range(weights.size):
        w = weights[m]
        if w != 0.0:
            for i in range(out.shape[0]):
                for j in range(out.shape[1]):
                    out[i, j] += w * stack[m, i, j]


@njit()
def predictor_run(matrices, phi, u, y, x0, influenced, limit, output, influence):
    """Output of x⁺ = A x + B u + f + K (y − ŷ), ŷ = C x + D u + g from x0, and its derivative to x0.

    matrices is (A, B, C, D, f, g, K), each (M, rows, columns), f and g with one column; `limit` (ny,) bounds each
    output; the derivative is written for the first `influenced` samples into influence (influenced, ny, nx). Returns
    the diverging sample or −1.
    """
    A, B, C, D, f, g, K = matrices
    n, ny, nx, nu = len(phi), C.shape[1], A.shape[1], u.shape[1]
    a, b, c, d = np.empty((nx, nx)), np.empty((nx, nu)), np.empty((ny, nx)), np.empty((ny, nu))
    ff, gg, k_ = np.empty((nx, 1)), np.empty((ny, 1)), np.empty((nx, ny))
    x, new = x0.copy(), np.empty(nx)
    moved, spread = np.eye(nx), np.empty((nx, nx))
    for k in range(n):
        mixed(A, phi[k], a)
        mixed(B, phi[k], b)
        mixed(C, phi[k], c)
        mixed(D, phi[k], d)
        mixed(f, phi[k], ff)
        mixed(g, phi[k], gg)
        mixed(K, phi[k], k_)
        for o in range(ny):
            total = gg[o, 0]
            for j in range(nx):
                total += c[o, j] * x[j]
            for j in range(nu):
                total += d[o, j] * u[k, j]
            output[k, o] = total
            if not abs(total) < limit[o]:
                return k
        for i in range(nx):
            total = ff[i, 0]
            for j in range(nx):
                total += a[i, j] * x[j]
            for j in range(nu):
                total += b[i, j] * u[k, j]
            for o in range(ny):
                total += k_[i, o] * (y[k, o] - output[k, o])
            new[i] = total
            if not abs(total) < STATE_LIMIT:
                return k
        copy_values(new, x)
        if k < influenced:
            for o in range(ny):
                for j in range(nx):
                    total = 0.0
                    for i in range(nx):
                        total += c[o, i] * moved[i, j]
                    influence[k, o, j] = total
            for i in range(nx):
                for j in range(nx):
                    total = 0.0
                    for q in range(nx):
                        total += a[i, q] * moved[q, j]
                    for o in range(ny):
                        total -= k_[i, o] * influence[k, o, j]
                    spread[i, j] = total
            for i in range(nx):
                copy_values(spread[i], moved[i])
    return -1


@njit()
def states_run(matrices, phi, u, x0, states):
    """States x(0) … x(n−1) of the free run, written into states (n, nx)."""
    A, B, _, _, f, _, _ = matrices
    nx, nu = A.shape[1], u.shape[1]
    a, b, ff = np.empty((nx, nx)), np.empty((nx, nu)), np.empty((nx, 1))
    copy_values(x0, states[0])
    for k in range(len(phi) - 1):
        mixed(A, phi[k], a)
        mixed(B, phi[k], b)
        mixed(f, phi[k], ff)
        for i in range(nx):
            total = ff[i, 0]
            for j in range(nx):
                total += a[i, j] * states[k, j]
            for j in range(nu):
                total += b[i, j] * u[k, j]
            states[k + 1, i] = total


@njit()
def sensitivity_rows(matrices, phi, u, y, table, weight, x, moved, first, last, block, d_phi, d_u):
    """Rows of [∂ŷ/∂x0, ∂ŷ/∂θ, ∂ŷ/∂ψ, ŷ − y] of samples first … last−1, output by output, times `weight` (ny,).

    table (entries, 6): parameter, array (0 A, 1 B, 2 f, 3 K, 4 C, 5 D, 6 g), function, row, column, sign. ψ are
    parameters of what makes φ and u: d_phi (n, M, s) and d_u (n, nu, s) are their derivatives, s may be 0. State x
    (nx,) and its sensitivities moved (nx, nx + parameters), x0 first and ψ last, are carried from call to call. block
    (columns, height) is filled as `ChunkedQR` takes it.
    """
    A, B, C, D, f, g, K = matrices
    ny, nx, nu, width = C.shape[1], A.shape[1], u.shape[1], moved.shape[1]
    signals = d_u.shape[2]
    a, b, c, d = np.empty((nx, nx)), np.empty((nx, nu)), np.empty((ny, nx)), np.empty((ny, nu))
    ff, gg, k_ = np.empty((nx, 1)), np.empty((ny, 1)), np.empty((nx, ny))
    slope, spread = np.empty((ny, width)), np.empty((nx, width))
    error, new = np.empty(ny), np.empty(nx)
    for k in range(first, last):
        mixed(A, phi[k], a)
        mixed(B, phi[k], b)
        mixed(C, phi[k], c)
        mixed(D, phi[k], d)
        mixed(f, phi[k], ff)
        mixed(g, phi[k], gg)
        mixed(K, phi[k], k_)
        for o in range(ny):
            total = gg[o, 0] - y[k, o]
            for j in range(nx):
                total += c[o, j] * x[j]
            for j in range(nu):
                total += d[o, j] * u[k, j]
            error[o] = total
        _product(c, moved, slope)
        for e in range(table.shape[0]):
            if table[e, 1] >= 4:
                w = phi[k, table[e, 2]] * table[e, 5]
                slope[table[e, 3], nx + table[e, 0]] += w * _signal(table[e, 1], table[e, 4], x, u[k], error)
        if signals:
            _add_drive(slope[:, width - signals:], C, D, g, d, phi[k], x, u[k], d_phi[k], d_u[k])
        _product(a, moved, spread)
        for i in range(nx):
            for o in range(ny):
                gain = k_[i, o]
                if gain != 0.0:
                    source, target = slope[o], spread[i]
                    for q in range(width):
                        target[q] -= gain * source[q]
        for e in range(table.shape[0]):
            if table[e, 1] < 4:
                w = phi[k, table[e, 2]] * table[e, 5]
                spread[table[e, 3], nx + table[e, 0]] += w * _signal(table[e, 1], table[e, 4], x, u[k], error)
        if signals:
            _add_drive(spread[:, width - signals:], A, B, f, b, phi[k], x, u[k], d_phi[k], d_u[k])
            _add_gain(spread[:, width - signals:], K, error, d_phi[k])
        for i in range(nx):
            copy_values(spread[i], moved[i])
        for i in range(nx):
            total = ff[i, 0]
            for j in range(nx):
                total += a[i, j] * x[j]
            for j in range(nu):
                total += b[i, j] * u[k, j]
            for o in range(ny):
                total -= k_[i, o] * error[o]
            new[i] = total
        copy_values(new, x)
        for o in range(ny):
            row = (k - first) * ny + o
            for q in range(width):
                block[q, row] = weight[o] * slope[o, q]
            block[width, row] = weight[o] * error[o]


@njit()
def _add_drive(out, on_state, on_input, alone, held, phi, x, u, d_phi, d_u):
    """out[i, q] += Σ_m ∂φ_m/∂ψ_q (X_m x + U_m u + c_m)[i] + (U ∂u/∂ψ_q)[i], U = Σ φ_m U_m as `held`."""
    for m in range(phi.size):
        for i in range(out.shape[0]):
            total = alone[m, i, 0]
            for j in range(x.size):
                total += on_state[m, i, j] * x[j]
            for j in range(u.size):
                total += on_input[m, i, j] * u[j]
            for q in range(out.shape[1]):
                out[i, q] += d_phi[m, q] * total
    for i in range(out.shape[0]):
        for j in range(u.size):
            for q in range(out.shape[1]):
                out[i, q] += held[i, j] * d_u[j, q]


@njit()
def _add_gain(out, K, error, d_phi):
    """out[i, q] −= Σ_m ∂φ_m/∂ψ_q (K_m e)[i] with e = ŷ − y."""
    for m in range(d_phi.shape[0]):
        for i in range(out.shape[0]):
            total = 0.0
            for o in range(error.size):
                total += K[m, i, o] * error[o]
            if total != 0.0:
                for q in range(out.shape[1]):
                    out[i, q] -= d_phi[m, q] * total


@njit()
def _product(left, right, out):
    """out = left @ right, running along the long axis."""
    for i in range(left.shape[0]):
        target = out[i]
        target[:] = 0.0
        for j in range(left.shape[1]):
            w, source = left[i, j], right[j]
            if w != 0.0:
                for q in range(target.size):
                    target[q] += w * source[q]


@njit()
def _signal(array, column, x, u, error):
    """What the coefficient of one entry multiplies: a state, an input, the innovation −error, or 1."""
    if array == 0 or array == 4:
        return x[column]
    if array == 1 or array == 5:
        return u[column]
    if array == 3:
        return -error[column]
    return 1.0
