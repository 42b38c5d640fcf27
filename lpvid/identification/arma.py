"""ARMA noise models of residual series: D(q) v = C(q) e by least squares and Gauss-Newton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.least_squares import Shares, StopRule, Trial, minimise_dense

ITERATIONS = 30
EDGE = 0.999
"""largest modulus that a root of C, and of D, may keep."""


@dataclass(frozen=True, eq=False)
class ARMA:
    """D(q) v(k) = C(q) e(k) with D = 1 + Σ d_i q⁻ⁱ and C = 1 + Σ c_i q⁻ⁱ.

    Attributes
    ----------
    c, d : (nc,) and (nd,) arrays
    """

    c: np.ndarray
    d: np.ndarray

    def whiten(self, series: np.ndarray) -> np.ndarray:
        """(n,) innovations of one series, from a zero past.

        Parameters
        ----------
        series : (n,) array
            v(k).

        Returns
        -------
        (n,) array
            e(k), in the unit of the series.
        """
        return _through(series, self.d, self.c)


def fit_arma(series: Sequence[np.ndarray], nc: int, nd: int, start: ARMA | None = None) -> ARMA:
    """Fit an ARMA model to series of one process.

    Hannan & Rissanen 1982 (a long autoregression, then least squares on its innovations) and Gauss-Newton steps with
    ∂e/∂c_i = −C⁻¹ e(k−i), ∂e/∂d_i = C⁻¹ v(k−i), shortened until the sum of squares falls. Roots of C and D outside the
    unit circle are reflected.

    Parameters
    ----------
    series : sequence of (n,) arrays
    nc, nd : int
        Orders.
    start : ARMA, optional
        Where to start instead.

    Returns
    -------
    ARMA
        Of zero coefficients where both orders are 0 or every series is zero throughout.

    Examples
    --------
    >>> e = np.random.default_rng(0).normal(size=4000)
    >>> fit_arma([_through(e, np.zeros(0), np.array([-0.8]))], 0, 1).d.round(2)
    array([-0.8])
    """
    if nc + nd == 0 or not any(np.any(v) for v in series):
        return ARMA(np.zeros(nc), np.zeros(nd))
    now = start if start is not None else _hannan_rissanen(series, nc, nd)
    stop = StopRule(calm=1, iterations=ITERATIONS if nc else 1, least_decrease=0.0, worth=0.0)
    found = minimise_dense(_Innovations(series, nc), np.concatenate([now.c, now.d]), stop, damping_rule=Shares())
    return now if found is None else ARMA(found.trial.theta[:nc], found.trial.theta[nc:])


@dataclass(frozen=True, eq=False)
class _Innovations:
    """Innovations of all series as residuals of the coefficients (c, d)."""

    series: Sequence[np.ndarray]
    nc: int

    def trial(self, point: np.ndarray) -> Trial | None:
        c, d = point[: self.nc], reflected(point[self.nc:])
        if largest_root(c) >= EDGE:
            return None
        theta = np.concatenate([c, d])
        return Trial(theta, theta, np.concatenate([ARMA(c, d).whiten(v) for v in self.series]))

    def jacobian(self, trial: Trial) -> np.ndarray:
        c, none = trial.theta[: self.nc], np.zeros(0)
        slopes, first = [], 0
        for v in self.series:
            e, first = trial.residual[first: first + len(v)], first + len(v)
            by_c, by_d = -_through(e, none, c), _through(v, none, c)
            slopes.append(np.column_stack([*(_delayed(by_c, i + 1) for i in range(self.nc)),
                                           *(_delayed(by_d, i + 1) for i in range(trial.theta.size - self.nc))]))
        return np.vstack(slopes)


def reflected(tail: np.ndarray, edge: float = EDGE) -> np.ndarray:
    """Coefficients after the leading 1 with the roots outside the circle of radius `edge` reflected into it.

    Parameters
    ----------
    tail : (m,) array
        Coefficients of q⁻¹ … q⁻ᵐ.
    edge : float
        Largest modulus that a root keeps; a root beyond the unit circle is reflected first.

    Returns
    -------
    (m,) array
        `tail` itself where no root lies outside.

    Examples
    --------
    >>> reflected(np.array([-2.0]))
    array([-0.5])
    """
    if not tail.size or largest_root(tail) <= edge:
        return tail
    roots = np.roots(np.concatenate([[1.0], tail]))
    outside = np.abs(roots) > 1
    roots[outside] = 1 / np.conj(roots[outside])
    modulus = np.abs(roots)
    roots = np.where(modulus > edge, roots / np.maximum(modulus, 1e-300) * edge, roots)
    return np.real(np.poly(roots))[1:]


def largest_root(tail: np.ndarray) -> float:
    """Largest modulus among the roots of 1 + Σ tail_i q⁻ⁱ.

    Parameters
    ----------
    tail : (m,) array
        Coefficients of q⁻¹ … q⁻ᵐ.

    Returns
    -------
    float
        0 for an empty tail.
    """
    return float(np.abs(np.roots(np.concatenate([[1.0], tail]))).max(initial=0.0)) if tail.size else 0.0


def _hannan_rissanen(series: Sequence[np.ndarray], nc: int, nd: int) -> ARMA:
    if not nc:
        return ARMA(np.zeros(0), reflected(_regress([(v, v) for v in series], nd, 0)))
    longest = min(max(20, 2 * (nc + nd)), max(1, max(len(v) for v in series) // 10))
    ar = reflected(_regress([(v, v) for v in series], longest, 0))
    both = _regress([(v, _through(v, ar, np.zeros(0))) for v in series], nd, nc)
    return ARMA(reflected(both[nd:], 0.95), reflected(both[:nd]))


def _regress(pairs: Sequence[tuple[np.ndarray, np.ndarray]], nd: int, nc: int) -> np.ndarray:
    """(nd + nc,) least squares of v on −v(k−1) … −v(k−nd), e(k−1) … e(k−nc)."""
    reach = max(nd, nc)
    rows, target = [np.zeros((0, nd + nc))], [np.zeros(0)]
    for v, e in pairs:
        if len(v) > reach:
            rows.append(np.column_stack([*(-v[reach - i: len(v) - i] for i in range(1, nd + 1)),
                                         *(e[reach - i: len(v) - i] for i in range(1, nc + 1))]))
            target.append(v[reach:])
    return np.linalg.lstsq(np.vstack(rows), np.concatenate(target), rcond=1e-10)[0]


def _delayed(series: np.ndarray, lag: int) -> np.ndarray:
    out = np.zeros_like(series)
    out[lag:] = series[: max(len(series) - lag, 0)]
    return out


def _through(series: np.ndarray, numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    from lpvid._filter_kernels import rational_rows

    m = max(numerator.size, denominator.size)
    out = np.array(series, dtype=float)[None, :]
    rational_rows(monic(numerator, m), monic(denominator, m), out, 0, 1, 0, out.shape[1], np.zeros((1, m)))
    return out[0]


def monic(tail: np.ndarray, m: int) -> np.ndarray:
    """(m + 1,) coefficients 1, tail, zeros.

    Parameters
    ----------
    tail : (n,) array
        Coefficients after the leading 1, no more than m.
    m : int
        Degree.

    Returns
    -------
    (m + 1,) array
    """
    out = np.zeros(m + 1)
    out[0], out[1: 1 + tail.size] = 1.0, tail
    return out
