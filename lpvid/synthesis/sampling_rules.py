"""Rules that turn ẋ = A x + B u into x⁺ = A_d x + B_d u with u and p held over the sample, and back."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.lft import held
from lpvid.model.state_space import Matrices
from lpvid.synthesis.matrix_function import MatrixFunction

Moving = tuple[MatrixFunction, MatrixFunction, MatrixFunction, MatrixFunction]
"""A, B, C, D over a basis."""


class SamplingRule(ABC):
    """One way to sample a system."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Its name in words."""

    @property
    @abstractmethod
    def accuracy(self) -> int | None:
        """r where the state after one sample is off by O(T^r); None where it is exact for held u and p."""

    @abstractmethod
    def sample(self, system: Matrices, period: float) -> Matrices:
        """Continuous to discrete, at points.

        Parameters
        ----------
        system : tuple of (N, …) arrays
            A, B, C, D at N points, continuous.
        period : float
            T [s].

        Returns
        -------
        tuple of (N, …) arrays
            A, B, C, D, discrete.
        """

    @abstractmethod
    def restore(self, system: Matrices, period: float) -> Matrices:
        """Discrete to continuous, at points.

        Parameters
        ----------
        system : tuple of (N, …) arrays
            A, B, C, D at N points, discrete.
        period : float
            T [s].

        Returns
        -------
        tuple of (N, …) arrays
            A, B, C, D, continuous.
        """

    @abstractmethod
    def sample_exactly(self, system: Moving, period: float) -> Moving | None:
        """Continuous to discrete over the basis, where the rule needs sums and products only.

        Parameters
        ----------
        system : tuple of MatrixFunction
            A, B, C, D, continuous.
        period : float
            T [s].

        Returns
        -------
        tuple of MatrixFunction or None
            A, B, C, D, discrete.
        """

    @abstractmethod
    def restore_exactly(self, system: Moving, period: float) -> Moving | None:
        """Discrete to continuous over the basis, where the rule needs sums and products only.

        Parameters
        ----------
        system : tuple of MatrixFunction
            A, B, C, D, discrete.
        period : float
            T [s].

        Returns
        -------
        tuple of MatrixFunction or None
            A, B, C, D, continuous.
        """


class PointwiseRule(SamplingRule, ABC):
    """A rule that needs inverses or exponentials, which are no finite sums over a basis."""

    def sample_exactly(self, system: Moving, period: float) -> None:
        return None

    def restore_exactly(self, system: Moving, period: float) -> None:
        return None


@dataclass(frozen=True)
class ZeroOrderHold(PointwiseRule):
    """A_d = exp(A T), B_d = ∫₀ᵀ exp(A t) dt B: exact while u and p are held (Tóth, Heuberger & Van den Hof 2010)."""

    label: ClassVar[str] = "zero-order hold"
    accuracy: ClassVar[None] = None

    def sample(self, system: Matrices, period: float) -> Matrices:
        a, b, c, d = system
        return (*held(a, b, period), c, d)

    def restore(self, system: Matrices, period: float) -> Matrices:
        a, b, c, d = system
        if not a.shape[1]:
            return system
        poles, vectors = np.linalg.eig(a.astype(complex))
        stuck = (np.abs(np.imag(poles)) <= 1e-9 * np.abs(poles).max(axis=1, keepdims=True)) & (np.real(poles) <= 1e-12)
        if np.any(stuck):
            worst = poles[np.argmax(stuck.any(axis=1))]
            raise InputError("a discrete pole at or left of 0 has no continuous counterpart",
                             got=f"poles {', '.join(f'{x:.4g}' for x in worst)}", mend="use Tustin()")
        logs = np.log(poles)
        near = np.abs(poles - 1) < 1e-6
        slope = np.where(near, 1 - (poles - 1) / 2, logs / np.where(near, 1.0, poles - 1))  # A T = Ψ (A_d − I)
        inverse = np.linalg.pinv(vectors)
        at, psi = (np.real((vectors * x[:, None, :]) @ inverse) for x in (logs, slope))
        out = at / period, psi @ b / period
        for k in np.flatnonzero(np.linalg.cond(vectors) > 1e7):  # Jordan blocks
            out[0][k], out[1][k] = _logarithm(a[k], b[k], period)
        return (*out, c, d)


def _logarithm(a: np.ndarray, b: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """A and B of one point from the logarithm of [A_d B_d; 0 I]."""
    from scipy.linalg import logm

    n, m = b.shape
    whole = np.real(logm(np.block([[a, b], [np.zeros((m, n)), np.eye(m)]]))) / period
    return whole[:n, :n], whole[:n, n:]


@dataclass(frozen=True)
class Tustin(PointwiseRule):
    """s = (2/T)(z − 1)/(z + 1): keeps stability and the gains at rest; frequencies are bent (ω → (2/T) tan ωT/2).

    A_d = (I − AT/2)⁻¹(I + AT/2), B_d = (I − AT/2)⁻¹ B T, C_d = C (I − AT/2)⁻¹, D_d = D + C B_d/2.
    """

    label: ClassVar[str] = "Tustin"
    accuracy: ClassVar[int] = 3

    def sample(self, system: Matrices, period: float) -> Matrices:
        a, b, c, d = system
        back = np.linalg.inv(np.eye(a.shape[1]) - a * period / 2)
        bd = back @ b * period
        return back @ (np.eye(a.shape[1]) + a * period / 2), bd, c @ back, d + c @ bd / 2

    def restore(self, system: Matrices, period: float) -> Matrices:
        a, b, c, d = system
        if a.shape[1] and np.min(np.abs(np.linalg.eigvals(a) + 1)) < 1e-9:
            raise InputError("a discrete pole at −1 has no continuous counterpart under Tustin's rule",
                             got=f"poles {np.round(np.linalg.eigvals(a).ravel(), 6).tolist()[:8]}")
        forward = 2 * np.linalg.inv(a + np.eye(a.shape[1]))  # I − AT/2
        return (a - np.eye(a.shape[1])) @ forward / period, forward @ b / period, c @ forward, d - c @ forward @ b / 2


@dataclass(frozen=True)
class Taylor(SamplingRule):
    """A_d = Σ_{k ≤ r} (AT)^k/k!, B_d = T Σ_{k < r} (AT)^k/(k+1)! B: exact over the products of the basis.

    Back by the series of the logarithm, Σ (−1)^{k+1} (A_d − I)^k/k, which converges for |A_d − I| < 1.

    Parameters
    ----------
    order : int
        r; 1 is Euler's rule.
    """

    order: int = 3

    def __post_init__(self) -> None:
        _checks.count(self.order, "the order of a Taylor series", at_least=1)

    @property
    def label(self) -> str:
        return "Euler" if self.order == 1 else f"Taylor series of order {self.order}"

    @property
    def accuracy(self) -> int:
        return self.order + 1

    def sample(self, system: Matrices, period: float) -> Matrices:
        a, b, c, d = system
        term = total = np.broadcast_to(np.eye(a.shape[1]), a.shape)
        for k in range(1, self.order):
            term = term @ a * (period / (k + 1))
            total = total + term
        return np.eye(a.shape[1]) + period * total @ a, period * total @ b, c, d

    def restore(self, system: Matrices, period: float) -> Matrices:
        a, b, c, d = system
        gap = a - np.eye(a.shape[1])
        power = total = np.broadcast_to(np.eye(a.shape[1]), a.shape)
        for k in range(1, self.order):
            power = -power @ gap
            total = total + power / (k + 1)
        return total @ gap / period, total @ b / period, c, d

    def sample_exactly(self, system: Moving, period: float) -> Moving:
        a, b, c, d = system
        n = a.shape[0]
        term = total = MatrixFunction.constant(np.eye(n).reshape(n, n))
        for k in range(1, self.order):
            term = (term @ a).times(period / (k + 1))
            total = total + term
        return (total @ a).times(period) + np.eye(n), (total @ b).times(period), c, d

    def restore_exactly(self, system: Moving, period: float) -> Moving:
        a, b, c, d = system
        n = a.shape[0]
        gap = a - np.eye(n)
        power = total = MatrixFunction.constant(np.eye(n).reshape(n, n))
        for k in range(1, self.order):
            power = -(power @ gap)
            total = total + power.times(1 / (k + 1))
        return (total @ gap).times(1 / period), (total @ b).times(1 / period), c, d


def Euler() -> Taylor:
    """A_d = I + A T, B_d = B T: the basis stays as it is; crude, and unstable where |1 + λT| > 1.

    Returns
    -------
    Taylor
        Of order one.
    """
    return Taylor(1)


def remainder(rule: SamplingRule, size: float) -> float | None:
    """Bound on ‖A_d − exp(A T)‖ for ‖A T‖ ≤ `size`, from the series; None where the rule has no such bound.

    Taylor: size^{r+1}/(r+1)! · e^size. Tustin, size < 2: Σ_{k ≥ 3} |1/2^{k−1} − 1/k!| size^k = O(T³).

    Parameters
    ----------
    rule : SamplingRule
        The discretisation.
    size : float
        ‖A T‖, without unit.

    Returns
    -------
    float or None
        0 for the zero-order hold, which is exact.

    Examples
    --------
    >>> round(remainder(Euler(), 0.1), 6)                                  # 0.01/2 · e^0.1
    0.005526
    """
    if isinstance(rule, ZeroOrderHold):
        return 0.0
    if isinstance(rule, Taylor):
        try:
            return size ** (rule.order + 1) / math.factorial(rule.order + 1) * math.exp(size)
        except OverflowError:
            return math.inf
    if isinstance(rule, Tustin) and size < 2:
        return 2 * (size / 2) ** 3 / (1 - size / 2) - (math.exp(size) - 1 - size - size**2 / 2)
    return None
