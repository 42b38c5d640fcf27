"""Compiled loops of the noise part of input-output models: arrays only, no checks (their callers have checked).

Import this module inside the function that needs it: it loads numba.
"""

from __future__ import annotations

from lpvid._compiling import njit


@njit(error_model="numpy")
def innovations(v, c, d, phi, lagged, begin, limit, e):
    """e(k) = D v − Σ c_i(p) e(k−i), in place for k = begin … n−1; returns the diverging sample or −1.

    v, e (n, ny), zero before the first sample that counts; c (nc, ny, M), d (nd, ny), phi (M, n). With M = 1 the
    coefficients are constant and phi is not read.
    """
    n, ny = v.shape
    nc, nd, m = c.shape[0], d.shape[0], c.shape[2]
    for k in range(begin, n):
        for o in range(ny):
            total = v[k, o]
            for i in range(min(nd, k)):
                total += d[i, o] * v[k - i - 1, o]
            for i in range(min(nc, k)):
                w = c[i, o, 0]
                if m > 1:
                    row = k - i - 1 if lagged else k
                    w = 0.0
                    for f in range(m):
                        w += c[i, o, f] * phi[f, row]
                total -= w * e[k - i - 1, o]
            e[k, o] = total
            if not abs(total) < limit:
                return k
    return -1


@njit(error_model="numpy")
def predict_coloured(v, e, c, d, begin, horizon, ahead):
    """`horizon`-step prediction of v = D⁻¹C e from its past: future innovations count as zero.

    v, e (n, ny), c (nc, ny, 1), d (nd, ny); writes `ahead` (n, ny) for k = begin … n−1 from v and e up to k−horizon.
    """
    n, ny = v.shape
    for o in range(ny):
        for k in range(n - 1, begin - 1, -1):  # backwards: what stands in `ahead` from k on is final
            base = max(k - horizon + 1, begin)  # first predicted sample
            for t in range(base, k + 1):
                total = 0.0
                for i in range(min(d.shape[0], t)):
                    s = t - i - 1
                    total -= d[i, o] * (ahead[s, o] if s >= base else v[s, o])
                for i in range(min(c.shape[0], t)):
                    if t - i - 1 < base:
                        total += c[i, o, 0] * e[t - i - 1, o]
                ahead[t, o] = total


@njit(error_model="numpy")
def predict_armax(equation, a, c, y, e, phi, lagged, start, horizon, out):
    """`horizon`-step prediction of an ARMAX model from y and e up to k−horizon.

    equation (n, ny) holds the part of B u and the affine terms; a (na, ny, ny, M), c (nc, ny, M or 1), phi (M, n).
    """
    n, ny = y.shape
    na, nc, m, mc = a.shape[0], c.shape[0], phi.shape[0], c.shape[2]
    for k in range(n - 1, start - 1, -1):  # backwards: what stands in `out` from k on is final
        base = max(k - horizon + 1, start)
        for t in range(base, k + 1):
            for o in range(ny):
                total = equation[t, o]
                for i in range(na):
                    s = t - i - 1
                    row = s if lagged else t
                    for q in range(ny):
                        w = 0.0
                        for f in range(m):
                            w += a[i, o, q, f] * phi[f, row]
                        total -= w * (out[s, q] if s >= base else y[s, q])
                for i in range(min(nc, t)):
                    s = t - i - 1
                    if s < base:
                        row = s if lagged else t
                        w = c[i, o, 0]
                        if mc > 1:
                            w = 0.0
                            for f in range(mc):
                                w += c[i, o, f] * phi[f, row]
                        total += w * e[s, o]
                out[t, o] = total
