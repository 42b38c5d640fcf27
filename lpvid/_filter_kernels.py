"""Compiled filters over regressor rows, and the recursive least-squares loop: arrays only, no checks.

Import this module inside the function that needs it: it loads numba.
"""

from __future__ import annotations

import numpy as np

from lpvid._compiling import njit

HUGE = 1e200
"""what a variance may grow to under forgetting without excitation."""


@njit()
def rational_rows(numerator, denominator, block, first, last, column, rows, state):
    """Rows `first` … `last`−1 of block[:, column: column + rows] through numerator/denominator, in place.

    Both polynomials start with 1 and have m + 1 coefficients; state (last − first, m) carries over to the next chunk
    (direct form II transposed).
    """
    m = state.shape[1]
    if m == 0:
        return
    for q in range(first, last):
        row, s = block[q], state[q - first]
        for r in range(column, column + rows):
            value = row[r]
            out = value + s[0]
            for i in range(m - 1):
                s[i] = s[i + 1] + numerator[i + 1] * value - denominator[i + 1] * out
            s[m - 1] = numerator[m] * value - denominator[m] * out
            row[r] = out


@njit()
def varying_rows(back, block, first, last, column, rows, past):
    """Rows `first` … `last`−1 of block[:, column: column + rows] through 1/A(p), in place: z = f − Σ a_i(k) z(k−i).

    back (na, rows) holds a_i of every sample; past (last − first, na) the latest z first, carried to the next chunk.
    """
    na = back.shape[0]
    if na == 0:
        return
    for q in range(first, last):
        row, z = block[q], past[q - first]
        for r in range(rows):
            out = row[column + r]
            for i in range(na):
                out -= back[i, r] * z[i]
            for i in range(na - 1, 0, -1):
                z[i] = z[i - 1]
            z[0] = out
            row[column + r] = out


@njit()
def recursive_rows(x, y, upper, diagonal, theta, loss, tally, square, inverse_noise, settings, errors, factors, trail,
                   stride):
    """Recursive least squares over the columns of x (k, rows) and y (ny, rows); P = U D Uᵀ is never formed.

    Bierman 1977 with forgetting. `upper` holds Uᵀ (unit lower triangular), `diagonal` D, theta (k, ny), loss (ny, ny)
    the weighted residual sum; square (k,) the mean square of every regressor. tally: Σw, Σw², samples, resets, noise
    level relative to `inverse_noise` (ny,), samples since the last reset, least variance since then. settings:
    forgetting, lowest, memory (0: constant forgetting), whether the noise is known, above, below, to. errors (ny, rows)
    are a priori, factors (rows,) the forgetting used; every `stride`-th theta goes to the next row of trail. Returns
    the rows of trail written.
    """
    k, rows = x.shape
    ny = y.shape[0]
    f, v, gain = np.empty(k), np.empty(k), np.empty(k)
    written = 0
    for r in range(rows):
        spread = 0.0
        for j in range(k):
            total = x[j, r]
            row = upper[j]
            for i in range(j):
                total += row[i] * x[i, r]
            f[j] = total
            v[j] = diagonal[j] * total
            spread += v[j] * total
        level = 0.0
        for o in range(ny):
            total = y[o, r]
            for j in range(k):
                total -= x[j, r] * theta[j, o]
            errors[o, r] = total
            level += total * total * inverse_noise[o] / (1.0 + spread) / ny
        forgetting = _forgetting(settings, tally, level) if spread > 0.0 else 1.0
        factors[r] = forgetting
        alpha = forgetting
        for j in range(k):
            beta = alpha
            alpha += v[j] * f[j]
            gain[j] = v[j]
            mu = -f[j] / beta
            row = upper[j]
            for i in range(j):
                old = row[i]
                row[i] = old + gain[i] * mu
                gain[i] += old * v[j]
            diagonal[j] = min(diagonal[j] * beta / (alpha * forgetting), HUGE)
        for o in range(ny):
            for j in range(k):
                theta[j, o] += gain[j] / alpha * errors[o, r]
            for q in range(ny):
                loss[o, q] = forgetting * (loss[o, q] + errors[o, r] * errors[q, r] / alpha)
        tally[0] = forgetting * tally[0] + 1.0
        tally[1] = forgetting * forgetting * tally[1] + 1.0
        tally[2] += 1.0
        tally[5] += 1.0
        for j in range(k):
            square[j] += (x[j, r] * x[j, r] - square[j]) / tally[2]
        if int(tally[2]) % k == 0:
            _watch(upper, diagonal, square, tally, settings)
        if stride > 0 and int(tally[2]) % stride == 0:
            for o in range(ny):
                for j in range(k):
                    trail[written, o * k + j] = theta[j, o]
            written += 1
    return written


@njit()
def _forgetting(settings, tally, level):
    """Constant, or 1 − ε²/(Σ_0 (1 + φᵀPφ)), Σ_0 = memory · noise variance (Fortescue, Kershenbaum & Ydstie 1981)."""
    memory = settings[2]
    if memory <= 0.0:
        return settings[0]
    noise = tally[4]
    if settings[3] == 0.0:
        shown = min(level, 10.0 * tally[4]) if tally[4] > 0.0 else level  # a jump of the parameters is not noise
        tally[4] += (shown - tally[4]) / min(max(tally[2], 1.0), 10.0 * memory)
    if noise <= 0.0:
        return 1.0
    return max(settings[1], 1.0 - level / (memory * noise))


@njit()
def _watch(upper, diagonal, square, tally, settings):
    """Reset P where its mean variance, in unit-column scaling, has grown `above` times its least or fell below."""
    k = diagonal.size
    total = 0.0
    for j in range(k):
        variance = diagonal[j]
        for i in range(j + 1, k):
            variance += upper[i, j] * upper[i, j] * diagonal[i]
        total += variance * square[j] / k
    tally[6] = total if tally[6] == 0.0 else min(tally[6], total)
    if total > settings[4] * tally[6] or (total < settings[5] and tally[5] > k):
        reset_covariance(upper, diagonal, square, settings[6])
        tally[3] += 1.0
        tally[5] = 0.0
        tally[6] = 0.0


@njit()
def reset_covariance(upper, diagonal, square, to):
    """P = to · diag(1/mean square of each regressor); a regressor that never moved keeps `to`."""
    for j in range(diagonal.size):
        diagonal[j] = to / square[j] if square[j] > 0.0 else to
        for i in range(diagonal.size):
            upper[j, i] = 1.0 if i == j else 0.0
