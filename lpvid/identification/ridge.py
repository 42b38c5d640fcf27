"""Ridge on the scheduling dependence, its strength chosen by marginal likelihood from the R factor alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.identification.regression import Factor, RegressionEstimate
from lpvid.scheduling import Basis

PENALTIES = {"size": 0, "variation": 1, "curvature": 2}
"""what is penalised: the coefficients themselves, how they vary with p, how they bend over p."""
STRENGTHS = np.logspace(-10, 4, 71)
"""where the marginal likelihood is searched, in units of the regressors' energy."""


@dataclass(frozen=True)
class Ridge(Encoded):
    r"""Prior on how the coefficients depend on the scheduling variables (empirical Bayes).

    ::

        min ‖y − Xθ‖² + λ Σ_g s_g² θ_gᵀ P θ_g          g: every coefficient a_i, b_j, c_j, with its own energy s_g²

        −2 ln L(λ) = (n − m₀) ln min_θ(…) + ln|XᵀX + λP| − (k − m₀) ln λ       m₀ = dim null P

    θ ~ N(0, σ²(λP)⁻¹), σ² profiled out (restricted likelihood, Harville 1977; Rasmussen & Williams 2006, 5.4.1). P is
    zero on what is left free: with "variation" the constant part of every coefficient, with "curvature" its straight
    part too. For polynomials P weighs each function by its degree (d², or d²(d−1)²), for splines it is that of first
    or second differences (Eilers & Marx 1996), for products the sum over the factors.

    Parameters
    ----------
    penalty : {"variation", "curvature", "size"} or sequence of float
        What is penalised, or a weight for every basis function.
    strength : float, optional
        λ; left out, the marginal likelihood chooses it.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> Ridge().matrix(Polynomial("p", degree=2)).diagonal()
    array([0., 1., 4.])
    """

    penalty: str | tuple[float, ...] = "variation"
    strength: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.penalty, str):
            _checks.one_of(self.penalty, tuple(PENALTIES), "penalty")
        else:
            weights = tuple(_checks.real(w, "a penalty weight") for w in self.penalty)
            if min(weights, default=0.0) < 0 or not any(weights):
                raise InputError("penalty weights must not be negative, and not all zero", got=weights)
            object.__setattr__(self, "penalty", weights)
        if self.strength is not None:
            _checks.positive(self.strength, "the strength of a ridge")

    def matrix(self, basis: Basis) -> np.ndarray:
        """(M, M) penalty P of one coefficient.

        Parameters
        ----------
        basis : Basis
            Of M functions.

        Returns
        -------
        (M, M) array

        Raises
        ------
        InputError
            Given weights are not as many as basis functions.
        """
        if isinstance(self.penalty, str):
            order = PENALTIES[self.penalty]
            return basis.penalty(order) if order else np.eye(basis.size)
        if len(self.penalty) != basis.size:
            raise InputError(f"a ridge needs one weight for each of {basis.size} basis functions",
                             got=f"{len(self.penalty)} weights")
        return np.diag(np.array(self.penalty))

    def solve(self, factor: Factor, places: np.ndarray, basis: Basis) -> tuple[RegressionEstimate, float]:
        """Penalised least squares.

        Parameters
        ----------
        factor : Factor
            R of [X Y].
        places : (columns, 4) int array
            Part, lag index, signal and basis function of every column.
        basis : Basis

        Returns
        -------
        solution : RegressionEstimate
            Its covariance is that of the posterior.
        strength : float
            λ as given or chosen.
        """
        problem = _RidgeProblem.of(factor, places, self.matrix(basis))
        strength = self.strength or problem.choose()
        return problem.solution(strength), float(strength)

    def describe(self) -> str:
        """What was done, in words.

        Returns
        -------
        str
        """
        what = self.penalty if isinstance(self.penalty, str) else "the basis functions by given weights"
        how = "chosen by marginal likelihood" if self.strength is None else "as given"
        return f"ridge on {what}, {how}"


@dataclass(frozen=True, eq=False)
class _RidgeProblem:
    """Scaled least squares with the root of its penalty."""

    r: np.ndarray
    target: np.ndarray
    rest: np.ndarray
    scale: np.ndarray
    root: np.ndarray
    rows: int
    condition: tuple[float, float]

    @classmethod
    def of(cls, factor: Factor, places: np.ndarray, penalty: np.ndarray) -> _RidgeProblem:
        k = factor.columns
        r11 = factor.r[:k, :k]
        norms = np.linalg.norm(r11, axis=0)
        scale, blocks = np.ones(k), np.zeros((k, k))
        for key in np.unique(places[:, :3], axis=0):
            columns = np.flatnonzero(np.all(places[:, :3] == key, axis=1))
            energy = float(np.sqrt(np.mean(norms[columns] ** 2)))
            scale[columns] = energy if energy > 0 else 1.0
            functions = places[columns, 3]
            blocks[np.ix_(columns, columns)] = penalty[np.ix_(functions, functions)]
        values, vectors = np.linalg.eigh(blocks)
        kept = values > 1e-10 * max(float(values[-1]), 1e-300)
        root = (vectors[:, kept] * np.sqrt(values[kept])).T
        unit = np.linalg.svd(r11 / np.where(norms > 0, norms, 1.0), compute_uv=False)
        condition = float(np.linalg.cond(r11)), float(unit[0] / max(unit[-1], 1e-300))
        return cls(r11 / scale, factor.r[:k, k:], factor.r[k:, k:], scale, root, factor.rows, condition)

    def _factor(self, strength: float) -> tuple[np.ndarray, np.ndarray]:
        """R and Qᵀ[target; 0] of the stacked problem."""
        k, rank = self.r.shape[1], len(self.root)
        full = np.vstack([np.hstack([self.r, self.target]),
                          np.hstack([np.sqrt(strength) * self.root, np.zeros((rank, self.target.shape[1]))])])
        stacked = np.asarray(np.linalg.qr(full, mode="r"))
        return stacked[:k, :k], stacked[:, k:]

    def criterion(self, strength: float) -> float:
        """−2 ln L but for a constant."""
        stacked, rotated = self._factor(strength)
        k, outputs, rank = self.r.shape[1], self.target.shape[1], len(self.root)
        cost = np.sum(rotated[k:] ** 2, axis=0) + np.sum(self.rest**2, axis=0)
        diagonal = np.abs(np.diag(stacked))
        if not np.all(diagonal > 1e-14 * diagonal.max()) or not np.all(cost > 0):
            return np.inf
        evidence = 2 * np.sum(np.log(diagonal)) - rank * np.log(strength)
        return float((self.rows - (k - rank)) * np.sum(np.log(cost)) + outputs * evidence)

    def choose(self) -> float:
        """Strength of least −2 ln L: a coarse search, then a parabola through the best three."""
        if not len(self.root):
            return float(STRENGTHS[0])
        values = np.array([self.criterion(s) for s in STRENGTHS])
        best = int(np.argmin(values))
        if not np.isfinite(values[best]):
            raise InputError("these data cannot separate the unpenalised parameters",
                             mend='lower the orders, or use the penalty "size"')
        if not 0 < best < len(STRENGTHS) - 1 or not np.all(np.isfinite(values[best - 1: best + 2])):
            return float(STRENGTHS[best])
        left, mid, right = values[best - 1: best + 2]
        bend = left - 2 * mid + right
        shift = 0.5 * (left - right) / bend if bend > 0 else 0.0
        return float(STRENGTHS[best] * (STRENGTHS[1] / STRENGTHS[0]) ** shift)

    def solution(self, strength: float) -> RegressionEstimate:
        from scipy.linalg import solve_triangular

        k = self.r.shape[1]
        stacked, rotated = self._factor(strength)
        theta = solve_triangular(stacked, rotated[:k])
        inverse = solve_triangular(stacked, np.eye(k))
        residual = np.vstack([self.target - self.r @ theta, self.rest])
        effective = float(np.sum((self.r @ inverse) ** 2))
        noise = residual.T @ residual / max(self.rows - effective, 1.0)
        gram = inverse @ inverse.T / np.outer(self.scale, self.scale)
        return RegressionEstimate(theta / self.scale[:, None], np.kron(noise, gram), noise, *self.condition)
