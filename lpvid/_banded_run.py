"""The free run of one output without a compiled kernel: forward substitution by LAPACK, for records that are short."""

from __future__ import annotations

import numpy as np

SHORT = 16_384
"""samples up to which this way is taken: half a minute at 512 Hz. A run takes up to 0.9 ms there, 14 times the compiled
kernel's time; the kernel takes two seconds to compile when a program first needs it, which is some thousand runs"""


def free_run_banded(a: np.ndarray, b: np.ndarray, c: np.ndarray, first_lag: int, lagged: bool, phi: np.ndarray,
                    offset: int, u: np.ndarray, y: np.ndarray, begin: int, end: int, limit: float) -> int:
    """Recursion y(k) = −Σ a_i y(k−i) + Σ b_j u(k−j) + Σ c_j in place for k = begin … end−1, one output.

    With L the unit lower triangular matrix of na bands that holds a_i(k) in row k, column k − i::

        L y = f − (what the na values before `begin` take from the first na rows),   f = Σ b_j u(k−j) + Σ c_j

    solved by dtbtrs, which subtracts the lags in the order of the compiled loop, the longest first.

    Parameters
    ----------
    a, b, c, first_lag, lagged, phi, offset, u, y, begin, end, limit
        As for `lpvid._kernels.free_run_io`.

    Returns
    -------
    int
        The first sample at which |y| exceeded `limit` (y is zero from there on), or −1.
    """
    from scipy.linalg import lapack

    na, n = a.shape[0], end - begin
    forced = np.zeros(n)
    with np.errstate(all="ignore"):  # what diverges is judged below
        for j in range(first_lag, b.shape[0]):
            low = begin - offset - (j if lagged else 0)
            for q in range(u.shape[0]):
                forced += (b[j, 0, q] @ phi[:, low: low + n]) * u[q, begin - j: begin - j + n]
        for j in range(c.shape[0]):
            low = begin - offset - j
            forced += c[j, 0] @ phi[:, low: low + n]
        if na:
            band = np.zeros((na + 1, n))
            band[0] = 1.0
            for i in range(na, 0, -1):
                low = begin - offset - (i if lagged else 0)
                back = a[i - 1, 0, 0] @ phi[:, low: low + n]
                head = min(i, n)
                forced[:head] -= back[:head] * y[begin - i: begin - i + head, 0]
                band[i, : n - head] = back[head:]
            found, _ = lapack.dtbtrs(np.asfortranarray(band), forced[:, None], uplo="L", trans="N",  # type: ignore[attr-defined]
                                     diag="U", overwrite_b=1)
            forced = found[:, 0]
        wrong = np.flatnonzero(~(np.abs(forced) < limit))
    y[begin:end, 0] = forced
    if not wrong.size:
        return -1
    y[begin + wrong[0]:] = 0.0
    return begin + int(wrong[0])
