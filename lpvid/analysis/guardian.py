"""Guardian maps: polynomials in the scheduling value that vanish exactly where a pole is on the stability boundary."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.analysis.frozen import (
    FrozenFamily,
    FrozenMatrix,
    Line,
    basis_values,
    breakpoints,
    stability_margin,
)

LARGEST_PENCIL = 700
FARTHEST = 1e6
ON_BOUNDARY = 1e-8
REAL_POLE = 1e-7


def bialternate(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Bialternate product a⊙b of two (n, n) matrices, of size n(n−1)/2.

    (a⊙b)_(ij),(kl) = ½(a_ik b_jl − a_il b_jk + b_ik a_jl − b_il a_jk), i < j, k < l: a⊙a has the eigenvalues
    λ_i λ_j and 2a⊙I the eigenvalues λ_i + λ_j (Fuller 1968).

    Parameters
    ----------
    a, b : (n, n) array
        Factors; the product is symmetric in them.

    Returns
    -------
    (n(n−1)/2, n(n−1)/2) array
        Rows and columns are the pairs i < j, in lexical order.

    Examples
    --------
    >>> bialternate(np.diag([2.0, 3.0, 5.0]), np.diag([2.0, 3.0, 5.0])).diagonal()
    array([ 6., 10., 15.])
    """
    i, j = np.triu_indices(a.shape[0], k=1)
    aik, ajl, ail, ajk = a[np.ix_(i, i)], a[np.ix_(j, j)], a[np.ix_(i, j)], a[np.ix_(j, i)]
    bik, bjl, bil, bjk = b[np.ix_(i, i)], b[np.ix_(j, j)], b[np.ix_(i, j)], b[np.ix_(j, i)]
    return 0.5 * (aik * bjl - ail * bjk + bik * ajl - bil * ajk)


@dataclass(frozen=True, eq=False)
class Piece:
    """One polynomial piece of a frozen family: A(s) = Σ_k matrix[k] t^k, t = (s − centre)/half, for low < s < high.

    Parameters
    ----------
    low, high : float
        Ends, in the unit of the line; may be infinite.
    centre, half : float
        What t is measured by, in the same unit.
    matrix : (degree + 1, N, N) array
        Coefficients of A, in balanced states.
    guardians : dict of str to (·, m, m) array
        Coefficients, in powers of t, of the matrix that is singular at a crossing of that kind.
    always : tuple of str
        Kinds whose matrix is singular at every t.
    """

    low: float
    high: float
    centre: float
    half: float
    matrix: np.ndarray
    guardians: dict[str, np.ndarray]
    always: tuple[str, ...] = ()

    def contains(self, s: float) -> bool:
        """Whether `s` lies in the piece, ends included.

        Parameters
        ----------
        s : float
            In the unit of the line.

        Returns
        -------
        bool
            True also a share 1e-9 of `half` beyond the ends.
        """
        slack = 1e-9 * self.half
        return self.low - slack <= s <= self.high + slack


def pieces(models: FrozenFamily, names: tuple[str, ...], line: Line) -> list[Piece] | None:
    """The polynomial pieces along a line with their guardian maps, or None if the basis is not piecewise polynomial.

    Parameters
    ----------
    models : FrozenFamily
        Matrices whose eigenvalues are the poles, by held scheduling.
    names : tuple of str
        All scheduling variables, in the order of the line's points.
    line : Line
        Along which s runs.

    Returns
    -------
    list of Piece or None
        From −∞ to ∞ without gaps.
    """
    moving = [n for n, d in zip(names, line.direction, strict=True) if d]
    degree = models.basis.piece_degree(moving)
    if degree is None:
        return None
    knots = breakpoints(models.basis, names, line)
    if knots.size == 0:
        return [_piece(models, line, degree, (-np.inf, np.inf), (line.centre, line.half_width))]
    edges = np.concatenate([[-np.inf], knots, [np.inf]])
    middle = float(np.median(np.diff(knots))) / 2 if knots.size > 1 else line.half_width
    listed = []
    for low, high in itertools.pairwise(edges):
        half = middle if np.isinf(low) or np.isinf(high) else 0.5 * (high - low)
        centre = high - half if np.isinf(low) else low + half
        listed.append(_piece(models, line, degree, (float(low), float(high)), (float(centre), float(half))))
    return listed


def _piece(
    models: FrozenFamily, line: Line, degree: int, ends: tuple[float, float], frame: tuple[float, float]
) -> Piece:
    centre, half = frame
    t = np.cos(np.pi * (2 * np.arange(degree + 1) + 1) / (2 * (degree + 1)))
    phi = basis_values(models.basis, line.points(centre + half * t))
    invert = np.linalg.inv(np.vander(t, increasing=True))

    def polynomial(entry: FrozenMatrix) -> np.ndarray:
        return _trimmed(np.tensordot(invert, entry.at(phi), axes=1), float(entry.size_at(phi).max(initial=0.0)))

    matrix = _balanced(polynomial(models.matrix))
    guardians = _guardian_polynomials(matrix, models.discrete)
    if models.minus is None:
        guardians["zero"] = polynomial(models.plus)
        sizes = {"zero": models.plus}
    else:
        guardians |= {"+1": polynomial(models.plus), "-1": polynomial(models.minus)}
        sizes = {"+1": models.plus, "-1": models.minus}
    piece = Piece(*ends, centre, half, matrix, guardians)
    scales = {kind: float(entry.size_at(phi).max(initial=1.0)) for kind, entry in sizes.items()}
    return Piece(*ends, centre, half, matrix, guardians, _always_on_boundary(piece, models.discrete, scales))


def _guardian_polynomials(matrix: np.ndarray, discrete: bool) -> dict[str, np.ndarray]:
    """Matrix polynomials that are singular where a *pair* of poles sits on the boundary.

    det(A⊙A − I) = 0 in discrete time, det(2A⊙I) = 0 in continuous time, for A = Σ_k matrix[k] t^k.
    """
    n, degree = matrix.shape[1], matrix.shape[0] - 1
    if n < 2:
        return {}
    eye = np.eye(n)
    if not discrete:
        return {"imaginary": _trimmed(np.array([2 * bialternate(a, eye) for a in matrix]), 0.0)}
    size = n * (n - 1) // 2
    product = np.zeros((2 * degree + 1, size, size))
    for i in range(degree + 1):
        for j in range(degree + 1):
            product[i + j] += bialternate(matrix[i], matrix[j])
    yardstick = float(sum(np.abs(a).sum(axis=1).max() for a in matrix)) ** 2
    product[0] -= np.eye(size)
    return {"complex": _trimmed(product, yardstick)}


def _balanced(matrix: np.ndarray) -> np.ndarray:
    """The same family in state coordinates of comparable size."""
    from scipy.linalg import matrix_balance

    if matrix.shape[1] < 2:
        return matrix
    _, (scale, _) = matrix_balance(np.abs(matrix).sum(axis=0), permute=False, separate=True)
    return matrix / scale[None, :, None] * scale[None, None, :]


def _trimmed(coefficients: np.ndarray, yardstick: float) -> np.ndarray:
    """Drop rounding noise and vanishing leading coefficients of a matrix polynomial (degree, m, m)."""
    noise = 16 * np.finfo(float).eps * max(yardstick, float(np.abs(coefficients).max(initial=0.0)))
    cleaned = np.where(np.abs(coefficients) <= noise, 0.0, coefficients)
    cleaned[0] = coefficients[0]
    top = int(np.max(np.nonzero(cleaned.any(axis=(1, 2)))[0], initial=0))
    return cleaned[: top + 1]


def _polynomial_value(coefficients: np.ndarray, t: float) -> np.ndarray:
    """Σ_k coefficients[k] t^k by Horner's rule."""
    value = coefficients[-1]
    for c in coefficients[-2::-1]:
        value = value * t + c
    return value


def _terms(coefficients: np.ndarray, t: float) -> float:
    sizes = np.abs(coefficients).sum(axis=2).max(axis=1)
    return float(sizes @ np.abs(t) ** np.arange(sizes.size))


def polynomial_eigenvalues(coefficients: np.ndarray) -> np.ndarray:
    """Finite t at which Σ_k coefficients[k] t^k, of shape (degree+1, m, m), is singular.

    Companion linearisation and the QZ algorithm, after scaling t so that the first and the last coefficient are equally
    large; eigenvalues at infinity (a singular last coefficient) are left out.

    Parameters
    ----------
    coefficients : (degree + 1, m, m) array
        From the constant upwards.

    Returns
    -------
    (·,) complex array
        Empty for a constant, and for m = 0.

    Examples
    --------
    >>> polynomial_eigenvalues(np.array([[[-6.0]], [[1.0]], [[1.0]]])).real
    array([-3.,  2.])
    """
    from scipy.linalg import eig

    degree, m = coefficients.shape[0] - 1, coefficients.shape[1]
    if degree < 1 or m == 0:
        return np.empty(0, dtype=complex)
    if m == 1:
        return np.roots(coefficients[::-1, 0, 0]).astype(complex)
    first, last = (np.linalg.norm(coefficients[k]) for k in (0, -1))
    scale = (first / last) ** (1.0 / degree) if first > 0 else 1.0
    scaled = coefficients * scale ** np.arange(degree + 1)[:, None, None]
    scaled = scaled / max(np.linalg.norm(c, 2) for c in scaled)
    left, right = np.eye(degree * m, k=m), np.eye(degree * m)
    left[-m:] = -np.hstack(list(scaled[:-1]))
    right[-m:, -m:] = scaled[-1]
    pairs: Any = eig(left, right, right=False, homogeneous_eigvals=True)
    alpha, beta = pairs
    finite = np.abs(beta) > np.abs(alpha) * max(1.0, scale) / (FARTHEST * 1e3)
    return alpha[finite] / beta[finite] * scale


def candidates(piece: Piece) -> list[tuple[str, float]] | None:
    """Where a guardian map of the piece vanishes, as (kind, t); None if its eigenvalue problem is too large.

    Parameters
    ----------
    piece : Piece
        With its guardian maps.

    Returns
    -------
    list of (str, float) or None
        Inside the piece, or a thousandth of `half` beyond its ends; kinds that are always singular are left out.
    """
    found: list[tuple[str, float]] = []
    for kind, coefficients in piece.guardians.items():
        if kind in piece.always:
            continue
        if (coefficients.shape[0] - 1) * coefficients.shape[1] > LARGEST_PENCIL:
            return None
        t = polynomial_eigenvalues(coefficients)
        real = np.real(t)
        near = (np.abs(np.imag(t)) <= 1e-3 * (1 + np.abs(real))) & (np.abs(t) < FARTHEST)
        s = piece.centre + piece.half * real
        slack = 1e-3 * piece.half
        inside = (s >= piece.low - slack) & (s <= piece.high + slack)
        found += [(kind, float(x)) for x in np.unique(real[near & inside])]
    return found


def polish(piece: Piece, kind: str, t: float, discrete: bool) -> tuple[float, complex, float] | None:
    """Newton steps on the pole's distance to the boundary: (t, pole, residual), or None for a spurious candidate.

    Spurious are real reciprocal pairs λ, 1/λ (continuous: ±λ), on which a⊙a − I vanishes too.

    Parameters
    ----------
    piece : Piece
        Where the candidate lies.
    kind : str
        Of the crossing.
    t : float
        Where the guardian map vanishes.
    discrete : bool
        Discrete time.

    Returns
    -------
    (float, complex, float) or None
        None where the pole is further from the boundary than `ON_BOUNDARY`.
    """
    start, best = t, None
    for _ in range(14):
        pole, slope, scale = _nearest_pole(piece.matrix, t, kind, discrete)
        if pole is None:
            break
        margin = float(stability_margin(np.array(pole), discrete))
        residual = abs(margin) / scale
        if best is None or residual < best[2]:
            best = (t, pole, residual)
        speed = (slope * np.conj(pole)).real / abs(pole) if discrete else slope.real
        if residual < 4e-16 or not np.isfinite(speed) or speed == 0:
            break
        t = t - margin / speed
        if abs(t - start) > 2e-3 * (1 + abs(start)):
            break
    return best if best is not None and best[2] <= ON_BOUNDARY else None


def _nearest_pole(matrix: np.ndarray, t: float, kind: str, discrete: bool) -> tuple[complex | None, complex, float]:
    """The pole of the candidate's kind, its slope dλ/dt = wᴴA'v/wᴴv, and the size that residuals are taken against."""
    from scipy.linalg import eig

    a = _polynomial_value(matrix, t)
    solved: Any = eig(a, left=True, right=True)
    values, left, right = solved
    scale = 1.0 if discrete else max(float(np.abs(values).max()), 1e-3 * _terms(matrix, t), 1e-300)
    if kind in ("complex", "imaginary"):
        distance = np.where(values.imag > REAL_POLE * scale, np.abs(stability_margin(values, discrete)), np.inf)
    else:
        distance = np.abs(values - {"+1": 1.0, "-1": -1.0, "zero": 0.0}[kind])
        distance = np.where(np.abs(values.imag) <= 1e3 * REAL_POLE * scale, distance, np.inf)
    i = int(np.argmin(distance))
    if not np.isfinite(distance[i]):
        return None, 0.0, scale
    if matrix.shape[0] == 1:
        return complex(values[i]), 0.0, scale
    slope_matrix = _polynomial_value(matrix[1:] * np.arange(1, matrix.shape[0])[:, None, None], t)
    w, v = left[:, i].conj(), right[:, i]
    weight = w @ v
    slope = complex(w @ slope_matrix @ v / weight) if abs(weight) > 1e-14 else complex(np.nan)
    return complex(values[i]), slope, scale


def _always_on_boundary(piece: Piece, discrete: bool, scales: dict[str, float]) -> tuple[str, ...]:
    """Kinds whose guardian map vanishes at every value: a pole that never leaves the boundary."""
    kinds = []
    at = (-0.7310585, 0.1192029, 0.6224593)
    norm = max(float(np.abs(_polynomial_value(piece.matrix, t)).sum(axis=1).max(initial=0.0)) for t in at)
    for kind, coefficients in piece.guardians.items():
        scale = scales.get(kind, 1.0 + norm**2 if discrete else norm)
        singular = all(_singular(_polynomial_value(coefficients, t), scale) for t in at)
        if singular and all(_pole_there(piece, kind, t, discrete) for t in at):
            kinds.append(kind)
    return tuple(kinds)


def _singular(value: np.ndarray, scale: float) -> bool:
    smallest = np.linalg.svd(value, compute_uv=False)[-1] if value.size else np.inf
    return bool(smallest <= 200 * np.finfo(float).eps * scale)


def _pole_there(piece: Piece, kind: str, t: float, discrete: bool) -> bool:
    pole, _, scale = _nearest_pole(piece.matrix, t, kind, discrete)
    return pole is not None and abs(float(stability_margin(np.array(pole), discrete))) <= 1e-4 * scale
