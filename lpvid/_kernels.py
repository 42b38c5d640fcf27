"""Compiled loops and the chunked QR: arrays only, no checks (their callers have checked).

Import this module inside the function that needs it: it loads numba.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def free_run_io(a, b, c, first_lag, lagged, phi, u, y, start, limit):
    """Recursion y(k) = −Σ a_i y(k−i) + Σ b_j u(k−j) + Σ c_j in place from `start` on.

    a (na, ny, ny, M), b (lags, ny, nu, M), c (nc, ny, M), phi (n, M), u (n, nu), y (n, ny); returns the first sample
    at which |y| exceeded `limit` (then y is zero from there on), or −1.
    """
    n, ny = y.shape
    na, nb, nc, nu, m = a.shape[0], b.shape[0], c.shape[0], u.shape[1], phi.shape[1]
    for k in range(start, n):
        for o in range(ny):
            total = 0.0
            for j in range(first_lag, nb):
                row = k - j if lagged else k
                for q in range(nu):
                    s = 0.0
                    for f in range(m):
                        s += b[j, o, q, f] * phi[row, f]
                    total += s * u[k - j, q]
            for j in range(nc):
                for f in range(m):
                    total += c[j, o, f] * phi[k - j, f]
            for i in range(na):
                row = k - i - 1 if lagged else k
                for q in range(ny):
                    s = 0.0
                    for f in range(m):
                        s += a[i, o, q, f] * phi[row, f]
                    total -= s * y[k - i - 1, q]
            y[k, o] = total
            if not abs(total) < limit:
                y[k:] = 0.0
                return k
    return -1


@njit(cache=True)
def predict_io(a, b, c, first_lag, lagged, phi, u, y, start, horizon, out):
    """`horizon`-step prediction of every sample from measured `y` up to k−horizon; writes `out` from `start` on."""
    n, ny = y.shape
    na = a.shape[0]
    window = np.zeros((na + horizon, ny))
    for k in range(start, n):
        steps = min(horizon, k - start + 1)
        base = k - steps + 1  # first predicted sample
        for i in range(na):
            for o in range(ny):
                window[i, o] = y[base - na + i, o]
        for s in range(steps):
            t = base + s
            _one_step(a, b, c, first_lag, lagged, phi, u, window, na + s, t)
        for o in range(ny):
            out[k, o] = window[na + steps - 1, o]


@njit(cache=True)
def _one_step(a, b, c, first_lag, lagged, phi, u, window, place, t):
    na, nb, nc, nu, m = a.shape[0], b.shape[0], c.shape[0], u.shape[1], phi.shape[1]
    for o in range(window.shape[1]):
        total = 0.0
        for j in range(first_lag, nb):
            row = t - j if lagged else t
            for q in range(nu):
                s = 0.0
                for f in range(m):
                    s += b[j, o, q, f] * phi[row, f]
                total += s * u[t - j, q]
        for j in range(nc):
            for f in range(m):
                total += c[j, o, f] * phi[t - j, f]
        for i in range(na):
            row = t - i - 1 if lagged else t
            for q in range(window.shape[1]):
                s = 0.0
                for f in range(m):
                    s += a[i, o, q, f] * phi[row, f]
                total -= s * window[place - i - 1, q]
        window[place, o] = total


@njit(cache=True)
def free_run_ss(A, B, C, D, f, g, phi, u, x0, y, limit):
    """State-space free run x⁺ = A(p)x + B(p)u + f(p), y = C(p)x + D(p)u + g(p); returns the diverging sample or −1."""
    n, ny = y.shape
    nx, nu, m = A.shape[1], u.shape[1], phi.shape[1]
    x = x0.copy()
    new = np.zeros(nx)
    for k in range(n):
        for o in range(ny):
            total = 0.0
            for q in range(m):
                w = phi[k, q]
                if w != 0.0:
                    s = g[q, o]
                    for j in range(nx):
                        s += C[q, o, j] * x[j]
                    for j in range(nu):
                        s += D[q, o, j] * u[k, j]
                    total += w * s
            y[k, o] = total
            if not abs(total) < limit:
                y[k:] = 0.0
                return k
        for i in range(nx):
            new[i] = 0.0
        for q in range(m):
            w = phi[k, q]
            if w != 0.0:
                for i in range(nx):
                    s = f[q, i]
                    for j in range(nx):
                        s += A[q, i, j] * x[j]
                    for j in range(nu):
                        s += B[q, i, j] * u[k, j]
                    new[i] += w * s
        for i in range(nx):
            x[i] = new[i]
    return -1


@njit(cache=True)
def predict_ss(A, B, C, D, f, g, K, phi, u, x0, y, horizon, out):
    """`horizon`-step prediction by the innovation form: the observer runs on `y`, then the model runs free."""
    n, ny = y.shape
    nx = A.shape[1]
    states = np.zeros((n + 1, nx))
    states[0] = x0
    for k in range(n):
        e = y[k] - _output(C, D, g, phi[k], states[k], u[k])
        states[k + 1] = _advance(A, B, f, phi[k], states[k], u[k])
        for q in range(phi.shape[1]):
            w = phi[k, q]
            for i in range(nx):
                for o in range(ny):
                    states[k + 1, i] += w * K[q, i, o] * e[o]
    for k in range(n):
        first = max(k - horizon + 1, 0)
        x = states[first].copy()
        for t in range(first, k):
            x = _advance(A, B, f, phi[t], x, u[t])
        out[k] = _output(C, D, g, phi[k], x, u[k])


@njit(cache=True)
def _advance(A, B, f, phi, x, u):
    new = np.zeros(A.shape[1])
    for q in range(phi.size):
        w = phi[q]
        if w != 0.0:
            for i in range(new.size):
                s = f[q, i]
                for j in range(new.size):
                    s += A[q, i, j] * x[j]
                for j in range(u.size):
                    s += B[q, i, j] * u[j]
                new[i] += w * s
    return new


@njit(cache=True)
def _output(C, D, g, phi, x, u):
    new = np.zeros(C.shape[1])
    for q in range(phi.size):
        w = phi[q]
        if w != 0.0:
            for o in range(new.size):
                s = g[q, o]
                for j in range(x.size):
                    s += C[q, o, j] * x[j]
                for j in range(u.size):
                    s += D[q, o, j] * u[j]
                new[o] += w * s
    return new


@njit(cache=True)
def fill_regressor(block, row0, first, rows, data, phi, source, sign, lag, function, phi_lag):
    """Write regressor rows `first` … `first+rows`−1 into the Fortran-ordered block given as its transpose.

    block (columns, height) C-ordered, filled from row `row0`; data (signals, n), phi (M, n);
    column q is sign[q] · data[source[q], k − lag[q]] · phi[function[q], k − phi_lag[q]], a negative function meaning 1.
    """
    for q in range(source.size):
        signal = data[source[q]]
        offset = first - lag[q]
        if function[q] < 0:
            for r in range(rows):
                block[q, row0 + r] = sign[q] * signal[offset + r]
        else:
            weight = phi[function[q]]
            other = first - phi_lag[q]
            for r in range(rows):
                block[q, row0 + r] = sign[q] * signal[offset + r] * weight[other + r]


class ChunkedQR:
    """R factor of a tall matrix that arrives in chunks; memory O(columns · chunk), independent of its length.

    After every chunk, R ← qr([R; chunk]). RᵀR is the Gram matrix of everything seen, without its squared condition
    number (Golub & Van Loan 2013, 6.5; the least-squares solution and residual stand in the last columns of R).
    """

    def __init__(self, columns: int, chunk: int = 1024) -> None:
        from scipy.linalg import lapack

        self.columns, self.chunk = columns, chunk
        self.rows_seen = 0
        self._geqrf = lapack.dgeqrf
        self._above = np.triu(np.ones((columns, columns), dtype=bool), 1)
        self._work = np.zeros((columns, columns + chunk))  # transpose of the Fortran-ordered workspace
        self._lwork = int(lapack.dgeqrf_lwork(columns + chunk, columns)[0])

    @property
    def block(self) -> np.ndarray:
        """(columns, height) transposed workspace; write chunk rows from row `columns` on, then call `absorb`."""
        return self._work

    def absorb(self, rows: int) -> None:
        """Fold the first `rows` rows of the chunk area into R."""
        self._work[:, self.columns + rows:] = 0.0
        factored, _, _, info = self._geqrf(self._work.T, lwork=self._lwork, overwrite_a=1)
        if info != 0:
            raise ArithmeticError(f"dgeqrf failed with info {info}")
        if not np.shares_memory(factored, self._work):
            self._work[...] = factored.T
        self._work[:, : self.columns][self._above] = 0.0
        self.rows_seen += rows

    @property
    def r(self) -> np.ndarray:
        """(columns, columns) upper triangular factor."""
        return np.triu(self._work[:, : self.columns].T)
