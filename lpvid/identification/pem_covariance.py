"""Covariance of prediction-error estimates: Gauss-Newton, and sandwiches where the residual is coloured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lpvid.identification.covariance import bartlett, block_length, blocks, pseudo_inverse, residual_memory
from lpvid.identification.levenberg_marquardt import LeastSquaresEnd, reduce
from lpvid.identification.pem_problem import Point, PredictionErrorProblem, PredictionErrors
from lpvid.identification.pem_starts import autoregression
from lpvid.validation.residuals import residual_tests

LONGEST_COLOUR = 40
"""highest order of the autoregression that describes a coloured residual."""
STEP = 1e-4
"""central difference of a noise model's coefficient: monic polynomials with roots inside have coefficients near one."""


def covariance(problem: PredictionErrorProblem, search: LeastSquaresEnd, *, coloured: bool) -> tuple[np.ndarray, str]:
    """Covariance of the shared parameters, the records' pasts estimated along, and what kind it is.

    White innovations: σ² (JᵀJ)⁻¹ (Ljung 1999 (9.54)). Innovations that the noise model leaves coloured: H⁻¹ S H⁻¹
    (`_of_scores`). Coloured output errors v: the sandwich
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
        Whether the errors are output errors, which have no noise model; otherwise they are innovations.

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
        series = [e[problem.head:, o] for e in search.trial.residuals.errors for o in range(problem.n_outputs)]
        if all(t.passed for t in residual_tests(series, [None] * len(series)) if t.name == "whiteness"):
            return _sandwich(problem, *ends, root, np.ones(1), spread), "Gauss-Newton, white innovations"
        memory = residual_memory(series)
        return (_of_scores(problem, *ends, root, memory) * (problem.counted / degrees),
                f"sandwich over the scores, innovations correlated over {memory} samples")
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


def _of_scores(problem: PredictionErrorProblem, point: Point, residuals: PredictionErrors,
               factors: Sequence[np.ndarray], root: np.ndarray, memory: int) -> np.ndarray:
    """H⁻¹ S H⁻¹ for innovations e that too low an order leaves coloured (White 1982; Ljung 1999, theorem 9.1).

    S is the long-run covariance of the scores J(t) e(t), from sums over blocks of three times the `memory` of e, or of
    data too short for these with Bartlett weights: J holds past outputs and innovations, so that it is not independent
    of e and no filter of J serves as in `_sandwich`. For the same reason the Hessian keeps the second derivatives of e,
    H = JᵀJ + Σ e ∂²e/∂θ², which are of zero mean for white e alone (`_curvature`).
    """
    middle = _long_run(_scores(problem, point, residuals, factors, root), memory, root.shape[1])
    curved = np.eye(root.shape[1]) + root.T @ _curvature(problem, point, residuals) @ root
    if np.linalg.eigvalsh(curved)[0] <= 0.0:  # a search that ended beside its minimum: JᵀJ as in Gauss-Newton
        return root @ middle @ root.T
    inverse = root @ np.linalg.inv(curved)
    return inverse @ middle @ inverse.T


def _long_run(scores: list[np.ndarray], memory: int, parameters: int) -> np.ndarray:
    length = block_length(memory, sum(len(s) for s in scores), parameters)
    return bartlett(scores, 3 * memory) if length is None else blocks(scores, length)


def _scores(problem: PredictionErrorProblem, point: Point, residuals: PredictionErrors, factors: Sequence[np.ndarray],
            root: np.ndarray) -> list[np.ndarray]:
    """(n, m) J(t) e(t) of every record in the coordinates of R⁺ = `root`, J orthogonal to the record's past."""
    out: list[list[np.ndarray]] = []

    def consumer(record: int) -> Callable:
        ni, chunks, factor = problem.n_past, [], factors[record]
        out.append(chunks)
        project = np.linalg.lstsq(factor[:ni, :ni], factor[:ni, ni:-1], rcond=1e-12)[0] if ni else None

        def absorb(write: Callable, rows: int) -> None:
            block, score = np.zeros((ni + len(root) + 1, rows)), np.zeros((rows, root.shape[1]))
            for output in range(problem.n_outputs):
                write(block, output)
                clean = block[ni:-1] if project is None else block[ni:-1] - project.T @ block[:ni]
                score += (clean * block[-1]).T @ root
            chunks.append(score)

        return absorb

    problem.sweep(point, residuals, consumer)
    return [np.vstack(chunks) for chunks in out]


def _curvature(problem: PredictionErrorProblem, point: Point, residuals: PredictionErrors) -> np.ndarray:
    """Σ e ∂²e/∂θ² (k, k) in the rows and columns of the noise model, by differences of the gradient; zero elsewhere.

    e of ARMAX is linear in A, B and c for any C; e of Box-Jenkins has second derivatives by A, B and c that depend on
    the inputs alone, of which e is independent. The pasts are held.
    """
    k, q, s = problem.sizes
    out = np.zeros((k + q + s, k + q + s))
    here = _gram(problem, point, residuals)
    for j in range(k, k + q):
        ends = []
        for sign in (1, -1):
            shared = point.shared.copy()
            shared[j] += sign * STEP
            moved = replace(point, shared=shared)
            there = problem.residuals(moved)
            if there is None:
                return np.zeros_like(out)
            ends.append(_gram(problem, moved, there)[:-1, -1])
        out[j] = (ends[0] - ends[1]) / (2 * STEP) - here[j, :-1]
    noise = slice(k, k + q)
    out[noise, noise] = 0.5 * (out[noise, noise] + out[noise, noise].T)
    out[:, noise] = out[noise].T
    return out


def _gram(problem: PredictionErrorProblem, point: Point, residuals: PredictionErrors) -> np.ndarray:
    """[J e]ᵀ[J e] of the shared parameters, all records."""
    ni = problem.n_past
    return np.sum([r[:, ni:].T @ r[:, ni:] for r in problem.factors(point, residuals)], axis=0)


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


