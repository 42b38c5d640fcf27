"""Compiled loops and the chunked QR: arrays only, no checks (their callers have checked).

Import this module inside the function that needs it: it loads numba.
"""

from __future__ import annotations

import numpy as np

from lpvid._compiling import copy_values, njit


@njit(fastmath={"contract"})
def free_run_io(a, b, c, first_lag, lagged, phi, offset, u, y, begin, end, limit):
    """Recursion y(k) = −Σ a_i y(k−i) + Σ b_j u(k−j) + Σ c_j in place for k = begin … end−1.

    a (na, ny, ny, M), b (lags, ny, nu, M), c (nc, ny, M), u (nu, n), y (n, ny); phi (M, columns) holds φ(p(k)) in
    column k − offset. Coefficients and forced response of a block are computed across the block, the recursion then
    runs through it. Returns the first sample at which |y| exceeded `limit` (y is zero from there on), or −1.
    """
    na, ny, nb, nc, nu = a.shape[0], y.shape[1], b.shape[0], c.shape[0], u.shape[0]
    block = 512
    forced = np.empty((ny, block))
    weight = np.empty(block)
    back = np.zeros((max(ny * na * ny, 4), block))
    flat = y.reshape(y.size)
    for first in range(begin, end, block):
        rows = min(block, end - first)
        for o in range(ny):
            total = forced[o][:rows]
            for r in range(rows):
                total[r] = 0.0
            for j in range(first_lag, nb):
                low = first - offset - (j if lagged else 0)
                for q in range(nu):
                    _mix(b[j, o, q], phi, low, weight[:rows])
                    moved = u[q][first - j: first - j + rows]
                    for r in range(rows):
                        total[r] += weight[r] * moved[r]
            for j in range(nc):
                low = first - offset - j
                _mix(c[j, o], phi, low, weight[:rows])
                for r in range(rows):
                    total[r] += weight[r]
            for i in range(na):
                low = first - offset - (i + 1 if lagged else 0)
                for q in range(ny):
                    _mix(a[i, o, q], phi, low, back[(o * na + i) * ny + q][:rows])
        if ny == 1:
            code = _recur_single(back, forced[0], flat[first - na: first + rows], na, limit)
        else:
            code = _recur(back, forced, y[first - na: first + rows], na, limit)
        if code >= 0:
            for k in range(first + code, y.shape[0]):
                for o in range(ny):
                    y[k, o] = 0.0
            return first + code
    return -1


@njit(fastmath={"contract"})
def _mix(coefficients, phi, low, out):
    """out(k) = Σ_m coefficients[m] φ_m(low + k); two and three functions, the usual case, in one pass.

    Rows are taken before their slices, which keeps them contiguous for the compiler.
    """
    m, rows = phi.shape[0], out.size
    if m == 2:
        c0, c1 = coefficients[0], coefficients[1]
        f0, f1 = phi[0][low: low + rows], phi[1][low: low + rows]
        for r in range(rows):
            out[r] = c0 * f0[r] + c1 * f1[r]
    elif m == 3:
        c0, c1, c2 = coefficients[0], coefficients[1], coefficients[2]
        f0, f1, f2 = phi[0][low: low + rows], phi[1][low: low + rows], phi[2][low: low + rows]
        for r in range(rows):
            out[r] = c0 * f0[r] + c1 * f1[r] + c2 * f2[r]
    else:
        for r in range(rows):
            out[r] = 0.0
        for f in range(m):
            value, row = coefficients[f], phi[f][low: low + rows]
            for r in range(rows):
                out[r] += value * row[r]


@njit(fastmath={"contract"})
def _recur(back, forced, window, na, limit):
    """The recursion alone: window (na + rows, ny) starts with the past; plane i·ny + q of back belongs to lag i + 1."""
    ny = window.shape[1]
    for r in range(window.shape[0] - na):
        for o in range(ny):
            total = forced[o, r]
            for i in range(na):
                for q in range(ny):
                    total -= back[(o * na + i) * ny + q, r] * window[na + r - 1 - i, q]
            window[na + r, o] = total
            if not abs(total) < limit:
                return r
    return -1


@njit(fastmath={"contract"})
def _recur_single(back, forced, window, na, limit):
    """`_recur` for one output: the four newest values stay in registers, so that only one product waits for the last.

    back has at least four planes; those of lags that do not exist are zero.
    """
    rows = window.size - na
    b1, b2, b3, b4 = back[0], back[1], back[2], back[3]
    y1 = window[na - 1] if na > 0 else 0.0
    y2 = window[na - 2] if na > 1 else 0.0
    y3 = window[na - 3] if na > 2 else 0.0
    y4 = window[na - 4] if na > 3 else 0.0
    ahead = window[na:]
    for r in range(rows):
        total = forced[r] - b4[r] * y4 - b3[r] * y3 - b2[r] * y2
        for i in range(4, na):
            total -= back[i, r] * window[na + r - 1 - i]
        total -= b1[r] * y1
        ahead[r] = total
        if not abs(total) < limit:
            return r
        y4 = y3
        y3 = y2
        y2 = y1
        y1 = total
    return -1


@njit()
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


@njit()
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


@njit()
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


@njit()
def predict_ss(A, B, C, D, f, g, K, phi, u, x0, y, horizon, out):
    """`horizon`-step prediction by the innovation form: the observer runs on `y`, then the model runs free."""
    n, ny = y.shape
    nx = A.shape[1]
    states = np.zeros((n + 1, nx))
    copy_values(x0, states[0])
    for k in range(n):
        e = y[k] - _affine(C, D, g, phi[k], states[k], u[k])
        copy_values(_affine(A, B, f, phi[k], states[k], u[k]), states[k + 1])
        for q in range(phi.shape[1]):
            w = phi[k, q]
            for i in range(nx):
                for o in range(ny):
                    states[k + 1, i] += w * K[q, i, o] * e[o]
    for k in range(n):
        first = max(k - horizon + 1, 0)
        x = states[first].copy()
        for t in range(first, k):
            x = _affine(A, B, f, phi[t], x, u[t])
        copy_values(_affine(C, D, g, phi[k], x, u[k]), out[k])


@njit()
def _affine(A, B, f, phi, x, u):
    """A(p)x + B(p)u + f(p) of a state space, or C(p)x + D(p)u + g(p)."""
    new = np.zeros(A.shape[1])
    for q in range(phi.size):
        w = phi[q]
        if w != 0.0:
            for i in range(new.size):
                s = f[q, i]
                for j in range(x.size):
                    s += A[q, i, j] * x[j]
                for j in range(u.size):
                    s += B[q, i, j] * u[j]
                new[i] += w * s
    return new


@njit()
def switched_lag(q, gain_up, gain_down):
    """First-order lag of `q` (n,), one gain where it must rise and one where it must fall; starts settled."""
    out = np.empty_like(q)
    s = q[0]
    for k in range(q.size):
        error = q[k] - s
        s += (gain_up if error > 0 else gain_down) * error
        out[k] = s
    return out


@njit()
def fill_regressor(block, row0, first, rows, data, phi, source, sign, lag, function, phi_lag):
    """Write regressor rows `first` … `first+rows`−1 into the Fortran-ordered block given as its transpose.

    block (columns, height) C-ordered, filled from row `row0`; data (signals, n), phi (M, n);
    column q is sign[q] · data[source[q], k − lag[q]] · phi[function[q], k − phi_lag[q]], a negative function meaning 1.
    """
    for q in range(source.size):
        factor, offset = sign[q], first - lag[q]
        signal = data[source[q]][offset: offset + rows]  # slices: an index that cannot be negative leaves vector code
        target = block[q][row0: row0 + rows]
        if function[q] < 0:
            for r in range(rows):
                target[r] = factor * signal[r]
        else:
            other = first - phi_lag[q]
            weight = phi[function[q]][other: other + rows]
            for r in range(rows):
                target[r] = factor * signal[r] * weight[r]


NARROW, PANEL, WIDE = 32, 8, 16
"""Columns of a panel of dtpqrt, whose reflections reach the others as matrix products: `PANEL` up to `NARROW` columns
in all, then `WIDE`. Of 1024 rows panels of 16 take 1.03 times as long as of 8 with 27 columns, .88 and .77 times with
60 and 120. dgeqrf, which makes such products from 128 columns on, takes 1.0, 1.3 and 1.6 times as long with 25, 60 and
120"""


class ChunkedQR:
    """R factor of a tall matrix that arrives in chunks; memory O(columns · chunk), independent of its length.

    After every chunk, R ← qr([R; chunk]), where the zeros of R are left alone (LAPACK's dtpqrt). RᵀR is the Gram matrix
    of everything seen, without its squared condition number (Golub & Van Loan 2013, 6.5; the least-squares solution and
    residual stand in the last columns of R).
    """

    def __init__(self, columns: int, chunk: int = 1024) -> None:
        from scipy.linalg import lapack

        self.columns, self.chunk = columns, chunk
        self.rows_seen = 0
        self._fold = lapack.dtpqrt  # type: ignore[attr-defined]
        self._panel = min(PANEL if columns <= NARROW else WIDE, columns)
        self._r = np.zeros((columns, columns), order="F")
        self._work = np.zeros((columns, chunk))  # transpose of the Fortran-ordered workspace

    @property
    def block(self) -> np.ndarray:
        """(columns, chunk) transposed workspace; write a chunk's rows, then call `absorb`."""
        return self._work

    def absorb(self, rows: int) -> None:
        """Fold the first `rows` rows of the workspace into R; what stands in it is overwritten."""
        self._work[:, rows:] = 0.0
        self._r, _, _, info = self._fold(0, self._panel, self._r, self._work.T, overwrite_a=1, overwrite_b=1)
        if info != 0:
            raise ArithmeticError(f"dtpqrt failed with info {info}")
        self.rows_seen += rows

    def resume(self, r: np.ndarray, rows: int) -> None:
        """Go on from the factor of so many rows."""
        self._r = np.asfortranarray(np.triu(r))
        self.rows_seen = rows

    @property
    def r(self) -> np.ndarray:
        """(columns, columns) upper triangular factor."""
        return np.ascontiguousarray(np.triu(self._r))
