"""Further claims of a matrix function of p: H2 norm, decay rate, region of frozen poles, rms and peak of outputs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lpvid.lmi.certificate import Recheck, diagonal
from lpvid.lmi.driven import Driven
from lpvid.lmi.gain_certificate import pace
from lpvid.lmi.inequality import LyapunovInequality, Pieces, recheck_inequality
from lpvid.lmi.polytope_positivity import recheck_on
from lpvid.lmi.storage import Storage


@dataclass(frozen=True, eq=False)
class H2Bound(LyapunovInequality):
    """−AᵀP − PA − Ṗ − CᵀC ≻ 0 and ν² > tr BᵀPB; in discrete time P − AᵀP⁺A − CᵀC ≻ 0 and ν² > tr(BᵀP⁺B + DᵀD).

    Then E|z|² averages at most ν² while w is white noise of unit intensity, and the energy of the responses to unit
    impulses at all inputs together is at most ν², whenever they strike.

    Parameters
    ----------
    system : Driven
        w → z, D = 0 in continuous time.
    storage : Storage
        xᵀP(p)x.
    level : float
        ν > 0.
    power : int
        Degree in the system's matrices.
    """

    system: Driven
    storage: Storage
    level: float
    power: int = 2

    def matrix(self, pieces: Pieces) -> np.ndarray:
        q, s = pieces, pieces.sign
        ct = q.C.swapaxes(2, 3)
        if self.system.sample_time is not None:
            state = q.P + s * (q.A.swapaxes(2, 3) @ q.later @ q.A) + s * (ct @ q.C)
            spent = q.B.swapaxes(2, 3) @ q.later @ q.B + q.D.swapaxes(2, 3) @ q.D
        else:
            product = q.P @ q.A
            state = s * (product + product.swapaxes(2, 3) + q.later + ct @ q.C)
            spent = q.B.swapaxes(2, 3) @ q.P @ q.B
        trace = np.trace(spent, axis1=2, axis2=3)[..., None, None]
        return diagonal(state, self.level**2 + s * trace)

    def congruence(self, root: np.ndarray) -> np.ndarray:
        return diagonal(root * math.sqrt(pace(self.system, self.storage, root)), np.eye(1) / max(self.level, 1e-300))


@dataclass(frozen=True, eq=False)
class DecayBound(LyapunovInequality):
    """−AᵀP − PA − Ṗ − 2αP ≻ 0, or exp(−2α T_s) P − AᵀP⁺A ≻ 0: √(xᵀPx) decreases at least as exp(−αt).

    Its margin is a pure number; of a stability certificate (`in_seconds`) it is 1/s in continuous time.

    Parameters
    ----------
    system : Driven
        Its A alone counts.
    storage : Storage
        xᵀP(p)x.
    level : float
        α [1/s].
    in_seconds : bool
        Leave the inequality in 1/s, not in the system's own time.
    """

    system: Driven
    storage: Storage
    level: float = 0.0
    in_seconds: bool = False

    @property
    def power(self) -> int:  # type: ignore[override]
        """Degree in the system's matrices."""
        return 1 if self.system.sample_time is None else 2

    def matrix(self, pieces: Pieces) -> np.ndarray:
        q, s = pieces, pieces.sign
        if self.system.sample_time is not None:
            rho2 = math.exp(-2 * self.level * self.system.sample_time)
            return rho2 * q.P + s * (q.A.swapaxes(2, 3) @ q.later @ q.A)
        product = q.P @ q.A
        size = abs(self.level) if s > 0 else self.level
        return s * (product + product.swapaxes(2, 3) + q.later + 2 * size * q.P)

    def congruence(self, root: np.ndarray) -> np.ndarray:
        return root if self.in_seconds else root * math.sqrt(pace(self.system, self.storage, root))


@dataclass(frozen=True, eq=False)
class RegionBound(LyapunovInequality):
    """−(L ⊗ P + M ⊗ PA + Mᵀ ⊗ AᵀP) ≻ 0: the poles of A(p), frozen anywhere in the box, keep L + sM + s̄Mᵀ ≺ 0.

    Chilali & Gahinet, IEEE Trans. Automatic Control 41 (1996) 358-367, (2) and theorem 2.2. P(p) need not move.

    Parameters
    ----------
    system : Driven
        Its A alone counts.
    storage : Storage
        xᵀP(p)x.
    fixed, varying : (m, m) array
        L, symmetric, and M.
    power : int
        Degree in the system's matrices.
    """

    system: Driven
    storage: Storage
    fixed: np.ndarray
    varying: np.ndarray
    power: int = 1

    def matrix(self, pieces: Pieces) -> np.ndarray:
        q, s = pieces, pieces.sign
        fixed, varying = (np.abs(x) if s > 0 else x for x in (self.fixed, self.varying))
        product = q.P @ q.A + 0.0 * q.later
        still = np.broadcast_to(q.P, product.shape)
        n, k = product.shape[-1], len(fixed)
        total = (np.einsum("ij,ntab->ntiajb", fixed, still) + np.einsum("ij,ntab->ntiajb", varying, product)
                 + np.einsum("ji,ntba->ntiajb", varying, product))
        return s * total.reshape(*product.shape[:2], k * n, k * n)

    def congruence(self, root: np.ndarray) -> np.ndarray:
        return np.kron(np.eye(len(self.fixed)), root * math.sqrt(pace(self.system, self.storage, root)))


@dataclass(frozen=True, eq=False)
class CovarianceBound(LyapunovInequality):
    """Q̇ − AQ − QAᵀ − BBᵀ ≻ 0, in discrete time Q⁺ − AQAᵀ − BBᵀ ≻ 0, and ν² > tr(CQCᵀ + DDᵀ) or ν²I ≻ CQCᵀ + DDᵀ.

    Q(p) is then above the covariance of the states from rest under white noise of unit intensity, so that E|z|² ≤ ν² at
    every instant; and xᵀQ⁻¹x is at most the energy of any w so far, so that |z|² ≤ ν²‖w‖² where the second holds
    (Boyd, El Ghaoui, Feron & Balakrishnan 1994, sections 6.2.1 and 10.1). In continuous time D must be zero.

    Parameters
    ----------
    system : Driven
    storage : Storage
        Q(p).
    level : float
        ν.
    peak : bool
        The second of the two conditions on ν.
    """

    system: Driven
    storage: Storage
    level: float
    peak: bool
    power: int = 2

    def matrix(self, pieces: Pieces) -> np.ndarray:
        q, s = pieces, pieces.sign
        noise, at = q.B @ q.B.swapaxes(2, 3), q.A.swapaxes(2, 3)
        if self.system.sample_time is not None:
            state = q.later + s * (q.A @ q.P @ at + noise)
        else:
            product = q.A @ q.P
            state = q.later + s * (product + product.swapaxes(2, 3) + noise)
        seen = q.C @ q.P @ q.C.swapaxes(2, 3) + q.D @ q.D.swapaxes(2, 3)
        if not self.peak:
            seen = np.trace(seen, axis1=2, axis2=3)[..., None, None]
        return diagonal(state, self.level**2 * np.eye(seen.shape[-1]) + s * seen)

    def congruence(self, root: np.ndarray) -> np.ndarray:
        n, m = len(root), self.system.coefficients.shape[1] - len(root) if self.peak else 1
        if self.system.sample_time is None and n:
            a = self.system.matrices(self.storage.box.centre[None, :])[0][0]
            size = float(np.linalg.norm(root @ a @ np.linalg.inv(root), 2))
            root = root / np.sqrt(size if 0 < size < np.inf else 1.0)
        return diagonal(root, np.eye(m) / max(self.level, 1e-300))


def recheck_decrease(system: Driven, storage: Storage, exponent: float = 0.0, *, budget: int | None = None) -> Recheck:
    """Check P(p) ≻ 0 and the decrease of V = xᵀP(p)x at least as exp(−2αt), between grid points if the budget allows.

    Parameters
    ----------
    system : Driven
    storage : Storage
    exponent : float
        α ≥ 0 [1/s].
    budget : int, optional
        Matrices that subdivision may examine; left out, about a second's worth.

    Returns
    -------
    Recheck
        Its margin in 1/s in continuous time.
    """
    if system.order == 0:
        return Recheck(True, True, 1.0, "the model has no memory")
    return recheck_inequality(DecayBound(system, storage, exponent, in_seconds=True), budget=budget)


def recheck_decrease_at(system: Driven, storage: Storage, vertices: np.ndarray, exponent: float = 0.0, *,
                        budget: int | None = None) -> Recheck:
    """As `recheck_decrease` on the polytope of some vertices, for one P and a system affine in its readings, or for a P
    that moves.

    Parameters
    ----------
    system : Driven
    storage : Storage
    vertices : (V, readings) array
    exponent : float
        α ≥ 0 [1/s].
    budget : int, optional
        Matrices that subdivision may examine.

    Returns
    -------
    Recheck
        Its margin, that of the worst vertex, in 1/s in continuous time.
    """
    if system.order == 0:
        return Recheck(True, True, 1.0, "the model has no memory")
    return recheck_on(DecayBound(system, storage, exponent, in_seconds=True), vertices, budget=budget)
