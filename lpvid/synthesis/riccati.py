"""The Riccati equations of H-infinity control at one value of the scheduling: a start, and a judge of the possible.

Glover & Doyle, Systems & Control Letters 11 (1988) 167-172. With D1 = [D11 D12], B = [B1 B2] and
R = D1ᵀD1 − diag(γ²I, 0), the stabilising X∞ of

    AᵀX + XA + C1ᵀC1 − (XB + C1ᵀD1) R⁻¹ (XB + C1ᵀD1)ᵀ = 0

and Y∞ of the dual plant decide: γ can be had if and only if both exist, are ⪰ 0, and ρ(X∞Y∞) < γ². They are found from
the ordered Schur form of the extended pencil (Van Dooren 1981; scipy), which inverts no R. The matrices of the
inequalities (`lpvid.synthesis.projection`) are X = γX∞⁻¹ and Y = γY∞⁻¹, made strict by a small further disturbance
into, and a small weight on, every state.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_continuous_are

from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.regularised_plants import regular

SETTLED = 1e-6
"""relative width of the interval that holds the least bound at which the bisection ends"""
HIGHEST = 1e12
"""multiple of the plant's size above which no bound is looked for: γ² then exceeds what double precision adds to one"""
STRICT = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
"""Disturbance into, and weight on, every state of balanced size, the largest first: shares of the plant's own."""
ACCURATE = 1e-6
"""Residual, as a share of the equation's terms, that counts as rounding: a Schur form of a pencil with eigenvalues six
decades apart leaves that much. Eigenvalues on the axis are split by the square root of rounding, above its square."""
FREE, GENTLE = 1e-5, 1e-2
"""Effort and noise, in balanced units, in directions where a plant has none, as R is singular without: to judge what is
possible, and for a start, where moderate matrices count for more."""
ROOM = 2.0
"""times the least bound at which a pair is a start: at the least itself it grows without bound"""


@dataclass(frozen=True, eq=False)
class Central:
    """X and Y of the inequalities, (n, n), and the bound that they keep at one value of the scheduling.

    Parameters
    ----------
    x, y : (n, n) array
        X and Y.
    gamma : float
        Bound of the gain w → z.
    """

    x: np.ndarray
    y: np.ndarray
    gamma: float


def least_gain(plant: PlantMatrices, k: int = 0, free: float = FREE) -> float:
    """The least H-infinity norm at point k, to `SETTLED`; infinite where the equations have no solution at any bound.

    Controls that are free and exact measurements get effort and noise of size `FREE`: the figure is then from above.

    Parameters
    ----------
    plant : PlantMatrices
        Continuous, at N points.
    k : int
        Which of them.
    free : float
        Effort and noise where the plant has none, in balanced units.

    Returns
    -------
    float
        Of all controllers at frozen scheduling.

    Examples
    --------
    >>> one = np.ones((1, 1, 1))
    >>> z, zero = np.array([[[1.0], [0.0]]]), np.zeros((1, 2, 2))
    >>> plant = PlantMatrices(-one, np.array([[[1.0, 0.0]]]), one, z, zero, z[:, ::-1], one, np.array([[[0.0, 1.0]]]),
    ...                       0 * one)
    >>> round(least_gain(plant), 4)
    0.7321
    """
    point = _point(plant, k, free)
    low, high = _parrott(point), 0.0
    step = max(low, _size(point))
    while high == 0.0:
        if step > HIGHEST * max(_size(point), 1e-300):
            return np.inf
        if admitted(point, step):
            high = step
        else:
            low, step = step, 4 * step
    if low < 1e-3 * high:  # from above: the least may be orders of magnitude below the plant's own size
        while high > 1e-14 * step and admitted(point, 0.25 * high) and 0.25 * high > low:
            high *= 0.25
        low = max(low, 0.25 * high)
    while high > low * (1 + SETTLED):
        middle = float(np.sqrt(low * high)) if low > 0 else 0.5 * high
        if admitted(point, middle):
            high = middle
        else:
            low = middle
    return high


def admits(plant: PlantMatrices, gamma: float, k: int = 0) -> bool:
    """A bound can be had at point k.

    Parameters
    ----------
    plant : PlantMatrices
        Continuous, at N points.
    gamma : float
        Bound of the gain.
    k : int
        Which of the points.

    Returns
    -------
    bool
        With effort and noise of size `FREE` where the plant has none.
    """
    return admitted(_point(plant, k, FREE), gamma)


def admitted(point: PlantMatrices, gamma: float) -> bool:
    """Both equations have a solution ⪰ 0, and they fit together.

    Parameters
    ----------
    point : PlantMatrices
        One point (first axes of length 1), with effort of every control and noise in every measurement.
    gamma : float
        Bound of the gain.

    Returns
    -------
    bool
        Also false where rounding keeps the equations from being solved.
    """
    return _solutions(point, gamma) is not None


def central(plant: PlantMatrices, gamma: float, k: int = 0, free: float = FREE) -> Central | None:
    """A pair that keeps a bound at point k with as much room as there is; None where the equations have none.

    Parameters
    ----------
    plant : PlantMatrices
        Continuous, at N points.
    gamma : float
        Bound of the gain.
    k : int
        Which of the points.
    free : float
        Effort and noise where the plant has none, in balanced units.

    Returns
    -------
    Central or None
        For the largest share of `STRICT` at which there is one.
    """
    point = _point(plant, k, free)
    for share in STRICT:
        found = _solutions(_strict(point, share), gamma)
        if found is None:
            continue
        x, y = found
        try:
            return Central(gamma * _inverse(x), gamma * _inverse(y), gamma)
        except np.linalg.LinAlgError:
            continue
    return None


def start(plant: PlantMatrices) -> Central | None:
    """A pair of the middle one of a plant's points at `ROOM` times its least bound.

    Parameters
    ----------
    plant : PlantMatrices
        Continuous, at N points.

    Returns
    -------
    Central or None
        None where that point has no least bound, or the bound zero.
    """
    middle = len(plant.A) // 2
    least = least_gain(plant, middle, GENTLE)
    return central(plant, ROOM * least, middle, GENTLE) if np.isfinite(least) and least > 0 else None


def _solutions(point: PlantMatrices, gamma: float) -> tuple[np.ndarray, np.ndarray] | None:
    p = point.point(0)
    x = _equation(p.A, p.B1, p.B2, p.C1, p.D11, p.D12, gamma)
    y = None if x is None else _equation(p.A.T, p.C1.T, p.C2.T, p.B1.T, p.D11.T, p.D21.T, gamma)
    if x is None or y is None or np.abs(np.linalg.eigvals(x @ y)).max(initial=0.0) >= gamma * gamma:
        return None
    return x, y


def _equation(a: np.ndarray, b1: np.ndarray, b2: np.ndarray, c1: np.ndarray, d11: np.ndarray, d12: np.ndarray,
              gamma: float) -> np.ndarray | None:
    """The stabilising solution ⪰ 0, in units of γ so that the plant's gain is of order one; None where there is none.
    """
    if not len(a):
        return np.zeros((0, 0))
    nw, b, d = b1.shape[1], np.hstack([b1, b2]), np.hstack([d11, d12])
    r = d.T @ d
    r[:nw, :nw] -= gamma * gamma * np.eye(nw)
    inertia = np.linalg.eigvalsh(r)
    if int((inertia < 0).sum()) != nw:
        return None
    scale = np.concatenate([np.full(nw, 1 / gamma), np.ones(b2.shape[1])])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            x = solve_continuous_are(a, b * scale, c1.T @ c1, r * np.outer(scale, scale), s=(c1.T @ d) * scale)
    except (np.linalg.LinAlgError, ValueError):
        return None
    x = 0.5 * (x + x.T)
    if not (np.all(np.isfinite(x)) and _stabilising(x, a, b * scale, r * np.outer(scale, scale), (c1.T @ d) * scale,
                                                   c1.T @ c1)):
        return None
    rounding = np.linalg.norm(c1, 2) ** 2 / max(float(np.linalg.norm(a, 2)), 1e-300)  # of a solution that is zero
    values = np.linalg.eigvalsh(x)
    return x if values[0] >= -1e-9 * max(values[-1], rounding) else None


def _stabilising(x: np.ndarray, a: np.ndarray, b: np.ndarray, r: np.ndarray, s: np.ndarray, q: np.ndarray) -> bool:
    """The equation holds to rounding, and A − B R⁻¹(BᵀX + Sᵀ) is stable: with eigenvalues of the pencil on the
    imaginary axis, below the least bound, the half that is taken for stable gives neither."""
    half = x @ b + s
    gain = np.linalg.solve(r, half.T)
    parts = a.T @ x, q, half @ gain
    rest = parts[0] + parts[0].T + parts[1] - parts[2]
    loop = np.linalg.eigvals(a - b @ gain)
    return bool(np.abs(rest).max() <= ACCURATE * max(float(np.abs(m).max()) for m in parts)
                and loop.real.max() < -ACCURATE**2 * np.abs(loop).max())


def _point(plant: PlantMatrices, k: int, free: float) -> PlantMatrices:
    return regular(plant.point(slice(k, k + 1)), free)


def _strict(point: PlantMatrices, share: float) -> PlantMatrices:
    """The plant with a disturbance of its own into every state, and a weight on each."""
    n, nw, nz = point.A.shape[1], point.B1.shape[2], point.C1.shape[1]
    into, out = (share * max(float(np.abs(m).max(initial=0.0)), 1e-8) * np.eye(n)[None] for m in (point.B1, point.C1))
    through = np.zeros((1, nz + n, nw + n))
    through[:, :nz, :nw] = point.D11
    return replace(point, B1=np.concatenate([point.B1, into], axis=2), C1=np.concatenate([point.C1, out], axis=1),
                   D11=through, D12=np.concatenate([point.D12, np.zeros((1, n, point.D12.shape[2]))], axis=1),
                   D21=np.concatenate([point.D21, np.zeros((1, point.D21.shape[1], n))], axis=2))


def _inverse(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(matrix)
    if values[0] <= 1e-14 * values[-1]:
        raise np.linalg.LinAlgError("a solution of the Riccati equations is singular")
    return (vectors / values) @ vectors.T


def _parrott(point: PlantMatrices) -> float:
    """No controller brings the norm of D11 + D12 D_K D21 below this (Parrott's theorem)."""
    p = point.point(0)
    out, into = _blocked(p.D12), _blocked(p.D21.T)
    return max(float(np.linalg.norm(out.T @ p.D11, 2)) if out.size else 0.0,
               float(np.linalg.norm(p.D11 @ into, 2)) if into.size else 0.0)


def _blocked(matrix: np.ndarray) -> np.ndarray:
    """Directions of the rows' space that a matrix does not reach."""
    u, s, _ = np.linalg.svd(matrix)
    return u[:, int((s > 1e-10 * max(s.max(initial=0.0), 1e-300)).sum()):]


def _size(point: PlantMatrices) -> float:
    p = point.point(0)
    return float(np.linalg.norm(p.B1, 2) * np.linalg.norm(p.C1, 2) + np.linalg.norm(p.D11, 2))
