"""Covariance of prediction-error estimates: Gauss-Newton, and the sandwich where the residual is coloured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lpvid.identification.covariance import pseudo_inverse
from lpvid.identification.levenberg_marquardt import LeastSquaresEnd, reduce
from lpvid.identification.pem_problem import Point, PredictionErrorProblem, PredictionErrors
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
    ends = (search.trial.point, search.trial.residuals, search.linearised.factors)
    if not coloured:
        return _sandwich(problem, *ends, root, np.ones(1), spread), "Gauss-Newton, white innovations"
    polynomial, innovation = _coloured(problem, rows, spread, degrees)
    return (_sandwich(problem, *ends, root, polynomial, innovation),
            f"sandwich, output error coloured by an autoregression of order {polynomial.size - 1}")


def free_run_covariance(problem: PredictionErrorProblem, point: Point, residuals: PredictionErrors,
                        root: np.ndarray, record_weights: np.ndarray) -> tuple[np.ndarray, str]:
    """The same sandwich for parameters θ = chain·ξ of a free run from measured samples, with its records weighed.

    Parameters
    ----------
    problem : PredictionErrorProblem
        Without pasts that are estimated along.
    point : Point
        Where a search ended.
    residuals : PredictionErrors
        There.
    root : (k, m) array
        chain·R⁺, with RᵀR the sum of products of the weighted Jacobian by ξ.
    record_weights : (records,) array
        Factors on the errors of each record.

    Returns
    -------
    (k, k) array, str
    """
    rows = [e[problem.head:] * problem.weights * w for e, w in zip(residuals.errors, record_weights, strict=True)]
    degrees = max(problem.counted - root.shape[1], 1)
    spread = sum(e.T @ e for e in rows) * (problem.n_outputs / degrees)
    polynomial, innovation = _coloured(problem, rows, spread, degrees)
    return (_sandwich(problem, point, residuals, [None] * len(rows), root, polynomial, innovation, record_weights),
            f"free run, sandwich, error coloured by an autoregression of order {polynomial.size - 1}")


def _coloured(problem: PredictionErrorProblem, rows: list[np.ndarray], spread: np.ndarray, degrees: int
              ) -> tuple[np.ndarray, np.ndarray]:
    """The autoregression that describes weighted errors, and the covariance of its innovations."""
    series = [e[:, o] / max(np.sqrt(spread[o, o]), 1e-300) for e in rows for o in range(problem.n_outputs)]
    polynomial = _colour(series)
    filtered = [np.apply_along_axis(lambda v: np.convolve(v, polynomial)[: len(v)], 0, e) for e in rows]
    return polynomial, np.sum([e.T @ e for e in filtered], axis=0) * (problem.n_outputs / degrees)


def _colour(series: list[np.ndarray]) -> np.ndarray:
    """Autoregression of the order that Akaike's criterion prefers."""
    n = sum(len(v) for v in series)
    most = int(min(LONGEST_COLOUR, max(1, min(len(v) for v in series) // 20)))
    fits = [autoregression(series, order) for order in range(most + 1)]
    aic = [n * np.log(variance) + 2 * order for order, (_, variance) in enumerate(fits)]
    return fits[int(np.argmin(aic))][0]


def _sandwich(problem: PredictionErrorProblem, point: Point, residuals: PredictionErrors,
              factors: Sequence[np.ndarray | None], root: np.ndarray, polynomial: np.ndarray, innovation: np.ndarray,
              record_weights: np.ndarray | None = None) -> np.ndarray:
    """R⁺ (Σ (J^f R⁺)ᵀ Λ J^f R⁺) R⁺ᵀ, with (k, m) R⁺ = `root`, for the part of J orthogonal to the records' pasts."""
    white = polynomial.size == 1
    if white and problem.n_outputs == 1:
        return float(innovation[0, 0]) * (root @ root.T)
    spread = np.linalg.cholesky(innovation + 1e-300 * np.eye(len(innovation)))
    middle = np.zeros((root.shape[1], root.shape[1]))

    def consumer(record: int) -> Callable:
        factor, ni = factors[record], problem.n_past
        scale = 1.0 if record_weights is None else float(record_weights[record])
        project = (None if factor is None or not ni else
                   np.linalg.lstsq(factor[:ni, :ni], factor[:ni, ni:-1], rcond=1e-12)[0])
        past = np.zeros((problem.n_outputs, root.shape[1], max(polynomial.size - 1, 4)))

        def absorb(write: Callable, rows: int) -> None:
            nonlocal middle
            block = np.zeros((ni + len(root) + 1, rows))
            parts = []
            for output in range(problem.n_outputs):
                write(block, output)
                clean = block[ni:-1] if project is None else block[ni:-1] - project.T @ block[:ni]
                parts.append(_filtered(scale * (root.T @ clean), polynomial, past, output))
            stacked = np.einsum("oq,okr->qkr", spread, np.array(parts))
            for part in stacked:
                middle += part @ part.T

        return absorb

    problem.sweep(point, residuals, consumer)
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


