"""Covariance of prediction-error estimates: Gauss-Newton, and the sandwich where the residual is coloured."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lpvid.identification.covariance import pseudo_inverse
from lpvid.identification.levenberg_marquardt import LeastSquaresEnd, reduce
from lpvid.identification.pem_problem import PredictionErrorProblem
from lpvid.identification.pem_starts import autoregression

LONGEST_COLOUR = 40
"""highest order of the autoregression that describes a coloured residual."""


def covariance(problem: PredictionErrorProblem, search: LeastSquaresEnd, *, coloured: bool) -> tuple[np.ndarray, str]:
    """Covariance of the shared parameters, the records' pasts estimated along, and what kind it is.

    White innovations: σ² (JᵀJ)⁻¹ (Ljung 1999 (9.54)). Coloured output errors v: the sandwich
    (JᵀJ)⁻¹ Jᵀ V J (JᵀJ)⁻¹ (Ljung 1999 (9.56) for fixed inputs), where Jᵀ V J = Σ_kl J_k r_v(k−l) J_lᵀ is formed as
    Λ Σ_k J^f_k J^f_kᵀ with J^f = J filtered by the autoregression that describes v (its order by AIC, one filter for
    all outputs). J is independent of v, so this needs no choice of a window. The products are formed of J R⁺, where
    JᵀJ = RᵀR: sums of squares of J itself would lose what J resolves beyond a condition number of 1e8, and H⁻¹ on
    either side would make negative variances of their rounding.

    Parameters
    ----------
    problem : PredictionErrorProblem
        That of the search.
    search : LeastSquaresEnd
        Its end.
    coloured : bool
        Whether the errors may be coloured, as output errors are.

    Returns
    -------
    (k, k) array, str
    """
    shared, _ = reduce(problem, search.linearised.factors)
    k = shared.shape[1] - 1
    root = pseudo_inverse(np.asarray(np.linalg.qr(shared[:, :k], mode="r")))
    degrees = max(problem.counted - k - problem.n_past * len(search.linearised.factors), 1)
    rows = [e[problem.head:] * problem.weights for e in search.trial.residuals.errors]
    spread = sum(e.T @ e for e in rows) * (problem.n_outputs / degrees)
    if not coloured:
        return _sandwich(problem, search, root, np.ones(1), spread), "Gauss-Newton, white innovations"
    series = [e[:, o] / max(np.sqrt(spread[o, o]), 1e-300) for e in rows for o in range(problem.n_outputs)]
    polynomial = _colour(series)
    filtered = [np.apply_along_axis(lambda v: np.convolve(v, polynomial)[: len(v)], 0, e) for e in rows]
    innovation = sum(e.T @ e for e in filtered) * (problem.n_outputs / degrees)
    order = polynomial.size - 1
    return (_sandwich(problem, search, root, polynomial, innovation),
            f"sandwich, output error coloured by an autoregression of order {order}")


def _colour(series: list[np.ndarray]) -> np.ndarray:
    """Autoregression of the order that Akaike's criterion prefers."""
    n = sum(len(v) for v in series)
    most = int(min(LONGEST_COLOUR, max(1, min(len(v) for v in series) // 20)))
    fits = [autoregression(series, order) for order in range(most + 1)]
    aic = [n * np.log(variance) + 2 * order for order, (_, variance) in enumerate(fits)]
    return fits[int(np.argmin(aic))][0]


def _sandwich(problem: PredictionErrorProblem, search: LeastSquaresEnd, root: np.ndarray, polynomial: np.ndarray,
              innovation: np.ndarray) -> np.ndarray:
    """R⁺ (Σ (J^f R⁺)ᵀ Λ J^f R⁺) R⁺ᵀ, with (k, k) R⁺ = `root`, for the part of J orthogonal to the records' pasts."""
    white = polynomial.size == 1
    if white and problem.n_outputs == 1:
        return float(innovation[0, 0]) * (root @ root.T)
    spread = np.linalg.cholesky(innovation + 1e-300 * np.eye(len(innovation)))
    middle = np.zeros_like(root)
    factors = iter(search.linearised.factors)

    def consumer(_: int) -> Callable:
        factor = next(factors)
        ni = problem.n_past
        project = np.linalg.lstsq(factor[:ni, :ni], factor[:ni, ni:-1], rcond=1e-12)[0] if ni else None
        past = np.zeros((problem.n_outputs, len(root), max(polynomial.size - 1, 4)))

        def absorb(write: Callable, rows: int) -> None:
            nonlocal middle
            block = np.zeros((ni + len(root) + 1, rows))
            parts = []
            for output in range(problem.n_outputs):
                write(block, output)
                clean = block[ni:-1] if project is None else block[ni:-1] - project.T @ block[:ni]
                parts.append(_filtered(root.T @ clean, polynomial, past, output))
            stacked = np.einsum("oq,okr->qkr", spread, np.array(parts))
            for part in stacked:
                middle += part @ part.T

        return absorb

    problem.sweep(search.trial.point, search.trial.residuals, consumer)
    return root @ middle @ root.T


def _filtered(rows: np.ndarray, polynomial: np.ndarray, past: np.ndarray, output: int) -> np.ndarray:
    """Rows filtered by one over the polynomial, behind the past of earlier chunks."""
    from lpvid import _sensitivity

    history, n = past.shape[2], rows.shape[1]
    z = np.concatenate([past[output], rows], axis=1)
    if polynomial.size > 1:
        _sensitivity.recur(np.repeat(polynomial[1:, None], n, axis=1), z, history, n)
    past[output] = z[:, n: n + history]
    return z[:, history:]


